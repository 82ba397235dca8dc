"""Steps of tone at joints."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from tests.evaluation.helpers import encoded
from texloom.stages.common.source_maps.tone_steps import ToneSteps
from texloom.stages.evaluation._measures.pictures import prepare
from texloom.stages.evaluation._measures.steps import tone_steps
from texloom.stages.evaluation._measures.table import lines
from texloom.stages.evaluation._measures.task import Task
from texloom.stages.vocabulary.facts import NOWHERE, Wraps

TILE = 32  # px


def tiles(count: int = 5) -> np.ndarray:
    """Plain tiles of many tones in white grout, with grain, sRGB."""
    rng = np.random.default_rng(0)
    tones = rng.permutation(np.linspace(0.2, 0.7, count * count)).reshape(count, count)
    values = tones.repeat(TILE, axis=0).repeat(TILE, axis=1)
    grout = (np.arange(count * TILE) % TILE) < 4
    values = np.where(grout[:, None] | grout[None, :], 0.9, values)
    return np.asarray(values + rng.normal(0, 0.01, values.shape))


def whole(shape: tuple[int, ...]) -> np.ndarray:
    """The source map of a copy."""
    return np.stack(np.mgrid[: shape[0], : shape[1]], axis=2).astype(np.uint32)


def task(exemplar: np.ndarray, match: np.ndarray, wraps: Wraps = NOWHERE, keep: np.ndarray | None = None) -> Task:
    source, made = prepare(encoded(exemplar), encoded(exemplar[match[..., 0], match[..., 1]]), keep)
    return Task(source, made, source, match, None, wraps, 0.25, 9)


def step_map(measured: Task) -> np.ndarray:
    assert measured.match is not None
    known = measured.exemplar.compared
    steps = ToneSteps(known.shape[:2], lambda first, last: known[first:last])
    return steps.at_joints(measured.result.compared, measured.match, measured.wraps, measured.result.counted)


def line(exemplar: np.ndarray, match: np.ndarray, **options: Any) -> dict[str, Any]:
    return lines(tone_steps, task(exemplar, match, **options), ("steps",))["steps"]


def moved(match: np.ndarray, rows: slice, columns: slice, by: tuple[int, int]) -> None:
    """Show in a part of the result what is elsewhere in the exemplar."""
    match[rows, columns] += np.array(by, np.uint32)


def test_tiles_of_two_tones_are_worse_than_whole_ones_of_other_places() -> None:
    exemplar = tiles()
    swapped, halves = whole(exemplar.shape), whole(exemplar.shape)
    for row, column in ((0, 0), (1, 2), (2, 1), (3, 3)):
        rows, columns = (slice(TILE * place, TILE * (place + 1)) for place in (row, column))
        moved(swapped, rows, columns, (TILE, 0))
        moved(halves, rows, slice(columns.start, columns.start + TILE // 2), (TILE, 0))
    good, bad = line(exemplar, swapped), line(exemplar, halves)
    assert good["score"] > 0.9
    assert bad["value"] > 3 * good["value"]
    assert bad["score"] < 0.6


def test_a_contour_that_ends_at_a_joint_is_a_step() -> None:
    exemplar = np.full((128, 128), 0.4) + np.random.default_rng(1).normal(0, 0.01, (128, 128))
    exemplar[:, 60:66] = 0.9
    cut = whole(exemplar.shape)
    moved(cut, slice(64, 128), slice(40, 100), (0, 27))
    steps = step_map(task(exemplar, cut))
    assert (steps[:20] == -1).all()
    row, column = np.unravel_index(steps.argmax(), steps.shape)
    assert row == 63
    assert 55 < column < 71
    assert steps.max() > 1
    assert line(exemplar, cut)["value"] > 0


def test_pieces_of_noise_have_no_steps() -> None:
    exemplar = np.random.default_rng(2).uniform(0.3, 0.7, (128, 128))
    match = whole((120, 120))
    for row in range(0, 120, 40):
        for column in range(0, 120, 40):
            corner = np.random.default_rng(row + column).integers(0, 88, 2)
            match[row : row + 40, column : column + 40] = whole((40, 40)) + corner.astype(np.uint32)
    assert line(exemplar, match)["score"] == 1
    assert line(ndimage.gaussian_filter(exemplar, 1), match)["score"] == 1


def test_the_border_is_a_joint_where_the_result_wraps() -> None:
    exemplar = np.linspace(0.2, 0.8, 128)[None, :] + np.zeros((96, 1))
    match = whole(exemplar.shape)
    assert line(exemplar, match)["value"] == 0
    assert line(exemplar, match, wraps=Wraps(False, True))["score"] < 0.5
    assert step_map(task(exemplar, match, Wraps(False, True)))[:, :-1].max() == -1


def test_only_what_was_made_counts() -> None:
    exemplar = tiles()
    match = whole(exemplar.shape)
    moved(match, slice(0, 32), slice(0, 16), (TILE, 0))
    keep = np.zeros(exemplar.shape, bool)
    keep[:48] = True
    assert line(exemplar, match)["value"] > 0
    assert line(exemplar, match, keep=keep)["value"] == 0
    assert line(exemplar, match, keep=np.ones_like(keep))["reason"] == "nothing of the result was made"


@pytest.mark.parametrize("side", [20, 35])
def test_small_pictures_are_not_measured(side: int) -> None:
    assert "36 px" in line(tiles()[:side, :side], whole((side, side)))["reason"]
