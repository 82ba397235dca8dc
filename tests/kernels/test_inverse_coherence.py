from __future__ import annotations

import numpy as np
import pytest

from stages.kernels.inverse_coherence import move_pixels
from tests import naive


@pytest.mark.parametrize("wrap", [False, True])
def test_pixels_take_the_best_proposal(wrap: bool, rng: np.random.Generator) -> None:
    shape, size, radius = (7, 8), (6, 7), 1
    texture = rng.normal(size=(*shape, 2)).astype(np.float32)
    given = rng.normal(size=(*size, 1)).astype(np.float32)
    vectors = rng.normal(size=(*shape, 4)).astype(np.float32)
    basis = rng.normal(size=(4, 27)).astype(np.float32)
    similar = np.stack([rng.integers(0, n, (*shape, 2)) for n in shape], axis=3).astype(np.int32)
    old = np.stack([rng.integers(0, n, size) for n in shape], axis=2).astype(np.int32)
    shared = (texture, given, vectors, basis, similar, radius)
    new = np.full_like(old, -1)
    energies = []
    for parity in range(4):
        energies.append(
            move_pixels(old, new, *shared, parity, 0, np.float32(1.5), wrap, np.uint64(1), 0, 3)
            + move_pixels(old, new, *shared, parity, 0, np.float32(1.5), wrap, np.uint64(1), 3, 6)
        )
    assert (new >= 0).all()
    least = [naive.moved_pixel(old, *shared, 1.5, wrap, y, x) for y, x in np.ndindex(size)]
    assert sum(energies) == pytest.approx(sum(least), rel=1e-4)
    assert energies[3] == pytest.approx(sum(np.reshape(least, size)[1::2, 1::2].ravel()), rel=1e-4)


def test_random_places_are_tried(rng: np.random.Generator) -> None:
    """A pixel far from what it should be finds it, given tries enough."""
    texture = rng.normal(size=(6, 6, 1)).astype(np.float32)
    source = np.zeros((1, 1, 2), np.int32)
    similar = np.zeros((6, 6, 0, 2), np.int32)
    vectors = np.zeros((6, 6, 1), np.float32) + 9
    basis, given = np.ones((1, 2), np.float32), np.full((1, 1, 1), 4.0, np.float32)
    vectors[4, 5] = texture[0, 0, 0] + 4
    new = np.empty_like(source)
    key = np.uint64(7)
    energy = move_pixels(
        source, new, texture, given, vectors, basis, similar, 0, 0, 500, np.float32(1), False, key, 0, 1
    )
    assert tuple(new[0, 0]) == (4, 5)
    assert energy == pytest.approx(0, abs=1e-9)
