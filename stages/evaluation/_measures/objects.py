"""Objects at joints of the source map: how unlike the exemplar's continuation the result is there."""

import numpy as np
from jaxtyping import Float32

from texloom.stages.common.similarity.patch_distance import Places, blurred
from texloom.stages.evaluation._measures.joints import worst_joints
from texloom.stages.evaluation._measures.pictures import (
    Picture,
    UnmeasurableError,
    require_side,
    require_variation,
)
from texloom.stages.evaluation._measures.table import Figures
from texloom.stages.evaluation._measures.task import Task
from texloom.stages.vocabulary.facts import NOWHERE, Wraps

_SIDE = 9  # px of the surroundings that are compared
_BLUR = 2.0  # px; detail that is finer does not tell where objects are cut
_WORST = 0.03  # share of the joints; a few fused objects have few
_GOOD, _BAD = 0.3, 1.8  # of worst joints: of the best results; usual of blocks joined at random
_CHUNK = 512


def _surroundings(picture: Picture, mean: np.ndarray, places: Places, wrap: Wraps) -> tuple[np.ndarray, np.ndarray]:
    """What is compared, less ``mean``, about each place, (n, pixel, channel); which pixels count."""
    offsets = np.stack(np.divmod(np.arange(_SIDE**2), _SIDE), axis=1) - _SIDE // 2
    shape = np.array(picture.tone.shape)
    wanted = places[:, None] + offsets
    around = np.array(wrap)
    inside = (around | ((wanted >= 0) & (wanted < shape))).all(axis=2)
    rows, columns = np.moveaxis(np.where(around, wanted % shape, np.clip(wanted, 0, shape - 1)), 2, 0)
    if picture.valid is not None:
        inside = inside & picture.valid[rows, columns]
    return picture.compared[rows, columns] - mean, inside


def departures(task: Task, places: Places) -> Float32[np.ndarray, "*n"]:
    """Squared difference of the result about a joint to what the exemplar shows about the joint's sources.

    The larger of the sources on both sides, each continued across the joint, over the variance of the surroundings
    plus that of the exemplar. NaN where more than half of the surroundings is masked or outside.
    """
    match = task.source_map()
    mean = task.exemplar.colors.mean(axis=0)[: task.exemplar.compared.shape[2]]
    variance = np.float32(task.exemplar.variances.sum())
    largest = np.full(len(places), np.nan, np.float32)
    for start in range(0, len(places), _CHUNK):
        chosen = places[start : start + _CHUNK]
        result, made = _surroundings(task.result, mean, chosen, task.wraps)
        for step in ((0, 0), (0, 1), (1, 0)):
            moved = np.where(np.array(task.wraps) | (chosen + step < match.shape[:2]), step, 0)
            beside = (chosen + moved) % match.shape[:2]
            sources = match[beside[:, 0], beside[:, 1]].astype(np.int64) - moved
            exemplar, known = _surroundings(task.exemplar, mean, sources, NOWHERE)
            departure = _relative_difference(result, exemplar, made & known, variance)
            largest[start : start + _CHUNK] = np.fmax(largest[start : start + _CHUNK], departure)
    return largest


def _relative_difference(
    one: np.ndarray, other: np.ndarray, counted: np.ndarray, variance: np.float32
) -> np.ndarray:
    share = counted.astype(np.float32)
    number = share.sum(axis=1)
    share /= np.maximum(number, 1)[:, None]
    difference = one - other
    distance = np.einsum("np,npc,npc->n", share, difference, difference)
    spread = np.zeros_like(distance)
    for values in (one, other):
        means = np.einsum("np,npc->nc", share, values)
        spread += np.einsum("np,npc,npc->n", share, values, values) - (means * means).sum(axis=1)
    return np.where(2 * number >= counted.shape[1], distance / (spread / 2 + variance), np.float32(np.nan))


def objects(task: Task) -> Figures:
    """The mean departure at the worst joints; a result without joints is perfect."""
    task.source_map()
    require_variation(task.exemplar)
    require_side(4 * _SIDE, task.exemplar, task.result)
    places, _ = worst_joints(task, *(blurred(picture.compared, _BLUR) for picture in (task.exemplar, task.result)))
    if not len(places):
        return Figures(0.0, _GOOD, _BAD, {"mean": 0.0})
    departure = departures(task, places)
    departure = np.sort(departure[np.isfinite(departure)])
    if not len(departure):
        raise UnmeasurableError("masks leave too little at the joints")
    worst = departure[-max(1, round(_WORST * len(departure))) :]
    return Figures(float(worst.mean()), _GOOD, _BAD, {"mean": float(departure.mean())})
