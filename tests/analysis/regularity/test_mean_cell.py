"""The median cell of a lattice is that of a wall without its door, and holds nothing of the door."""

import numpy as np
import pytest

from texloom.stages.analysis.regularity.mean_cell import MeanCell, mean_cell

GENERATORS = np.array([[20.0, 0.0], [0.0, 30.0]], np.float32)
DOOR = slice(40, 90), slice(60, 105)


def wall(move: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """A wall of tiles, each of its own brightness, and the same with a door; (120, 180, 3)."""
    random = np.random.default_rng(1)
    tile = np.full((20, 30, 3), 60.0, np.float32)
    tile[:3], tile[:, :3] = 30, 30
    tile[10:14, 12:20, 1] += 20
    clean = np.concatenate(
        [
            np.concatenate(
                [np.roll(tile, random.integers(-1, 2, 2) if move else (0, 0), (0, 1)) for _ in range(6)], 1
            )
            for _ in range(6)
        ]
    )
    clean += random.normal(0, 0.5, clean.shape).astype(np.float32)
    shown = clean.copy()
    shown[DOOR] = (20, 40, 10)
    return clean, shown


def unexplained(planes: np.ndarray, found: MeanCell) -> np.ndarray:
    return np.maximum(np.maximum(planes - found.highest, found.lowest - planes), 0).mean(axis=2)


@pytest.mark.parametrize("move", [False, True])
def test_the_median_cell_knows_nothing_of_a_door(move: bool) -> None:
    clean, shown = wall(move)
    found = mean_cell(shown, GENERATORS)
    assert found.count == 36
    rest = unexplained(shown, found)
    door = np.zeros(rest.shape, bool)
    door[DOOR] = True
    assert np.percentile(rest[door], 5) > 3
    assert np.percentile(rest[~door], 97) < 1
    assert np.abs(found.expected - clean)[~door].mean() < (4 if move else 1)


def test_excluded_pixels_have_no_influence() -> None:
    _, shown = wall()
    valid = np.ones(shown.shape[:2], bool)
    valid[:50] = False
    other = shown.copy()
    other[~valid] = 1000
    one, two = mean_cell(shown, GENERATORS, valid), mean_cell(other, GENERATORS, valid)
    np.testing.assert_array_equal(one.expected, two.expected)


def test_what_no_cell_shows_is_taken_as_the_median_of_all() -> None:
    clean, _ = wall()
    valid = np.arange(clean.shape[0]) % 20 < 10
    found = mean_cell(clean, GENERATORS, np.repeat(valid[:, None], clean.shape[1], axis=1))
    assert np.isfinite(found.median).all()
    np.testing.assert_allclose(found.median[15], np.broadcast_to([60, 60, 60], (30, 3)), atol=1)


def test_a_skewed_lattice_is_followed() -> None:
    frame = np.array([[15.0, 6.0], [-4.0, 22.0]])
    rows, columns = np.indices((140, 150))
    cycles = np.stack([rows, columns], 2) @ np.linalg.inv(frame)
    planes = (50 + 30 * np.sin(2 * np.pi * cycles[..., :1]) + 20 * np.cos(2 * np.pi * cycles[..., 1:])).astype(
        np.float32
    )
    found = mean_cell(planes, frame.astype(np.float32))
    assert np.median(unexplained(planes, found)) == 0
    assert np.abs(found.expected - planes).mean() < 5
