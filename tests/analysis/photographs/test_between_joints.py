"""Whole periods of a surface, from joint to joint."""

from __future__ import annotations

import itertools
import logging

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.photographs.between_joints import BetweenJointsParams, between_joints

NONE = np.zeros((0, 2), np.float32)


def shelves(joints: list[int], height: int, rng: np.random.Generator) -> np.ndarray:
    """Bright boards of 4 px in these rows; between two of them shade above things."""
    rows = np.full(height, 0.15)
    for top, bottom in itertools.pairwise(joints):
        rows[(top + bottom) // 2 : bottom] = 0.3
    for joint in joints:
        rows[max(0, joint - 2) : joint + 2] = 0.9
    return np.clip(rows[:, None] + 0.02 * smooth_noise((height, 160), 1, rng), 0.01, 1)


def test_rows_that_are_cut_are_left_out(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    image = picture(shelves([30, 90, 150, 210], 235, rng))
    with caplog.at_level(logging.WARNING):
        made = between_joints(image, np.array([[60, 0]], np.float32), BetweenJointsParams())
    top, left, height, width = made.table["box"]
    assert abs(top - 30) <= 2
    assert abs(height - 180) <= 2
    assert (left, width) == (0, 160)
    assert made.image.pixels.shape[:2] == (height, width)
    assert made.table["periods"] == [3, 0]
    assert "3 down" in caplog.text


def test_a_row_of_another_height_is_left_out(rng: np.random.Generator) -> None:
    made = between_joints(
        picture(shelves([20, 80, 140, 212], 214, rng)), np.array([[60, 0]], np.float32), BetweenJointsParams()
    )
    assert made.table["periods"] == [2, 0]
    assert abs(made.table["box"][2] - 120) <= 2


def test_boards_are_two_rows_of_things_apart(rng: np.random.Generator) -> None:
    """Of a period that is half of theirs."""
    image = picture(shelves([30, 90, 150, 210], 235, rng))
    made = between_joints(image, np.array([[30, 0]], np.float32), BetweenJointsParams())
    np.testing.assert_allclose(made.generators, [[60, 0]], atol=1)


def test_both_generators_are_told_of_what_is_cropped(rng: np.random.Generator) -> None:
    """That along the cropped side by its joints: few periods are left to find them in."""
    image = picture(shelves([30, 90, 150, 210], 235, rng))
    made = between_joints(image, np.array([[0, 40], [59, 0]], np.float32), BetweenJointsParams())
    np.testing.assert_allclose(made.generators, [[60, 0], [0, 40]], atol=0.7)
    slanted = between_joints(image, np.array([[59, 0], [30, 40]], np.float32), BetweenJointsParams())
    assert slanted.table["periods"] == [3, 0]
    assert len(slanted.generators) == 0


@pytest.mark.parametrize("generators", [NONE, np.array([[60, 30]], np.float32), np.array([[5, 0]], np.float32)])
def test_all_is_kept_where_no_period_runs_along_a_side(generators: np.ndarray, rng: np.random.Generator) -> None:
    image = picture(shelves([30, 90, 150, 210], 235, rng))
    made = between_joints(image, generators, BetweenJointsParams())
    assert made.image is image
    assert made.table["why"] == ""


def test_all_is_kept_when_asked_or_where_much_would_be_lost(rng: np.random.Generator) -> None:
    image = picture(shelves([30, 90, 150, 210], 235, rng))
    period = np.array([[60, 0]], np.float32)
    assert between_joints(image, period, BetweenJointsParams(whole=False)).image is image
    uneven = picture(shelves([20, 80, 140, 230, 300, 350], 380, rng))
    assert between_joints(uneven, period, BetweenJointsParams()).image is uneven
