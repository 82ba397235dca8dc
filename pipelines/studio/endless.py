"""Windows of an endless texture as tiles, made when they are looked at, in a worker."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from texloom.pipelines.engine.keys import generator
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.model import Reference
from texloom.pipelines.store.png_file import png
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.picture_levels import SIDE
from texloom.pipelines.studio.recipe_flows import open_recipe, output_of, steps_alone, upstream_of
from texloom.pipelines.studio.work import Encoded, EndlessWork, Places, library_of
from texloom.stages.vocabulary.declare import InputError

FLOW = "per_pixel"
_RESULT = "texture"  # the step of the flow of which windows are made
_BLOCK = 2 * SIDE  # px; larger than a tile, since preparing the exemplar takes as long as a tile
_MOST_BLOCKS = 32  # that are kept, of 3 MB


class Endless:
    """The texture that is looked at, and the blocks of it that were made last."""

    def __init__(self, places: Places):
        self.library, self.store = library_of(places), Store(Path(places.store))
        self._recipe: Recipe | None = None
        self._blocks: dict[tuple[int, int], np.ndarray] = {}

    def send(self, work: EndlessWork, check: Callable[[], None], send: Callable[..., None]) -> None:
        """Send a tile as PNG: what the flow makes with its ``origin`` and ``size``, reduced by its level."""
        if work.recipe != self._recipe:
            self._open(work.recipe, check)
        side = SIDE << work.level
        top, left = side * work.row, side * work.column
        rows, columns = (range(first // _BLOCK, -(-(first + side) // _BLOCK)) for first in (top, left))
        whole = np.vstack([np.hstack([self._block(row, column, check) for column in columns]) for row in rows])
        tile = whole[top % _BLOCK :, left % _BLOCK :][:side, :side]
        if work.level:
            tile = cv2.resize(tile, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
        send(Encoded(), png(np.ascontiguousarray(tile)))

    def _open(self, recipe: Recipe, check: Callable[[], None]) -> None:
        """Analyse the exemplar, unless the store has that."""
        if recipe.flow != FLOW or recipe.tileable not in (None, "off"):
            raise InputError(f"only textures of {FLOW} that are not tileable go on without end")
        run = open_recipe(recipe, self.library, self.store)
        step = run.flow.steps[_RESULT]
        run = steps_alone(run, upstream_of(run.flow, _RESULT) - {_RESULT})
        execute(run, lambda _: check(), self.store.root / "runs")
        self._step, self._inputs = step, {name: _value(run, given) for name, given in step.inputs.items()}
        self._recipe, self._blocks = recipe, {}

    def _block(self, row: int, column: int, check: Callable[[], None]) -> np.ndarray:
        """A block in sRGB, uint8."""
        block = self._blocks.pop((row, column), None)
        if block is None:
            check()
            assert self._recipe is not None
            place = {"size": (_BLOCK, _BLOCK), "origin": (_BLOCK * row, _BLOCK * column)}
            params, rng = (
                self._step.params.model_copy(update=place),
                generator(self._recipe.seed, self._step.draws_as),
            )
            block = self._step.stage.function(**self._inputs, params=params, rng=rng).image.srgb
        self._blocks[row, column] = block
        while len(self._blocks) > _MOST_BLOCKS:
            del self._blocks[next(iter(self._blocks))]
        return block


def _value(run: Run, given: Reference) -> Any:
    """What a step takes."""
    if given.output is None:
        return run.shared.source(given.name).value()
    return output_of(run, given.name, given.output)
