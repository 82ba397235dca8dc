"""Joints of the source map: how unlike the exemplar's own patches are those across them."""

import dataclasses

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.common.similarity.patch_distance import SIDE, Places
from texloom.stages.common.source_maps.source_joints import (
    NoPatchError,
    PatchRatios,
    cell_side,
    joint_contrast,
    steps_for,
    worst_of_cells,
)
from texloom.stages.evaluation._measures.pictures import UnmeasurableError, require_side, require_variation
from texloom.stages.evaluation._measures.table import Figures, share
from texloom.stages.evaluation._measures.task import Task
from texloom.stages.vocabulary.arrays import ScalarMap

_WORST = 0.1  # share of the joints; people see the worst ones
_GOOD, _UNALIKE = 1.6, 2.3  # of worst joints: usual of good results; usual of blocks joined at random
_BAD = 1.7  # ratio of a joint that is seen
_MOST_BAD = 0.15  # share of the cells with such a joint; good results have .02


@dataclasses.dataclass(frozen=True)
class Joints:
    """The joints that were measured, one a cell of the result."""

    places: Places
    ratios: Float64[np.ndarray, "n s"]
    """distance of the patch at a joint over the usual one of the exemplar, by scale; NaN where masked"""
    cell: int
    """side of the cells, px"""

    @property
    def ratio(self) -> Float64[np.ndarray, "*n"]:
        """Mean over the scales."""
        return np.asarray(np.nanmean(self.ratios, axis=1))

    def map(self, shape: tuple[int, int]) -> ScalarMap:
        """The ratio of the joint in each pixel's cell; 0 in cells without joints."""
        cells = np.zeros((-(-shape[0] // self.cell), -(-shape[1] // self.cell)), np.float32)
        cells[self.places[:, 0] // self.cell, self.places[:, 1] // self.cell] = self.ratio
        whole = cells.repeat(self.cell, axis=0).repeat(self.cell, axis=1)
        return np.ascontiguousarray(whole[: shape[0], : shape[1]])


def worst_joints(
    task: Task, exemplar: Float32[np.ndarray, "h w c"], result: Float32[np.ndarray, "H W c"]
) -> tuple[Places, int]:
    """The joints of largest contrast in these pictures, one a cell, and the side of the cells, px.

    `UnmeasurableError` where nothing of the result was made.
    """
    contrast = joint_contrast(exemplar, result, task.source_map(), task.wraps)
    made = task.result.made
    if made is not None:
        if not made.any():
            raise UnmeasurableError("nothing of the result was made")
        contrast[~made] = -1
    cell = cell_side(contrast.size)
    return worst_of_cells(contrast, cell), cell


def measure_joints(task: Task) -> Joints:
    """Search the exemplar for the patches across joints; `UnmeasurableError` where pictures do not allow it."""
    task.source_map()
    require_variation(task.exemplar)
    require_side(4 * SIDE, task.exemplar, task.result)
    places, cell = worst_joints(task, task.exemplar.compared, task.result.compared)
    if not len(places):
        return Joints(places, np.zeros((0, 1)), cell)
    shorter = min(task.exemplar.shorter, task.result.shorter)
    try:  # scale by scale, as each has a copy of the exemplar
        of_scales = [
            PatchRatios(task.exemplar.compared, task.exemplar.valid, [step]).at(
                task.result.compared, places, task.result.valid, task.wraps
            )
            for step in steps_for(shorter)
        ]
    except NoPatchError as error:
        raise UnmeasurableError(str(error)) from None
    ratios = np.concatenate(of_scales, axis=1)
    known = np.isfinite(ratios).any(axis=1)
    if not known.any():
        raise UnmeasurableError("masks leave no patch at a joint")
    return Joints(places[known], ratios[known], cell)


def joint_figures(joints: Joints, cells: int) -> Figures:
    """The mean ratio of the worst tenth of the joints, and the share of the result's cells with a bad one.

    The share decides the score, as few bad joints are seen less than many. A result without joints is perfect.
    """
    ratio = np.sort(joints.ratio) if len(joints.places) else np.zeros(1)
    worst = float(ratio[-max(1, round(_WORST * len(ratio))) :].mean())
    bad = float((ratio > _BAD).sum()) / max(1, cells)
    levels = np.nanmean(joints.ratios, axis=0).tolist() if len(joints.places) else []
    more = {"mean": float(ratio.mean()), "bad": bad, "levels": levels}
    return Figures(worst, _GOOD, _UNALIKE, more, share(bad, 0.0, _MOST_BAD))
