"""Whether a result that wraps holds whole periods of its lattice; else cells at its border have a wrong length."""

import numpy as np

from texloom.stages.common.regularity.lattice_cells import steps_along
from texloom.stages.evaluation._measures.pictures import UnmeasurableError
from texloom.stages.evaluation._measures.table import Figures
from texloom.stages.vocabulary.arrays import Vectors
from texloom.stages.vocabulary.facts import Wraps

_GOOD, _BAD = 0.1, 0.35  # periods; a lattice that is known to within a few per cent of a period misses by the first
_MIN_PERIODS = 2.0  # of a side that is measured


def period_misfit(generators: Vectors, sides: tuple[int, int], wraps: Wraps) -> Figures:
    """Periods by which the sides along which a result wraps miss whole ones; the worse of these sides.

    Parameters
    ----------
    generators : of the lattice of the result, two rows of px, or one at right angles to its courses.
    sides : height and width, px.

    Raises
    ------
    UnmeasurableError
        The result does not wrap, or no side along which it does shows two periods.
    """
    if not len(generators):
        raise UnmeasurableError("no lattice was found")
    periods = steps_along(generators.astype(np.float64)) * np.array(sides, float)[:, None]
    known = np.abs(periods).max(axis=1) >= _MIN_PERIODS
    counted = periods[known & np.array(wraps)]
    if not len(counted):
        raise UnmeasurableError("it does not wrap around along a side with two periods or more")
    misses = [float(np.abs(row - np.rint(row)).max()) for row in counted]
    return Figures(max(misses), _GOOD, _BAD, {"periods": [float(np.abs(row).max()) for row in counted]})
