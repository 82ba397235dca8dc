"""The most confident lattice of an exemplar, detected by matched features and by autocorrelation."""

import dataclasses
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.analysis.autocorrelation import AutocorrelationParams, dominant_peaks
from texloom.stages.analysis.lattice import Lattice, LatticeParams, lattice_of, self_correlation, valid_lightness
from texloom.stages.arrays import Channels, Image, ScalarMap, Vectors
from texloom.stages.declare import Params, stage

_CONFIDENCE_TOLERANCE = 0.015  # smaller differences in confidence are ignored
_MIN_SIGNIFICANCE = 2.0  # of a lattice that is accepted by its confidence
_BETA = 3.0  # of `lattice`: the autocorrelation has few peaks, so recall counts more


class LatticeSelectionParams(Params):
    """When a lattice is accepted."""

    confidence: float = Field(0.4, ge=-1, le=1)
    """minimum correlation of the exemplar with itself, shifted by the generators, to accept a lattice whose
    significance is at least 2"""
    significance: float = Field(5.5, ge=0, le=100)
    """minimum significance to accept a lattice of less confidence; see `lattice`"""
    min_length: float = Field(10.0, ge=2)
    """minimum length of a generator, px"""
    stripes: bool = False
    """accept by confidence alone: stripes repeat too, by every displacement along them"""


@dataclasses.dataclass(frozen=True)
class LatticeSelection:
    """The selected lattice, if one was accepted."""

    generators: Vectors
    """of the selected lattice, px, (2, 2); no rows where neither is accepted"""
    best: Annotated[Float32[np.ndarray, "tried 2"], Channels(("row", "column"))]
    """the same, accepted or not"""
    confidence: float
    """of ``best``, -1..1"""
    significance: float
    """of ``best``"""
    chosen: str
    """`features`, `autocorrelation`, or `none`"""


Origin = Literal["features", "autocorrelation"]


@stage(version=3)
def lattice_selection(image: Image, density: ScalarMap, params: LatticeSelectionParams) -> LatticeSelection:
    """Detect the exemplar's lattice by matched features and by autocorrelation, and select the most confident.

    Features fail on large uniform parts and on fine weaves, autocorrelation where elements differ in colour. Of two
    lattices of about the same confidence the one with smaller cells is selected, since every second row of a
    lattice is a lattice too. Where neither is confident, the more significant one is selected.

    Parameters
    ----------
    image : the exemplar.
    density : of the offsets between matching features, see `offset_statistics`.

    Raises
    ------
    InputError
        all pixels are excluded.

    References
    ----------
    [Kaspar2015]_ section 3.3 and [Liu2004]_ each detect a lattice; selecting between them is ours.
    """
    lightness = valid_lightness(image)
    correlation = self_correlation(lightness)
    peaks = dominant_peaks(lightness, correlation, AutocorrelationParams()).density
    by_features = lattice_of(correlation, density, LatticeParams(min_length=params.min_length))
    by_correlation = lattice_of(correlation, peaks, LatticeParams(min_length=params.min_length, beta=_BETA))
    return most_confident({"features": by_features, "autocorrelation": by_correlation}, params)


def most_confident(lattices: dict[Origin, Lattice], params: LatticeSelectionParams) -> LatticeSelection:
    """The most confident of several lattices, accepted or not.

    A lattice from features is also accepted where it has too few points for a significance, but not where it has
    enough and a low one: lines of text correlate whichever letters meet.
    """
    detected = {origin: lattice for origin, lattice in lattices.items() if len(lattice.best)}
    none = np.zeros((0, 2), np.float32)
    if not detected:
        return LatticeSelection(none, none, 0.0, 0.0, "none")
    confident = {
        origin: lattice
        for origin, lattice in detected.items()
        if lattice.confidence >= params.confidence
        and (
            lattice.significance >= _MIN_SIGNIFICANCE
            or params.stripes
            or (origin == "features" and lattice.significance < 0)
        )
    }
    if confident:
        highest = max(lattice.confidence for lattice in confident.values())
        origin = min(
            (name for name in confident if confident[name].confidence >= highest - _CONFIDENCE_TOLERANCE),
            key=lambda name: _cell_area(confident[name]),
        )
    else:
        origin = max(detected, key=lambda name: detected[name].significance)
    best = detected[origin]
    accepted = bool(confident) or best.significance >= params.significance
    return LatticeSelection(
        best.best if accepted else none,
        best.best,
        best.confidence,
        best.significance,
        origin if accepted else "none",
    )


def _cell_area(lattice: Lattice) -> float:
    """Area of a cell, px squared."""
    return abs(float(np.linalg.det(lattice.best.astype(np.float64))))
