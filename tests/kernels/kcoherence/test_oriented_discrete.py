from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.kernels.kcoherence import naive
from texloom.stages.kernels.kcoherence.discrete import DIMENSIONS, move_pixels
from texloom.stages.kernels.kcoherence.oriented_discrete import move_turned

SHAPE, SIZE, RADIUS, BROKEN = (9, 10), (6, 8), 1, 300
TOGETHER = np.float32(0.5)


@pytest.fixture
def data(rng: np.random.Generator) -> dict[str, Any]:
    """Whole numbers in the exemplar, so that neither kernel rounds."""
    sources = np.stack([rng.integers(0, n, SIZE) for n in SHAPE], axis=2)
    sources[:5, :4] = np.indices((5, 4)).transpose(1, 2, 0) + 3  # hangs together
    return {
        "source": sources,
        "texture": rng.integers(-20, 20, (*SHAPE, 2)).astype(np.int16),
        "given": rng.integers(-20, 20, (*SIZE, 1)).astype(np.float32),
        "vectors": rng.normal(size=(*SHAPE, DIMENSIONS), scale=20).astype(np.int16),
        "basis": rng.normal(size=(27, DIMENSIONS)).astype(np.float32),
        "candidates": np.stack([rng.integers(0, n, (*SHAPE, 2)) for n in SHAPE], axis=3).astype(np.int32),
        "price": rng.integers(0, 9000, SHAPE),
    }


def turned(
    data: dict[str, Any], jacobian: np.ndarray, inverse: np.ndarray, wrap: bool, edges_only: bool, tries: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """New sources, and the kernel's three sums."""
    old = data["source"].astype(np.float32)
    new = np.full_like(old, -1)
    texture, vectors = (data[name].reshape(SHAPE[0], -1) for name in ("texture", "vectors"))
    sums = [
        move_turned(
            old, new, texture, 2, data["given"], vectors, data["basis"], data["candidates"], data["price"],
            jacobian, inverse, RADIUS, TOGETHER, parity, tries, np.int64(BROKEN), edges_only, wrap,
            np.uint64(1), *span,
        )
        for parity in range(4) for span in ((0, 3), (3, 6))
    ]  # fmt: skip
    return new, np.sum(sums, axis=0)


@pytest.mark.parametrize("wrap", [False, True])
@pytest.mark.parametrize("edges_only", [False, True])
def test_what_lies_flat_moves_as_by_whole_pixels(data: dict[str, Any], wrap: bool, edges_only: bool) -> None:
    flat = np.ascontiguousarray(np.broadcast_to(np.array([1, 0, 0, 1], np.float32), (*SIZE, 4)))
    new, sums = turned(data, flat, flat, wrap, edges_only, tries=3)
    old = data["source"].astype(np.int32)
    expected = np.empty_like(old)
    found = [
        move_pixels(
            old, expected, data["texture"].astype(np.float32), data["given"],
            data["vectors"].reshape(-1, DIMENSIONS // 2), data["basis"], data["candidates"], data["price"], RADIUS,
            parity, 3, np.int64(BROKEN), edges_only, wrap, np.uint64(1), 0, 6,
        )
        for parity in range(4)
    ]  # fmt: skip
    np.testing.assert_array_equal(new, expected)
    np.testing.assert_array_equal(sums, np.sum(found, axis=0))


@pytest.mark.parametrize("wrap", [False, True])
def test_turned_pixels_take_the_cheapest_proposal(
    data: dict[str, Any], wrap: bool, rng: np.random.Generator
) -> None:
    angle = 0.6 + rng.normal(size=SIZE) * 0.1
    jacobian = 1.2 * np.stack([np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)], axis=2)
    inverse = np.linalg.inv(jacobian.reshape(*SIZE, 2, 2)).reshape(*SIZE, 4)
    # a piece that hangs together along one direction, between pixels
    offset = np.indices((5, 4)).transpose(1, 2, 0) - 2
    data["source"] = data["source"].astype(np.float32)
    data["source"][:5, :4] = np.array([4.3, 4.8]) + offset @ inverse[2, 2].reshape(2, 2).T
    new, sums = turned(data, jacobian.astype(np.float32), inverse.astype(np.float32), wrap, False)
    energy = 0.0
    for y, x in np.ndindex(SIZE):
        proposed = naive.turned_proposals(data["source"], inverse, data["candidates"], float(TOGETHER), wrap, y, x)
        wanted = naive.turned_vector(
            data["source"], data["texture"], data["given"], data["basis"], jacobian, inverse, RADIUS, wrap, y, x
        )
        costs = [
            float(((wanted - np.floor(naive.bilinear(data["vectors"], *place) + 0.5)) ** 2).sum())
            + data["price"][tuple(np.rint(place).astype(int))]
            + BROKEN * unlike
            for place, unlike in proposed
        ]
        places = np.array([place for place, _ in proposed])
        # what is rounded may fall to the other side in single precision
        energy += min(costs)
        chosen = int(np.abs(places - new[y, x]).max(axis=1).argmin())
        assert np.abs(places[chosen] - new[y, x]).max() < 1e-4
        assert costs[chosen] <= min(costs) * 1.01
    assert sums[0] == pytest.approx(energy, rel=1e-3)
    assert sums[2] == SIZE[0] * SIZE[1]
    rounded = np.rint(new).astype(int)
    assert sums[1] == data["price"][rounded[..., 0], rounded[..., 1]].sum()
