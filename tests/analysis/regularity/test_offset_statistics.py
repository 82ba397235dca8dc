from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise, stamped, tiled
from texloom.stages.analysis.regularity.offset_statistics import (
    OffsetStatistics,
    OffsetStatisticsParams,
    offset_statistics,
)
from texloom.stages.vocabulary.arrays import Image

SHAPE = (200, 240)


def measured(image: Image, **params: float) -> OffsetStatistics:
    return offset_statistics(image, OffsetStatisticsParams(**params))  # type: ignore[arg-type]


@pytest.fixture
def repeated(rng: np.random.Generator) -> tuple[Image, np.ndarray]:
    """A picture that is exactly periodic, and its generators."""
    import cv2

    cell = cv2.GaussianBlur(np.tile(rng.random((36, 44, 3)), (3, 3, 1)), (0, 0), 1.5)[36:72, 44:88]
    return tiled(cell, 15, SHAPE)


def off_lattice(offsets: np.ndarray, generators: np.ndarray) -> np.ndarray:
    """Distance of each offset to the nearest lattice point, px."""
    cells = offsets @ np.linalg.inv(generators)
    return np.hypot(*((cells - np.rint(cells)) @ generators).T)


def test_equal_features_are_whole_cells_apart(repeated: tuple[Image, np.ndarray]) -> None:
    """At a ratio this small only equal descriptors match."""
    image, generators = repeated
    offsets = measured(image, ratio=0.05).offsets
    assert len(offsets) > 100
    assert off_lattice(offsets, generators).max() < 0.5

    steps = np.array([(i, j) for i in range(-3, 4) for j in range(-3, 4) if (i, j) != (0, 0)])
    points = steps @ generators
    points = points[(np.abs(points) < np.array(SHAPE) / 2).all(axis=1)]
    reached = np.array([(np.hypot(*(offsets - point).T) < 0.5).sum() for point in points])
    assert (reached > 5).all()
    assert reached.sum() == len(offsets)


def test_density_is_highest_at_whole_cells(repeated: tuple[Image, np.ndarray]) -> None:
    image, generators = repeated
    density = measured(image).density
    highest = np.argwhere(density > 0.6) - np.array(density.shape) // 2
    assert len(highest) > 20
    assert off_lattice(highest, generators).max() <= 2


def test_density_is_a_sum_of_gaussians_at_the_offsets(repeated: tuple[Image, np.ndarray]) -> None:
    result = measured(repeated[0])
    row, column = (np.arange(side) - side // 2 for side in result.density.shape)
    expected = np.zeros(result.density.shape)
    places, counts = np.unique(np.rint(result.offsets), axis=0, return_counts=True)
    for place, count in zip(places, counts, strict=True):
        down, across = ((axis - at) / 1.7 for axis, at in zip((row, column), place, strict=True))  # least spread
        expected += count * np.exp(-(down**2) / 2)[:, None] * np.exp(-(across**2) / 2)
    np.testing.assert_allclose(result.density, expected / expected.max(), atol=0.01)


@pytest.mark.parametrize("shape", [(200, 240), (201, 239)])
def test_offsets_come_with_their_opposites(shape: tuple[int, int], rng: np.random.Generator) -> None:
    result = measured(stamped(np.array([[50.0, 10.0], [0.0, 60.0]]), rng, shape))
    assert result.density.shape == (2 * (shape[0] // 2) + 1, 2 * (shape[1] // 2) + 1)
    np.testing.assert_allclose(result.density, result.density[::-1, ::-1], atol=1e-6)
    assert result.density.max() == 1
    assert result.density.min() >= 0
    assert sorted(map(tuple, result.offsets.tolist())) == sorted(map(tuple, (-result.offsets).tolist()))
    assert (np.hypot(*result.offsets.T) > 5).all()
    assert (np.abs(result.offsets) < np.array(shape) / 2).all()


def test_few_features_give_few_offsets(repeated: tuple[Image, np.ndarray]) -> None:
    few, all_ = measured(repeated[0], features=60).offsets, measured(repeated[0]).offsets
    assert 0 < len(few) <= 60 * 59
    assert len(few) < len(all_)


def test_lonely_offsets_are_noise(rng: np.random.Generator) -> None:
    """Those that are not one of six, at least, in a square of 5 px."""
    lattice = stamped(np.array([[50.0, 10.0], [0.0, 60.0]]), rng, SHAPE)
    for image in (lattice, picture(smooth_noise((*SHAPE, 3), 2.0, rng))):
        offsets = measured(image, ratio=0.6).offsets
        _, counts = np.unique(np.rint(offsets / 5), axis=0, return_counts=True)
        assert (counts >= 6).all()


def test_a_smaller_ratio_accepts_fewer(rng: np.random.Generator) -> None:
    image = stamped(np.array([[40.0, 0.0], [0.0, 40.0]]), rng, SHAPE)
    counts = [len(measured(image, ratio=ratio).offsets) for ratio in (0.2, 0.4, 0.6)]
    assert counts[0] < counts[1] < counts[2]


def test_darkness_hides_nothing(rng: np.random.Generator) -> None:
    bright = stamped(np.array([[40.0, 0.0], [0.0, 40.0]]), rng, SHAPE)
    dark = picture(bright.pixels * np.float32(0.002))  # below this lightness is proportional to luminance
    darker = picture(bright.pixels * np.float32(0.0002))
    counts = [len(measured(image).offsets) for image in (bright, dark, darker)]
    assert counts[0] > 100
    assert min(counts) > 0.5 * max(counts)


@pytest.mark.parametrize(
    "pixels",
    [
        np.full((*SHAPE, 3), 0.5),
        np.zeros(SHAPE),
        np.tile(np.linspace(0, 1, SHAPE[0])[:, None], SHAPE[1]),
        np.random.default_rng(1).random((10, 11, 3)),
    ],
    ids=["constant", "black", "gradient", "tiny"],
)
def test_nothing_repeats_where_there_are_no_features(pixels: np.ndarray) -> None:
    result = measured(picture(pixels))
    assert result.offsets.shape == (0, 2)
    assert result.density.shape == tuple(2 * (side // 2) + 1 for side in pixels.shape[:2])
    assert (result.density == 0).all()


def test_grey_pictures_have_the_offsets_of_their_colour_twins(rng: np.random.Generator) -> None:
    grey = smooth_noise(SHAPE, 2.0, rng)
    colour = np.dstack([grey] * 3)
    np.testing.assert_array_equal(measured(picture(grey)).density, measured(picture(colour)).density)
