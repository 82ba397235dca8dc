"""The coarser lattice whose larger cells explain a picture better than those of a lattice that was found."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from texloom.stages.analysis.regularity.lattice import MIN_POINTS, SEARCH_RADIUS, steps_in_range
from texloom.stages.common.regularity.lattice_cells import reduced
from texloom.stages.numerics.matrices import determinant, matrix_product, rank

_MOST_CELLS = 12  # of the lattice in a cell of the coarser one: herringbone of planks six times as long as wide
_MIN_STATISTIC = (
    6.0  # Student's, of the difference between correlations at points of the coarser lattice and others
)
_MIN_SEPARATION = 2.5  # of both, in standard deviations: nearly none of one are among the other
_MIN_DIFFERENCE = (
    0.1  # of both, as drift across a picture and tones of elements make differences of a few hundredths
)
_MIN_FALL = 0.1  # share of the error of a cell, predicted from the others, that larger cells have to save


def superlattice(
    generators: np.ndarray, correlation: Float32[np.ndarray, "rows columns"]
) -> Float64[np.ndarray, "2 2"]:
    """The coarser lattice, of at most twelve cells, whose cells explain a picture clearly better; else the same.

    A checkerboard of two alike tones repeats nearly in every square, herringbone nearly in every plank's width, and
    contours may repeat in every row where colours do in every third.

    Of a picture with variance 1 that correlates by r at the points of a lattice, of which it shows k cells, the
    mean of all other cells predicts a cell with a squared error of (1 - r) k / (k - 1). Larger cells are fewer, so
    that they lose where they explain nothing more. As correlations scatter, those at the coarser lattice's points
    have to be higher than those at the other points significantly, nearly all of them, and not just by a little.

    Parameters
    ----------
    generators : of the lattice, px.
    correlation : of any property of the picture, see `self_correlation`.

    References
    ----------
    Ours.
    """
    import cv2

    frame = reduced(generators)
    steps = steps_in_range(correlation, frame)
    if len(steps) < 2 * MIN_POINTS:
        return frame
    near = cv2.dilate(correlation, np.ones((2 * SEARCH_RADIUS + 1, 2 * SEARCH_RADIUS + 1), np.uint8))
    row, column = (np.rint(matrix_product(steps, frame)).astype(int) + np.array(correlation.shape) // 2).T
    values = near[row, column].astype(np.float64)
    cells = correlation.size / abs(float(determinant(frame)))
    best, highest = frame, _MIN_STATISTIC
    most = (1 - _MIN_FALL) * prediction_error(float(values.mean()), cells)
    for first, shear, second in _changes():
        on = _on(steps, first, shear, second)
        inside, others = values[on], values[~on]
        if min(len(inside), len(others)) < MIN_POINTS - 1 or inside.mean() - others.mean() < _MIN_DIFFERENCE:
            continue
        statistic, separation = _contrast(inside, others)
        clear = (
            separation >= _MIN_SEPARATION
            and prediction_error(float(inside.mean()), cells / (first * second)) <= most
        )
        if clear and statistic > highest and rank(steps[on]) == 2:
            best, highest = matrix_product(np.array([[first, shear], [0, second]]), frame), statistic
    return reduced(best)


def _changes() -> Iterator[tuple[int, int, int]]:
    """All coarser lattices: ((first, shear), (0, second)) times the generators (Hermite's normal form)."""
    for count in range(2, _MOST_CELLS + 1):
        for first in (first for first in range(1, count + 1) if count % first == 0):
            for shear in range(count // first):
                yield first, shear, count // first


def _on(steps: Int64[np.ndarray, "n 2"], first: int, shear: int, second: int) -> Bool[np.ndarray, "n"]:  # type: ignore[name-defined]
    """Which steps of a lattice are those of the coarser one."""
    one, other = steps.T
    return np.asarray((one % first == 0) & ((other - one // first * shear) % second == 0))


def _contrast(
    first: Float64[np.ndarray, "n"],  # type: ignore[name-defined]
    second: Float64[np.ndarray, "m"],  # type: ignore[name-defined]
) -> tuple[float, float]:
    """Student's statistic of the difference of two means, and that difference in standard deviations."""
    n, m = len(first), len(second)
    deviation = float(np.sqrt((n * first.var() + m * second.var()) / (n + m - 2)))
    separation = float(first.mean() - second.mean()) / max(deviation, 1e-3)
    return separation / float(np.sqrt(1 / n + 1 / m)), separation


def prediction_error(correlation: float, cells: float) -> float:
    """Of the mean of all other cells as a prediction of one, relative to the variance.

    Parameters
    ----------
    correlation : mean at the lattice's points.
    cells : that are shown.
    """
    return max(0.0, 1 - correlation) * cells / max(cells - 1, 1e-3)
