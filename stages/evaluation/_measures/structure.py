"""The straightness of long lines, which measures of small patches do not see."""

import numpy as np
from jaxtyping import Float32

from texloom.stages.common.similarity.patch_distance import blurred
from texloom.stages.evaluation._measures.pictures import (
    MeasuredPicture,
    UnmeasurableError,
    require_side,
    require_variation,
)
from texloom.stages.evaluation._measures.table import Figures
from texloom.stages.evaluation._measures.task import Task
from texloom.stages.vocabulary.arrays import Mask

_ANGLE = 6.0  # degrees between directions that are tried
_LINE = (16, 32)  # px, range of the length along which lines are straight
_MARGIN = 4  # px about masks and borders that filters reach
_BEND = 0.02  # amplitude of the bent exemplar over its shorter side
_GOOD = 0.05  # share of the straightness that good results lose
_MAX_SIDE = 512  # px; larger results are halved before lines are sought


def line_coherence(tone: Float32[np.ndarray, "h w"], angle: float, length: int, valid: Mask | None = None) -> float:
    """Share of the power of the gradient across ``angle`` that is left after averaging along it.

    Parameters
    ----------
    angle : direction of the lines, degrees, counter-clockwise from the rows.
    length : of the average, px.
    """
    import cv2

    height, width = tone.shape
    turn = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), -angle, 1.0)
    cosine, sine = abs(turn[0, 0]), abs(turn[0, 1])
    size = (int(np.ceil(width * cosine + height * sine)), int(np.ceil(height * cosine + width * sine)))
    turn[:, 2] += (np.array(size) - (width, height)) / 2
    known = np.ones(tone.shape, np.uint8) if valid is None else valid.astype(np.uint8)
    turned = cv2.warpAffine(tone, turn, size, flags=cv2.INTER_LINEAR)
    known = cv2.warpAffine(known, turn, size, flags=cv2.INTER_NEAREST)
    inside = cv2.erode(known, np.ones((2 * _MARGIN + 1, 2 * _MARGIN + 1), np.uint8), borderValue=0).astype(
        np.float32
    )
    across = cv2.Sobel(blurred(turned, 1.0), cv2.CV_32F, 0, 1) * inside
    along = cv2.boxFilter(across, -1, (length, 1), borderType=cv2.BORDER_CONSTANT)
    whole = cv2.boxFilter(inside, -1, (length, 1), borderType=cv2.BORDER_CONSTANT) > 1 - 0.5 / length
    power = float((across[whole] ** 2).mean(dtype=np.float64)) if whole.any() else 0.0
    return float((along[whole] ** 2).mean(dtype=np.float64)) / power if power > 0 else 0.0


def bent(tone: Float32[np.ndarray, "h w"], amplitude: float, period: float) -> Float32[np.ndarray, "h w"]:
    """A picture displaced along both axes by waves; px."""
    import cv2

    rows, columns = np.mgrid[: tone.shape[0], : tone.shape[1]].astype(np.float32)
    down, right = (
        np.float32(amplitude) * np.sin(np.float32(2 * np.pi / period) * axis) for axis in (columns, rows)
    )
    return np.asarray(
        cv2.remap(tone, columns + right, rows + down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    )


def straightness(task: Task) -> Figures:
    """How much of the straightness of the exemplar's lines the result has lost, in their main direction."""
    require_variation(task.exemplar)
    require_variation(task.result, "the result")
    require_side(4 * _LINE[0], task.exemplar, task.result)
    task.require_all_made()
    step = max(1, task.result.shorter // _MAX_SIDE)
    exemplar, result = (_reduced(picture, step) for picture in (task.exemplar, task.result))
    shorter = min(*exemplar[0].shape, *result[0].shape)
    length = int(np.clip(shorter // 8, _LINE[0] // step, _LINE[1]))
    tone, valid = exemplar
    coherence = {angle: line_coherence(tone, angle, length, valid) for angle in np.arange(0, 180, _ANGLE)}
    angle = max(coherence, key=lambda one: coherence[one])
    for turn in (_ANGLE / 2, _ANGLE / 4):
        coherence |= {one: line_coherence(tone, one, length, valid) for one in (angle - turn, angle + turn)}
        angle = max(coherence, key=lambda one: coherence[one])
    straight = coherence[angle]
    if straight <= 0:
        raise UnmeasurableError("the exemplar has no lines")
    waved = bent(tone, _BEND * min(tone.shape), 3.0 * length)

    def lost(tone: np.ndarray, valid: Mask | None = None) -> float:
        return 1 - line_coherence(tone, angle, length, valid) / straight

    # Where lines run in many directions, as of polygons, each direction's share differs from part to part.
    parts = [np.ascontiguousarray(part) for axis in (0, 1) for part in np.array_split(tone, 2, axis)]
    floor = max(_GOOD, *(lost(part) for part in parts)) if valid is None else _GOOD
    more = {"angle": float(angle % 180), "length": length * step, "coherence": straight}
    unclear = "the exemplar has no long straight lines"
    value, worst = lost(*result), lost(waved, valid)
    # parts of the exemplar that differ half as much as bent lines do leave nothing to be told
    return Figures(value, floor, max(worst, floor) if worst < 2 * floor else worst, more, unclear=unclear)


def _reduced(picture: MeasuredPicture, step: int) -> tuple[np.ndarray, Mask | None]:
    """Tone and valid pixels at a whole fraction of the size."""
    import cv2

    if step == 1:
        return picture.tone, picture.valid
    size = (picture.tone.shape[1] // step, picture.tone.shape[0] // step)
    tone = cv2.resize(picture.tone, size, interpolation=cv2.INTER_AREA)
    if picture.valid is None:
        return tone, None
    return tone, cv2.resize(picture.valid.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.999
