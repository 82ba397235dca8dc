"""The surroundings of a hole in a photograph, laid flat."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from pydantic import Field

from texloom.stages.analysis.photographs.flattening import charted, photo_positions
from texloom.stages.analysis.photographs.pull_push import pull_push
from texloom.stages.common.geometry.footprints import footprints, resampled
from texloom.stages.kernels.core.elementary_functions import exp, log, log2
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Channels, Image, Jacobian, Mask
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.masks import USABLE

_MIN_CONTEXT = 48  # px
_LIGHT = 0.4  # standard deviation of the Gaussian that is left of light, in sides of the hole
_DARK = 0.01  # linear light; below it the light is no longer a factor


class UnrollHoleParams(Params):
    """Size of the surroundings."""

    context: float = Field(1.0, gt=0, le=8)
    """width of the surroundings on every side, in sides of the hole; texture is taken from there"""
    sharpness: float = Field(0.8, ge=0, le=1)
    """least size of the texture where it is taken from, relative to its size in the hole: smaller parts would be
    magnified and blurred"""
    even: float = Field(0.5, ge=0, le=1)
    """share of the slow light that is removed for comparisons"""
    detail: float = Field(30.0, ge=0, le=100)
    """CIELAB units per octave of contrast in ``guide``: larger values prefer sources as detailed as the hole's
    surroundings"""
    max_side: int = Field(768, ge=64, le=4096)
    """maximum side of the flat image, px; larger surroundings are cropped, and a larger hole is reduced"""


@dataclasses.dataclass(frozen=True)
class UnrollHole:
    """The flat surroundings, and the way back."""

    image: Image
    """about a px of the hole per pixel; the channel ``usable`` is 0 in the hole and outside the region"""
    guide: Float32[np.ndarray, "rows columns k"]
    """local contrast, which continues through the hole; to be taken as the guide of exemplar and result"""
    keep: Bool[np.ndarray, "rows columns"]
    """of the flat image; false in the hole"""
    positions: Annotated[Float32[np.ndarray, "rows columns 2"], Channels(("row", "column"))]
    """row and column in the photograph of each pixel of the flat image"""
    chart: Annotated[Float32[np.ndarray, "h w 2"], Channels(("row", "column"))]
    """row and column in the flat image of each pixel of the hole's bounding box"""
    jacobian: Jacobian
    """that of the photograph in the bounding box"""
    hole: Mask
    """the hole in its bounding box"""
    corner: Int64[np.ndarray, "2"]
    """row and column in the photograph of the bounding box's first pixel"""


