from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import difference, picture, smooth_noise
from texloom.stages.analysis.regularity.lattice import detail, gradient_magnitude, self_correlation, valid_lightness
from texloom.stages.analysis.regularity.lattice_selection import LatticeSelectionParams, lattice_selection
from texloom.stages.analysis.regularity.offset_statistics import OffsetStatisticsParams, offset_statistics
from texloom.stages.analysis.regularity.superlattice import superlattice
from texloom.stages.vocabulary.arrays import Image

SEEDS = pytest.mark.parametrize("seed", [0, 1, 2])


def tones(one: np.ndarray, other: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A random tone for each of the elements that two numbers tell apart, -1..1."""
    return rng.uniform(-1, 1, 4096)[(one * 73 + other * 179) % 4096]


def worn(tone: np.ndarray, rng: np.random.Generator) -> Image:
    return picture(np.clip(tone + 0.08 * (smooth_noise(tone.shape, 2.0, rng) - 0.5), 0, 1))


def squares(seed: int, side: int, contrast: float, spread: float) -> Image:
    """A checkerboard with joints, of tones ``contrast`` apart that each vary by ``spread``."""
    rng = np.random.default_rng(seed)
    row, column = np.indices((256, 256)) + rng.integers(0, side, 2)[:, None, None]
    one, other = row // side, column // side
    tone = 0.45 + contrast * ((one + other) % 2 - 0.5) + spread * tones(one, other, rng)
    return worn(np.where((row % side < 2) | (column % side < 2), 0.1, tone), rng)


def herringbone(seed: int, width: int, ratio: int) -> Image:
    """Planks of random tones, ``ratio`` times as long as wide."""
    rng = np.random.default_rng(seed)
    row, column = np.indices((256, 256)) + rng.integers(500, 600, 2)[:, None, None]
    down, across = row // width, column // width
    phase = (across - down) % (2 * ratio)
    level = phase < ratio
    top = np.where(level, down, down - (2 * ratio - 1 - phase))
    left = np.where(level, across - phase, across)
    bottom, right = np.where(level, 1, ratio), np.where(level, ratio, 1)
    y, x = row - top * width, column - left * width
    joint = np.minimum(np.minimum(y, bottom * width - 1 - y), np.minimum(x, right * width - 1 - x)) < 1
    return worn(np.where(joint, 0.15, 0.45 + 0.1 * tones(top, left, rng)), rng)


def larger(image: Image, generators: np.ndarray, gradients: bool = False) -> np.ndarray:
    plane = valid_lightness(image)
    if gradients:
        plane = gradient_magnitude(plane, None)
    return superlattice(generators, self_correlation(detail(plane)))


@SEEDS
@pytest.mark.parametrize("side", [20, 40])
def test_a_checkerboard_repeats_in_every_second_square(seed: int, side: int) -> None:
    found = larger(squares(seed, side, 0.12, 0.05), side * np.eye(2))
    assert difference(found, side * np.array([[1.0, 1.0], [1.0, -1.0]])) < 1e-6


@SEEDS
@pytest.mark.parametrize("ratio", [2, 3, 4])
def test_herringbone_repeats_in_pairs_of_planks(seed: int, ratio: int) -> None:
    """Not by the width of a plank, by which most joints do; of ``2 * ratio`` squares of it is a cell."""
    found = larger(herringbone(seed, 12, ratio), 12 * np.eye(2), gradients=True)
    assert difference(found, 12 * np.array([[1.0, 1.0], [-ratio, ratio]])) < 1e-6


@SEEDS
@pytest.mark.parametrize(("side", "spread"), [(20, 0.05), (20, 0.2), (44, 0.1)])
@pytest.mark.parametrize("gradients", [False, True])
def test_tiles_of_random_tones_keep_their_lattice(seed: int, side: int, spread: float, gradients: bool) -> None:
    found = larger(squares(seed, side, 0.0, spread), side * np.eye(2), gradients)
    np.testing.assert_array_equal(found, side * np.eye(2))


def test_few_cells_tell_nothing() -> None:
    image = squares(0, 100, 0.3, 0.0)
    np.testing.assert_array_equal(larger(image, 100 * np.eye(2)), 100 * np.eye(2))


@SEEDS
def test_larger_cells_are_selected(seed: int) -> None:
    image = squares(seed, 20, 0.12, 0.05)
    found = lattice_selection(
        image, offset_statistics(image, OffsetStatisticsParams()).density, LatticeSelectionParams()
    )
    assert difference(found.generators, np.array([[20.0, 20.0], [20.0, -20.0]])) < 0.5
    assert found.cells == pytest.approx(256**2 / 800, rel=0.02)
