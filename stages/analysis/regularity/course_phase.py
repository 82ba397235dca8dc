"""The lattice of courses whose elements are equally long and whose phase changes alike from course to course."""

import numpy as np
from jaxtyping import Float64, Int64

from texloom.stages.kernels.core.elementary_functions import squared_size
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import ScalarMap, Vectors

_HEIGHT = 0.7  # of the part of a course whose mean shows its joints, relative to the course
_JOINT = 0.06  # of a course's height: half of a joint's width, at least
_MIN_JOINT = 2  # px
_NOISE = 2.5  # deviations that a joint differs by
_MOST = 5.0  # deviations beyond these that count: joints are of different strength
_JITTER = 0.08  # deviation of joints from their places, relative to the course's height
_REACH = 2 / 3  # of the width; what is shifted further overlaps too little
_MOST_SHIFT = 0.55  # of a course, relative to the period: half of it and what the peaks may be off
_LAGS = 4  # courses that are compared with a course
_PEAKS = 8  # of the correlation along the courses
_NEAR = 1.5  # periods along a course within which lattice points count: errors of a period add up
_LIKENESS = 0.28  # least mean correlation at these points: patterns that are no courses reach .23, bonds .31
_SIGNIFICANCE = 2.0  # least, in standard errors: free phases reach 1.4, bonds 2.4


def lattice_in_phase(lightness: ScalarMap, step: Float64[np.ndarray, "2"], min_length: float) -> Vectors | None:
    """Both generators of a running bond and the like, of which only courses were found; none where phases are free.

    Elements differ in tone, so only the joints between them are compared: where lightness bends sharply along the
    course, over most of its height. The period of the elements along a course, and the shift of the next course,
    are peaks of the correlation of the courses' joints. The most significant pair is taken.

    Parameters
    ----------
    lightness : of the exemplar.
    step : from a course to the next, at right angles to both, px.
    min_length : of the elements, px.

    References
    ----------
    Ours.
    """
    along = np.array([-step[1], step[0]]) / np.hypot(*step)
    joints = _joints(lightness, step, along)
    if len(joints) < 2 or not joints.any():
        return None
    reach = int(_REACH * joints.shape[1])
    correlation = _correlation(joints, reach)
    least = int(np.ceil(min_length))
    periods = (_peaks(correlation[0, reach + least :]) + least).tolist()
    shifts = (_peaks(correlation[1]) - reach).tolist()
    pairs = [(shift, period) for period in periods for shift in shifts if abs(shift) <= _MOST_SHIFT * period]
    if not pairs:
        return None
    likeness = np.array([_likeness(correlation, reach, *pair) for pair in pairs])
    elements = joints.size / np.array([period for _, period in pairs])
    significance = likeness * np.sqrt(elements)
    best = int(np.argmax(significance))
    if significance[best] < _SIGNIFICANCE or likeness[best] < _LIKENESS:
        return None
    shift, period = pairs[best]
    return np.stack([step + shift * along, period * along]).astype(np.float32)


def _joints(
    lightness: ScalarMap, step: Float64[np.ndarray, "2"], along: Float64[np.ndarray, "2"]
) -> Float64[np.ndarray, "courses places"]:
    """How much of a joint there is at every px along every course, 0 for none."""
    length = float(np.hypot(*step))
    bend, inside = _bend(lightness, step / length, along, max(_MIN_JOINT, round(_JOINT * length)))
    bend[~inside] = 0
    height = max(3, round(_HEIGHT * length))
    sums = np.concatenate([np.zeros((1, bend.shape[1])), np.cumsum(bend, axis=0)])
    means = (sums[height:] - sums[:-height]) / height  # of the rows from each one on
    energy = (means**2).mean(axis=1)
    # Joints fill a course where the phase is right.
    starts = [np.rint(np.arange(first, len(means), length)).astype(int) for first in range(int(length))]
    starts = [rows[rows < len(means)] for rows in starts]
    starts = [rows for rows in starts if len(rows) > 1]
    if not starts:
        return np.zeros((0, bend.shape[1]))
    profiles = means[max(starts, key=lambda rows: float(energy[rows].mean()))]
    middle = np.median(profiles)
    deviation = 1.4826 * float(np.median(np.abs(profiles - middle)))
    if deviation <= 0:
        return np.zeros_like(profiles)
    signs = [np.clip(sign * (profiles - middle) / deviation - _NOISE, 0, _MOST) for sign in (1, -1)]
    joints = max(signs, key=lambda joints: float(joints.sum()))
    return np.concatenate([gaussian_blur(row[None], max(1.0, _JITTER * length)) for row in joints])


def _bend(
    lightness: ScalarMap, across: np.ndarray, along: np.ndarray, joint: int
) -> tuple[Float64[np.ndarray, "rows columns"], np.ndarray]:
    """Second difference along the courses, whose direction becomes that of rows, and where it is known."""
    from texloom.stages.kernels.core.resample import sampled

    sides = np.array(lightness.shape)
    shape = [int((np.abs(axis) * sides).sum()) for axis in (across, along)]
    rows, columns = (np.arange(side) - (side - 1) / 2 for side in shape)
    places = rows[:, None, None] * across + columns[None, :, None] * along + (sides - 1) / 2
    inside = ((places >= 0) & (places <= sides - 1)).all(axis=2)
    turned = sampled(np.ascontiguousarray(lightness[..., None]), places)[..., 0]
    smooth = gaussian_blur(np.ascontiguousarray(turned), joint / 2).astype(np.float64)
    bend = np.zeros_like(smooth)
    bend[:, joint:-joint] = smooth[:, 2 * joint :] - 2 * smooth[:, joint:-joint] + smooth[:, : -2 * joint]
    return bend, inside


def _correlation(joints: Float64[np.ndarray, "courses places"], reach: int) -> Float64[np.ndarray, "lags offsets"]:
    """Correlation of courses with those up to four courses further, by offset from -``reach`` to ``reach``."""
    count, width = joints.shape
    centred = joints - joints.mean()
    shape = 2 * count, 2 * width
    product = np.fft.irfft2(squared_size(np.fft.rfft2(centred, shape)), shape)
    lags, offsets = np.arange(min(_LAGS, count - 1) + 1), np.arange(-reach, reach + 1)
    overlap = np.outer(count - lags, width - np.abs(offsets))
    return np.asarray(product[lags[:, None], offsets] / overlap / float((centred**2).mean()))


def _peaks(values: Float64[np.ndarray, "n"]) -> Int64[np.ndarray, "m"]:  # type: ignore[name-defined]
    """Places of the highest local maxima, ascending."""
    inner = np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] > values[2:])) + 1
    return np.sort(inner[np.argsort(-values[inner], kind="stable")[:_PEAKS]])


def _likeness(correlation: Float64[np.ndarray, "lags offsets"], reach: int, shift: int, period: int) -> float:
    """Mean correlation at the nearest points of a lattice in the same course, or in others if that is less."""
    lags, steps = np.arange(len(correlation)), np.arange(-2 * reach // period, 2 * reach // period + 1)
    offsets = lags[:, None] * shift + steps * period
    known = (np.abs(offsets) <= min(reach, _NEAR * period)) & ((lags[:, None] > 0) | (offsets > 0))
    near = np.max([np.roll(correlation, by, axis=1) for by in (-1, 0, 1)], axis=0)
    lag, step = np.nonzero(known)
    values = near[lag, offsets[lag, step] + reach]
    return float(min(values[lag == 0].mean(), values[lag > 0].mean()))
