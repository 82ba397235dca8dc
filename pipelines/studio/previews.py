"""Previews: the texture of a small version of the exemplar, with every scale of the optimisation as it comes."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable
from pathlib import Path

from texloom.pipelines.engine.events import Event, StepProgress
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.messages import PreviewPicture, PreviewRequest
from texloom.pipelines.studio.pixels import rgba
from texloom.pipelines.studio.recipes import image_of, open_texture
from texloom.pipelines.studio.reduced import Reducer, exemplar_of, reduced_size, scale_of
from texloom.pipelines.studio.work import Places, library_of
from texloom.stages.arrays import Image

_INTERVAL = 0.06  # seconds between pictures of one preview


class Previewer:
    """Makes previews; its results are in a store of its own, which is removed with the studio."""

    def __init__(self, places: Places):
        scratch = Path(places.scratch)
        self.library = library_of(places)
        self.store = Store(scratch / "store")
        self.reducer = Reducer(scratch / "sources")

    def make(self, work: PreviewRequest, check: Callable[[], None], send: Callable[..., None]) -> None:
        """Send pictures of a recipe until the preview is final; ``check`` raises when it is not wanted any more."""
        recipe = work.recipe
        run, made = open_texture(recipe, self.library, self.store)
        exemplar = exemplar_of(recipe, self.library)
        size = recipe.size or _default_size(run) or (exemplar.height, exemplar.width)
        scale = scale_of((exemplar.height, exemplar.width), size)
        small = recipe.model_copy(update={"size": reduced_size(size, scale)})
        run, made = open_texture(small, self.library, self.store)
        name = next(iter(recipe.sources))
        sources = {**run.flow.sources, name: self.reducer.reference(exemplar, scale)}
        run = Run(dataclasses.replace(run.flow, sources=sources), self.store)
        last = 0.0

        def tell(image: Image, done: float, is_final: bool) -> None:
            picture = PreviewPicture(
                number=work.number,
                height=image.height,
                width=image.width,
                scale=scale,
                done=done,
                is_final=is_final,
            )
            send(picture, rgba(image))

        def listen(event: Event) -> None:
            nonlocal last
            check()
            if isinstance(event, StepProgress) and event.progress.preview is not None:
                now = time.perf_counter()
                if now - last >= _INTERVAL:
                    tell(event.progress.preview(), min(1.0, event.progress.done), False)
                    last = now

        os.environ.pop("PREFECT_API_URL", None)  # a server there shows runs, not previews
        execute(run, listen, self.store.root / "out")
        tell(image_of(run, made), 1.0, True)


def _default_size(run: Run) -> tuple[int, int] | None:
    """The default size of a method, px."""
    step, _, param = run.flow.params.get("size", ("",))[0].partition(".")
    size = getattr(run.flow.steps[step].params, param, None) if step in run.flow.steps else None
    return size if isinstance(size, tuple) else None
