"""The lattice of courses whose elements are equally long and whose phase changes alike from course to course."""

import numpy as np
from jaxtyping import Float64

from texloom.stages.analysis.regularity.lattice import mean_around, significance
from texloom.stages.vocabulary.arrays import ScalarMap, Vectors

_CONFIDENCE = 0.5  # mean correlation at the nearest lattice points; letters meet as often, but at random
_SIGNIFICANCE = 2.0  # which these do not reach
_TOLERANCE = 0.02  # of the correlation, by which smaller cells may be worse
_PEAKS = 8  # of the correlation along the courses
_REACH = 0.9  # of half the exemplar's side; what is shifted further overlaps too little
_APART = 4  # px on both sides of a peak that are lower


def lattice_in_phase(correlation: ScalarMap, step: Float64[np.ndarray, "2"], min_length: float) -> Vectors | None:
    """Both generators of a running bond and the like, of which only courses were found; none where phases are free.

    The period of the elements along a course, and the shift of the next course, are peaks of the correlation of the
    exemplar with itself along these rows. The pair of most correlation is taken, or one of smaller cells and about
    as much.

    Parameters
    ----------
    correlation : of the exemplar with itself, by offset from the middle; see `self_correlation`.
    step : from a course to the next, at right angles to both, px.
    min_length : of the elements, px.

    References
    ----------
    Ours.
    """
    along = np.array([-step[1], step[0]]) / np.hypot(*step)
    reach = int(_REACH * float((np.abs(along) * correlation.shape).sum()) / 2)
    offsets = np.arange(-reach, reach + 1)
    periods = [x for x in _peaks(correlation, 0 * step, along, offsets) if x >= min_length]
    shifts = _peaks(correlation, step, along, offsets)
    pairs = [np.array([step + shift * along, period * along]) for period in periods for shift in shifts]
    confidence = np.array([mean_around(correlation, pair) for pair in pairs])
    if confidence.max(initial=-1.0) < _CONFIDENCE:
        return None
    for place in np.flatnonzero(confidence >= confidence.max() - _TOLERANCE):  # the shortest period first
        if significance(correlation, pairs[place]) >= _SIGNIFICANCE:
            return pairs[place].astype(np.float32)
    return None


def _peaks(correlation: ScalarMap, start: np.ndarray, along: np.ndarray, offsets: np.ndarray) -> list[float]:
    """Offsets of the highest local maxima of the correlation along a line, ascending."""
    from texloom.stages.kernels.core.resample import sampled

    middle = np.array(correlation.shape) // 2
    places = (middle + start + offsets[:, None] * along).astype(np.float32)
    values = sampled(correlation[..., None], places[None])[0, :, 0]
    windows = np.lib.stride_tricks.sliding_window_view(values, 2 * _APART + 1)
    inner = np.flatnonzero(values[_APART:-_APART] >= windows.max(axis=1)) + _APART
    highest = inner[np.argsort(-values[inner], kind="stable")[:_PEAKS]]
    return sorted(float(offsets[place]) for place in highest)
