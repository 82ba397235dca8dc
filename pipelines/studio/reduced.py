"""Small versions of recipes, for previews."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from texloom.pipelines.media.arrays import file_source
from texloom.pipelines.media.sources import Source, open_source
from texloom.pipelines.studio.library import Library
from texloom.pipelines.studio.messages import Recipe
from texloom.stages.arrays import Image

_EXEMPLAR = 208  # px of an exemplar's shorter side, at most
_LEAST_EXEMPLAR = 72  # px of it, at least
_RESULT = 288  # px of a result's longer side, unless the exemplar would become too small
_LARGEST_RESULT = 400  # px; of larger ones a part is shown


def scale_of(exemplar: tuple[int, int], size: tuple[int, int]) -> float:
    """How much smaller a preview is than the result; both are reduced alike."""
    least, most = (min(1.0, side / min(exemplar)) for side in (_LEAST_EXEMPLAR, _EXEMPLAR))
    return min(most, max(least, _RESULT / max(size)))


def reduced_size(size: tuple[int, int], scale: float) -> tuple[int, int]:
    """Height and width of a preview, px; multiples of 4, which pyramids of tileable textures divide."""
    height, width = (min(_LARGEST_RESULT, max(16, 4 * round(side * scale / 4))) for side in size)
    return height, width


class Reducer:
    """Makes small pictures of sources in a folder, each once."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._made: dict[tuple[str, float], str] = {}

    def reference(self, source: Source, scale: float) -> str:
        """The small picture of a source, with all its channels."""
        if scale >= 1:
            return source.reference
        key = source.digest, scale
        if key not in self._made:
            self._made[key] = file_source(_reduced(source.read(), scale), self.folder)
        return self._made[key]


def _reduced(image: Image, scale: float) -> Image:
    import cv2

    sides = tuple(max(2, round(side * scale)) for side in (image.width, image.height))
    planes = [
        cv2.resize(np.ascontiguousarray(image.pixels[..., index]), sides, interpolation=cv2.INTER_AREA)
        for index in range(len(image.channels))
    ]
    return Image(np.stack(planes, axis=2).astype(np.float32, copy=False), image.channels)


def exemplar_of(recipe: Recipe, library: Library) -> Source:
    """The first source of a recipe."""
    name, picture = next(iter(recipe.sources.items()))
    return open_source(name, library.reference(picture))
