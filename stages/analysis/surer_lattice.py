"""The surer of two lattices that were found in different ways."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Float32
from pydantic import Field as Knob

from stages.arrays import Channels, Vectors
from stages.declare import Params, stage

_EQUAL = 0.015  # difference in confidence that means nothing


class SurerLatticeParams(Params):
    """When a lattice is trusted."""

    confidence: float = Knob(0.4, ge=-1, le=1)
    """correlation of the exemplar with itself, displaced by the generators, from which a lattice is trusted if it
    stands out at all"""
    significance: float = Knob(5.5, ge=0, le=100)
    """significance from which a lattice of less confidence is trusted too; see `lattice`"""


@dataclasses.dataclass(frozen=True)
class SurerLattice:
    """The lattice, or none."""

    generators: Vectors
    """of the surer lattice, px; no rows where neither is trusted"""
    best: Annotated[Float32[np.ndarray, "tried 2"], Channels(("row", "column"))]
    """the same, whether it is trusted or not"""
    confidence: float
    """of ``best``, -1..1"""
    significance: float
    """of ``best``"""
    chosen: str
    """`first`, `second`, or `none`"""


@dataclasses.dataclass(frozen=True)
class _Found:
    name: str
    generators: Vectors
    confidence: float
    significance: float

    @property
    def cell(self) -> float:
        """px squared"""
        return abs(float(np.linalg.det(self.generators.astype(np.float64))))


@stage(version=1)
def surer_lattice(
    first: Vectors,
    first_confidence: float,
    first_significance: float,
    second: Annotated[Float32[np.ndarray, "other 2"], Channels(("row", "column"))],
    second_confidence: float,
    second_significance: float,
    params: SurerLatticeParams,
) -> SurerLattice:
    """Take that of two lattices of an exemplar which it resembles itself by most.

    Of two that are about as sure it is that of the smaller cells: a lattice's every second row is a lattice too.
    Where the exemplar resembles itself by neither much, it is the more significant one.

    Parameters
    ----------
    first, second : generators, trusted or not, as ``best`` of `lattice`; no rows where nothing was found. The first
        may also be trusted where it has too few points to be significant.
    first_confidence, second_confidence, first_significance, second_significance : as `lattice` gives them.

    References
    ----------
    [Kaspar2015]_ section 4.1 and [Liu2004]_ each find a lattice; that one is asked where the other fails is ours.
    """
    both = (
        _Found("first", first, first_confidence, first_significance),
        _Found("second", second, second_confidence, second_significance),
    )
    found = [one for one in both if len(one.generators)]
    if not found:
        return SurerLattice(np.zeros((0, 2), np.float32), np.zeros((0, 2), np.float32), 0.0, 0.0, "none")
    likely = [
        one
        for one in found
        if one.confidence >= params.confidence and (one.name == "first" or one.significance > 0)
    ]
    if likely:
        surest = max(one.confidence for one in likely)
        best = min((one for one in likely if one.confidence >= surest - _EQUAL), key=lambda one: one.cell)
    else:
        best = max(found, key=lambda one: one.significance)
    trusted = bool(likely) or best.significance >= params.significance
    none = np.zeros((0, 2), np.float32)
    return SurerLattice(
        best.generators if trusted else none,
        best.generators,
        best.confidence,
        best.significance,
        best.name if trusted else "none",
    )
