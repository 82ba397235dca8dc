"""Rectangles on walls of known extent."""

from __future__ import annotations

import numpy as np
import pytest

from tests.analysis.photographs.test_plane_proposal import bricks, pixels, rectangle, rendered
from texloom.stages.analysis.photographs import bezier
from texloom.stages.analysis.photographs.plane_extent import extended
from texloom.stages.common.features.line_segments import line_segments
from texloom.stages.vocabulary.arrays import Image


def part(corners: np.ndarray, low: float, high: float) -> np.ndarray:
    """Of a wall, from one share of its sides to another."""
    square = np.array([[low, low, 1], [low, high, 1], [high, high, 1], [high, low, 1]])
    there = square @ bezier.homography(corners).T
    return np.asarray(there[:, :2] / there[:, 2:])


def shares(corners: np.ndarray, found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the greatest place of a rectangle along the sides of a wall, 0..1 on it."""
    flat = np.concatenate([found, np.ones((4, 1))], axis=1) @ np.linalg.inv(bezier.homography(corners)).T
    places = flat[:, :2] / flat[:, 2:]
    # Still a rectangle on the plane.
    assert np.ptp(places[[0, 1], 0]) < 1e-6
    assert np.ptp(places[[0, 3], 1]) < 1e-6
    return places[0], places[2]


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.1), (0.2, -0.4, 0.1), (-0.3, 0.1, 0.0)])
def test_a_part_of_a_wall_is_extended_to_its_end(
    pose: tuple[float, float, float], rng: np.random.Generator
) -> None:
    corners = pixels(rectangle(2.6, 3.4, *pose))
    photo = rendered([(bricks(10, 7, True, rng), corners)], rng)
    found = extended(photo, part(corners, 0.25, 0.75), line_segments(photo))
    first, last = shares(corners, found.corners)
    assert (first >= -0.03).all()
    assert (last <= 1.03).all()
    assert np.prod(last - first) > 0.6  # of .25
    assert found.share == pytest.approx(np.prod(last - first) / 0.25)


def test_the_whole_of_a_wall_is_not_extended_over_what_is_behind(rng: np.random.Generator) -> None:
    corners = pixels(rectangle(1.6, 2.0, 0.1, 0.2, 0.0))
    photo = rendered([(bricks(10, 7, True, rng), corners)], rng)
    found = extended(photo, corners, line_segments(photo))
    assert found.share == 1
    np.testing.assert_allclose(found.corners, corners, atol=1e-6)


def test_only_what_the_photograph_shows_is_added(rng: np.random.Generator) -> None:
    corners = pixels(rectangle(6.0, 8.0, 0.0, 0.2, 0.0))  # beyond the photograph on all sides
    photo = rendered([(bricks(30, 20, True, rng), corners)], rng)
    found = extended(photo, part(corners, 0.4, 0.6), line_segments(photo))
    middles = (found.corners + np.roll(found.corners, -1, axis=0)) / 2
    assert found.share > 1.5
    assert (middles > -25).all()
    assert (middles < np.array([photo.height, photo.width]) + 25).all()


def test_a_rectangle_that_is_too_narrow_stays(rng: np.random.Generator) -> None:
    photo = Image(rng.random((64, 64, 3)).astype(np.float32), ("R", "G", "B"))
    corners = np.array([[10, 10], [10, 60], [12, 60], [12, 10]], float)
    assert extended(photo, corners, line_segments(photo)).share == 1
