"""Small versions of recipes, for previews."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import pydantic

from texloom.pipelines.media.array_sources import file_source
from texloom.pipelines.media.sources import Source
from texloom.pipelines.studio import picture_levels
from texloom.pipelines.studio.messages.recipes import Params
from texloom.pipelines.studio.work import Places
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import valid_pixels, without_usable
from texloom.stages.vocabulary.sizes import SIDES, size_value

_EXEMPLAR = 208  # px of an exemplar's shorter side, at most, at first
_LEAST_EXEMPLAR = 72  # px of it, at least
_RESULT = 288  # px of a result's longer side, unless the exemplar would become too small
_LARGEST_RESULT = 400  # px; of larger ones a part is shown
_WHOLE = 144  # px of a result's longer side where no part can be shown, as of a texture on a mesh
_FINER = 2.0  # times as large is each picture after the first
_NEARLY = 0.7  # of the last one's scale, from which the next picture is the last one
_SIZE: pydantic.TypeAdapter[tuple[int, int]] = pydantic.TypeAdapter(Annotated[tuple[int, int], SIDES])
_PATIENCE = 10.0  # seconds, below which a preview of the full size is made


@dataclasses.dataclass(frozen=True)
class Reduction:
    """How much smaller a preview is than the result; exemplars and results are reduced alike."""

    scale: float
    """of a side; 1 is the full size"""
    most: int
    """px of a side of the preview; of larger ones a part is made"""
    step: int = 4
    """px of which the sides of a reduced one are multiples, which tileable pyramids divide"""

    @classmethod
    def first(cls, exemplar: tuple[int, int], size: tuple[int, int], is_whole: bool = False, step: int = 4) -> Self:
        """That of the first picture of a preview, which is to come at once; ``is_whole``: never of a part."""
        least, most = (min(1.0, side / min(exemplar)) for side in (_LEAST_EXEMPLAR, _EXEMPLAR))
        if is_whole:
            return cls(min(most, max(least, _WHOLE / max(size))), max(size), step)
        return cls(min(most, max(least, _RESULT / max(size))), _LARGEST_RESULT, step)

    def size(self, size: tuple[int, int]) -> tuple[int, int]:
        """Height and width of a preview, px."""
        step = 1 if self.scale >= 1 else self.step
        height, width = (min(self.most, max(16, step, step * round(side * self.scale / step))) for side in size)
        return height, width

    def finer(self, size: tuple[int, int], largest: int, seconds: float) -> Self | None:
        """That of the next picture, or none where a finer one is not wanted or would take too long.

        Parameters
        ----------
        size : of the result, px.
        largest : px of the longer side that are to be seen; the full size follows where it takes less than 10 s.
        seconds : that this one took; it is taken that another one does by its area.
        """
        made = self.size(size)
        is_quick = seconds * (size[0] * size[1]) / (made[0] * made[1]) < _PATIENCE
        last = 1.0 if is_quick else min(1.0, largest * self.scale / max(made))
        if not largest or (self.scale >= last and (made == size or not is_quick)):
            return None
        scale = _FINER * self.scale
        if scale >= _NEARLY * last:
            scale = last
        most = max(size) if scale == 1 and is_quick else math.ceil(self.most * scale / self.scale)
        return dataclasses.replace(self, scale=scale, most=most)


def reduced_lengths(params: Params, lengths: Mapping[str, int], scale: float) -> Params:
    """Params for pictures that are reduced: those of ``lengths`` are px, at least so many."""
    small = {
        name: max(lengths[name], round(value * scale))
        for name, value in params.items()
        if name in lengths and isinstance(value, int | float)
    }
    return params | small


def reduced_document(content: dict[str, Any], scale: float) -> dict[str, Any]:
    """Pieces of a collage, a lattice or strokes, of pictures that are reduced; others are returned as they are."""

    def at(point: Sequence[float]) -> list[float]:  # whole numbers are the middles of pixels
        return [(one + 0.5) * scale - 0.5 for one in point]

    def moved(piece: dict[str, Any]) -> dict[str, Any]:
        changes: dict[str, Any] = {"at": at(piece["at"])}
        if "box" in piece:
            changes["box"] = [one * scale for one in piece["box"]]
        if "polygon" in piece:
            changes["polygon"] = [at(point) for point in piece["polygon"]]
        return piece | changes

    if "strokes" in content:
        height, width = (max(2, round(side * scale)) for side in _SIZE.validate_python(content["size"]))
        lines = [[at(point) for point in line] for line in content["strokes"]]
        return content | {"size": size_value((height, width)), "strokes": lines}
    if "pieces" in content:
        return {"pieces": [moved(piece) for piece in content["pieces"]]}
    if "vertices" in content:
        content = content | {"vertices": [[i, j, *at(place)] for i, j, *place in content["vertices"]]}
    if "generators" in content:
        content = content | {"generators": [[one * scale for one in vector] for vector in content["generators"]]}
    return content


class Reducer:
    """Makes small pictures of sources in a folder, each once."""

    def __init__(self, folder: Path, places: Places):
        self.folder, self._places = folder, places
        self._made: dict[tuple[str, tuple[int, int]], str] = {}

    def reference(self, source: Source, exemplar: Source, reduction: Reduction) -> str:
        """The small picture of a source, with all its channels: an exemplar's, its map's, or that of a result."""
        if reduction.scale >= 1:
            return source.reference
        size = source.height, source.width
        small = _sides(size, reduction.scale)
        if size != (exemplar.height, exemplar.width):
            small = reduction.size(size)
        return self._small(source, small)

    def named(self, source: Source, scale: float) -> str:
        """The small picture of one of several exemplars, under its own name; relative to the folder."""
        small = _sides((source.height, source.width), scale)
        file = Path(self._small(source, small))
        own = hashlib.sha256(f"{file.stem}{source.reference}".encode()).hexdigest()  # two may have equal content
        named = self.folder / own / f"{source.picture}{file.suffix}"
        if not named.exists():
            named.parent.mkdir(exist_ok=True)
            shutil.copyfile(file, named)
        return str(named.relative_to(self.folder))

    def kept(self, image: Image) -> str:
        """A picture of an image, its excluded pixels transparent; relative to the folder."""
        file = file_source(_reduced(image, (image.height, image.width), is_guide=False), self.folder)
        return str(Path(file).relative_to(self.folder))

    def _small(self, source: Source, size: tuple[int, int]) -> str:
        key = source.digest, size
        if key not in self._made or not Path(self._made[key]).exists():
            is_guide = source.name.endswith("_guide")  # whose colours are labels
            is_plain = picture_levels.is_large(source) and set(source.channels) <= {*"RGBY"} and not is_guide
            image = picture_levels.small_image(source, size, self._places) if is_plain else source.read()
            self._made[key] = file_source(_reduced(image, size, is_guide), self.folder)
        return self._made[key]


def _sides(size: tuple[int, int], scale: float) -> tuple[int, int]:
    return max(2, round(size[0] * scale)), max(2, round(size[1] * scale))


def _reduced(image: Image, size: tuple[int, int], is_guide: bool) -> Image:
    """An image reduced; excluded pixels become transparent, since files have no channel for them."""
    import cv2

    kind = cv2.INTER_NEAREST if is_guide else cv2.INTER_AREA

    def resized(plane: np.ndarray) -> np.ndarray:
        return np.asarray(cv2.resize(np.ascontiguousarray(plane, np.float32), size[::-1], interpolation=kind))

    valid, image = valid_pixels(image), without_usable(image)
    kept = [name for name in image.channels if valid is None or name != "A"]
    planes = [resized(image.pixels[..., image.channels.index(name)]) for name in kept]
    if valid is not None:
        planes, kept = [*planes, resized(valid)], [*kept, "A"]
    return Image(np.stack(planes, axis=2), tuple(kept))