@stage(version=1)
def unroll_hole(image: Image, jacobian: Jacobian, region: Mask, hole: Mask, params: UnrollHoleParams) -> UnrollHole:
    """Lay the surroundings of a hole flat, so that a flat synthesis can continue them into it.

    Parameters
    ----------
    image : the photograph.
    jacobian, region, hole : see `jacobian_field`.

    Raises
    ------
    InputError
        there is no hole, or no part of the region is near it.

    References
    ----------
    Ours; positions as in `unroll`.
    """
    if not hole.any():
        raise InputError("hole: empty; give its polygons in the geometry file, hole: [polygon, ...]")
    box = _box(hole)
    sides = [part.stop - part.start for part in box]
    margin = max(_MIN_CONTEXT, round(params.context * max(sides)))
    window = tuple(
        slice(max(0, part.start - margin), min(size, part.stop + margin))
        for part, size in zip(box, hole.shape, strict=True)
    )
    region, inner = (np.ascontiguousarray(part[window]) for part in (region & ~hole, hole))
    if not region.any():
        raise InputError("region: no part of it is near the hole")
    field = jacobian[window]
    stretch = np.sqrt(np.maximum(field[..., 0] * field[..., 3] - field[..., 1] * field[..., 2], 0))
    own = float(np.median(stretch[inner]))
    sharp = region & (stretch >= params.sharpness * own)
    chart = charted(field, region | inner) * own
    reduced = min(1.0, params.max_side / 2 / max(float(np.ptp(chart[inner], axis=0).max()), 1.0))
    chart, field = chart * reduced, np.asarray(field / (own * reduced), np.float32)
    shape = _placed(chart, region | inner, inner, params)
    positions, shown = photo_positions(chart, field, region | inner, shape)
    flat = np.tile(np.array([1, 0, 0, 1], np.float64), (positions.size // 2, 1))
    places = positions.reshape(-1, 2)
    feet = footprints(field, places, flat)
    pixels = resampled(image.color[window].astype(np.float32), ~inner, places, feet)
    row, column = np.moveaxis(np.rint(positions).astype(int), 2, 0)
    keep = ~(shown & inner[row, column])
    pixels = pixels.reshape(*shape, 3)
    seen, usable = (shown & part[row, column] for part in (region, sharp if sharp.any() else region))
    sigma = _LIGHT * float(np.ptp(chart[inner], axis=0).max())
    detail = params.detail * _detail(pixels, seen, sigma)
    pixels = _evened(pixels, seen, sigma, params.even)
    pixels = np.concatenate([pixels, usable[..., None]], axis=2, dtype=np.float32)
    first = np.array([part.start for part in window], np.int64)
    corner = np.array([part.start for part in box], np.int64)
    inside = tuple(slice(part.start - start, part.stop - start) for part, start in zip(box, first, strict=True))
    return UnrollHole(
        image=Image(pixels, ("R", "G", "B", USABLE)),
        guide=detail,
        keep=keep,
        positions=(positions + first).astype(np.float32),
        chart=chart[inside].astype(np.float32),
        jacobian=np.ascontiguousarray(jacobian[box]),
        hole=np.ascontiguousarray(hole[box]),
        corner=corner,
    )


def _box(mask: Mask) -> tuple[slice, slice]:
    """Bounding box."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _placed(
    chart: Float64[np.ndarray, "h w 2"], shown: Mask, hole: Mask, params: UnrollHoleParams
) -> tuple[int, int]:
    """Shift positions so that the flat image begins at 0; its height and width."""
    low, high = chart[hole].min(axis=0), chart[hole].max(axis=0)
    side = float((high - low).max())
    margin = min(max(_MIN_CONTEXT, params.context * side), (params.max_side - side) / 2)
    low = np.floor(np.maximum(low - margin, chart[shown].min(axis=0)))
    high = np.ceil(np.minimum(high + margin, chart[shown].max(axis=0)))
    chart -= low
    return int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1


def _blurred(values: Float32[np.ndarray, "rows columns k"], seen: Mask, sigma: float) -> np.ndarray:
    """Means of the pixels that are seen."""

    planes = np.concatenate([values * seen[..., None], seen[..., None]], axis=2, dtype=np.float32)
    planes = gaussian_blur(planes, sigma, "zero")
    return np.asarray(planes[..., :-1] / np.maximum(planes[..., -1:], 1e-6))


def _detail(
    color: Float32[np.ndarray, "rows columns 3"], seen: Mask, sigma: float
) -> Float32[np.ndarray, "rows columns 1"]:
    """Mean contrast of neighbouring pixels around each, octaves; interpolated where nothing is seen."""
    logs = log(np.maximum(color, 0).mean(axis=2) + np.float32(_DARK))
    steps = np.hypot(*np.gradient(logs))[..., None].astype(np.float32)
    inner = seen.copy()  # away from what else the photograph shows
    for axis in (0, 1):
        inner &= np.roll(seen, 1, axis) & np.roll(seen, -1, axis)
    inner = inner if inner.any() else seen
    octaves = log2(_blurred(steps, inner, sigma) + np.float32(1e-4)).astype(np.float32)
    return pull_push(octaves, inner.astype(np.float32))


def _evened(
    color: Float32[np.ndarray, "rows columns 3"], seen: Mask, sigma: float, share: float
) -> Float32[np.ndarray, "rows columns 3"]:
    """Colours divided by a power of the slow light of the pixels that are seen."""
    logs = log(np.maximum(color, 0) + np.float32(_DARK))
    light = _blurred(logs, seen, sigma) - logs[seen].mean(axis=0)
    even = exp(logs - np.float32(share) * light) - np.float32(_DARK)
    return np.asarray(np.clip(even, 0, 4), np.float32)
