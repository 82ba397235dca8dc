"""How far a texture repeats itself more than its exemplar."""

from __future__ import annotations

import numpy as np
import pytest

from texloom.stages.common.regularity.excess_repetition import repetition


def lines(height: int, rng: np.random.Generator) -> np.ndarray:
    """Upright lines that explain half of the variance, and noise."""
    profile = np.random.default_rng(3).normal(size=512)
    noise = rng.normal(size=(height, 512)) * profile.std()
    return np.asarray(profile + noise, np.float32)


@pytest.mark.parametrize("along", [0, 1])
def test_straight_lines_are_no_repetition(rng: np.random.Generator, along: int) -> None:
    exemplar, result = (np.moveaxis(picture, 0, along) for picture in (lines(256, rng)[:, :256], lines(512, rng)))
    assert repetition(np.ascontiguousarray(exemplar), np.ascontiguousarray(result))[0] < 0.1


def test_a_copy_along_straight_lines_is_repetition(rng: np.random.Generator) -> None:
    exemplar = lines(256, rng)[:, :256]
    value, offset = repetition(exemplar, np.tile(exemplar, (2, 2)))
    assert value > 0.9
    assert not any(step % 256 for step in offset)


def tiles(count: int, rng: np.random.Generator) -> np.ndarray:
    """Square tiles of 64 px between dark joints of 4 px, each of its own grain."""
    picture = rng.normal(scale=0.3, size=(64 * count, 64 * count))
    inside = np.arange(64 * count) % 64 >= 4
    return np.asarray(picture + inside[:, None] * inside, np.float32)


def test_a_lattice_that_goes_on_is_no_repetition(rng: np.random.Generator) -> None:
    """Joints correlate at offsets of whole cells, which are too few for the exemplar's usual correlation."""
    assert repetition(tiles(4, rng), tiles(8, rng))[0] < 0.1


def test_a_copy_of_a_lattice_is_repetition(rng: np.random.Generator) -> None:
    exemplar = tiles(4, rng)
    value, offset = repetition(exemplar, np.tile(exemplar, (2, 2)))
    assert value > 0.9
    assert not any(step % 256 for step in offset)
