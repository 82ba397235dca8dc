"""Straightness of lines."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from tests.evaluation.helpers import encoded, tinted
from texloom.stages.evaluation._measures import structure
from texloom.stages.evaluation._measures.pictures import prepare
from texloom.stages.evaluation._measures.table import lines
from texloom.stages.evaluation._measures.task import Task
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.masks import USABLE


def measure(exemplar: np.ndarray | Image, result: np.ndarray, keep: np.ndarray | None = None) -> dict[str, Any]:
    """The measure's line, without the time of the others."""
    exemplar = exemplar if isinstance(exemplar, Image) else encoded(exemplar)
    source, made = prepare(exemplar, encoded(result), keep)
    task = Task(source, made, source, None, None, NOWHERE, 0.25, 9)
    return lines(structure.straightness, task, ("straightness",))


def wall(height: int, width: int, tilt: float = 0.0) -> np.ndarray:
    """Rows of bricks in mortar, with grain; ``tilt`` in px per px."""
    rows, columns = np.mgrid[:height, :width]
    rows = rows + tilt * columns
    course = np.floor(rows / 20).astype(int)
    mortar = (rows % 20 < 3) | ((columns + 20 * (course % 2)) % 40 < 3)
    values = np.where(mortar, 0.8, 0.35)
    return np.asarray(ndimage.gaussian_filter(values, 0.6) + np.random.default_rng(2).normal(0, 0.02, values.shape))


def test_kinked_rows_are_less_straight() -> None:
    straight = wall(192, 256)
    kinked = straight.copy()
    for start in range(0, 256, 40):
        kinked[:, start : start + 20] = np.roll(kinked[:, start : start + 20], 4, axis=0)
    exemplar = wall(128, 128)
    good, tilted, bad = (measure(exemplar, one)["straightness"] for one in (straight, wall(192, 256, 0.12), kinked))
    assert good["score"] == 1
    assert abs(good["value"]) < 0.05
    assert min(bad["value"], tilted["value"]) > 0.1
    assert max(bad["score"], tilted["score"]) < 0.85


@pytest.mark.parametrize(("transpose", "angle"), [(False, 0), (True, 90)])
def test_lines_are_found_in_their_direction(transpose: bool, angle: int) -> None:
    exemplar = wall(128, 160).T if transpose else wall(128, 160)
    line = measure(exemplar, exemplar)["straightness"]
    assert line["value"] == 0
    assert line["more"]["angle"] == pytest.approx(angle, abs=2)


def test_the_coherence_of_a_slanted_edge_is_largest_along_it() -> None:
    rows, columns = np.mgrid[:100, :140]
    for degrees in (0, 25, 60, 90, 140):
        turn = np.deg2rad(degrees)
        # rows grow downwards, angles counter-clockwise
        tone = np.sin((rows * np.cos(turn) + columns * np.sin(turn)) / 4).astype(np.float32)
        coherence = {angle: structure.line_coherence(tone, angle, 32) for angle in np.arange(0.0, 180.0, 5.0)}
        assert max(coherence, key=lambda one: coherence[one]) == degrees
        assert coherence[degrees] > 0.9


def test_a_texture_without_lines_is_not_scored_for_them() -> None:
    speckle = np.random.default_rng(4).uniform(0, 1, (128, 128))
    assert "straight lines" in measure(speckle, speckle)["straightness"]["reason"]


def test_polygons_are_not_scored_by_the_direction_of_one_of_their_sides() -> None:
    def polygons(seed: int) -> np.ndarray:
        points = np.random.default_rng(seed).uniform(-20, 180, (60, 2))
        places = np.stack(np.mgrid[:160, :160], axis=2)[:, :, None]
        nearest = np.sort(np.hypot(*np.moveaxis(places - points, 3, 0)), axis=2)
        return np.asarray(np.clip((nearest[..., 1] - nearest[..., 0]) / 3, 0, 1) * 0.6 + 0.2)

    assert measure(polygons(1), polygons(2))["straightness"]["score"] in (None, 1)


def test_masked_pixels_change_nothing() -> None:
    values = tinted("brick")[:160, :180]
    usable = np.ones((160, 180, 1), np.float32)
    usable[60:90, 60:90] = 0
    pictures = [
        Image(np.concatenate([encoded(one).pixels, usable], axis=2), ("R", "G", "B", USABLE))
        for one in (values, np.where(usable > 0, values, np.random.default_rng(3).uniform(0, 1, values.shape)))
    ]
    measured = [measure(one, values) for one in pictures]
    assert measured[0] == measured[1]
    assert abs(measured[0]["straightness"]["value"]) < 0.15


def test_given_parts_are_not_judged() -> None:
    values = tinted("brick")[:96, :96]
    keep = np.zeros((96, 96), bool)
    keep[:40] = True
    assert "given" in measure(values, values, keep=keep)["straightness"]["reason"]
