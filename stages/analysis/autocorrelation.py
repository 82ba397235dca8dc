"""Autocorrelation: by which displacements an exemplar resembles itself most, and how far around each."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.analysis.lattice import self_correlation, usable_lightness
from texloom.stages.arrays import Channels, Image, ScalarMap, Vectors
from texloom.stages.declare import Params, stage

_FLAT = 1e-3  # CIELAB units; what varies less is rounding
_MOST = 2000  # peaks that are looked at, highest first
_SPREAD = 3.0  # px of an exemplar of 512 px; standard deviation of a peak's place
_LEAST_SPREAD = 1.7  # px


class AutocorrelationParams(Params):
    """Which peaks count."""

    peaks: int = Field(64, ge=4, le=1000)
    """peaks kept, those of the largest regions of dominance; far more than cells makes no difference"""
    lowest: float = Field(0.05, ge=0, lt=1)
    """least correlation of a peak"""


@dataclasses.dataclass(frozen=True)
class Autocorrelation:
    """Where the exemplar is like itself."""

    density: ScalarMap
    """regions of dominance times height, at the kept peaks, the highest is 1; offset (0, 0) is the middle, offsets
    reach to half the exemplar's sides; all 0 where nothing repeats. For `analysis.lattice`"""
    correlation: ScalarMap
    """of lightness with itself at each offset, -1..1; even shading is taken out first"""
    peaks: Vectors
    """the kept peaks, px, the largest regions of dominance first; of opposite ones only that which points down"""
    dominance: Annotated[Float32[np.ndarray, "n 2"], Channels(("dominance", "correlation"))]
    """of each kept peak the distance to the nearest higher one, px, and the correlation there"""


def _summits(correlation: ScalarMap, lowest: float) -> tuple[np.ndarray, np.ndarray]:
    """Local maxima (n, 2) as offsets between pixels, and heights (n,), the origin and highest first."""
    import cv2

    highest = correlation >= cv2.dilate(correlation, np.ones((3, 3), np.uint8))
    highest &= correlation > lowest
    highest[[0, -1]] = highest[:, [0, -1]] = False
    row, column = np.nonzero(highest)
    heights = correlation[row, column].astype(np.float64)
    order = np.argsort(-heights, kind="stable")[:_MOST]
    row, column, heights = row[order], column[order], heights[order]
    places = np.stack([row, column], axis=1).astype(np.float64)
    for axis, (down, right) in enumerate(((1, 0), (0, 1))):
        before, after = (
            correlation[row + sign * down, column + sign * right].astype(np.float64) for sign in (-1, 1)
        )
        bend = before - 2 * heights + after
        places[:, axis] += np.clip(
            0.5 * np.divide(before - after, bend, out=np.zeros_like(bend), where=bend < 0), -0.5, 0.5
        )
    return places - np.array(correlation.shape) // 2, heights


def _dominance(places: np.ndarray) -> np.ndarray:
    """Distance of each place to the nearest of those before it; infinite for the first."""
    found = np.full(len(places), np.inf)
    for index in range(1, len(places)):
        found[index] = np.hypot(*(places[:index] - places[index]).T).min()
    return found


@stage(version=1)
def autocorrelation(image: Image, params: AutocorrelationParams) -> Autocorrelation:
    """Correlate the exemplar with itself and rank the peaks by their regions of dominance.

    A peak's region of dominance is the largest circle around it without a higher peak. Peaks of a lattice dominate
    about a cell; those of parts that look alike within a cell dominate less, however high they are. Masked pixels
    are not looked at.

    References
    ----------
    [Liu2004]_ for the regions of dominance; [Lin2004]_ section 2.2. The number of peaks and that a peak
    counts by dominance times height are ours. Generators are fitted to the peaks by `analysis.lattice`.
    """
    lightness = usable_lightness(image)
    return dominant_peaks(lightness, self_correlation(lightness), params)


def dominant_peaks(lightness: ScalarMap, correlation: ScalarMap, params: AutocorrelationParams) -> Autocorrelation:
    """The peaks of what `self_correlation` makes of ``lightness``; see `autocorrelation`."""
    import cv2

    if float(np.ptp(lightness)) < _FLAT:
        correlation = np.zeros_like(correlation)
    # Odd sides, so that the origin is the middle and every offset has its opposite.
    reach = np.array(correlation.shape) // 2
    half = np.zeros(2 * reach + 1, np.float32)
    half[: correlation.shape[0], : correlation.shape[1]] = correlation
    places, heights = _summits(half, params.lowest)
    dominance = _dominance(places)
    lower = (places[:, 0] > 0.25) | ((np.abs(places[:, 0]) <= 0.25) & (places[:, 1] > 0))
    kept = np.flatnonzero(lower & np.isfinite(dominance))
    kept = kept[np.argsort(-dominance[kept], kind="stable")[: params.peaks]]
    places, heights, dominance = places[kept], heights[kept], dominance[kept]
    density = np.zeros(half.shape, np.float32)
    if len(kept):
        both = np.concatenate([places, -places])
        corner = np.floor(both).astype(np.int64)
        share = both - corner
        weight = np.tile(dominance * heights, 2)
        for down in (0, 1):
            for right in (0, 1):
                part = np.abs(1 - down - share[:, 0]) * np.abs(1 - right - share[:, 1]) * weight
                at = np.clip(corner + reach + (down, right), 0, 2 * reach)
                np.add.at(density, tuple(at.T), part.astype(np.float32))
        spread = max(_LEAST_SPREAD, _SPREAD * min(lightness.shape) / 512)
        side = 2 * int(np.ceil(3 * spread)) + 1
        density = cv2.GaussianBlur(density, (side, side), spread, borderType=cv2.BORDER_CONSTANT)
        density /= density.max()
    ranked = np.stack([dominance, heights], axis=1).astype(np.float32)
    return Autocorrelation(density, half, places.astype(np.float32), ranked)
