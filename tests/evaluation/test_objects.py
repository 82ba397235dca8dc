"""Objects at joints: fused discs against seamless joints, and the measure against a slow and plain form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from tests.evaluation.helpers import encoded, tinted
from tests.evaluation.test_joints import copied, grid, task, with_block
from texloom.stages.evaluation._measures import joints
from texloom.stages.evaluation._measures.objects import departures, objects
from texloom.stages.evaluation._measures.pictures import prepare
from texloom.stages.evaluation._measures.table import lines
from texloom.stages.evaluation._measures.task import Task
from texloom.stages.evaluation.metrics import MetricsParams, metrics
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.masks import USABLE

PERIOD = 32


def discs(side: int) -> Image:
    """Bright discs on a grid, with grain."""
    rows, columns = (axis % PERIOD - PERIOD / 2 for axis in np.mgrid[:side, :side])
    values = ndimage.gaussian_filter(np.where(np.hypot(rows, columns) < 13, 0.8, 0.2), 0.7)
    return encoded(values + np.random.default_rng(1).normal(0, 0.01, values.shape))


def continued(side: int, size: int) -> np.ndarray:
    """A source map of ``size`` px that continues the discs of an exemplar of ``side`` px by whole periods."""
    sources = grid(size, size)
    beyond = sources >= side - PERIOD
    sources[beyond] = sources[beyond] % PERIOD + PERIOD
    return sources


def fused(match: np.ndarray, count: int) -> np.ndarray:
    """Gaps between discs and their right neighbours are filled with the middle of a disc."""
    changed = match.copy()
    gaps = [(row, column) for row in range(16, len(match), PERIOD) for column in range(32, len(match) - 8, PERIOD)]
    for index in np.random.default_rng(2).permutation(len(gaps))[:count]:
        row, column = gaps[index]
        changed[row - 7 : row + 7, column - 6 : column + 6] = grid(14, 12) + np.array([41, 42], np.uint32)
    return changed


def test_fused_discs_differ_from_what_the_exemplar_continues() -> None:
    exemplar = discs(192)
    match = continued(192, 256)
    results = [lines(objects, task(exemplar, fused(match, count)), ("objects",))["objects"] for count in (0, 4, 16)]
    assert results[0]["value"] < 0.1
    assert results[0]["score"] == 1
    assert results[1]["value"] > results[0]["value"] + 0.5
    assert results[2]["value"] >= results[1]["value"]
    assert results[2]["score"] < 0.5


def test_a_copy_has_no_fused_objects() -> None:
    exemplar = encoded(tinted("brick")[:128, :128])
    line = lines(objects, task(exemplar, grid(128, 128)[10:100, 20:120]), ("objects",))["objects"]
    assert (line["value"], line["score"]) == (0, 1)


def test_without_a_source_map_objects_are_not_measured() -> None:
    exemplar = encoded(tinted("brick")[:64, :64])
    line = metrics(exemplar, exemplar, MetricsParams()).table["measures"]["objects"]
    assert line["reason"] == "no source map was given"


def test_departures_are_those_of_the_continued_sources() -> None:
    match = with_block(grid(60, 60), 20, 20, (5, 30))
    measured = task(encoded(tinted("gravel")[100:160, 100:160]), match)
    exemplar, result = (picture.lab.astype(np.float64) for picture in (measured.exemplar, measured.result))
    variance = exemplar.reshape(-1, 3).var(axis=0).sum()
    places = np.array([(19, 30), (30, 19), (43, 25), (30, 43)])
    for (row, column), departure in zip(places, departures(measured, places), strict=True):
        here = result[row - 4 : row + 5, column - 4 : column + 5].reshape(81, 3)
        expected = []
        for down, right in ((0, 0), (0, 1), (1, 0)):
            top, left = match[row + down, column + right].astype(int) - (down, right)
            beside = exemplar[top - 4 : top + 5, left - 4 : left + 5].reshape(81, 3)
            spread = (here.var(axis=0).sum() + beside.var(axis=0).sum()) / 2
            expected.append(((here - beside) ** 2).sum(axis=1).mean() / (spread + variance))
        assert departure == pytest.approx(max(expected), rel=1e-3)


def test_surroundings_wrap_around_in_tileable_results() -> None:
    exemplar = discs(128)
    for match, tileable, least, most in (
        (grid(96, 96), False, 0.0, 0.0),
        (grid(96, 96), True, 1e-4, 0.1),
        (grid(96, 80), True, 0.5, 5.0),
    ):
        places = np.array([(50, match.shape[1] - 1)])
        assert least <= departures(task(exemplar, match, tileable), places)[0] <= most


def test_masked_and_given_pixels_are_ignored() -> None:
    exemplar = encoded(tinted("gravel")[:160, :160])
    match = with_block(with_block(grid(160, 160), 20, 20, (100, 90)), 100, 100, (30, 40))
    keep = np.ones((160, 160), bool)
    keep[90:, 90:] = False
    source, result = prepare(exemplar, copied(exemplar, match), keep)
    made = Task(source, result, source, match, None, NOWHERE, 0.25, 9)
    assert (joints.worst_joints(made, source.lab, result.lab)[0] >= 90).all()
    usable = np.ones((160, 160, 1), np.float32)
    usable[60:80, 60:80] = 0
    values = []
    for pixels in (exemplar.pixels, np.where(usable > 0, exemplar.pixels, np.float32(0.9))):
        masked = Image(np.concatenate([pixels, usable], axis=2), (*exemplar.channels, USABLE))
        values.append(objects(task(masked, match)).value)
    assert values[0] == values[1]
    assert values[0] > 0
