from typing import Any

import numpy as np
import pytest

from tests.kernels.kcoherence import naive
from tests.wraps import WRAPS
from texloom.stages.kernels.kcoherence.discrete_pixels import (
    DIMENSIONS,
    ExemplarNeighbourhoods,
    ParityPass,
    Repeats,
    choose_sources,
)
from texloom.stages.kernels.kcoherence.oriented_discrete import Orientation, choose_oriented_sources
from texloom.stages.vocabulary.facts import Wraps

SHAPE, SIZE, RADIUS, SEAM = (9, 10), (6, 8), 1, 300
MERGE_DISTANCE = np.float32(0.5)


@pytest.fixture
def data(rng: np.random.Generator) -> dict[str, Any]:
    """Whole numbers in the exemplar, so that neither kernel rounds."""
    sources = np.stack([rng.integers(0, n, SIZE) for n in SHAPE], axis=2)
    sources[:5, :4] = np.indices((5, 4)).transpose(1, 2, 0) + 3  # a continuous piece
    return {
        "source": sources,
        "texture": rng.integers(-20, 20, (*SHAPE, 2)).astype(np.int16),
        "control": rng.integers(-20, 20, (*SIZE, 1)).astype(np.float32),
        "vectors": rng.normal(size=(*SHAPE, DIMENSIONS), scale=20).astype(np.int16),
        "basis": rng.normal(size=(27, DIMENSIONS)).astype(np.float32),
        "candidates": np.stack([rng.integers(0, n, (*SHAPE, 2)) for n in SHAPE], axis=3).astype(np.int32),
        "penalty": rng.integers(0, 9000, SHAPE),
    }


def subpasses(tries: int, edges_only: bool, wrap: Wraps) -> list[ParityPass]:
    return [ParityPass(parity, tries, np.int64(SEAM), edges_only, wrap, np.uint64(1)) for parity in range(4)]


def oriented_exemplar(data: dict[str, Any]) -> ExemplarNeighbourhoods:
    texture, vectors = (data[name].reshape(SHAPE[0], -1) for name in ("texture", "vectors"))
    return ExemplarNeighbourhoods(texture, vectors, data["basis"], data["candidates"], data["penalty"], RADIUS)


def chosen_sources(
    data: dict[str, Any], orientation: Orientation, wrap: Wraps, edges_only: bool, tries: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """New sources, and the kernel's three sums."""
    old, exemplar = data["source"].astype(np.float32), oriented_exemplar(data)
    new = np.full_like(old, -1)
    sums = [
        choose_oriented_sources(old, new, data["control"], exemplar, orientation, subpass, *span)
        for subpass in subpasses(tries, edges_only, wrap)
        for span in ((0, 3), (3, 6))
    ]
    return new, np.sum(sums, axis=0)


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("edges_only", [False, True])
def test_upright_textures_choose_as_without_orientation(
    data: dict[str, Any], wrap: Wraps, edges_only: bool
) -> None:
    flat = np.ascontiguousarray(np.broadcast_to(np.array([1, 0, 0, 1], np.float32), (*SIZE, 4)))
    new, sums = chosen_sources(data, Orientation(flat, flat, MERGE_DISTANCE), wrap, edges_only, tries=3)
    old = data["source"].astype(np.int32)
    expected = np.empty_like(old)
    exemplar = oriented_exemplar(data)._replace(
        texture=data["texture"].astype(np.float32), vectors=data["vectors"].reshape(-1, DIMENSIONS // 2)
    )
    repeats = Repeats(np.zeros(SHAPE, np.int32), np.zeros(SIZE, np.int32), 0, np.int64(0))
    upright = [
        choose_sources(old, expected, data["control"], exemplar, repeats, subpass, 0, 6)
        for subpass in subpasses(3, edges_only, wrap)
    ]
    np.testing.assert_array_equal(new, expected)
    np.testing.assert_array_equal(sums, np.sum(upright, axis=0))


@pytest.mark.parametrize("wrap", WRAPS)
def test_pixels_take_the_cheapest_proposal(data: dict[str, Any], wrap: Wraps, rng: np.random.Generator) -> None:
    angle = 0.6 + rng.normal(size=SIZE) * 0.1
    jacobian = 1.2 * np.stack([np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)], axis=2)
    inverse = np.linalg.inv(jacobian.reshape(*SIZE, 2, 2)).reshape(*SIZE, 4)
    # a continuous piece along one direction, between pixels
    offset = np.indices((5, 4)).transpose(1, 2, 0) - 2
    data["source"] = data["source"].astype(np.float32)
    data["source"][:5, :4] = np.array([4.3, 4.8]) + offset @ inverse[2, 2].reshape(2, 2).T
    orientation = Orientation(jacobian.astype(np.float32), inverse.astype(np.float32), MERGE_DISTANCE)
    new, sums = chosen_sources(data, orientation, wrap, False)
    exemplar = oriented_exemplar(data)
    energy = 0.0
    for y, x in np.ndindex(SIZE):
        proposed = naive.oriented_proposals(data["source"], data["candidates"], orientation, wrap, y, x)
        wanted = naive.oriented_vector(data["source"], data["control"], exemplar, orientation, wrap, y, x)
        costs = [
            float(((wanted - np.floor(naive.bilinear(data["vectors"], *place) + 0.5)) ** 2).sum())
            + data["penalty"][tuple(np.rint(place).astype(int))]
            + SEAM * unlike
            for place, unlike in proposed
        ]
        places = np.array([place for place, _ in proposed])
        # rounding may differ in single precision
        energy += min(costs)
        chosen = int(np.abs(places - new[y, x]).max(axis=1).argmin())
        assert np.abs(places[chosen] - new[y, x]).max() < 1e-4
        assert costs[chosen] <= min(costs) * 1.01
    assert sums[0] == pytest.approx(energy, rel=1e-3)
    assert sums[2] == SIZE[0] * SIZE[1]
    rounded = np.rint(new).astype(int)
    assert sums[1] == data["penalty"][rounded[..., 0], rounded[..., 1]].sum()
