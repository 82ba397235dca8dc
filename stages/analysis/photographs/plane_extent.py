"""How far a plane goes on beyond its outermost lines: as far as its texture does."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64

from texloom.stages.analysis.photographs import bezier
from texloom.stages.analysis.photographs.geometry import patch_of_plane
from texloom.stages.common.features.line_segments import Frame, Segments
from texloom.stages.kernels.core.elementary_functions import arctan2, log
from texloom.stages.numerics.filters import gaussian_blur, gradients
from texloom.stages.numerics.matrices import inverse_of, matrix_product
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.color import lab_from_linear

_BEYOND = 1.5  # sizes of the rectangle, to each side: the farthest that is looked at
_SIDE = 128  # px of the rectangle's longer side from the front
_WINDOWS = 5.0  # along its shorter side, in which looks are compared
_MIN_WINDOW = 8.0  # px
_MAX_DEPTH = 1.6  # relative to the rectangle's middle: what is farther would make the texture coarser
_SCALES = (6.0, 6.0, 6.0, 0.3, 0.3)  # of colours, CIELAB, and of logarithms of mean gradients, that count alike
_NOISE = 0.5  # CIELAB for a px, added to mean gradients
_UNLIKE = 2.0  # times the usual distance of the rectangle's parts from each other
_USUAL = 0.5  # of that distance, added: even textures
_EXPLAINED = 0.75  # share of a strip that looks like the rectangle
_STRAIGHT = np.radians(3.0)  # of a side: lines along it
_LINED = 0.5  # share of straight lines in the rectangle, from which strips must have them too
_AS_STRAIGHT = 0.55  # of that share
_MIN_LINES = 0.2  # length of the lines in a strip that tell, in lengths of the strip
_MIN_SHOWN = 0.6  # share of a strip that the photograph shows


@dataclass(frozen=True)
class _Front:
    """The plane from the front, in windows around the rectangle."""

    looks: Float32[np.ndarray, "rows columns 5"]
    shown: Mask
    inside: Mask
    """in the rectangle"""
    bounds: tuple[int, int, int, int]
    """of the rectangle, windows: top, bottom, left, right"""
    lines: Float64[np.ndarray, "rows columns 2"]
    """length of straight lines, and of all, windows"""
    steps: tuple[float, float]
    """from one window to the next, down and across, in sizes of the rectangle"""


@dataclass(frozen=True)
class Extent:
    """A rectangle on a plane."""

    corners: Float64[np.ndarray, "4 2"]
    """row and column, px, clockwise from the texture's origin"""
    share: float
    """its size from the front, relative to the given rectangle"""


def extended(image: Image, corners: Float64[np.ndarray, "4 2"], segments: Segments) -> Extent:
    """The rectangle on a plane with what goes on around it.

    Each side moves outwards while most of the next strip looks, in colour and in the strength of its gradients in
    both directions, like some part of the rectangle; parts of the rectangle that no other is like explain nothing.
    Its lines must be about as often straight as those of the rectangle: another wall of the same bricks has lines
    that are not.

    Parameters
    ----------
    corners : row and column, px, clockwise from the texture's origin.
    segments : all line segments of the photograph.

    References
    ----------
    Ours.
    """
    front = _front(image, corners, segments)
    if front is None:
        return Extent(corners, 1.0)
    explained = _explained(front)
    top, bottom, left, right = _grown(front, explained)
    first = np.array([front.bounds[0] - top, front.bounds[2] - left]) * front.steps
    last = np.array([bottom - front.bounds[1], right - front.bounds[3]]) * front.steps
    low, high = -first, 1 + last
    square = np.array([[*low, 1], [low[0], high[1], 1], [*high, 1], [high[0], low[1], 1]])
    there = matrix_product(square, bezier.homography(corners).T)
    if not (there[:, 2] > 0).all():
        return Extent(corners, 1.0)
    return Extent(there[:, :2] / there[:, 2:], float(np.prod(high - low)))


def _grown(front: _Front, explained: Bool[np.ndarray, "rows columns"]) -> tuple[int, int, int, int]:
    """The rectangle's bounds, top, bottom, left and right, as far as windows beyond them are explained."""
    bounds = list(front.bounds)
    ended = [False] * 4
    straight, lines = front.lines[front.inside].sum(axis=0).tolist()
    usual = straight / max(lines, 1e-9)
    lined = usual >= _LINED

    def strip(side: int) -> tuple[slice, slice]:
        top, bottom, left, right = bounds
        first = max(bounds[side] - (1 - side % 2), 0)
        across = slice(first, first + 1)
        return (across, slice(left, right)) if side < 2 else (slice(top, bottom), across)

    def goes_on(side: int) -> bool:
        beyond = strip(side)
        shown = front.shown[beyond]
        if not shown.size or bounds[side] == 0 or shown.mean() < _MIN_SHOWN:
            return False
        straight, lines = front.lines[beyond].sum(axis=(0, 1)).tolist()
        bent = lined and lines >= _MIN_LINES * shown.size and straight < _AS_STRAIGHT * usual * lines
        ended[side] = bent or bool(explained[beyond][shown].mean() < _EXPLAINED)
        return not ended[side]

    moved = True
    while moved:
        moved = False
        for side in range(4):
            if goes_on(side):
                bounds[side] += 2 * (side % 2) - 1
                moved = True
    # Where another surface begins, the last windows reach into it.
    for side in range(4):
        if ended[side] and bounds[side] != front.bounds[side]:
            bounds[side] -= 2 * (side % 2) - 1
    top, bottom, left, right = bounds
    return top, bottom, left, right


