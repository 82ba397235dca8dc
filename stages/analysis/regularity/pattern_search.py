"""Generators of a lattice refined to a fraction of a pixel, by the autocorrelation at many lattice points."""

from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float64, Int64

from texloom.stages.kernels.core.elementary_functions import complex_product, cos, squared_size
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.vocabulary.arrays import Mask, ScalarMap

_MAX_REPETITIONS = 16  # along a generator
_MIN_OVERLAP = 0.2  # of the exemplar with its shifted copy, as a share of its pixels
_LAST_STEP = 1 / 64  # px, at the farthest repetition
_DIRECTIONS = tuple((generator, axis, sign) for generator in (0, 1) for axis in (0, 1) for sign in (-1, 1))

Correlation: TypeAlias = Float64[np.ndarray, "rows columns"]
Known: TypeAlias = Bool[np.ndarray, "rows columns"]


def autocorrelation_splines(plane: ScalarMap, valid: Mask | None) -> tuple[Correlation, Known]:
    """Cubic B-spline coefficients of the autocorrelation of a plane, (0, 0) at the centre, and where it is known.

    Shading at the scale of an eighth of the image is removed. Excluded pixels have no influence.

    Parameters
    ----------
    valid : false for excluded pixels; none where all are valid.
    """

    weight = np.ones(plane.shape, np.float32) if valid is None else valid.astype(np.float32)
    sigma = min(weight.shape) / 8
    total = np.maximum(gaussian_blur(weight, sigma), 1e-3)
    fine = (plane - gaussian_blur(plane * weight, sigma) / total) * weight
    shape = 2 * weight.shape[0], 2 * weight.shape[1]
    spectrum, power, mask = (np.fft.rfft2(part, shape) for part in (fine, fine**2, weight))
    product, overlap = (np.fft.irfft2(squared_size(part), shape) for part in (spectrum, mask))
    # Energy of either copy where they overlap; shares of an element at the border would move the maxima otherwise.
    energy = np.fft.irfft2(complex_product(power, mask.conj()), shape)
    other = np.roll(energy[::-1, ::-1], 1, (0, 1))
    mean = product / np.sqrt(np.maximum(energy * other, 1e-12))
    known = overlap >= _MIN_OVERLAP * overlap[0, 0]
    # At whole pixels a spline is (1, 4, 1) / 6 of its coefficients along each axis.
    down, across = ((2 + cos(2 * np.pi * np.fft.fftfreq(side))) / 3 for side in shape)
    response = np.outer(down, across[: shape[1] // 2 + 1])
    splines = np.fft.irfft2(np.fft.rfft2(np.where(known, mean, 0.0).astype(np.float64)) / response, shape)
    return np.fft.fftshift(splines), np.fft.fftshift(known)


def refined_generators(
    splines: Correlation, known: Known, generators: np.ndarray, first_step: float
) -> tuple[Float64[np.ndarray, "2 2"], float]:
    """The generators near others at which the mean autocorrelation is largest, and that mean.

    Maxima are searched at the lattice points of up to 1, 2, 4, ... repetitions in turn, each from the one before.

    Parameters
    ----------
    generators : reduced.
    first_step : of the search, at the nearest points, as a share of the shorter generator.
    """
    best, value, reach = generators.astype(np.float64), 0.0, 1
    while reach <= _MAX_REPETITIONS:
        step = first_step * float(np.hypot(*best.T).min()) / reach
        points = _known_points(known, best, reach)
        value = float(_means(splines, points, best[None])[0])
        while step * reach > _LAST_STEP:
            moved = np.stack([_moved(best, direction, step) for direction in _DIRECTIONS])
            values = _means(splines, points, moved)
            index = int(np.argmax(values))
            if values[index] > value:
                best, value = moved[index], float(values[index])
            else:
                step /= 2
        reach *= 2
    return best, value


def _known_points(known: Known, generators: np.ndarray, reach: int) -> Int64[np.ndarray, "n 2"]:
    """The steps of up to ``reach`` repetitions along both generators at which the autocorrelation is known."""
    steps = np.array([(i, j) for i in range(reach + 1) for j in range(-reach, reach + 1) if (i, j) > (0, 0)])
    rows, columns = np.rint(matrix_product(steps, generators) + np.array(known.shape) // 2).astype(int).T
    inside = (rows >= 0) & (rows < known.shape[0]) & (columns >= 0) & (columns < known.shape[1])
    inside[inside] = known[rows[inside], columns[inside]]
    return np.asarray(steps[inside])


def _means(
    splines: Correlation, steps: Int64[np.ndarray, "n 2"], generators: Float64[np.ndarray, "m 2 2"]
) -> np.ndarray:
    """Mean correlation at some steps of each pair of generators; -1 where there are none."""
    if not len(steps):
        return np.full(len(generators), -1.0)
    positions = (matrix_product(steps, generators) + np.array(splines.shape) // 2)[..., None]
    first = np.floor(positions)
    t = positions - first
    weights = (
        np.concatenate(
            [(1 - t) ** 2 * (1 - t), (3 * t - 6) * t**2 + 4, 3 * t * (1 + t - t**2) + 1, t**2 * t], axis=3
        )
        / 6
    )
    rows, columns = np.moveaxis(first.astype(int) + np.arange(-1, 3), 2, 0)
    values = splines[rows[..., None] % splines.shape[0], columns[..., None, :] % splines.shape[1]]
    down, across = np.moveaxis(weights, 2, 0)
    return np.asarray(np.einsum("mnij,mni,mnj->m", values, down, across)) / len(steps)


def _moved(generators: np.ndarray, direction: tuple[int, int, int], step: float) -> np.ndarray:
    generator, axis, sign = direction
    moved = generators.copy()
    moved[generator, axis] += sign * step
    return moved
