"""Detail of an exemplar's control that the target's control does not have."""

from __future__ import annotations

import numpy as np

from tests.synthetic import smooth_noise, spots
from texloom.stages.synthesis.control_maps.detail_of_control import as_smooth_as

SHAPE = (96, 112)


def ramp(shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """From 0 at the left to 1 at the right."""
    return np.tile(np.linspace(0, 1, shape[1], dtype=np.float32)[:, None], (shape[0], 1, 1))


def spotted(rng: np.random.Generator, channels: int = 1) -> np.ndarray:
    """Other spots in each channel."""
    return np.stack([spots(SHAPE, rng) for _ in range(channels)], axis=2).astype(np.float32)


def test_under_a_smooth_target_detail_is_removed(rng: np.random.Generator) -> None:
    for channels in (1, 3):
        own = spotted(rng, channels)
        smooth = as_smooth_as(own, ramp((150, 150)).repeat(channels, axis=2), toroidal=False)
        assert smooth.shape == own.shape
        assert smooth.dtype == np.float32
        assert np.abs(np.diff(smooth, axis=0)).mean() < 0.1 * np.abs(np.diff(own, axis=0)).mean()
        # what remains is the share of the spots
        middle = smooth[20:-20, 20:-20, 0]
        assert np.corrcoef(middle.mean(axis=0), ramp()[0, 20:-20, 0])[0, 1] > 0.9


def test_under_a_target_with_as_much_detail_control_is_as_it_was(rng: np.random.Generator) -> None:
    own = spotted(rng)
    assert as_smooth_as(own, np.ascontiguousarray(own[:, ::-1]), toroidal=False) is own
    assert as_smooth_as(own, spotted(rng), toroidal=True) is own


def test_a_line_in_a_smooth_target_counts(rng: np.random.Generator) -> None:
    own, target = spotted(rng), ramp((200, 200))
    assert as_smooth_as(own, target, toroidal=False) is not own
    target[99:102] = 0
    assert as_smooth_as(own, target, toroidal=False) is own


def test_borders_between_even_regions_are_no_lines(rng: np.random.Generator) -> None:
    rows, columns = np.indices((200, 200))
    painted = (np.hypot(rows - 100, columns - 100) < 60).astype(np.float32)[..., None]
    own = spotted(rng)
    assert as_smooth_as(own, painted, toroidal=False) is not own
    painted[np.abs(rows - columns) < 3] = 0.5
    assert as_smooth_as(own, painted, toroidal=False) is own


def test_joints_of_a_smooth_control_are_no_detail() -> None:
    own = ramp()
    own[48:] = own[48:, ::-1]
    assert as_smooth_as(own, ramp((150, 150)), toroidal=False) is own


def test_labels_stay_sharp() -> None:
    labels = np.eye(3, dtype=np.float32)
    own = labels[np.repeat([0, 1, 2, 1], 28)][None].repeat(SHAPE[0], axis=0)
    target = np.broadcast_to(labels[1], (80, 80, 3))
    assert as_smooth_as(own, target, toroidal=False) is own


def test_a_toroidal_control_is_blurred_across_its_border(rng: np.random.Generator) -> None:
    own = smooth_noise(SHAPE, 1, rng)[..., None].astype(np.float32)
    target = np.full((60, 60, 1), 0.5, np.float32)
    moved = np.roll(own, (40, 30), axis=(0, 1))
    smooth = as_smooth_as(own, target, toroidal=True)
    np.testing.assert_allclose(
        np.roll(smooth, (40, 30), axis=(0, 1)), as_smooth_as(moved, target, toroidal=True), atol=1e-6
    )


def test_without_control_there_is_nothing_to_do() -> None:
    none = np.zeros((*SHAPE, 0), np.float32)
    assert as_smooth_as(none, np.zeros((50, 50, 0), np.float32), toroidal=False) is none