def _front(image: Image, corners: Float64[np.ndarray, "4 2"], segments: Segments) -> _Front | None:
    """None where the rectangle is too narrow to tell what its texture is."""
    from texloom.stages.kernels.core.resample import sampled

    shape = (image.height, image.width)
    patch = patch_of_plane(corners, shape)
    if patch is None:
        return None
    size = np.array(patch.size) * _SIDE / max(patch.size)
    window = max(_MIN_WINDOW, float(size.min()) / _WINDOWS)
    if size.min() < 2 * window:
        return None
    counts = np.rint(2 * size / window).astype(int)  # half windows along the rectangle
    around = np.ceil(_BEYOND * counts).astype(int)
    spans = [(np.arange(round(side * (1 + 2 * reach))) + 0.5) / side - reach
             for side, reach in zip(size, around / counts, strict=True)]  # fmt: skip
    u, v = np.meshgrid(*spans, indexing="ij")
    homography = bezier.homography(corners)
    places = matrix_product(np.stack([u, v, np.ones_like(u)], axis=2), homography.T)
    depth = places[..., 2]
    middle = float(matrix_product(np.array([0.5, 0.5, 1.0]), homography[2]))
    near = (depth > 0) & (depth <= _MAX_DEPTH * middle)
    flat = places[..., :2] / np.where(near, depth, 1)[..., None]
    shown = near & ((flat >= 0) & (flat <= np.array(shape) - 1)).all(axis=2)
    flat = np.where(shown[..., None], flat, 0)
    lab = lab_from_linear(sampled(image.color, flat)).astype(np.float32)
    lightness = np.where(shown, lab[..., 0], lab[shown][:, 0].mean()).astype(np.float32)
    # A slope across the border of what is shown is none of the texture's.
    within = shown & (gaussian_blur(shown.astype(np.float32), 1.0) > 0.99)
    weight = np.maximum(gaussian_blur(within.astype(np.float32), window / 2), np.float32(1e-6))

    def averaged(plane: np.ndarray) -> np.ndarray:
        return np.asarray(gaussian_blur(np.where(within, plane, 0).astype(np.float32), window / 2) / weight)

    colors = [averaged(lab[..., channel]) for channel in range(3)]
    slopes = [log(averaged(np.abs(slope) / 32) + np.float32(_NOISE)) for slope in gradients(lightness)]
    looks = np.stack([*colors, *slopes], axis=2) / np.array(_SCALES, np.float32)
    steps = 1 / counts
    at = [((np.arange(count + 2 * reach) + 0.5) * side / count).astype(int)
          for count, reach, side in zip(counts, around, size, strict=True)]  # fmt: skip
    chosen = np.ix_(*(np.minimum(index, limit - 1) for index, limit in zip(at, u.shape, strict=True)))
    seen = np.asarray(shown[chosen])
    top, left = around.tolist()
    bottom, right = (around + counts).tolist()
    inside = np.zeros_like(seen)
    inside[top:bottom, left:right] = True
    return _Front(
        looks=looks[chosen].astype(np.float32),
        shown=seen,
        inside=inside,
        bounds=(top, bottom, left, right),
        lines=_lines(Frame(shape).pixels(segments.ends), corners, size, (counts, around)),
        steps=(float(steps[0]), float(steps[1])),
    )


def _lines(
    ends: Float64[np.ndarray, "n 2 2"],
    corners: Float64[np.ndarray, "4 2"],
    size: Float64[np.ndarray, "2"],
    grid: tuple[np.ndarray, np.ndarray],
) -> Float64[np.ndarray, "rows columns 2"]:
    """Length of straight lines, and of all, in each window, by where their middles are."""
    counts, around = grid
    flat = matrix_product(
        np.concatenate([ends, np.ones((*ends.shape[:2], 1))], axis=2), inverse_of(bezier.homography(corners)).T
    )
    flat = flat[(flat[..., 2] > 0).all(axis=1)]
    places = flat[..., :2] / flat[..., 2:] * counts
    at = np.floor(places.mean(axis=1)).astype(int) + around
    sides = counts + 2 * around
    within = ((at >= 0) & (at < sides)).all(axis=1)
    at, along = at[within], np.abs(places[within, 1] - places[within, 0])
    down, across = (along * size / counts).T
    straight = arctan2(np.minimum(down, across), np.maximum(down, across)) < _STRAIGHT
    lengths = np.hypot(*along.T)
    sums = np.zeros((*sides, 2))
    np.add.at(sums, (at[:, 0], at[:, 1]), np.stack([lengths * straight, lengths], axis=1))
    return sums


def _explained(front: _Front) -> Bool[np.ndarray, "rows columns"]:
    """Windows that look like some of the rectangle."""
    own = front.inside & front.shown
    places, looks = np.argwhere(own), front.looks[own]
    if len(places) < 9:
        return np.zeros_like(own)
    apart = np.abs(places[:, None] - places).max(axis=2) > 2
    between = np.sqrt(np.square(looks[:, None] - looks).sum(axis=2))
    nearest = np.where(apart, between, np.inf).min(axis=1)
    limit = _UNLIKE * (float(np.median(nearest)) + _USUAL) if np.isfinite(nearest).any() else 0.0
    looks = looks[nearest <= limit]
    if not len(looks):
        return np.zeros_like(own)
    away = np.stack([np.sqrt(np.square(looks - row[:, None]).sum(axis=2)).min(axis=1) for row in front.looks])
    return np.asarray(away <= limit)
