"""Pictures cut to whole periods of their lattice."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import blobs, picture, tiled
from tests.wraps import X
from texloom.stages.synthesis.edits.whole_periods import WholePeriods, WholePeriodsParams, whole_periods
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.normals import NORMAL

RUNNING = [[16, 20], [16, -20]]
"""bricks of 40 x 16 px, each course displaced by half a brick"""


@pytest.fixture
def wall(rng: np.random.Generator) -> Image:
    return tiled(blobs((32, 40, 3), rng, 2.0), 0, (183, 213))[0]


def run(image: Image, generators: list[list[float]], **params: Any) -> WholePeriods:
    return whole_periods(image, np.array(generators, np.float32).reshape(-1, 2), WholePeriodsParams(**params))


def test_the_middle_with_whole_periods_is_left(wall: Image, caplog: pytest.LogCaptureFixture) -> None:
    result = run(wall, RUNNING)
    assert (result.image.height, result.image.width) == (160, 200)  # of 11 courses 10, as a period has two
    np.testing.assert_array_equal(result.image.pixels, wall.pixels[11:171, 6:206])
    np.testing.assert_array_equal(result.image.pixels[0], wall.pixels[171, 6:206])
    assert len(result.generators) == 2
    assert caplog.messages == [
        "the pattern has a period, and the picture was cut to whole ones: 200 x 160 px of 213 x 183 px, 6.1 % of "
        "its width and 12.6 % of its height less; --set keep_size=true keeps all of it"
    ]


def test_only_what_is_asked_for_is_cut(wall: Image, caplog: pytest.LogCaptureFixture) -> None:
    across = run(wall, RUNNING, tileable=X).image
    assert (across.height, across.width) == (183, 200)
    caplog.clear()
    for generators, params in ((RUNNING, {"keep_size": True}), ([], {}), ([[0.0, 150.0]], {})):
        kept = run(wall, generators, **params)
        assert kept.image is wall
        assert not len(kept.generators)
        assert len(kept.lattice) == (2 if generators is RUNNING else 0)
    whole = run(wall.cropped(slice(0, 160), slice(0, 200)), RUNNING)
    assert (whole.image.height, whole.image.width, len(whole.generators)) == (160, 200, 2)
    assert caplog.messages == []


def test_a_part_that_is_nearly_whole_is_not_enough(rng: np.random.Generator) -> None:
    """Else one row of tiles would be higher than the others."""
    tiles = tiled(blobs((64, 64, 3), rng, 2.0), 0, (230, 192))[0]
    assert run(tiles, [[64, 0], [0, 64]]).image.height == 192
    assert run(tiles, [[64, 0], [0, 64]], most=0.15).image is tiles


def test_courses_have_a_period_across_them_alone(wall: Image) -> None:
    cut = run(wall, [[16.0, 0.0]]).image
    assert (cut.height, cut.width) == (176, 213)


def test_a_lattice_that_leans_is_resampled(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    generators = np.array([[40.0, 0.8], [-0.9, 36.0]])
    cell = blobs((64, 64), rng, 6.0)
    rows, columns = np.indices((340, 340))
    cells = np.stack([rows, columns], axis=2) @ np.linalg.inv(generators)
    place = np.floor(cells * 64).astype(int) % 64
    image = picture(cell[place[..., 0], place[..., 1]])
    made = run(image, generators.tolist())
    assert (made.image.height, made.image.width) == (320, 324)
    ends = [
        np.abs(np.take(made.image.pixels, 0, axis) - np.take(made.image.pixels, -1, axis)).mean() for axis in (0, 1)
    ]
    inner = [np.abs(np.diff(made.image.pixels, axis=axis)).mean() for axis in (0, 1)]
    assert max(np.divide(ends, inner)) < 1.6
    np.testing.assert_allclose(made.generators, [[40, 0], [0, 36]], atol=0.05)
    assert "it was resampled, as its lattice leans by 2" in caplog.text
    cut = run(image, generators.tolist(), scaled=0)
    assert cut.image is image or cut.image.height * cut.image.width < 320 * 324
    across = run(image, generators.tolist(), tileable=X)
    assert across.image.width == 324


def test_courses_that_lean_are_resampled() -> None:
    rows, columns = np.indices((200, 240))
    image = picture(0.5 + 0.4 * np.sin(2 * np.pi * (rows + 0.03 * columns) / 23.7))
    generator = np.array([[1.0, 0.03]]) * 23.7 / (1 + 0.03**2)
    made = run(image, generator.tolist()).image
    for axis in (0, 1):
        step = np.abs(np.take(made.pixels, 0, axis) - np.take(made.pixels, -1, axis)).mean()
        assert step < 1.5 * np.abs(np.diff(made.pixels, axis=0)).mean()


def test_normals_turn_with_the_lattice() -> None:
    flat = np.tile(np.array([0.5, 0.5, 0.5, 0.6, 0, 0.8], np.float32), (330, 330, 1))
    image = Image(flat, ("R", "G", "B", *NORMAL))
    generators = [[40.0, 0.8], [-0.8, 40.0]]
    turned = run(image, generators).image.pixels[0, 0, 3:]
    angle = np.arctan2(turned[1], turned[0])
    np.testing.assert_allclose(np.abs(angle), np.arctan(0.02), atol=1e-3)


def test_too_much_is_not_cut_off(wall: Image, caplog: pytest.LogCaptureFixture) -> None:
    kept = run(wall, RUNNING, most=0.05)
    assert kept.image is wall
    assert not len(kept.generators)
    assert "no 174 px of the picture are whole periods down" in caplog.text


def test_a_plain_margin_is_cut_off(wall: Image, caplog: pytest.LogCaptureFixture) -> None:
    framed = Image.of(np.pad(wall.pixels, ((12, 9), (0, 14), (0, 0)), constant_values=1.0))
    cut = run(framed, []).image
    assert (cut.height, cut.width) == (
        wall.height - 4,
        wall.width - 2,
    )  # two beside each margin may be mixed with it
    assert "plain margin" in caplog.text
    assert run(framed, [], keep_size=True).image.pixels.shape == framed.pixels.shape
