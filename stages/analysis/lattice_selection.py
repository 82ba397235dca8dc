"""The lattice of an exemplar by matched features and by autocorrelation, whichever of the two is surer."""

import dataclasses
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.analysis.autocorrelation import AutocorrelationParams, dominant_peaks
from texloom.stages.analysis.lattice import Lattice, LatticeParams, lattice_of, self_correlation, usable_lightness
from texloom.stages.arrays import Channels, Image, ScalarMap, Vectors
from texloom.stages.declare import Params, stage

_EQUAL = 0.015  # difference in confidence that means nothing
_LEAST = 2.0  # significance below which a lattice does not stand out at all
_BETA = 3.0  # of `lattice`: peaks of the autocorrelation are few, so hardly one may be left out


class LatticeSelectionParams(Params):
    """When a lattice is trusted."""

    confidence: float = Field(0.4, ge=-1, le=1)
    """correlation of the exemplar with itself, displaced by the generators, from which a lattice is trusted if it
    stands out at all"""
    significance: float = Field(5.5, ge=0, le=100)
    """significance from which a lattice of less confidence is trusted too; see `lattice`"""
    shortest: float = Field(10.0, ge=2)
    """least length of a generator, px"""
    stripes: bool = False
    """confidence alone is enough: stripes repeat too, though by every displacement along them"""


@dataclasses.dataclass(frozen=True)
class LatticeSelection:
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
    """`features`, `autocorrelation`, or `none`"""


Origin = Literal["features", "autocorrelation"]


@stage(version=3)
def lattice_selection(image: Image, density: ScalarMap, params: LatticeSelectionParams) -> LatticeSelection:
    """Find the exemplar's lattice by matched features and by autocorrelation, and take the surer one.

    Features fail on large even parts and on fine weaves, autocorrelation where parts differ in colour. Of two
    lattices that are about as sure it is that of the smaller cells: a lattice's every second row is a lattice too.
    Where the exemplar resembles itself by neither much, it is the more significant one.

    Parameters
    ----------
    density : of offsets between features that match, see `offset_statistics`.

    References
    ----------
    [Kaspar2015]_ section 4.1 and [Liu2004]_ each find a lattice; that one is asked where the other fails is ours.
    """
    lightness = usable_lightness(image)
    correlation = self_correlation(lightness)
    peaks = dominant_peaks(lightness, correlation, AutocorrelationParams()).density
    by_features = lattice_of(correlation, density, LatticeParams(shortest=params.shortest))
    by_correlation = lattice_of(correlation, peaks, LatticeParams(shortest=params.shortest, beta=_BETA))
    return most_confident({"features": by_features, "autocorrelation": by_correlation}, params)


def most_confident(lattices: dict[Origin, Lattice], params: LatticeSelectionParams) -> LatticeSelection:
    """The surest of some lattices.

    That of features may also be trusted where it has too few points to tell whether it is significant, but not
    where it has enough and is not: lines of text resemble each other whichever letters meet.
    """
    found = {origin: one for origin, one in lattices.items() if len(one.best)}
    none = np.zeros((0, 2), np.float32)
    if not found:
        return LatticeSelection(none, none, 0.0, 0.0, "none")
    likely = {
        origin: one
        for origin, one in found.items()
        if one.confidence >= params.confidence
        and (one.significance >= _LEAST or params.stripes or (origin == "features" and one.significance < 0))
    }
    if likely:
        surest = max(one.confidence for one in likely.values())
        best = min(
            (name for name in likely if likely[name].confidence >= surest - _EQUAL),
            key=lambda name: _cell(likely[name]),
        )
    else:
        best = max(found, key=lambda name: found[name].significance)
    one = found[best]
    trusted = bool(likely) or one.significance >= params.significance
    return LatticeSelection(
        one.best if trusted else none, one.best, one.confidence, one.significance, best if trusted else "none"
    )


def _cell(found: Lattice) -> float:
    """px squared"""
    return abs(float(np.linalg.det(found.best.astype(np.float64))))
