"""Lines that fan out: an exemplar that is seen in perspective."""

import numpy as np

from texloom.stages.common.features.line_segments import line_segments
from texloom.stages.kernels.core.elementary_functions import arctan2, cos, sin
from texloom.stages.numerics.matrices import least_squares, matrix_product
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import valid_pixels

_SIDE = 512  # px of the longer side, at which lines are found
_DIRECTIONS = 180
_NEAR = 15  # degrees from its commonest direction, of a family of lines
_MIN_LINES, _MIN_SHARE = 20, 0.2  # of a family; of the length of all lines
_OUTLYING = 2.5  # times the deviation, or
_STRAIGHT = 2.0  # degrees, if more: lines that are further off do not count
_ROUNDS = 6
_EXPLAINED = 0.85  # share of the variance of directions that positions explain
_LEAST = 4.0  # degrees


def fan_of_lines(image: Image) -> float:
    """By how many degrees lines turn from one side to the other; 0 where they do not clearly.

    Parallel lines of a plane in perspective point to one place, so that their directions change evenly across them;
    grain, cracks and leaves have directions of any kind, and what is seen from the front has one of each family.
    Both commonest families are looked at, without what is off the line of best fit.

    References
    ----------
    Ours; lines by [Gioi2010]_.
    """
    segments, valid = line_segments(image, _SIDE), valid_pixels(image)
    if valid is not None:
        segments = segments[segments.within(valid)]
    along = segments.ends[:, 1] - segments.ends[:, 0]
    angle = np.degrees(arctan2(along[:, 0], along[:, 1])) % 180
    weight, total = segments.lengths, float(segments.lengths.sum())
    rest, widest = np.ones(len(weight), bool), 0.0
    for _ in range(2):
        common = _commonest(angle[rest], weight[rest])
        off = (angle - common + 90) % 180 - 90
        own = rest & (np.abs(off) < _NEAR)
        rest &= np.abs(off) > 2 * _NEAR
        if own.sum() >= _MIN_LINES and weight[own].sum() >= _MIN_SHARE * total:
            turned = np.radians(common)
            across = matrix_product(segments.middles[own], np.concatenate([cos(turned), -sin(turned)], axis=None))
            widest = max(widest, _fan(off[own], across, weight[own]))
    return widest


def _commonest(angle: np.ndarray, weight: np.ndarray) -> float:
    """The direction near which most of the length of lines points, degrees."""
    bins = np.bincount((angle * (_DIRECTIONS / 180)).astype(int) % _DIRECTIONS, weight, _DIRECTIONS)
    near = np.arange(-_NEAR, _NEAR + 1)
    sums = bins[(np.arange(_DIRECTIONS)[:, None] + near) % _DIRECTIONS].sum(axis=1)
    return (int(sums.argmax()) + 0.5) * (180 / _DIRECTIONS)


def _fan(off: np.ndarray, across: np.ndarray, weight: np.ndarray) -> float:
    """The change of directions over positions, degrees; 0 where these explain little of it."""
    terms, kept = np.stack([np.ones_like(across), across], axis=1), np.ones(len(off), bool)
    for _ in range(_ROUNDS):
        roots = np.sqrt(weight[kept])
        fitted = least_squares(terms[kept] * roots[:, None], off[kept] * roots)
        error = np.abs(off - matrix_product(terms, fitted))
        deviation = np.sqrt(np.average(np.square(error[kept]), weights=weight[kept]))
        kept = error < max(_STRAIGHT, _OUTLYING * float(deviation))
    mean = np.average(off[kept], weights=weight[kept])
    variance = float(np.average(np.square(off[kept] - mean), weights=weight[kept]))
    left = float(np.average(np.square(error[kept]), weights=weight[kept]))
    turned = abs(float(fitted[1])) * float(np.ptp(across[kept]))
    clear = left <= min((1 - _EXPLAINED) * variance, _STRAIGHT**2) and kept.sum() >= _MIN_LINES
    return turned if clear and turned >= _LEAST else 0.0
