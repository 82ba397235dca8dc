"""Epitomes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.synthesis.inverse.energy import ExactEnergy
from texloom.stages.synthesis.inverse.epitome import Epitome, EpitomeParams, epitome
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError


def learned(texture: Image, seed: int = 1, control: Image | None = None, **params: object) -> Epitome:
    checked = EpitomeParams.model_validate({"patch_size": 6, "patches": 400, "rounds": 12, **params})
    return epitome(texture, texture.pixels * 100, checked, np.random.default_rng(seed), control)


@pytest.fixture
def halves(rng: np.random.Generator) -> Image:
    """Dark stripes beside light blobs."""
    pixels = 0.15 + 0.15 * np.sin(np.arange(64)[:, None] * np.ones(96) * 0.8)
    pixels[:, 48:] = 0.5 + 0.5 * smooth_noise((64, 48), 2.5, rng)
    return picture(pixels)


def test_it_explains_more_than_its_start(halves: Image) -> None:
    judge = ExactEnergy(halves.pixels * 100, 5, 1000)
    untrained, trained = (learned(halves, size=(24, 24), rounds=rounds) for rounds in (1, 16))
    assert judge.inverse_of(trained.planes) < 0.7 * judge.inverse_of(untrained.planes)
    assert judge.inverse_of(trained.planes) < 0.25 * float((halves.pixels * 100).var())


def test_a_repeated_cell_is_learned_exactly(rng: np.random.Generator) -> None:
    cell = 0.1 + 0.8 * rng.random((4, 4))
    texture = picture(np.tile(cell, (12, 12)))
    result = learned(texture, size=(8, 8), rounds=20, least_deviation=1.0)
    near = ExactEnergy(texture.pixels * 100, 5, 1000).inverse_of(result.planes)
    assert near < 0.02 * float((texture.pixels * 100).var())


def test_image_and_control_are_learned_with_the_features(halves: Image) -> None:
    """Features are a hundred times the pixels, rounded to whole numbers."""
    result = learned(halves, size=(20, 28), control=halves)
    assert result.image.pixels.shape == (20, 28, 1)
    np.testing.assert_allclose(result.image.pixels, result.planes / 100, atol=0.01)
    assert result.control is not None
    np.testing.assert_array_equal(result.control.pixels, result.image.pixels)
    assert result.deviation.min() >= 4 - 1e-4


def test_the_seed_alone_decides(halves: Image) -> None:
    first, again, other = (learned(halves, seed, size=(16, 16), rounds=3).planes for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_wrong_sizes_are_refused(halves: Image) -> None:
    with pytest.raises(InputError, match="size: 9 x 5 px is too small; its sides must be 6 px"):
        learned(halves, size=(5, 9))
    with pytest.raises(InputError, match="epitome: neither size nor the sides"):
        learned(halves)
