"""Steps of tone at joints of the source map: two-tone cells, cut contours, pieces that are lighter or darker."""

from texloom.stages.common.source_maps.source_joints import worst_of_cells
from texloom.stages.common.source_maps.tone_steps import SEEN, SIDE, ToneSteps
from texloom.stages.evaluation._measures.pictures import UnmeasurableError, require_side, require_variation
from texloom.stages.evaluation._measures.table import Figures
from texloom.stages.evaluation._measures.task import Task

_BAD = 0.1  # share of the cells with such a step; blocks joined at random have more, good results .01


def tone_steps(task: Task) -> Figures:
    """Share of the cells of 9x9 px of the result with a step that is seen; none without joints."""
    match, counted = task.source_map(), task.result.counted
    require_variation(task.exemplar)
    require_side(4 * SIDE, task.exemplar, task.result)
    if counted is not None and not counted.any():
        raise UnmeasurableError("nothing of the result was made")
    known, made = task.exemplar.compared, task.result.compared
    steps = ToneSteps(known.shape[:2], lambda first, last: known[first:last])
    found = steps.at_joints(made, match, task.wraps, counted)
    worst = found[tuple(worst_of_cells(found, SIDE).T)]
    cells = found.size if counted is None else int(counted.sum())
    share = float((worst > SEEN).sum()) * SIDE**2 / cells
    return Figures(share, 0.0, _BAD, {"largest": float(worst.max(initial=0))})
