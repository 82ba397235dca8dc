"""Painting a control map: the texture follows every dab. In a worker, which keeps the canvas."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.engine.events import Event, StepProgress, StepStarted
from texloom.pipelines.engine.keys import generator
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.model import Step
from texloom.pipelines.media.array_sources import file_source
from texloom.pipelines.media.sources import open_source
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.library import Library
from texloom.pipelines.studio.messages.answers import PaintOpened, PaintPicture, PaintProgress, PaintSummarised
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.messages.requests import PaintDabRequest, PaintOpenRequest, PaintSummaryRequest
from texloom.pipelines.studio.recipe_flows import open_recipe, output_of, steps_alone, upstream_of
from texloom.pipelines.studio.reduced_recipes import Reducer
from texloom.pipelines.studio.work import Places
from texloom.stages.analysis.similarity.appearance_stack import AppearanceStack
from texloom.stages.interactive.canvas import Canvas, CoarseColours, Rect, colours_help
from texloom.stages.synthesis.per_pixel.per_pixel import ArrangementParams
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import format_size

FLOW = "per_pixel_control"
_RESULT = "result"  # the step of the flow that the canvas stands for
_ANALYSIS = "appearance"  # and that of which it is made


class Painter:
    """A canvas, and what it was made of."""

    def __init__(self, places: Places):
        self.store = Store(Path(places.store))
        self._drafts = Store(Path(places.scratch) / "store")
        self._reducer = Reducer(self._drafts.root / "sources", places)
        self.library = Library(Path(places.folder), Path(places.store), reduced=self._reducer.folder)
        self.canvas: Canvas | None = None

    def summarise(self, work: PaintSummaryRequest, check: Callable[[], None], send: Callable[..., None]) -> None:
        """Do what takes long before a canvas can be opened, in the user's store."""
        control = work.control or self._brightness(work.texture, self.library.dropped(), "dropped")
        run, _ = self._begun(work.texture, control, work, self.store)
        _do(run, work.number, check, send)
        send(PaintSummarised(number=work.number))

    def open(
        self, work: PaintOpenRequest, map_: bytes, check: Callable[[], None], send: Callable[..., None]
    ) -> None:
        """Summarise a texture with its control map, and make the texture of another map, 8 bits a pixel."""
        texture, control, store = work.texture, work.control, self.store
        if work.scale < 1:
            self._drafts.ready("sources")
            texture, store = self._reduced(texture, work.scale), self._drafts
            control = control and self._reduced(control, work.scale)
            control = control or self._brightness(texture, self._reducer.folder, "reduced")
        control = control or self._brightness(texture, self.library.dropped(), "dropped")
        run, result = self._begun(texture, control, work, store)
        _do(run, work.number, check, send)
        chosen = {name: getattr(result.params, name) for name in ArrangementParams.model_fields}
        stack = {name: output_of(run, _ANALYSIS, name) for name in _STACK}
        send(PaintProgress(number=work.number, step="canvas", done=0.0))
        values = _values(map_, work.size, self._planes(run))
        pair = output_of(run, "compact", "image"), output_of(run, "compact", "control")
        coarse = CoarseColours(
            output_of(run, "level", "image"),
            output_of(run, "features", "control"),
            output_of(run, "compact", "guide"),
        )
        same: dict[str, Any] = {
            "params": ArrangementParams(**chosen),
            "stack": AppearanceStack(**stack),
            "seed": int(generator(work.seed, result.draws_as).integers(2**63)),
        }
        pixels = open_source("texture", self.library.reference(texture)).read()
        used = coarse if colours_help(pixels, *pair, coarse, **same) else None
        self.canvas = Canvas(*pair, work.size, values=values, coarse=used, **same)
        send(PaintOpened(number=work.number, control=control if work.scale == 1 else work.control))
        self._send(work.number, Rect(0, work.size[0], 0, work.size[1]), send)

    def _begun(
        self, texture: str, control: str, work: PaintSummaryRequest | PaintOpenRequest, store: Store
    ) -> tuple[Run, Step]:
        """The steps that a canvas is made of, not done yet, and the one that it stands for."""
        sources = {"texture": texture, "control": control, "target": control}
        size = work.size if isinstance(work, PaintOpenRequest) else None
        run = open_recipe(Recipe(flow=FLOW, sources=sources, size=size, seed=work.seed), self.library, store)
        return steps_alone(run, upstream_of(run.flow, _ANALYSIS)), run.flow.steps[_RESULT]

    def _reduced(self, picture: str, scale: float) -> str:
        """The id of a picture, reduced."""
        source = open_source("texture", self.library.reference(picture))
        return f"reduced:{self._reducer.named(source, scale)}"

    def _brightness(self, texture: str, folder: Path, scheme: str) -> str:
        """The id of a grey picture of a texture's luminance, 8 bits."""
        color = open_source("texture", self.library.reference(texture)).read().color
        luminance = color @ np.array([0.2126, 0.7152, 0.0722], np.float32)
        codes = Image(luminance[..., None], ("Y",)).srgb[..., 0]
        return f"{scheme}:{Path(file_source(codes, folder)).name}"

    def _planes(self, run: Run) -> int:
        planes = [
            plane for plane in np.moveaxis(output_of(run, "compact", "control").pixels, 2, 0) if np.ptp(plane) > 0
        ]
        if len(planes) != 1:
            raise InputError("the control map must be grey; choose another, or the brightness of the texture")
        return len(planes)

    def paint(self, work: PaintDabRequest, map_: bytes, send: Callable[..., None]) -> None:
        """Replace a rectangle of the map, and send what changes in the texture."""
        if self.canvas is None:
            raise InputError("the canvas is no longer open; choose the texture again")
        values = _values(map_, (work.height, work.width), self.canvas.planes)
        try:
            changed = self.canvas.paint(values, work.top, work.left)
        except ValueError as error:
            raise InputError(str(error)) from None
        for area in changed or [Rect(0, 0, 0, 0)]:
            self._send(work.number, area, send)

    def _send(self, number: int, area: Rect, send: Callable[..., None]) -> None:
        assert self.canvas is not None
        height, width = area.bottom - area.top, area.right - area.left
        pixels = np.full((height, width, 4), 255, np.uint8)
        if pixels.size:
            pixels[..., :3] = self.canvas.picture(area)
        told = PaintPicture(number=number, top=area.top, left=area.left, height=height, width=width)
        send(told, pixels.tobytes())


_STACK = ("appearance", "basis", "candidates", "toroidal")


def _do(run: Run, number: int, check: Callable[[], None], send: Callable[..., None]) -> None:
    """Do all steps, and tell how far they are."""

    def listen(event: Event) -> None:
        check()
        if isinstance(event, StepStarted | StepProgress):
            done = event.progress.done if isinstance(event, StepProgress) else 0.0
            send(PaintProgress(number=number, step=event.step, done=min(1.0, done)))

    execute(run, listen, run.store.root / "runs")


def _values(map_: bytes, size: tuple[int, int], planes: int) -> np.ndarray:
    """A part of a map: 0..1 for the codes 0..255."""
    if len(map_) != size[0] * size[1]:
        raise InputError(f"{len(map_)} bytes are no map of {format_size(size)}")
    codes = np.frombuffer(map_, np.uint8).reshape(*size, 1)
    return np.repeat(codes.astype(np.float32) / np.float32(255), planes, axis=2)
