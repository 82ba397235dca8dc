"""The patches of a photograph as seen from the front, side by side in one image."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Float64
from pydantic import Field

from texloom.stages.analysis.photographs import bezier
from texloom.stages.analysis.photographs.repetition_phase import mean_repetition, phase_offset
from texloom.stages.common.geometry.footprints import resampled
from texloom.stages.common.grids.packing import arranged
from texloom.stages.numerics.matrices import inverse_of, matrix_product
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.masks import USABLE
from texloom.stages.vocabulary.progress import Progress, part, report

_REACH = 3  # repetitions among which a place is searched, to each side of the nearest
_MIN_SHOWN = 0.25  # of a border row or column of a cropped patch, as a share of that of which most is shown
_MOST_PIXELS = 2**28  # of all patches
_CHANNELS = ("R", "G", "B", USABLE)


class PatchAtlasParams(Params):
    """Size of the atlas."""

    gap: int = Field(16, ge=1, le=256)
    """px between two patches"""
    max_side: int = Field(1024, ge=16, le=8192)
    """maximum side of a patch, px; with a larger one all are reduced"""
    blur: float = Field(1.5, ge=0)
    """with ``level``: octaves by which a pixel may be less sharp than the atlas; others are not shown"""


@dataclasses.dataclass(frozen=True)
class PatchAtlas:
    """The patches."""

    image: Image
    """R G B, and ``usable``, which is 0 where the photograph does not show the texture"""
    keep: Bool[np.ndarray, "H W"]
    """whether the photograph shows it"""
    table: dict[str, Any]
    """``patches``: row, column, height and width of each in the atlas, px, in the order of the geometry file"""
    largest: Image
    """the patch of which most is shown; with ``level`` cropped to what is shown"""


@stage(version=1)
def patch_atlas(
    image: Image,
    region: Mask,
    controls: Float32[np.ndarray, "patches 4 4 3"],
    spaces: Float32[np.ndarray, "patches 4 4 3"],
    sizes: Float32[np.ndarray, "patches 2"],
    scale: float,
    params: PatchAtlasParams,
    generators: Vectors | None = None,
    level: ScalarMap | None = None,
) -> PatchAtlas:
    """Show every patch from the front, at one scale, in an atlas.

    Parameters
    ----------
    image : the photograph.
    region, controls, spaces, sizes, scale : see `jacobian_field`; a px of the atlas is an element of texture.
    generators : of the repetition of the largest patch, px of the atlas, as from `repetition`: patches move apart
        until all are in phase.
    level : see `jacobian_field`; what is blurred more than ``blur`` is not shown. Without it, all is.

    Raises
    ------
    InputError
        no patch shows any of the region, or all together have too many pixels.

    References
    ----------
    [Eisenacher2008]_ section 3.1, the patches; [Heckbert1989]_ elliptical weighted averages.
    """
    if level is not None:
        region = region & (level <= params.blur)
    factor = scale * min(1.0, params.max_side / (scale * float(sizes.max())))
    shapes = [(max(1, round(height)), max(1, round(width))) for height, width in (sizes * factor).tolist()]
    total = sum(height * width for height, width in shapes)
    if total > _MOST_PIXELS:
        raise InputError(f"max_side: {len(shapes)} patches are {total} px in all, at most {_MOST_PIXELS}; lower it")
    parts: list[Image] = []
    for patch, space, shape in zip(controls.astype(np.float64), spaces.astype(np.float64), shapes, strict=True):
        with part(len(parts) / len(shapes), (len(parts) + 1) / len(shapes)):
            parts.append(_patch(image, region, patch, space, shape))
    counts = [np.count_nonzero(shown.pixels[..., 3]) for shown in parts]
    if not any(counts):
        raise InputError("region: no patch shows any of it")
    largest = parts[int(np.argmax(counts))]
    moved = None
    if generators is not None and len(generators) == 2:
        moved = _in_phase(
            [shown if count else largest for shown, count in zip(parts, counts, strict=True)],
            largest,
            generators.astype(np.float64),
        )
    rectangles, (rows, columns) = arranged(shapes, params.gap, moved)
    canvas = np.zeros((rows, columns, 4), np.float32)
    for shown, (top, left, height, width) in zip(parts, rectangles.tolist(), strict=True):
        canvas[top : top + height, left : left + width] = shown.pixels
    keep = canvas[..., 3] > 0
    names = ("row", "column", "height", "width")
    table = {"patches": [dict(zip(names, rectangle, strict=True)) for rectangle in rectangles.tolist()]}
    return PatchAtlas(
        Image(canvas, _CHANNELS), keep, table, largest if level is None else cropped_to_shown(largest)
    )


def cropped_to_shown(part: Image) -> Image:
    """Without the rows and columns of which less than `_MIN_SHOWN` of the most is shown."""
    shown = part.pixels[..., 3] > 0
    sides = []
    for axis in (1, 0):
        counts = shown.sum(axis=axis)
        kept = np.flatnonzero(counts >= _MIN_SHOWN * counts.max())
        sides.append(slice(int(kept[0]), int(kept[-1]) + 1))
    return part.cropped(sides[0], sides[1])


def _patch(
    image: Image,
    region: Mask,
    patch: Float64[np.ndarray, "4 4 3"],
    space: Float64[np.ndarray, "4 4 3"],
    shape: tuple[int, int],
) -> Image:
    """A patch from the front."""
    places = bezier.even_points(patch, space, shape)
    down, across = (np.gradient(places, axis=axis) if places.shape[axis] > 1 else 0 * places for axis in (0, 1))
    feet = np.stack([down[..., 0], across[..., 0], down[..., 1], across[..., 1]], axis=2).reshape(-1, 4)
    nearest = np.rint(places).astype(int)
    inside = ((nearest >= 0) & (nearest < region.shape)).all(axis=2)
    row, column = np.moveaxis(np.clip(nearest, 0, np.array(region.shape) - 1), 2, 0)
    shown = (inside & region[row, column])[..., None]
    report(Progress(0.3))
    pixels = resampled(image.color.astype(np.float32), region, places.reshape(-1, 2), feet)
    report(Progress(1.0))
    return Image(np.concatenate([pixels.reshape(*shape, 3) * shown, shown], axis=2, dtype=np.float32), _CHANNELS)


def _in_phase(
    parts: list[Image], largest: Image, generators: Float64[np.ndarray, "2 2"]
) -> Callable[[int, int, int], tuple[int, int]]:
    """Where a patch goes, given its number and its least row and column, to be in phase with the first."""
    mean = mean_repetition(largest, generators)
    offsets = [phase_offset(mean_repetition(part, generators), mean) for part in parts]
    around = np.argwhere(np.ones((2 * _REACH + 1, 2 * _REACH + 1))) - _REACH

    def moved(number: int, row: int, column: int) -> tuple[int, int]:
        offset = offsets[number] - offsets[0]
        nearest = np.rint(matrix_product([row, column], inverse_of(generators)) - offset)
        places = np.rint(matrix_product(offset + nearest + around, generators)).astype(int)
        places = places[(places >= (row, column)).all(axis=1)]
        top, left = places[np.argmin(places.sum(axis=1))].tolist()
        return top, left

    return moved
