"""The lattice of courses whose elements are equally long and whose phase changes alike from course to course."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from texloom.stages.analysis.regularity.superlattice import prediction_error
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
_COURSES = 2  # of a cell, at most
_MIN_DIFFERENCE = 0.15  # of the likeness, by which joints are clearly more alike
_MIN_FALL = 1 / 3  # share of the error that larger cells have to save, as fewer of them are shown
_LEVEL = 0.06  # sine of the angle to an axis, of courses of a lattice
_NEAR_LENGTH = 0.1  # of a lattice's period along them, by which that of joints may differ
_EXPLAINED = 0.5  # likeness from which on a lattice explains its joints
_STACKED = 0.15  # of a period: where courses are shifted less, their joints are lines
_LIKENESS = 0.28  # least mean correlation at these points: patterns that are no courses reach .23, bonds .31
_SIGNIFICANCE = 2.0  # least, in standard errors: free phases reach 1.4, bonds 2.4


class _Bond(NamedTuple):
    """How elements lie in courses."""

    courses: int
    """of a cell"""
    shift: int
    """along the courses, from those of a cell to the next ones, px"""
    period: int
    """of the elements along a course, px"""
    likeness: float
    """see `_likeness`"""
    cells: float
    """number of cells that are shown"""

    def generators(self, step: Float64[np.ndarray, "2"]) -> Vectors:
        """From a cell to the next ones, px, where courses are ``step`` apart."""
        along = _along(step)
        return np.stack([self.courses * step + self.shift * along, self.period * along]).astype(np.float32)

    @property
    def significance(self) -> float:
        """In standard errors."""
        return self.likeness * float(np.sqrt(self.cells))

    @property
    def error(self) -> float:
        """See `prediction_error`."""
        return prediction_error(self.likeness, self.cells)


def lattice_in_phase(lightness: ScalarMap, step: Float64[np.ndarray, "2"], min_length: float) -> Vectors | None:
    """Both generators of a running bond and the like, of which only courses were found; none where phases are free.

    Elements differ in tone, so only the joints between them are compared: where lightness bends sharply along the
    course, over most of its height. The period of the elements along a course, and the shift of the next course or
    the next but one, as courses of headers and of stretchers may alternate, are peaks of the correlation of the
    courses' joints. The most significant pair is taken, or one of larger cells by which joints are clearly more
    alike.

    Parameters
    ----------
    lightness : of the exemplar.
    step : from a course to the next, at right angles to both, px.
    min_length : of the elements, px.

    References
    ----------
    Ours.
    """
    bonds, shape = _bonds(lightness, step, min_length)
    bonds = [bond for bond in bonds if bond.likeness >= _LIKENESS and bond.significance >= _SIGNIFICANCE]
    if not bonds:
        return None
    best = max(bonds, key=lambda bond: bond.significance)
    return _larger(best, bonds, shape).generators(step)


def larger_bond(lightness: ScalarMap, generators: Vectors, min_length: float) -> Vectors | None:
    """The bond of larger cells by which joints are clearly more alike than by a lattice; none where there is none.

    A lattice may be that of headers alone, which stretchers of every second course repeat by half of their length,
    or of joints that bricks of a course and the half courses between them share.

    Parameters
    ----------
    lightness : of the exemplar.
    generators : of its lattice, px; rows of elements lie along an axis.
    min_length : of the elements, px.

    References
    ----------
    Ours; see `lattice_in_phase`.
    """
    one, other = generators.astype(np.float64)
    area = abs(float(one[0] * other[1] - one[1] * other[0]))
    for row in (one, other, one + other, one - other):
        length = float(np.hypot(*row))
        if np.abs(row).min() > _LEVEL * length or min(length, area / length) < min_length:
            continue
        step = np.array([-row[1], row[0]]) * (area / length**2)
        step *= np.sign(step[np.abs(step).argmax()])
        bonds, shape = _bonds(lightness, step, min_length)
        known = [bond for bond in bonds if bond.courses == 1 and abs(bond.period - length) < _NEAR_LENGTH * length]
        best = max(known, key=lambda bond: bond.likeness, default=None)
        if best is not None and best.likeness < _EXPLAINED and abs(best.shift) > _STACKED * best.period:
            larger = _larger(best, bonds, shape)
            if larger is not best:
                return larger.generators(step)
    return None


def _along(step: Float64[np.ndarray, "2"]) -> Float64[np.ndarray, "2"]:
    """The direction of courses that are ``step`` apart."""
    return np.array([-step[1], step[0]]) / np.hypot(*step)


def _bonds(
    lightness: ScalarMap, step: Float64[np.ndarray, "2"], min_length: float
) -> tuple[list[_Bond], tuple[int, int]]:
    """The ways in which joints of courses may repeat, and the numbers of courses and of places along them."""
    joints = _joints(lightness, step)
    shape = len(joints), joints.shape[1]
    if len(joints) < 2 or not joints.any():
        return [], shape
    reach, least = int(_REACH * shape[1]), int(np.ceil(min_length))
    correlation = _correlation(joints, reach)
    near = np.max([np.roll(correlation, by, axis=1) for by in (-1, 0, 1)], axis=0)
    found = []
    for period in (_peaks(correlation[0, reach + least :]) + least).tolist():
        most = min(reach, int(_MOST_SHIFT * period) + 1)
        for courses in range(1, min(_COURSES, len(correlation) - 1) + 1):
            for shift in (_peaks(correlation[courses, reach - most : reach + most + 1]) - most).tolist():
                likeness = _likeness(near[::courses], reach, shift, period)
                found.append(_Bond(courses, shift, period, likeness, joints.size / (courses * period)))
    return found, shape


def _larger(bond: _Bond, bonds: list[_Bond], shape: tuple[int, int]) -> _Bond:
    """The most significant bond that explains clearly more and is shown twice in both directions, or the same."""
    shown = [other for other in bonds if 2 * other.courses <= shape[0] and 2 * other.period <= shape[1]]
    better = [other for other in shown if other.significance >= _SIGNIFICANCE and _explains_more(other, bond)]
    return max(better, key=lambda other: other.significance, default=bond)


def _explains_more(larger: _Bond, bond: _Bond) -> bool:
    """Whether joints are clearly more alike by a bond of larger cells."""
    is_larger = larger.courses * larger.period > bond.courses * bond.period
    clearly = larger.likeness >= bond.likeness + _MIN_DIFFERENCE
    return is_larger and clearly and larger.error <= (1 - _MIN_FALL) * bond.error


def _joints(lightness: ScalarMap, step: Float64[np.ndarray, "2"]) -> Float64[np.ndarray, "courses places"]:
    """How much of a joint there is at every px along every course, 0 for none."""
    length = float(np.hypot(*step))
    bend, inside = _bend(lightness, step / length, _along(step), max(_MIN_JOINT, round(_JOINT * length)))
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


def _likeness(near: Float64[np.ndarray, "lags offsets"], reach: int, shift: int, period: int) -> float:
    """Mean correlation at the nearest points of a lattice in the same course, or in others if that is less.

    Parameters
    ----------
    near : the greatest correlation within a px.
    """
    lags, steps = np.arange(len(near)), np.arange(-2 * reach // period, 2 * reach // period + 1)
    offsets = lags[:, None] * shift + steps * period
    known = (np.abs(offsets) <= min(reach, _NEAR * period)) & ((lags[:, None] > 0) | (offsets > 0))
    lag, step = np.nonzero(known)
    values = near[lag, offsets[lag, step] + reach]
    return float(min(values[lag == 0].mean(), values[lag > 0].mean()))
