"""Per-pixel synthesis in the tiles of charts, see `texloom.stages.kernels.per_pixel`.

``strips`` are (n, 6) int64: top, bottom, left and right in the array of a level, then row and column of the result
at the array's row 0 and column 0. ``first`` and ``last`` are the strips of a call.
"""

from texloom.stages.kernels.core.compiled import compiled
from texloom.stages.kernels.per_pixel.arguments import LevelState
from texloom.stages.kernels.per_pixel.correction import correct, refine, start


@compiled
def _at(level, row, column):
    """A level whose first pixel is elsewhere in the result."""
    return LevelState(level.number, row, column, level.states, level.given, level.pinned)


@compiled
def start_strips(level, exemplar, distortion, pieces, repetition, tolerance, key, strips, first, last):
    """Call `start` for every strip."""
    for at in range(first, last):
        top, bottom, left, right, row, column = strips[at]
        own = _at(level, row, column)
        start(own, exemplar, distortion, pieces, repetition, tolerance, key, (top, bottom, left, right))


@compiled
def refine_strips(level, coarse, origins, exemplar, distortion, amplitude, key, strips, first, last):
    """Call `refine` for every strip; ``origins``: (n, 2), of the coarser level for each strip."""
    for at in range(first, last):
        top, bottom, left, right, row, column = strips[at]
        own, above = _at(level, row, column), _at(coarse, origins[at, 0], origins[at, 1])
        refine(own, above, exemplar, distortion, amplitude, key, (top, bottom, left, right))


@compiled
def correct_strips(
    level, subpass, parity, exemplar, appearance, distortion, bonuses, tolerance, strips, first, last
):
    """Call `correct` for every strip; ``parity``: row and column of the subpass's pixels, modulo 2."""
    for at in range(first, last):
        top, bottom, left, right, row, column = strips[at]
        top += (top + row + parity[0]) % 2
        left += (left + column + parity[1]) % 2
        own = _at(level, row, column)
        correct(
            own, subpass, exemplar, appearance, distortion, bonuses, tolerance, (top, bottom, left, right)
        )  # fmt: skip
