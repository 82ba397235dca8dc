"""Previews: the texture of a small version of the exemplar, with every scale of the optimisation as it comes."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.engine.events import Event, StepProgress
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.model import Reference
from texloom.pipelines.media.sources import Source, open_source
from texloom.pipelines.store.housekeeping import set_limit
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.library import GEOMETRY, Library
from texloom.pipelines.studio.messages.answers import PreviewPicture
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.messages.requests import PreviewRequest
from texloom.pipelines.studio.offer import Offer
from texloom.pipelines.studio.offers import OFFERS, STROKES, WAY
from texloom.pipelines.studio.page_images import rgba
from texloom.pipelines.studio.recipe_flows import (
    image_of,
    open_recipe,
    open_texture,
    output_of,
    steps_alone,
    upstream_of,
)
from texloom.pipelines.studio.reduced_geometry import reduced_geometry
from texloom.pipelines.studio.reduced_recipes import Reducer, Reduction, reduced_document, reduced_lengths
from texloom.pipelines.studio.work import Places
from texloom.stages.vocabulary.arrays import Image

_MOST_BYTES = 2**29  # of the results of previews; those that were used least recently are removed
_UNOFFERED = Offer("")
_COLOUR = "self_tuning"  # by which a photograph becomes a material
_FAST = "fast"  # preset of previews of many tiles
_TILE = "tile"  # the param of the side of tiles of a set
_TILES = 2  # sides of an exemplar that all tiles of a set take, about
_WHOLE = ("mesh", "surfaces")  # layers of whose results no part can be made
_PYRAMID = 32  # px that divide the sides of tileable textures that are made in a photograph
_CHARTS = "charts"  # the step that gives a mesh its texture coordinates
_INTERVAL = 0.06  # seconds between pictures of one preview
_NEARLY_DONE = 0.99  # of a picture that is not made from all scales yet


class Previewer:
    """Makes previews; its results are in a store of its own, which is removed with the studio."""

    def __init__(self, places: Places):
        scratch = Path(places.scratch)
        self.attached = scratch / f"attached-{os.getpid()}"
        self.store = Store(scratch / "store")
        set_limit(self.store, _MOST_BYTES)
        self.reducer = Reducer(self.store.root / "sources", places)
        others = {"attached": self.attached, "reduced": self.reducer.folder}
        self._charts: dict[Any, bool] = {}
        self.library = Library(Path(places.folder), Path(places.store), **others)

    def make(
        self, work: PreviewRequest, payload: bytes, check: Callable[[], None], send: Callable[..., None]
    ) -> None:
        """Send pictures of a recipe until the preview is final; ``check`` raises when it is not wanted any more.

        Those of the first one come scale by scale; finer ones follow as a whole, each from larger exemplars.
        """
        recipe = work.recipe
        self._keep(work.attached, payload)
        offer = OFFERS.get(recipe.flow, _UNOFFERED)
        export = offer.views[0].file if offer.views else None
        run = open_recipe(recipe, self.library, self.store)
        if offer.surface:
            recipe = self._of_surface(recipe, run, offer.surface, check)
            run, offer = open_recipe(recipe, self.library, self.store), OFFERS[recipe.flow]
        if offer.ways:
            way = self._way(run, check)
            recipe = recipe.model_copy(update={"params": {**recipe.params, WAY[1]: way}})
            export = offer.ways[way]
        exemplar = min(self._exemplars(recipe, run), key=lambda one: min(one.height, one.width))
        size = _size(recipe, run, exemplar, offer)
        os.environ.pop("PREFECT_API_URL", None)  # a server there shows runs, not previews
        step = _PYRAMID if offer.layer == "surfaces" else 4
        first = Reduction.first((exemplar.height, exemplar.width), size, offer.layer in _WHOLE, step)
        if offer.layer == "mesh" and not self._has_charts(recipe, first.size(size), check):
            first = Reduction(1.0, max(size))
        last = 0.0

        def tell(image: Image, scale: float, done: float, is_final: bool) -> None:
            picture = PreviewPicture(
                number=work.number,
                height=image.height,
                width=image.width,
                scale=scale,
                done=done,
                is_final=is_final,
            )
            send(picture, rgba(image))

        def show(event: Event) -> None:
            nonlocal last
            check()
            if isinstance(event, StepProgress) and event.progress.preview is not None:
                now = time.perf_counter()
                if now - last >= _INTERVAL:
                    tell(event.progress.preview(), first.scale, min(_NEARLY_DONE, event.progress.done), False)
                    last = now

        reduction = first
        listen: Callable[[Event], None] = show
        while True:
            began = time.perf_counter()
            draft = offer.draft if reduction is first and reduction.scale < 1 else None
            image = self._made(recipe, run, exemplar, reduction, export, draft, listen)
            finer = reduction.finer(size, work.largest, time.perf_counter() - began)
            tell(image, reduction.scale, 1.0, finer is None)
            if finer is None:
                break
            reduction, listen = finer, lambda _: check()

    def _made(
        self,
        recipe: Recipe,
        run: Run,
        exemplar: Source,
        reduction: Reduction,
        export: str | None,
        draft: Reference | None,
        listen: Callable[[Event], None],
    ) -> Image:
        """What a recipe makes of pictures that are reduced; ``run`` is that of the recipe as it is."""
        offer = OFFERS.get(recipe.flow, _UNOFFERED)
        reduced = self._smaller(recipe, run, reduction, offer)
        smaller, made = open_texture(reduced, self.library, self.store, export, draft)
        sources = {
            name: self._reduced_source(run.shared.source(name), exemplar, reduction)
            for name, given in recipe.sources.items()
            if isinstance(given, str) and offer.layer != "surfaces"
        }
        flow = dataclasses.replace(smaller.flow, sources={**smaller.flow.sources, **sources})
        run = Run(flow, self.store)
        execute(run, listen, self.store.root / "out")
        return image_of(run, made)

    def _reduced_source(self, source: Source, exemplar: Source, reduction: Reduction) -> str:
        """What stands for a source in a preview: meshes stay as they are, and lines get a smaller picture."""
        if source.kind != "picture" or reduction.scale >= 1:
            return source.reference
        if source.reference.endswith(".json"):
            return str(self._reduced_document(source.name, Path(source.reference), reduction.scale))
        return self.reducer.reference(source, exemplar, reduction)

    def _has_charts(self, recipe: Recipe, size: tuple[int, int], check: Callable[[], None]) -> bool:
        """Whether a mesh has the same texture coordinates at a smaller size, as lines drawn in them need."""
        key = recipe.sources["mesh"], recipe.size, size
        if key not in self._charts:
            self._charts[key] = self._compared(recipe, size, check)
        return self._charts[key]

    def _compared(self, recipe: Recipe, size: tuple[int, int], check: Callable[[], None]) -> bool:
        found = []
        for one in (recipe.size, size):
            run = open_recipe(recipe.model_copy(update={"size": one}), self.library, self.store)
            run = steps_alone(run, {_CHARTS})
            execute(run, lambda _: check(), self.store.root / "out")
            found.append(output_of(run, _CHARTS, "mesh")[:, 6:8])
        return np.array_equal(found[0], found[1])

    def _of_surface(self, recipe: Recipe, run: Run, step: str, check: Callable[[], None]) -> Recipe:
        """The recipe of the colour of what a step makes of a photograph, which reduced shows too little."""
        run = steps_alone(run, upstream_of(run.flow, step))
        execute(run, lambda _: check(), self.store.root / "out")
        kept = self.reducer.kept(output_of(run, step, "image"))
        params = {name: value for name, value in recipe.params.items() if name.startswith("texture.")}
        changes = {"flow": _COLOUR, "sources": {"exemplar": f"reduced:{kept}"}, "params": params}
        return recipe.model_copy(update=changes | {"tileable": recipe.tileable or "both"})

    def _exemplars(self, recipe: Recipe, run: Run) -> list[Source]:
        """The pictures of the first source."""
        name, given = next(iter(recipe.sources.items()))
        if isinstance(given, str):
            return [run.shared.source(name)]
        return [open_source(name, self.library.reference(one)) for one in given]

    def _smaller(self, recipe: Recipe, run: Run, reduction: Reduction, offer: Offer) -> Recipe:
        """The recipe of reduced pictures; those of which there is one for a source are replaced in its run."""
        scale = reduction.scale
        params = recipe.params
        if STROKES in offer.lengths:
            step, _, name = STROKES.partition(".")
            params = {STROKES: getattr(run.flow.steps[step].params, name)} | params
        changes: dict[str, Any] = {
            "files": self._reduced_files(recipe, scale),
            "params": reduced_lengths(params, offer.lengths, scale),
        }
        if "size" in run.flow.params:
            exemplar = self._exemplars(recipe, run)[0]
            changes["size"] = reduction.size(_size(recipe, run, exemplar, offer))
        if _TILE in offer.lengths and recipe.preset is None and scale < 1:
            changes["preset"] = _FAST
        if scale < 1:
            changes["sources"] = {
                name: tuple(self._reduced_of(name, one, scale) for one in given)
                if not isinstance(given, str)
                else self._reduced_of(name, given, scale)
                if offer.layer == "surfaces"  # whose geometry is checked with them
                else given
                for name, given in recipe.sources.items()
            }
        return recipe.model_copy(update=changes)

    def _reduced_of(self, name: str, picture: str, scale: float) -> str:
        """The id of one of several pictures, reduced."""
        return f"reduced:{self.reducer.named(open_source(name, self.library.reference(picture)), scale)}"

    def _way(self, run: Run, check: Callable[[], None]) -> str:
        """What `WAY` chooses at full size, which may be another way than for smaller pictures, or a refusal."""
        run = steps_alone(run, upstream_of(run.flow, WAY[0]))
        execute(run, lambda _: check(), self.store.root / "out")
        return str(output_of(run, WAY[0], "table")["chosen"][0])

    def _keep(self, attached: Mapping[str, int], payload: bytes) -> None:
        """Write what came with a request, in place of what came with the one before."""
        shutil.rmtree(self.attached, ignore_errors=True)
        self.attached.mkdir(parents=True)
        begin = 0
        for name, size in attached.items():
            (self.attached / name).write_bytes(payload[begin : begin + size])
            begin += size

    def _reduced_files(self, recipe: Recipe, scale: float) -> dict[str, str]:
        """The documents of a recipe for reduced pictures."""
        made = {}
        for name, file in recipe.files.items():
            path = Path(self.library.reference(file))
            if path.name == GEOMETRY:
                folder = self.attached / f"reduced_{name}"
                path = reduced_geometry(path, folder, scale) if scale < 1 else path
                made[name] = f"attached:{folder.name}/{path.name}" if scale < 1 else file
            else:
                made[name] = f"attached:{self._reduced_document(name, path, scale).name}"
        return made

    def _reduced_document(self, name: str, file: Path, scale: float) -> Path:
        path = self.attached / f"reduced_{name}.json"
        path.write_text(json.dumps(reduced_document(json.loads(file.read_bytes()), scale)))
        return path


def _size(recipe: Recipe, run: Run, exemplar: Source, offer: Offer) -> tuple[int, int]:
    """Height and width of the result, px; of tiles about those of all of them."""
    times = _TILES if _TILE in offer.lengths else 1
    return recipe.size or _default_size(run) or (times * exemplar.height, times * exemplar.width)


def _default_size(run: Run) -> tuple[int, int] | None:
    """The default size of a method, px."""
    step, _, param = run.flow.params.get("size", ("",))[0].partition(".")
    size = getattr(run.flow.steps[step].params, param, None) if step in run.flow.steps else None
    return size if isinstance(size, tuple) else None
