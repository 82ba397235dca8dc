"""Phases, in a repetition, of the places of an exemplar and of the pixels of a result."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int64, UInt32

from texloom.stages.kernels.per_pixel.arguments import PhaseMaps
from texloom.stages.numerics.matrices import determinant, inverse_of, matrix_product
from texloom.stages.vocabulary.facts import TORUS, Wraps

_WHOLE = 2.0**32  # of a phase
_PIXEL = 256  # units of a generator in a px


@dataclass(frozen=True)
class Phases:
    """Phases of a repeating exemplar, see `texloom.stages.kernels.per_pixel.arguments.PhaseMaps`."""

    places: UInt32[np.ndarray, "places 2"]
    """of every place, 2**-32 of each generator"""
    generators: Int64[np.ndarray, "4"]
    """rows and columns of the two, 1/256 px"""

    def repetition(self, wanted: UInt32[np.ndarray, "pixels 2"]) -> PhaseMaps:
        """For kernels; ``wanted`` at the pixels of the coarsest level."""
        first_down, first_across, second_down, second_across = (int(part) for part in self.generators)
        return PhaseMaps(wanted, self.places, (first_down, first_across, second_down, second_across))

    @property
    def exact(self) -> Float64[np.ndarray, "2 2"]:
        """The generators, px."""
        return np.asarray(self.generators.reshape(2, 2) / _PIXEL)

    def of_result(
        self, rows: np.ndarray, columns: np.ndarray, size: tuple[int, int] | None, wrap: Wraps = TORUS
    ) -> UInt32[np.ndarray, "rows columns 2"]:
        """Those of pixels of the endless result, or of one of so many px, around which all repetitions fit."""
        return _linear(rows, columns, self.exact if size is None else fitted(self.exact, size, wrap))

    def of_places(self, chart: Float32[np.ndarray, "rows columns 2"]) -> UInt32[np.ndarray, "rows columns 2"]:
        """Those of pixels that lie in the flat texture as ``chart`` says."""
        return _charted(chart, self.exact)


NO_PHASES = Phases(np.empty((0, 2), np.uint32), np.zeros(4, np.int64))
"""those of an exemplar that does not repeat"""


def fitted(
    generators: Float64[np.ndarray, "2 2"], size: tuple[int, int], wrap: Wraps
) -> Float64[np.ndarray, "2 2"]:
    """Generators that fit whole times around a result of so many px; the same where it is too small."""
    if not wrap:
        return generators
    times = matrix_product(np.diag(size), inverse_of(generators))
    times = np.where(np.array(wrap)[:, None], np.rint(times), times)
    return np.asarray(matrix_product(inverse_of(times), np.diag(size)) if determinant(times) else generators)


def _linear(rows: np.ndarray, columns: np.ndarray, generators: np.ndarray) -> UInt32[np.ndarray, "rows columns 2"]:
    """Of flat texture; in whole numbers, so that all distances of two pixels are of one phase."""
    share = np.rint(inverse_of(generators) * _WHOLE).astype(np.int64)
    cycles = rows.astype(np.int64)[:, None, None] * share[0] + columns.astype(np.int64)[:, None] * share[1]
    return (cycles % 2**32).astype(np.uint32)


def _charted(
    chart: Float32[np.ndarray, "rows columns 2"], generators: np.ndarray
) -> UInt32[np.ndarray, "rows columns 2"]:
    cycles = np.rint(matrix_product(chart.astype(np.float64), inverse_of(generators)) * _WHOLE).astype(np.int64)
    return (cycles % 2**32).astype(np.uint32)


def phases_of(
    generators: Float32[np.ndarray, "n 2"],
    shape: tuple[int, int],
    margin: int,
    chart: Float32[np.ndarray, "h w 2"] | None = None,
) -> Phases:
    """Those of an exemplar's places.

    Parameters
    ----------
    generators : two displacements by which the texture repeats, px of flat texture; no rows if it does not.
    shape, margin : of the exemplar, and around it, px.
    chart : where in the texture pixels are, if it is distorted.
    """
    if not len(generators):
        return NO_PHASES
    units = np.rint(generators.astype(np.float64) * _PIXEL).astype(np.int64)
    exact: Float[np.ndarray, "2 2"] = units / _PIXEL
    rows, columns = (np.arange(-margin, size + margin) for size in shape)
    if chart is None:
        phases = _linear(rows, columns, exact)
    else:
        phases = _charted(chart[np.clip(rows, 0, shape[0] - 1)][:, np.clip(columns, 0, shape[1] - 1)], exact)
    return Phases(phases.reshape(-1, 2), units.ravel())
