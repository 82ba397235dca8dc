from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import LATTICES, bent, picture, smooth_noise
from texloom.stages.analysis.regularity.deformed_lattice import DeformedLatticeParams, deformed_lattice
from texloom.stages.analysis.regularity.straighten import Straightened, straighten
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, NoParams


def test_a_bent_lattice_becomes_regular(rng: np.random.Generator) -> None:
    """From pixels alone: straightened, it is as it was before a known field bent it, but for an affine map.

    Near the border no whole cells are seen.
    """
    generators = 0.6 * LATTICES["hexagonal"]
    image, field = bent(generators, rng)
    measured = deformed_lattice(image, DeformedLatticeParams(), generators.astype(np.float32))
    result = straighten(image, measured.vertices, measured.regular, NoParams())
    margin = 40
    grid = np.moveaxis(np.indices((image.height, image.width)), 0, -1)[margin:-margin:9, margin:-margin:9]
    to, shown = grid.reshape(-1, 2).astype(float), result.source[margin:-margin:9, margin:-margin:9].reshape(-1, 2)
    before = shown.astype(float)
    for _ in range(20):
        before = shown - field(before)
    system = np.column_stack([to, np.ones(len(to))])
    left = before - system @ np.linalg.lstsq(system, before, rcond=None)[0]
    assert np.hypot(*left.T).max() < 0.5
    assert np.sqrt((left**2).sum(axis=1).mean()) < 0.25


def grid(shape: tuple[int, int]) -> np.ndarray:
    lines = [np.linspace(-10, side + 10, 6) for side in shape]
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2).astype(np.float32)


def straight(image: Image, shift: np.ndarray) -> Straightened:
    regular = grid((image.height, image.width))
    return straighten(image, regular + np.float32(shift), regular, NoParams())


def test_nothing_to_straighten(rng: np.random.Generator) -> None:
    image = picture(rng.random((40, 50, 3)))
    result = straight(image, np.zeros(2))
    np.testing.assert_allclose(result.image.pixels, image.pixels, atol=1e-5)
    np.testing.assert_allclose(result.source, np.moveaxis(np.indices((40, 50)), 0, -1), atol=1e-4)


def test_all_channels_move_and_what_is_beyond_is_black(rng: np.random.Generator) -> None:
    pixels = smooth_noise((40, 50, 4), 2.0, rng).astype(np.float32) + 1
    image = Image(pixels, ("R", "G", "B", "height"))
    result = straight(image, np.array([3.0, -2.0]))
    assert result.image.channels == image.channels
    np.testing.assert_allclose(result.image.pixels[:36, 3:], pixels[3:39, 1:48], atol=1e-4)
    assert not result.image.pixels[38:].any()
    assert not result.image.pixels[:, :1].any()


def test_too_few_points(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="regular: want three points or more, got 2"):
        straighten(picture(rng.random((40, 50, 3))), grid((40, 50))[:2], grid((40, 50))[:2], NoParams())


def test_threads_do_not_matter(rng: np.random.Generator, on_threads: Any) -> None:
    image = picture(rng.random((60, 50, 3)))
    regular = grid((60, 50))
    vertices = regular + rng.normal(0, 1, regular.shape).astype(np.float32)
    one, three = on_threads(lambda: straighten(image, vertices, regular, NoParams()))
    np.testing.assert_array_equal(one.image.pixels, three.image.pixels)
    np.testing.assert_array_equal(one.source, three.source)
