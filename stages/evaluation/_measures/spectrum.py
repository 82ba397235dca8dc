"""Long-range measures: autocorrelation and repetition."""

import numpy as np

from texloom.stages.common.grids.working_size import reduction, square_means
from texloom.stages.common.regularity.excess_repetition import autocorrelation, repetition, whole_squares
from texloom.stages.evaluation._measures.pictures import (
    MeasuredPicture,
    UnmeasurableError,
    between_halves,
    require_side,
    require_variation,
)
from texloom.stages.evaluation._measures.table import Figures
from texloom.stages.evaluation._measures.task import Task, sampling

_USUAL = 0.8  # excess of results in which large pieces occur twice, which nobody notices
_NOISE = 2.0  # a difference of uncorrelated pictures, with pixels**-0.5 as its unit; expected is 2**0.5


def autocorrelation_difference(task: Task) -> Figures:
    """Root mean square difference of the autocorrelations."""
    require_variation(task.exemplar)
    require_side(32, task.exemplar)
    require_side(16, task.result)
    task.require_all_made()
    # Of large exemplars, structure is coarse.
    step = min(reduction(*task.source_shape), task.result.shorter // 16)
    reach = min(task.exemplar.shorter, task.result.shorter) // (4 * step)

    def distance(one: MeasuredPicture, other: MeasuredPicture) -> float:
        first, second = (
            autocorrelation(square_means(picture.tone, step), (reach, reach), whole_squares(picture.valid, step))
            for picture in (one, other)
        )
        return float(np.sqrt(((first - second) ** 2).mean()))

    ceiling = distance(task.exemplar, task.shuffled)
    if ceiling <= _NOISE * step / np.sqrt(task.source_area):
        raise UnmeasurableError("the exemplar has no structure beyond single pixels")
    floor = sampling(task, between_halves(task.exemplar, distance))
    return Figures(distance(task.exemplar, task.result), floor, ceiling)


def repetition_excess(task: Task) -> Figures:
    """Long-range autocorrelation in excess of the exemplar's."""
    require_variation(task.exemplar)
    require_variation(task.result, "the result")
    require_side(64, task.exemplar, task.result)
    task.require_all_made()

    def excess(one: MeasuredPicture, other: MeasuredPicture) -> tuple[float, tuple[int, int]]:
        return repetition(one.tone, other.tone, (one.valid, other.valid))

    value, offset = excess(task.exemplar, task.result)
    return Figures(value, _USUAL, 1.0, {"offset": list(offset)})
