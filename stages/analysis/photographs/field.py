"""The distortion of a texture on the patches of a photograph: of each patch, and of all together."""

import dataclasses
from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float64, Int32

from texloom.stages.analysis.photographs.geometry import Geometry, Patch, pixels_inside
from texloom.stages.analysis.photographs.pull_push import pull_push
from texloom.stages.kernels.core.elementary_functions import exp, log, log2
from texloom.stages.vocabulary.arrays import Jacobian, Mask, ScalarMap
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.scratch import bands
from texloom.stages.vocabulary.sizes import format_size

_CELLS = 16  # a side: parts of a patch in which its pixels are searched
_PIECES = 8
_MIN_REGION = 256  # px


@dataclasses.dataclass(frozen=True)
class Coverage:
    """Jacobians of one patch, in the box around the pixels that it covers."""

    corner: tuple[int, int]
    """row and column of the box's first pixel"""
    total: Float64[np.ndarray, "h w 4"]
    """sums over parts of the patch; units of texture"""
    count: Int32[np.ndarray, "h w"]
    """parts of the patch at a pixel"""


@dataclasses.dataclass(frozen=True)
class PhotoDistortion:
    """Distortion and regions of the texture in a photograph; see `jacobian_field` beside it."""

    jacobian: Jacobian
    """from texture elements to px; an element is about a px where the texture is sharpest"""
    level: ScalarMap
    """log2 of the elements per pixel in the most foreshortened direction: 0 where the texture is sharp"""
    region: Mask
    """the pixels to take texture from"""
    hole: Mask
    """the pixels to be filled"""
    features: Bool[np.ndarray, "classes h w"]
    """each class of features; one empty class where there is none"""
    scale: float
    """elements per unit of texture"""


def coverage(patch: Patch, shape: tuple[int, int]) -> Coverage:
    """The Jacobians of a patch.

    Raises
    ------
    InputError
        the patch is outside the photograph.
    """
    from texloom.stages.kernels.core.threads import run_spans
    from texloom.stages.kernels.distortion.patch_coverage import cover

    total = np.zeros((*shape, 4))
    count, place = np.zeros(shape, np.int32), np.zeros((*shape, 2))
    run_spans(cover, (patch.controls, patch.space, patch.unit, _CELLS, total, count, place), shape[0], _PIECES)
    rows, columns = (np.flatnonzero(count.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        raise InputError(f"{patch.name}: is outside the photograph of {format_size(shape)}")
    del place
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    if count[box].size < count.size:
        total, count = total[box].copy(), count[box].copy()
    return Coverage((int(rows[0]), int(columns[0])), total, count)


def distortion(
    geometry: Geometry,
    parts: Iterable[Coverage],
    shape: tuple[int, int],
    detail: float,
    magnify: float = 1.0,
    scale: float | None = None,
) -> PhotoDistortion:
    """The distortion of all patches together.

    Parameters
    ----------
    parts : of the geometry's patches, in their order.
    detail, magnify, scale : see `texloom.stages.analysis.photographs.jacobian_field`.

    Raises
    ------
    InputError
        overlapping patches have opposite directions, or the region is too small.
    """
    field, covered = _joined(list(parts), shape)
    inside = covered if geometry.region is None else pixels_inside(geometry.region, shape)
    hole = pixels_inside(geometry.hole, shape)
    inside = inside & ~pixels_inside(geometry.without, shape) & ~hole
    features = [pixels_inside(area, shape) for area in geometry.features.values()] or [np.zeros(shape, np.bool_)]
    check_count(inside, "region")
    stretch = _min_stretch(field)
    if scale is None:
        scale = float(np.quantile(stretch[inside], 1 - detail, method="nearest"))
    field = np.asarray(field * (magnify / scale), np.float32)
    level = np.asarray(-log2(np.maximum(stretch * (magnify / scale), 1e-6)), np.float32)
    return PhotoDistortion(field, level, inside, hole, np.stack(features), float(scale))


def check_count(region: Mask, name: str) -> None:
    """`InputError` where too few pixels remain."""
    if np.count_nonzero(region) < _MIN_REGION:
        raise InputError(f"{name}: {np.count_nonzero(region)} px remain, fewer than {_MIN_REGION}")


def _joined(parts: list[Coverage], shape: tuple[int, int]) -> tuple[Jacobian, Mask]:
    """Jacobians of units of texture, extrapolated everywhere; and the pixels that patches cover."""
    field, covered = np.empty((*shape, 4), np.float32), np.empty(shape, np.bool_)
    for band in bands(shape[0]):
        total, count = _summed(parts, band, shape[1])
        covered[band] = count > 0
        field[band] = total / np.maximum(count, 1)[..., None]
    parts.clear()  # of double precision
    area = field[..., 0] * field[..., 3] - field[..., 1] * field[..., 2]
    if not (area[covered] > 0).all():
        raise InputError("patches: two overlapping patches have opposite directions of texture")
    if covered.all():  # as of a frontal photograph, which may be large
        return field, covered
    # Areas are extrapolated separately, since means of different directions are too short.
    planes = np.concatenate([field, log(np.where(covered, area, np.float32(1)))[..., None]], axis=2)
    planes = pull_push(planes, covered.astype(np.float32))
    for band in bands(shape[0]):
        own, target = planes[band, :, :4], exp(planes[band, :, 4])
        current = own[..., 0] * own[..., 3] - own[..., 1] * own[..., 2]
        factor = np.sqrt(target / np.maximum(current, 1e-3 * target))
        field[band] = np.where(covered[band][..., None], own, own * factor[..., None])
    return field, covered


def _summed(parts: list[Coverage], rows: slice, across: int) -> tuple[np.ndarray, np.ndarray]:
    """Sums of the totals and counts of all patches in some rows."""
    total, count = (
        np.zeros((rows.stop - rows.start, across, 4)),
        np.zeros((rows.stop - rows.start, across), np.int32),
    )
    for part in parts:
        (row, column), (height, width) = part.corner, part.count.shape
        first, last = max(row, rows.start), min(row + height, rows.stop)
        if first < last:
            place = np.s_[first - rows.start : last - rows.start, column : column + width]
            total[place] += part.total[first - row : last - row]
            count[place] += part.count[first - row : last - row]
    return total, count


def _min_stretch(field: Jacobian) -> ScalarMap:
    """The smaller singular value: px per unit of texture in the most foreshortened direction."""
    stretch = np.empty(field.shape[:2], np.float32)
    for band in bands(len(field)):
        a, b, c, d = np.moveaxis(field[band].astype(np.float64), 2, 0)
        half = (a * a + b * b + c * c + d * d) / 2
        square = half - np.sqrt(np.maximum(half**2 - (a * d - b * c) ** 2, 0))
        stretch[band] = np.sqrt(np.maximum(square, 0))
    return stretch
