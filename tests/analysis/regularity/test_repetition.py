"""Displacements by which an exemplar repeats."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.regularity.repetition import RepetitionParams, repetition
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import USABLE

TRUE = np.array([[13.37, 2.5], [-3.1, 17.83]])


def waves(shape: tuple[int, int], generators: np.ndarray) -> np.ndarray:
    """Rounded dots on a lattice, 0..1."""
    phase = np.moveaxis(np.indices(shape), 0, 2) @ np.linalg.inv(generators)
    return np.asarray(np.prod(0.5 + 0.5 * np.cos(2 * np.pi * phase), axis=2), np.float32)


@pytest.mark.parametrize("masked", [False, True])
def test_generators_are_found_to_a_part_of_a_pixel(rng: np.random.Generator, masked: bool) -> None:
    grey = np.float32(0.8) * waves((150, 170), TRUE) + np.float32(0.2) * rng.random((150, 170), np.float32)
    image = picture(grey)
    if masked:
        usable = np.ones((150, 170, 1), np.float32)
        usable[40:90, 60:120] = 0
        grey[40:90, 60:120] = rng.random((50, 60))
        image = Image(np.concatenate([grey[..., None], usable], axis=2), ("Y", USABLE))
    start = np.asarray(TRUE + np.array([[1.2, -0.9], [0.7, 1.3]]), np.float32)
    result = repetition(image, start, RepetitionParams())
    np.testing.assert_allclose(result.generators, [TRUE[0], -TRUE[1]], atol=0.06)
    assert result.correlation > 0.6


def test_stripes_repeat_across(rng: np.random.Generator) -> None:
    wave = np.array([0.06, 0.08])
    grey = 0.5 + 0.5 * np.sin(2 * np.pi * np.moveaxis(np.indices((90, 90)), 0, 2) @ wave)
    result = repetition(picture(grey), np.array([[7.0, -4.4], [5.5, 8.2]], np.float32), RepetitionParams())
    turns = result.generators @ wave
    np.testing.assert_allclose(turns, np.rint(turns), atol=0.01)
    assert np.rint(turns).any()


def test_noise_does_not_repeat(rng: np.random.Generator) -> None:
    image = picture(smooth_noise((120, 120), 2.0, rng))
    result = repetition(image, np.array([[20, 3], [-4, 25]], np.float32), RepetitionParams())
    assert result.generators.shape == (0, 2)
    assert result.correlation < 0.1


def test_without_generators_there_is_nothing_to_fit() -> None:
    result = repetition(picture(np.zeros((20, 20))), np.zeros((0, 2), np.float32), RepetitionParams())
    assert result.generators.shape == (0, 2)
    assert result.correlation == 0
