"""The displacements by which an exemplar repeats, to a fraction of a pixel."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float64
from pydantic import Field

from texloom.stages.analysis.lattice import usable_lightness
from texloom.stages.arrays import Image, Vectors
from texloom.stages.common.lattice_cells import reduced
from texloom.stages.declare import Params, stage
from texloom.stages.masks import usable_pixels

_OVERLAP = 0.2  # share of the exemplar that must lie on itself where it is displaced
_MOST = 16  # repetitions along a generator that are looked at
_FIRST = 0.25  # of a generator's length, by which it may be wrong
_FINEST = 1 / 64  # px by which all displacements together are still moved
_WAYS = tuple((which, side, sign) for which in (0, 1) for side in (0, 1) for sign in (-1, 1))


class RepetitionParams(Params):
    """When displacements are believed."""

    correlation: float = Field(0.1, ge=-1, le=2)
    """least mean correlation of the exemplar with itself at all repetitions; none reaches 2"""


@dataclasses.dataclass(frozen=True)
class Repetition:
    """By what the exemplar repeats, if it does."""

    generators: Vectors
    """two displacements, px, to about a hundredth; no rows where the exemplar does not repeat by them"""
    correlation: float
    """mean at all repetitions that lie on the exemplar well enough, -1..1; 0 without any"""


@stage(version=1)
def repetition(image: Image, generators: Vectors, params: RepetitionParams) -> Repetition:
    """Fit the generators of a lattice to an exemplar, so that they hold across all of it.

    Generators are moved until the exemplar resembles itself most where it is displaced by them, by twice as much,
    and so on, from few repetitions to many. Masked pixels are not looked at.

    Parameters
    ----------
    generators : about, as from `lattice_selection`; no rows, and there is nothing to fit.

    References
    ----------
    Ours.
    """
    none = Repetition(np.zeros((0, 2), np.float32), 0.0)
    if not len(generators):
        return none
    correlated = _correlation(image)
    found, value, reach = reduced(generators), 0.0, 1
    while reach <= _MOST:
        step = _FIRST * float(np.hypot(*found[0])) / reach
        value = _mean(*correlated, found, reach)
        while step * reach > _FINEST:
            moved = [_moved(found, way, step) for way in _WAYS]
            values = [_mean(*correlated, one, reach) for one in moved]
            best = int(np.argmax(values))
            if values[best] > value:
                found, value = moved[best], values[best]
            else:
                step /= 2
        reach *= 2
    if value < params.correlation:
        return dataclasses.replace(none, correlation=value)
    return Repetition(reduced(found).astype(np.float32), value)


def _correlation(image: Image) -> tuple[Float64[np.ndarray, "rows columns"], Bool[np.ndarray, "rows columns"]]:
    """Of lightness with itself where it is displaced, (0, 0) in the middle, as splines; and where that is known."""
    import cv2
    from scipy.ndimage import spline_filter

    usable = usable_pixels(image)
    here = np.ones((image.height, image.width), np.float32) if usable is None else usable.astype(np.float32)
    wide = min(here.shape) / 8
    light = usable_lightness(image)
    # without shading that changes over an eighth of the picture
    around = cv2.GaussianBlur(light * here, (0, 0), wide) / np.maximum(cv2.GaussianBlur(here, (0, 0), wide), 1e-3)
    fine = (light - around) * here
    shape = 2 * here.shape[0], 2 * here.shape[1]
    product, overlap = (np.fft.irfft2(np.abs(np.fft.rfft2(part, shape)) ** 2, shape) for part in (fine, here))
    variance = float(product[0, 0] / overlap[0, 0])
    mean = product / np.maximum(overlap, 1) / max(variance, 1e-12)
    known = overlap >= _OVERLAP * overlap[0, 0]
    return spline_filter(np.fft.fftshift(np.where(known, mean, 0))), np.fft.fftshift(known)


def _mean(
    correlation: Float64[np.ndarray, "rows columns"],
    known: Bool[np.ndarray, "rows columns"],
    generators: np.ndarray,
    reach: int,
) -> float:
    """At up to ``reach`` repetitions along both generators, where it is known; -1 if nowhere."""
    from scipy.ndimage import map_coordinates

    steps = np.array([(i, j) for i in range(reach + 1) for j in range(-reach, reach + 1) if (i, j) > (0, 0)])
    places = steps @ generators + np.array(known.shape) // 2
    rows, columns = np.rint(places).astype(int).T
    inside = (rows >= 0) & (rows < known.shape[0]) & (columns >= 0) & (columns < known.shape[1])
    inside[inside] = known[rows[inside], columns[inside]]
    if not inside.any():
        return -1.0
    return float(map_coordinates(correlation, places[inside].T, prefilter=False).mean())


def _moved(generators: np.ndarray, way: tuple[int, int, int], step: float) -> np.ndarray:
    which, side, sign = way
    moved = generators.copy()
    moved[which, side] += sign * step
    return moved
