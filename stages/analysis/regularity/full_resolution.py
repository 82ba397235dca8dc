"""Generators of a lattice that was found in a reduced picture, refined in the picture itself."""

import numpy as np
from jaxtyping import Float64

from texloom.stages.common.regularity.lattice_cells import reduced
from texloom.stages.kernels.core.threads import run_all
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import cubic_spline, least_squares, matrix_product, rank
from texloom.stages.vocabulary.arrays import Mask, ScalarMap

_MOST_STEPS = 16  # along a generator
_MIN_OVERLAP = 0.2  # of the picture with its shifted copy
_PARTS = 2  # of the longest steps along a generator that are compared
_MIN_POINTS = 3
_PARTS_OF_PIXELS = 64  # to which places are exact
_PASSES = ((6, 1 << 21), (3, 1 << 23))
# px around expected places, at most, and pixels that are compared at each shift, for all places together


def refined_in_full(
    plane: ScalarMap, valid: Mask | None, generators: np.ndarray, step: int
) -> Float64[np.ndarray, "2 2"]:
    """The generators at whose distant lattice points the picture is most like itself; the same where none do.

    The picture is compared at few lattice points, but at all pixels of many rows: generators found in means over
    squares of ``step`` px are off by a share of such a square at the most distant point.

    Parameters
    ----------
    plane : what repeats, at full size; changed in place.
    valid : false for excluded pixels, which have no influence; none where all are valid.
    generators : px of ``plane``.
    """
    _without_shading(plane, valid, step)
    best = reduced(generators)
    for most, samples in _PASSES:
        steps = _distant_steps(plane.shape, best)
        if len(steps) < _MIN_POINTS:
            return best
        reach = max(3, min(step + 1, most))
        calls = [(plane, matrix_product(number, best), reach, samples // len(steps)) for number in steps]
        found = [entry for entry in zip(steps, run_all(_peak, calls), strict=True) if entry[1] is not None]
        if len(found) < _MIN_POINTS or rank(np.array([number for number, _ in found])) < 2:
            return best
        steps = np.array([number for number, _ in found], np.float64)
        places = np.array([peak[:2] for _, peak in found])
        weight = np.sqrt([peak[2] for _, peak in found])[:, None]
        best = least_squares(steps * weight, places * weight)
    return np.asarray(best)


def _without_shading(plane: ScalarMap, valid: Mask | None, step: int) -> None:
    """Subtract what is smooth at the scale of an eighth of the picture; excluded pixels become 0."""
    import cv2

    step *= 4  # shading is smooth
    height, width = (side // step for side in plane.shape)
    small = cv2.resize(plane, (width, height), interpolation=cv2.INTER_AREA)
    smooth = gaussian_blur(small, min(small.shape) / 8)
    plane -= cv2.resize(smooth, plane.shape[::-1], interpolation=cv2.INTER_LINEAR)
    if valid is not None:
        plane[~valid] = 0


def _distant_steps(shape: tuple[int, int], generators: np.ndarray) -> Float64[np.ndarray, "n 2"]:
    """Steps along the generators in a half plane, as far from the origin as the picture still overlaps itself."""
    around = np.arange(-_MOST_STEPS, _MOST_STEPS + 1)
    steps = np.stack(np.meshgrid(around[_MOST_STEPS:], around, indexing="ij"), axis=2).reshape(-1, 2)
    steps = steps[(steps[:, 0] > 0) | (steps[:, 1] > 0)]
    left = 1 - np.abs(matrix_product(steps, generators)) / np.array(shape)
    steps = steps[(left > 0).all(axis=1) & (left.prod(axis=1) >= _MIN_OVERLAP)]
    if not len(steps):
        return np.zeros((0, 2))
    parts = np.maximum(1, -(-np.abs(steps).max(axis=0) // _PARTS))
    return np.asarray(steps[(steps % parts == 0).all(axis=1)], np.float64)


def _peak(plane: ScalarMap, expected: np.ndarray, reach: int, samples: int) -> Float64[np.ndarray, "3"] | None:
    """Place and height of the maximal correlation within ``reach`` px; None where it is no peak."""
    from texloom.stages.kernels.lattice.shifted_products import shifted_products

    middle = np.rint(expected).astype(np.int64)
    shifts = middle[:, None] + np.arange(-reach, reach + 1)
    rows = np.arange(max(0, -shifts[0, 0]), min(plane.shape[0], plane.shape[0] - shifts[0, -1]))
    # Odd, for rows of all phases of JPEG's blocks.
    every = 1 | max(1, rows.size * (plane.shape[1] - abs(int(middle[1]))) // samples)
    sums = np.zeros((shifts.shape[1], shifts.shape[1], 3))
    shifted_products(plane, rows[every // 2 :: every], shifts[0], shifts[1], sums)
    correlation = sums[..., 0] / np.sqrt(np.maximum(sums[..., 1] * sums[..., 2], 1e-12))
    row, column = np.unravel_index(int(np.argmax(correlation)), correlation.shape)
    if correlation[row, column] <= 0 or {row, column} & {0, 2 * reach}:
        return None
    # The spline at parts of pixels, less than one from the highest value.
    near = []
    for place in (row, column):
        correlation = cubic_spline(correlation, _PARTS_OF_PIXELS, (len(correlation) - 1) * _PARTS_OF_PIXELS + 1).T
        near.append(np.s_[(place - 1) * _PARTS_OF_PIXELS : (place + 1) * _PARTS_OF_PIXELS + 1])
    part = correlation[near[0], near[1]]
    down, right = np.unravel_index(int(np.argmax(part)), part.shape)
    away = np.array([row - 1, column - 1]) + np.array([down, right]) / _PARTS_OF_PIXELS
    return np.array([*(shifts[:, 0] + away), part[down, right]])
