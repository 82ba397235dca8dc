from __future__ import annotations

import numpy as np
import pytest

from tests import tilings
from tests.synthetic import masked, picture, smooth_noise, wall
from texloom.stages.analysis.regularity.courses import Courses, CoursesParams, courses
from texloom.stages.common.grids import working_size
from texloom.stages.vocabulary.arrays import Image


def of(image: Image) -> Courses:
    return courses(image, CoursesParams())


@pytest.mark.parametrize("period", [11.0, 20.0, 32.5, 50.0])
@pytest.mark.parametrize("degrees", [0.0, 90.0, 7.0, -31.0])
def test_courses_of_random_bricks_are_found(period: float, degrees: float, rng: np.random.Generator) -> None:
    result = of(wall((240, 270), period, degrees, rng))
    angle = np.radians(degrees)
    expected = period * np.array([np.cos(angle), np.sin(angle)])
    assert result.generators.shape == (1, 2)
    sign = np.sign(result.generators[0] @ expected)
    np.testing.assert_allclose(sign * result.generators[0], expected, atol=0.02 * period)
    np.testing.assert_array_equal(result.best, result.generators)
    assert result.confidence >= result.worst > 0.5


def test_courses_of_a_large_exemplar_have_its_scale(rng: np.random.Generator) -> None:
    result = of(wall((560, 600), 60, 0, rng))
    np.testing.assert_allclose(result.generators, [[60, 0]], atol=0.6)


def test_courses_of_a_reduced_exemplar_have_its_scale(
    monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    monkeypatch.setattr(working_size, "MOST_PIXELS", 100_000)
    result = of(wall((560, 600), 60, 0, rng))
    np.testing.assert_allclose(result.generators, [[60, 0]], atol=0.6)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("blur", [1.0, 3.0, 8.0])
def test_random_textures_have_none(seed: int, blur: float) -> None:
    result = of(picture(smooth_noise((240, 260, 3), blur, np.random.default_rng(seed))))
    assert result.generators.shape == (0, 2)
    assert result.confidence < 0.75


@pytest.mark.parametrize("seed", range(3))
def test_lines_at_uneven_distances_are_none(seed: int) -> None:
    """Like the grain of wood."""
    rng = np.random.default_rng(seed)
    tone = np.full((240, 260), 0.6)
    for line in np.cumsum(rng.uniform(8, 40, 24)).astype(int):
        tone[line : line + 3] = 0.1
    tone += 0.1 * smooth_noise((240, 260), 1.5, rng)
    assert len(of(picture(tone)).generators) == 0


def test_rows_in_two_directions_are_no_courses(rng: np.random.Generator) -> None:
    """As in a weave, where elements line up along neither."""
    row, column = np.indices((240, 260))
    tone = np.sin(2 * np.pi * (row + 0.4 * column) / 22) + np.sin(2 * np.pi * (row - 0.5 * column) / 26)
    result = of(picture(np.clip(0.4 + 0.15 * tone + 0.1 * smooth_noise((240, 260), 1.5, rng), 0, 1)))
    assert result.generators.shape == (0, 2)
    assert result.confidence > CoursesParams().confidence
    assert result.confidence - result.rival < CoursesParams().lead


@pytest.mark.parametrize(("height", "width"), [(16, 40), (20, 50), (20, 36), (24, 60)])
def test_courses_of_equally_long_blocks_are_found(height: int, width: int, rng: np.random.Generator) -> None:
    """Their joints line up every few courses, so that they have rows in other directions too."""
    found = courses(tilings.painted(tilings.blocks((256, 256), height, width, rng), rng), CoursesParams())
    np.testing.assert_allclose(found.generators, [[height, 0]], atol=0.3)


def test_weaves_have_no_courses(rng: np.random.Generator) -> None:
    for label in (tilings.basket_weave((256, 256), 12)[0], tilings.herringbone((256, 256), 14)[0]):
        assert not len(courses(tilings.painted(label, rng), CoursesParams()).generators)


@pytest.mark.parametrize("shape", [(4, 4), (30, 300), (64, 64)])
def test_an_exemplar_without_variation_has_none(shape: tuple[int, int]) -> None:
    result = of(picture(np.full(shape, 0.4)))
    assert (result.generators.shape, result.confidence) == ((0, 2), 0)


@pytest.mark.parametrize(("seed", "wear"), [(2, 0.85), (0, 0.92)])
def test_one_worn_course_leaves_the_others(seed: int, wear: float) -> None:
    """Its joints are hardly visible, as at the ends of courses that fan out."""
    rng = np.random.default_rng(seed)
    pixels = wall((256, 256), 24, 0, rng).pixels[..., 0].copy()
    pixels[94:126] = (1 - wear) * pixels[94:126] + wear * smooth_noise((32, 256), 6.0, rng)
    result = of(picture(pixels))
    assert result.worst < 0.55
    np.testing.assert_allclose(result.generators, [[24, 0]], atol=0.4)


def test_fewer_than_four_courses_are_none(rng: np.random.Generator) -> None:
    assert len(of(wall((150, 200), 50, 0, rng)).generators) == 0


def test_masked_pixels_make_no_difference(rng: np.random.Generator) -> None:
    image = wall((240, 270), 20, 0, rng)
    usable = np.ones((240, 270), bool)
    usable[40:70, 100:150] = False
    results = [of(masked(image, usable, value)) for value in (0.0, 20.0)]
    np.testing.assert_array_equal(results[0].generators, results[1].generators)
    np.testing.assert_allclose(results[0].generators, [[20, 0]], atol=0.4)
