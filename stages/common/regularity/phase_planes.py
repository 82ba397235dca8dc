"""Planes that show where in its repetition a regular texture is, for syntheses under control."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Float64, Int64, UInt32

from texloom.stages.common.per_pixel.phases import fitted
from texloom.stages.kernels.core.elementary_functions import complex_product, cos, sin
from texloom.stages.numerics.matrices import determinant, inverse_of, matrix_product
from texloom.stages.vocabulary.arrays import Vectors
from texloom.stages.vocabulary.facts import Wraps

_BIN = 1.0  # px of a repetition over which control is averaged, at least
_MAX_BINS = 24  # along a generator
_MIN_CELLS = 2.0  # of an exemplar; fewer lack some phases at most values of control
_MAX_CONTRADICTION = 0.3  # share of control's variance that may be contradicted, beyond chance


class PhasePlanes(NamedTuple):
    """Phases as planes that are compared together with control, and vary as much."""

    own: Float32[np.ndarray, "h w 4"]
    """of the exemplar"""
    wanted: Float32[np.ndarray, "H W 4"]
    """of the result"""
    places: Float32[np.ndarray, "h w 2"]
    """rows and columns of the exemplar's pixels in a texture that repeats as the result does, px"""

    def after(
        self, own: Float32[np.ndarray, "h w k"], wanted: Float32[np.ndarray, "H W k"]
    ) -> tuple[Float32[np.ndarray, "h w all"], Float32[np.ndarray, "H W all"]]:
        """The planes of control of exemplar and result, and these."""
        return np.concatenate([own, self.own], axis=2), np.concatenate([wanted, self.wanted], axis=2)


def phase_planes(
    generators: Vectors,
    source: UInt32[np.ndarray, "h w 2"] | None,
    own: Float32[np.ndarray, "h w k"],
    wanted: Float32[np.ndarray, "H W k"],
    wrap: Wraps,
) -> PhasePlanes | None:
    """Cosine and sine of the phase along each of two generators, so that pieces of a regular texture are in step.

    The result's repetition is displaced so that control fits it best: a map of dirt shows the joints of the bricks
    that it lies on. None where control tells where things are, and has another repetition or none,
    and for an exemplar of less than two cells.

    Parameters
    ----------
    generators : the two displacements by which the texture repeats, px.
    source : where in that texture the exemplar's pixels come from, as of a compaction; none if it is the exemplar.
    own, wanted : control of the exemplar and of the result.
    wrap : where the result wraps; the repetition is fitted to it.
    """
    exact, size = generators.astype(np.float64), (wanted.shape[0], wanted.shape[1])
    places = _positions((own.shape[0], own.shape[1])) if source is None else source.astype(np.float64)
    result = _phases(_positions(size), fitted(exact, size, wrap))
    phases = _phases(places, exact)
    bins = np.clip(np.rint(np.hypot(*exact.T) / _BIN), 1, _MAX_BINS).astype(np.int64)
    means = (_means(phases, own, bins), _means(result, wanted, bins))
    shift, contradicted = _displacement(*means)
    variance = float(own.var(axis=(0, 1)).sum())
    # Of n cells of unrelated control, the mean has a share of 1/n of the variance.
    cells = own.shape[0] * own.shape[1] / abs(float(determinant(exact)))
    if cells < _MIN_CELLS or contradicted > (_MAX_CONTRADICTION + 1 / cells) * variance:
        return None
    # Four planes that go from 0 to 1 have variances of 1/8.
    amplitude = float(np.sqrt(2 * variance))
    return PhasePlanes(
        _planes(phases + shift, amplitude),
        _planes(result, amplitude),
        (places + matrix_product(shift, exact)).astype(np.float32),
    )


def _positions(shape: tuple[int, int]) -> Float64[np.ndarray, "h w 2"]:
    """Row and column of every pixel."""
    return np.stack(np.meshgrid(*(np.arange(side, dtype=np.float64) for side in shape), indexing="ij"), axis=2)


def _phases(
    positions: Float64[np.ndarray, "h w 2"], generators: Float64[np.ndarray, "2 2"]
) -> Float64[np.ndarray, "h w 2"]:
    """How many of each generator lead there."""
    return np.asarray(np.einsum("hwi,ij->hwj", positions, inverse_of(generators)))  # no threads, as BLAS has


def _planes(phases: Float64[np.ndarray, "h w 2"], amplitude: float) -> Float32[np.ndarray, "h w 4"]:
    angles = 2 * np.pi * phases
    waves = np.concatenate([cos(angles), sin(angles)], axis=2)
    return np.asarray(0.5 * amplitude * (1 + waves), np.float32)


def _means(
    phases: Float64[np.ndarray, "h w 2"], control: Float32[np.ndarray, "h w k"], bins: Int64[np.ndarray, "2"]
) -> Float64[np.ndarray, "rows columns k"]:
    """Means of control at similar phases, less the mean of all."""
    rows, columns = np.moveaxis(np.rint(phases * bins).astype(np.int64) % bins, 2, 0)
    numbers, count = (rows * bins[1] + columns).ravel(), int(bins.prod())
    pixels = np.maximum(np.bincount(numbers, minlength=count), 1)
    varying = (control - control.mean(axis=(0, 1), dtype=np.float64)).reshape(-1, control.shape[2])
    sums = np.stack([np.bincount(numbers, plane, count) for plane in varying.T], axis=1)
    return np.asarray((sums / pixels[:, None]).reshape(*bins, -1))


def _displacement(
    own: Float64[np.ndarray, "rows columns k"], wanted: Float64[np.ndarray, "rows columns k"]
) -> tuple[Float64[np.ndarray, "2"], float]:
    """By which phases of the exemplar become those of the result where means of control are most similar, 0..1.

    And the variance of the exemplar's means that the result's lack there.
    """
    one, other = (np.fft.fft2(part, axes=(0, 1)) for part in (own, wanted))
    covariance = np.fft.ifft2(complex_product(one.conj(), other).sum(axis=2)).real / (own.shape[0] * own.shape[1])
    best = np.unravel_index(int(covariance.argmax()), covariance.shape)
    return np.array(best) / covariance.shape, float((own**2).sum()) / covariance.size - float(covariance[best])
