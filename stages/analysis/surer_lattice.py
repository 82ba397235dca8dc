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

    confidence: float = Knob(0.25, ge=-1, le=1)
    """correlation of the exemplar with itself, displaced by the generators, below which there is no lattice; lower
    than where a lattice only helps, since here nothing works without"""


@dataclasses.dataclass(frozen=True)
class SurerLattice:
    """The lattice, or none."""

    generators: Vectors
    """of the surer lattice, px; no rows where neither is sure enough"""
    best: Annotated[Float32[np.ndarray, "tried 2"], Channels(("row", "column"))]
    """the same, whether it is trusted or not"""
    confidence: float
    """of ``best``, -1..1"""
    chosen: str
    """`first`, `second`, or `none`"""


@stage(version=1)
def surer_lattice(
    first: Vectors,
    first_confidence: float,
    second: Annotated[Float32[np.ndarray, "other 2"], Channels(("row", "column"))],
    second_confidence: float,
    params: SurerLatticeParams,
) -> SurerLattice:
    """Take that of two lattices of an exemplar which it resembles itself by most.

    Of two that are about as sure it is that of the smaller cells: a lattice's every second row is a lattice too.

    Parameters
    ----------
    first, second : generators, trusted or not, as ``best`` of `lattice`; no rows where nothing was found.
    first_confidence, second_confidence : as ``confidence`` of `lattice`.

    References
    ----------
    [Kaspar2015]_ section 4.1 and [Liu2004]_ each find a lattice; that one is asked where the other fails is ours.
    """
    found = [(first_confidence, first, "first"), (second_confidence, second, "second")]
    found = [entry for entry in found if len(entry[1])]
    none = np.zeros((0, 2), np.float32)
    if not found:
        return SurerLattice(none, none, 0.0, "none")
    surest = max(entry[0] for entry in found)
    equals = [entry for entry in found if entry[0] >= surest - _EQUAL]
    confidence, best, chosen = min(equals, key=lambda entry: abs(float(np.linalg.det(entry[1].astype(np.float64)))))
    if confidence < params.confidence:
        return SurerLattice(none, best, confidence, "none")
    return SurerLattice(best, best, confidence, chosen)
