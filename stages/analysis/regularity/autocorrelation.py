"""Autocorrelation of an exemplar: its peaks, ranked by their regions of dominance."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.analysis.regularity.density import smoothed
from texloom.stages.analysis.regularity.lattice import detail, self_correlation, valid_lightness
from texloom.stages.common.grids.working_size import working_image
from texloom.stages.vocabulary.arrays import Channels, Image, ScalarMap, Vectors
from texloom.stages.vocabulary.declare import Params, stage

_MIN_RANGE = 1e-3  # CIELAB units; smaller variation is rounding
_MAX_PEAKS = 2000  # that are examined, highest first


class AutocorrelationParams(Params):
    """Which peaks are kept."""

    peaks: int = Field(64, ge=4, le=1000)
    """maximum number of peaks, those with the largest regions of dominance"""
    min_correlation: float = Field(0.05, ge=0, lt=1)
    """minimum correlation of a peak"""


@dataclasses.dataclass(frozen=True)
class Autocorrelation:
    """The exemplar's autocorrelation and its peaks."""

    density: ScalarMap
    """radius of dominance times height at the kept peaks, smoothed and scaled to a maximum of 1; offset (0, 0) is
    the centre and offsets extend to half the exemplar's sides, in px of its `working_image`; all 0 where nothing
    repeats. For `analysis.lattice`"""
    correlation: ScalarMap
    """autocorrelation of lightness at each offset, as of ``density``, -1..1; smooth shading is removed first"""
    peaks: Vectors
    """the kept peaks, px of the exemplar, the largest regions of dominance first; of opposite peaks only the one
    that points down"""
    dominance: Annotated[Float32[np.ndarray, "n 2"], Channels(("dominance", "correlation"))]
    """of each kept peak the distance to the nearest higher one, px, and its correlation"""


def _local_maxima(correlation: ScalarMap, min_correlation: float) -> tuple[np.ndarray, np.ndarray]:
    """Sub-pixel offsets (n, 2) and heights (n,) of local maxima, the origin and the highest first."""
    import cv2

    is_peak = correlation >= cv2.dilate(correlation, np.ones((3, 3), np.uint8))
    is_peak &= correlation > min_correlation
    is_peak[[0, -1]] = is_peak[:, [0, -1]] = False
    row, column = np.nonzero(is_peak)
    heights = correlation[row, column].astype(np.float64)
    order = np.argsort(-heights, kind="stable")[:_MAX_PEAKS]
    row, column, heights = row[order], column[order], heights[order]
    positions = np.stack([row, column], axis=1).astype(np.float64)
    for axis, (down, right) in enumerate(((1, 0), (0, 1))):
        before, after = (
            correlation[row + sign * down, column + sign * right].astype(np.float64) for sign in (-1, 1)
        )
        curvature = before - 2 * heights + after
        shift = 0.5 * np.divide(before - after, curvature, out=np.zeros_like(curvature), where=curvature < 0)
        positions[:, axis] += np.clip(shift, -0.5, 0.5)
    return positions - np.array(correlation.shape) // 2, heights


def _dominance_radii(peaks: np.ndarray) -> np.ndarray:
    """Distance of each peak to the nearest of those before it; infinite for the first."""
    radii = np.full(len(peaks), np.inf)
    for index in range(1, len(peaks)):
        radii[index] = np.hypot(*(peaks[:index] - peaks[index]).T).min()
    return radii


@stage(version=1)
def autocorrelation(image: Image, params: AutocorrelationParams) -> Autocorrelation:
    """Correlate the exemplar with itself and rank the peaks by their regions of dominance.

    A peak's region of dominance is the largest circle around it without a higher peak. Peaks of a lattice dominate
    about a cell; those of similar parts within a cell dominate less, however high they are. Excluded pixels have no
    influence. `analysis.lattice` fits generators to the peaks.

    Parameters
    ----------
    image : the exemplar.

    Raises
    ------
    InputError
        all pixels are excluded.

    References
    ----------
    [Liu2004]_ for the regions of dominance; [Lin2004]_ section 2.2. The number of peaks, and their weight by
    dominance times height, are ours.
    """
    small, step = working_image(image)
    lightness = valid_lightness(small)
    found = dominant_peaks(lightness, self_correlation(detail(lightness)), params)
    scale = np.array([step, 1], np.float32)  # of a dominance and a correlation
    return dataclasses.replace(found, peaks=found.peaks * scale[0], dominance=found.dominance * scale)


def dominant_peaks(
    lightness: ScalarMap, correlation: Float32[np.ndarray, "rows columns"], params: AutocorrelationParams
) -> Autocorrelation:
    """The peaks of the autocorrelation of ``lightness``, see `self_correlation` and `autocorrelation`.

    Parameters
    ----------
    correlation : of ``lightness``, or its middle part for short offsets alone.
    """
    if float(np.ptp(lightness)) < _MIN_RANGE:
        correlation = np.zeros_like(correlation)
    # Odd sides, so that the origin is the centre and every offset has its opposite.
    reach = np.array(correlation.shape) // 2
    centred = np.zeros(2 * reach + 1, np.float32)
    centred[: correlation.shape[0], : correlation.shape[1]] = correlation
    peaks, heights = _local_maxima(centred, params.min_correlation)
    dominance = _dominance_radii(peaks)
    lower = (peaks[:, 0] > 0.25) | ((np.abs(peaks[:, 0]) <= 0.25) & (peaks[:, 1] > 0))
    kept = np.flatnonzero(lower & np.isfinite(dominance))
    kept = kept[np.argsort(-dominance[kept], kind="stable")[: params.peaks]]
    peaks, heights, dominance = peaks[kept], heights[kept], dominance[kept]
    density = np.zeros(centred.shape, np.float32)
    if len(kept):
        _splat(density, np.concatenate([peaks, -peaks]), np.tile(dominance * heights, 2))
        density = smoothed(density, min(lightness.shape))
    ranked = np.stack([dominance, heights], axis=1).astype(np.float32)
    return Autocorrelation(density, centred, peaks.astype(np.float32), ranked)


def _splat(density: np.ndarray, offsets: np.ndarray, weights: np.ndarray) -> None:
    """Add weights to ``density`` at sub-pixel offsets from its centre, with bilinear shares."""
    reach = np.array(density.shape) // 2
    corner = np.floor(offsets).astype(np.int64)
    fraction = offsets - corner
    for down in (0, 1):
        for right in (0, 1):
            share = np.abs(1 - down - fraction[:, 0]) * np.abs(1 - right - fraction[:, 1]) * weights
            index = np.clip(corner + reach + (down, right), 0, 2 * reach)
            np.add.at(density, tuple(index.T), share.astype(np.float32))
