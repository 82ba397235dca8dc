"""Orientation fields: doubled-angle vectors, smoothing, diffusion and visualisation.

An orientation is an angle a in radians, 0..pi, from along a row (columns growing) towards growing rows. Since a and
a + pi are equal, sums are over doubled-angle vectors (cos 2a, sin 2a), whose length is the confidence.
"""

from typing import TypeAlias

import numpy as np
from jaxtyping import Float32

from texloom.stages.kernels.core.elementary_functions import arctan2, cos, exp, power, sin
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.kernels.core.threads import run_spans
from texloom.stages.numerics.filters import gaussian_blur, gradients
from texloom.stages.numerics.matrices import solve_symmetric
from texloom.stages.vocabulary.arrays import ColorField, Image, ScalarMap
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import NOWHERE, Wraps

Doubled: TypeAlias = Float32[np.ndarray, "h w 2"]
"""(cos 2a, sin 2a) of an orientation a, times its confidence, 0..1"""

_MIN_COVER = 0.5  # of a pixel that belongs to a stroke, as a share of the largest
_MAX_SIDE = 192  # px; of the grid on which a field is diffused
_PIECES = 16
_ALIKE = 1024  # steps in which weights of differences are tabulated
_NEGLIGIBLE = 16.0  # minus the logarithm of a weight that counts as 0
_STREAK = 14  # px to both sides, of the lines in a picture of a field


def doubled(angle: ScalarMap, confidence: ScalarMap) -> Doubled:
    """Orientations as doubled-angle vectors."""
    return np.stack([confidence * cos(2 * angle), confidence * sin(2 * angle)], axis=2).astype(np.float32)


def angle_of(vectors: Doubled) -> ScalarMap:
    """Orientations of doubled-angle vectors, 0..pi."""
    angle = arctan2(vectors[..., 1], vectors[..., 0]) / 2
    return np.asarray(np.where(angle < 0, angle + np.pi, angle), np.float32)


def length_of(vectors: Doubled) -> ScalarMap:
    """Confidence of doubled-angle vectors."""
    return np.asarray(np.hypot(vectors[..., 0], vectors[..., 1]), np.float32)


def unit(vectors: Doubled) -> Doubled:
    """The same orientations with length 1; (1, 0) for vectors of length 0."""
    length = length_of(vectors)[..., None]
    return np.asarray(np.where(length > 1e-9, vectors / np.maximum(length, 1e-9), [1.0, 0.0]), np.float32)


def gradient_tensor(down: Float32[np.ndarray, "h w"], across: Float32[np.ndarray, "h w"]) -> np.ndarray:
    """Doubled-angle vectors perpendicular to gradients, times their squared length, and that length; (h, w, 3)."""
    # Perpendicular vectors, doubled, point the opposite way.
    return np.dstack([down**2 - across**2, -2 * down * across, down**2 + across**2])


def painted(strokes: Image, radius: float) -> tuple[Doubled, ScalarMap]:
    """The orientation of the nearest stroke, and its weight at each pixel: 1 on it, less within ``radius`` px.

    Raises
    ------
    InputError : nothing is painted, or everything.
    """
    import cv2

    cover = (
        strokes.pixels[..., strokes.channels.index("A")] if "A" in strokes.channels else strokes.color.max(axis=2)
    )
    is_painted = cover >= _MIN_COVER * max(float(cover.max()), 1e-6)
    if cover.max() <= 0 or is_painted.all():
        raise InputError("strokes: nothing is painted; paint lines on a transparent layer or on black")
    soft = gaussian_blur(is_painted.astype(np.float32), 1.0)
    down, across = gradients(soft)
    tensor = gaussian_blur(gradient_tensor(down, across), 4.0)
    straight = tensor[..., :2] / np.maximum(tensor[..., 2:], 1e-9)
    distance, nearest = cv2.distanceTransformWithLabels(
        (~is_painted).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE, labelType=cv2.DIST_LABEL_PIXEL
    )
    along = np.zeros((int(nearest.max()) + 1, 2), np.float32)
    along[nearest[is_painted]] = unit(straight.astype(np.float32))[is_painted]
    return along[nearest], exp(-((distance / radius) ** 2)).astype(np.float32)


