"""Lattice generators refined to a fraction of a pixel."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float64
from pydantic import Field

from texloom.stages.analysis.lattice import valid_lightness
from texloom.stages.arrays import Image, Vectors
from texloom.stages.common.lattice_cells import reduced
from texloom.stages.declare import Params, stage
from texloom.stages.masks import valid_pixels

_MIN_OVERLAP = 0.2  # of the exemplar with its shifted copy, as a share of its pixels
_MAX_REPETITIONS = 16  # along a generator
_FIRST_STEP = 0.25  # of the search, as a share of the shorter generator
_LAST_STEP = 1 / 64  # px, at the farthest repetition
_DIRECTIONS = tuple((generator, axis, sign) for generator in (0, 1) for axis in (0, 1) for sign in (-1, 1))


class RepetitionParams(Params):
    """When generators are accepted."""

    correlation: float = Field(0.1, ge=-1, le=2)
    """minimum mean correlation of the exemplar with itself at all repetitions; 2 accepts none"""


@dataclasses.dataclass(frozen=True)
class Repetition:
    """The refined generators, if they were accepted."""

    generators: Vectors
    """px, accurate to about 0.01; no rows where the exemplar does not repeat by them"""
    correlation: float
    """mean correlation at all repetitions with enough overlap, -1..1; 0 without generators"""


@stage(version=1)
def repetition(image: Image, generators: Vectors, params: RepetitionParams) -> Repetition:
    """Refine the generators of a lattice, so that they hold across the whole exemplar.

    A pattern search maximises the mean autocorrelation at the lattice points up to 1, 2, 4, ... repetitions of the
    generators. Excluded pixels have no influence.

    Parameters
    ----------
    image : the exemplar.
    generators : initial values, as from `lattice_selection`; with less than two rows there is nothing to refine.

    Raises
    ------
    InputError
        all pixels are excluded.

    References
    ----------
    Ours.
    """
    none = Repetition(np.zeros((0, 2), np.float32), 0.0)
    if len(generators) < 2:
        return none
    splines, known = _correlation(image)
    best, value, reach = reduced(generators), 0.0, 1
    while reach <= _MAX_REPETITIONS:
        step = _FIRST_STEP * float(np.hypot(*best[0])) / reach
        value = _mean(splines, known, best, reach)
        while step * reach > _LAST_STEP:
            moved = [_moved(best, direction, step) for direction in _DIRECTIONS]
            values = [_mean(splines, known, candidate, reach) for candidate in moved]
            index = int(np.argmax(values))
            if values[index] > value:
                best, value = moved[index], values[index]
            else:
                step /= 2
        reach *= 2
    if value < params.correlation:
        return dataclasses.replace(none, correlation=value)
    return Repetition(reduced(best).astype(np.float32), value)


def _correlation(image: Image) -> tuple[Float64[np.ndarray, "rows columns"], Bool[np.ndarray, "rows columns"]]:
    """Spline coefficients of the autocorrelation of lightness, (0, 0) at the centre, and where it is known."""
    import cv2
    from scipy.ndimage import spline_filter

    valid = valid_pixels(image)
    weight = np.ones((image.height, image.width), np.float32) if valid is None else valid.astype(np.float32)
    sigma = min(weight.shape) / 8
    lightness = valid_lightness(image)
    # Shading at the scale of an eighth of the image is removed.
    total = np.maximum(cv2.GaussianBlur(weight, (0, 0), sigma), 1e-3)
    fine = (lightness - cv2.GaussianBlur(lightness * weight, (0, 0), sigma) / total) * weight
    shape = 2 * weight.shape[0], 2 * weight.shape[1]
    product, overlap = (np.fft.irfft2(np.abs(np.fft.rfft2(part, shape)) ** 2, shape) for part in (fine, weight))
    variance = float(product[0, 0] / overlap[0, 0])
    mean = product / np.maximum(overlap, 1) / max(variance, 1e-12)
    known = overlap >= _MIN_OVERLAP * overlap[0, 0]
    return spline_filter(np.fft.fftshift(np.where(known, mean, 0))), np.fft.fftshift(known)


def _mean(
    splines: Float64[np.ndarray, "rows columns"],
    known: Bool[np.ndarray, "rows columns"],
    generators: np.ndarray,
    reach: int,
) -> float:
    """Mean correlation at up to ``reach`` repetitions along both generators; -1 where none is known."""
    from scipy.ndimage import map_coordinates

    steps = np.array([(i, j) for i in range(reach + 1) for j in range(-reach, reach + 1) if (i, j) > (0, 0)])
    positions = steps @ generators + np.array(known.shape) // 2
    rows, columns = np.rint(positions).astype(int).T
    inside = (rows >= 0) & (rows < known.shape[0]) & (columns >= 0) & (columns < known.shape[1])
    inside[inside] = known[rows[inside], columns[inside]]
    if not inside.any():
        return -1.0
    return float(map_coordinates(splines, positions[inside].T, prefilter=False).mean())


def _moved(generators: np.ndarray, direction: tuple[int, int, int], step: float) -> np.ndarray:
    generator, axis, sign = direction
    moved = generators.copy()
    moved[generator, axis] += sign * step
    return moved
