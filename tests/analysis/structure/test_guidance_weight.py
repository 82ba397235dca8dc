from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.analysis.structure.guidance_weight import (
    STRONG_WEIGHT,
    WEAK_WEIGHT,
    GuidanceWeight,
    GuidanceWeightParams,
    guidance_weight,
)
from texloom.stages.analysis.structure.signed_distance import signed_distance
from texloom.stages.vocabulary.color import lab_from_linear

CRACK = (0.02, 0.02, 0.02)
RED, GREEN, CREAM = (0.5, 0.08, 0.05), (0.1, 0.4, 0.1), (0.7, 0.6, 0.4)


def weighed(pixels: np.ndarray, structure: np.ndarray, **params: float) -> GuidanceWeight:
    return guidance_weight(picture(pixels), signed_distance(structure).pixels, GuidanceWeightParams(**params))


def bricks(
    colors: list[tuple[float, float, float]], rng: np.random.Generator, noise: float = 0.02
) -> GuidanceWeight:
    """The decision for bricks of 32 px whose colours take turns, with dark cracks of 4 px as features."""
    rows, columns = np.indices((192, 192))
    turn = (rows // 32 + columns // 32) % len(colors)
    structure = (rows % 32 < 4) | (columns % 32 < 4)
    color = np.where(structure[..., None], CRACK, np.array(colors)[turn])
    color = color * rng.normal(1, noise, (192, 192, 1))
    return weighed(np.maximum(color, 0), structure)


@pytest.mark.parametrize("pair", [[RED, GREEN], [RED, CREAM], [GREEN, CREAM]])
def test_two_materials_beside_the_cracks_forbid_a_strong_weight(
    pair: list[tuple[float, float, float]], rng: np.random.Generator
) -> None:
    result = bricks(pair, rng)
    assert result.weight == WEAK_WEIGHT == 1
    assert result.peaks == 2


@pytest.mark.parametrize("color", [RED, GREEN, CREAM])
def test_one_material_with_dark_cracks_allows_a_strong_weight(
    color: tuple[float, float, float], rng: np.random.Generator
) -> None:
    """The cracks' own colour does not count."""
    result = bricks([color], rng)
    assert result.weight == STRONG_WEIGHT == 3
    assert result.peaks == 1
    assert result.fill < 0.5


def test_colours_all_over_the_plane_forbid_a_strong_weight(rng: np.random.Generator) -> None:
    structure = np.zeros((128, 128), bool)
    structure[:, 64] = True
    result = weighed(rng.random((128, 128, 3)), structure, vicinity=0.49, blur=5, min_peak=0.99)
    assert result.weight == WEAK_WEIGHT
    assert result.fill >= 0.5
    assert result.peaks == 1


def test_only_the_vicinity_counts() -> None:
    """A second material that no crack touches; it counts as soon as the vicinity reaches it."""
    structure = np.zeros((100, 100), bool)
    structure[:, 0] = True
    pixels = np.tile(np.where(np.arange(100)[:, None] < 20, RED, GREEN), (100, 1, 1))
    assert weighed(pixels, structure, vicinity=0.15).weight == STRONG_WEIGHT
    assert weighed(pixels, structure, vicinity=0.4).weight == WEAK_WEIGHT


@pytest.mark.parametrize("filled", [False, True])
def test_without_features_or_surroundings_the_weight_is_weak(filled: bool) -> None:
    result = weighed(np.ones((16, 16, 3)), np.full((16, 16), filled))
    assert result.weight == WEAK_WEIGHT
    assert not result.densities.any()


def test_densities_peak_at_the_colour(rng: np.random.Generator) -> None:
    result = bricks([RED], rng, noise=0)
    lightness, a, b = lab_from_linear(np.float32(RED).reshape(1, 1, 3))[0, 0]
    places = (lightness, (a + 80) / 1.6, (b + 80) / 1.6)
    for density, (one, other) in zip(result.densities, ((0, 1), (0, 2), (1, 2)), strict=True):
        assert density.max() == 1
        assert np.unravel_index(density.argmax(), density.shape) == (int(places[one]), int(places[other]))


def test_grey_picture() -> None:
    structure = np.zeros((64, 64), bool)
    structure[32] = True
    assert weighed(np.where(structure, 0.05, 0.5), structure).weight == STRONG_WEIGHT