def smoothed(vectors: Doubled, guide: ColorField, sigma: float, color_sigma: float) -> Doubled:
    """Joint bilateral filter: means over near pixels of similar colour, weighted by confidence.

    Parameters
    ----------
    sigma : standard deviation of the weight by distance, px.
    color_sigma : standard deviation of the weight by colour, CIELAB units.
    """
    from texloom.stages.kernels.core.joint_bilateral import joint_bilateral

    radius = int(np.ceil(2 * sigma))
    offsets = np.stack(np.meshgrid(*[np.arange(-radius, radius + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    squared = (offsets**2).sum(axis=1)
    offsets, squared = offsets[squared <= radius**2], squared[squared <= radius**2]
    near = exp(-squared / (2 * sigma**2)).astype(np.float32)
    alike = exp(-np.arange(_ALIKE + 1) * (_NEGLIGIBLE / _ALIKE)).astype(np.float32)
    per_unit = np.float32(_ALIKE / _NEGLIGIBLE / (2 * color_sigma**2))
    beyond = [(0, 0), (radius, radius), (radius, radius)]
    values, planes = (np.pad(np.moveaxis(one, 2, 0), beyond, "reflect") for one in (vectors, guide))
    out = np.empty((2, *vectors.shape[:2]), np.float32)
    given = values, planes, offsets + radius, near, alike, per_unit, out
    run_spans(joint_bilateral, given, len(vectors), _PIECES)
    return np.ascontiguousarray(np.moveaxis(out, 0, 2))


def diffused(vectors: Doubled, stiffness: float) -> Doubled:
    """The smoothest field that agrees with the confident vectors; where none is, it solves Laplace's equation.

    Minimises the squared differences to ``vectors``, weighted by their length, plus ``stiffness`` times those
    between neighbours. Solved on a grid of up to 192 px a side and interpolated.
    """
    import cv2

    sparse = loaded("scipy.sparse")
    height, width = vectors.shape[:2]
    factor = min(1.0, _MAX_SIDE / max(height, width))
    rows, columns = max(1, round(height * factor)), max(1, round(width * factor))
    coarse = vectors if factor == 1 else cv2.resize(vectors, (columns, rows), interpolation=cv2.INTER_AREA)
    coarse = coarse.reshape(rows, columns, 2).astype(np.float64)
    weight = np.hypot(coarse[..., 0], coarse[..., 1]).ravel()
    if not weight.any():
        return np.zeros_like(vectors)
    number = np.arange(rows * columns).reshape(rows, columns)
    first = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    second = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    links = sparse.coo_array((np.ones(first.size), (first, second)), (number.size, number.size))
    links = (links + links.T).tocsc()
    laplacian = sparse.diags_array(np.asarray(links.sum(axis=0)).ravel()) - links
    system = (sparse.diags_array(weight + 1e-9 * stiffness) + stiffness * laplacian).tocsc()
    # The vectors are already multiplied by their weight.
    solved = solve_symmetric(system, coarse.reshape(-1, 2)).reshape(rows, columns, 2)
    solved = solved.astype(np.float32)
    return (
        solved if factor == 1 else np.asarray(cv2.resize(solved, (width, height), interpolation=cv2.INTER_LINEAR))
    )


def signed_angles(angle: ScalarMap, wrap: Wraps = NOWHERE) -> ScalarMap:
    """Angles modulo 2 pi of an orientation field modulo pi, with signs that agree between neighbours.

    Signs propagate along the minimum spanning tree of the differences between neighbouring and surrounding
    orientations, which keeps away from singularities, across which signs would be wrong. Where it wraps, pixels at
    opposite borders are neighbours too.
    """
    import cv2

    sparse = loaded("scipy.sparse")
    csgraph = loaded("scipy.sparse.csgraph")
    height, width = angle.shape
    step = max(1, max(height, width) // 128)
    coarse = angle[::step, ::step].astype(np.float64)
    number = np.arange(coarse.size).reshape(coarse.shape)
    links = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    links += [(number[:, 0], number[:, -1])] * wrap.across + [(number[0], number[-1])] * wrap.down
    first, second = (np.concatenate([link[end].ravel() for link in links]) for end in (0, 1))
    flat = coarse.ravel()
    around = cv2.blur(doubled(angle, np.ones_like(angle)), (4 * step + 1, 4 * step + 1))
    coherence = length_of(around)[::step, ::step].ravel()
    cost = 1.001 - np.abs(cos(flat[first] - flat[second])) * np.minimum(coherence[first], coherence[second])
    tree = csgraph.minimum_spanning_tree(sparse.coo_array((cost, (first, second)), (flat.size, flat.size)).tocsr())
    order, before = csgraph.breadth_first_order(tree, 0, directed=False)
    # whether a place turns: where the one before it keeps its sign, and where that turns
    places, others = order[1:], before[order[1:]]
    turns = [cos(flat[places] - (flat[others] + turn)) < 0 for turn in (0, np.pi)]
    is_turned = [False] * flat.size
    for place, other, *turn in np.stack([places, others, *turns], axis=1).tolist():
        is_turned[place] = bool(turn[is_turned[other]])
    flat[is_turned] += np.pi
    signed = cv2.resize(
        np.dstack([cos(flat), sin(flat)]).reshape(*coarse.shape, 2), (width, height),
        interpolation=cv2.INTER_NEAREST,
    )  # fmt: skip
    opposite = cos(angle) * signed[..., 0] + sin(angle) * signed[..., 1] < 0
    return np.asarray(np.where(opposite, angle + np.pi, angle), np.float32)


def completed(vectors: Doubled, stiffness: float) -> tuple[ScalarMap, ScalarMap]:
    """Orientations, 0..pi, diffused into pixels of low confidence as in `diffused`; and the confidence, 0..1."""
    confidence = np.clip(length_of(vectors), 0, 1)
    return angle_of(vectors + (1 - confidence)[..., None] ** 2 * unit(diffused(vectors, stiffness))), confidence


def streaks(angle: ScalarMap, length: int) -> ScalarMap:
    """Visualise an angle field by line integral convolution of noise, 0..1 [Cabral1993]_."""
    from texloom.stages.kernels.distortion.line_integral import convolve_lines

    noise = np.random.default_rng(0).random(angle.shape, np.float32)
    out = np.empty_like(noise)
    direction = np.stack([sin(angle), cos(angle)], axis=2)
    run_spans(convolve_lines, (noise, direction, length, out), angle.shape[0], _PIECES)
    # The mean of many values has a small spread, which is stretched.
    return np.asarray(np.clip(0.5 + (out - 0.5) * 0.9 * np.sqrt(2 * length + 1), 0, 1), np.float32)


def pictured(light: ColorField, angle: ScalarMap, confidence: ScalarMap) -> Image:
    """Line integral convolution of a field over a darkened picture, fainter where the confidence is low."""
    lines = streaks(angle, _STREAK)[..., None]
    contrast = (0.35 + 0.65 * np.sqrt(confidence))[..., None]
    shown = 0.25 * np.clip(light, 0, 1) + 0.6 * power(0.5 + (lines - 0.5) * contrast, 2.2)
    return Image(np.ascontiguousarray(shown, np.float32), ("R", "G", "B"))
