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
from texloom.stages.vocabulary.facts import NOWHERE, Wraps

HALF = DIMENSIONS // 2


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("edges_only", [False, True])
def test_pixels_take_the_cheapest_proposal(wrap: Wraps, edges_only: bool, rng: np.random.Generator) -> None:
    shape, size, radius, seam = (9, 10), (6, 8), 1, np.int64(300)
    texture = rng.normal(size=(*shape, 2)).astype(np.float32) * 8
    control = rng.normal(size=(*size, 1)).astype(np.float32) * 8
    vectors = rng.normal(size=(*shape, DIMENSIONS), scale=20).astype(np.int16)
    basis = rng.normal(size=(27, DIMENSIONS)).astype(np.float32)
    candidates = np.stack([rng.integers(0, n, (*shape, 2)) for n in shape], axis=3).astype(np.int32)
    penalty = rng.integers(0, 9000, shape)
    old = np.stack([rng.integers(0, n, size) for n in shape], axis=2).astype(np.int32)
    whole = np.indices((5, 4)).transpose(1, 2, 0) + 3
    old[:5, :4] = whole  # a continuous piece, inside which nothing is to choose
    new = np.full_like(old, -1)
    exemplar = ExemplarNeighbourhoods(texture, vectors.reshape(-1, HALF), basis, candidates, penalty, radius)
    places = np.arange(90, dtype=np.int32).reshape(shape)
    places[:, 7:] = places[:, :3]  # copies of the same pixels
    sources = places[old[..., 0], old[..., 1]]
    used = sources
    for axis, around in enumerate(wrap):
        ends = [(2, 2) if axis == side else (0, 0) for side in (0, 1)]
        used = np.pad(used, ends, mode="wrap") if around else np.pad(used, ends, constant_values=-1)
    repeats = Repeats(places, used, 2, np.int64(2000))
    subpasses = [ParityPass(parity, 0, seam, edges_only, wrap, np.uint64(1)) for parity in range(4)]
    parts = [
        choose_sources(old, new, control, exemplar, repeats, part, *span)
        for part in subpasses
        for span in ((0, 3), (3, 6))
    ]
    energy, penalties, chosen = (sum(column) for column in zip(*parts, strict=True))
    costs = {at: naive.proposal_costs(old, control, exemplar, repeats, seam, wrap, *at) for at in np.ndindex(size)}
    still = [(y, x) for y in range(1, 4) for x in range(1, 3)]
    still += [] if wrap.down else [(0, x) for x in range(1, 3)]
    still += [] if wrap.across else [(y, 0) for y in range(1, 4)]
    still += [] if wrap else [(0, 0)]
    moving = [place for place in costs if not (edges_only and place in still)]
    assert chosen == len(moving)
    assert energy == sum(min(costs[place].values()) for place in moving)
    assert penalties == sum(penalty[tuple(new[place])] for place in moving)
    for place, proposals in costs.items():
        expected = min(proposals.values()) if place in moving else proposals[tuple(old[place])]
        assert proposals[tuple(new[place])] == expected


def test_random_places_are_tried(rng: np.random.Generator) -> None:
    """A pixel far from what it should be finds it, control tries enough."""
    texture = rng.normal(size=(6, 6, 1)).astype(np.float32)
    source = np.zeros((1, 1, 2), np.int32)
    candidates = np.zeros((6, 6, 0, 2), np.int32)
    vectors = np.full((6, 6, DIMENSIONS), 900, np.int16)
    basis, control = np.ones((2, DIMENSIONS), np.float32), np.full((1, 1, 1), 400.0, np.float32)
    vectors[4, 5] = np.rint(texture[0, 0, 0] + 400)
    new = np.empty_like(source)
    penalty = np.zeros((6, 6), np.int64)
    exemplar = ExemplarNeighbourhoods(texture, vectors.reshape(-1, HALF), basis, candidates, penalty, 0)
    repeats = Repeats(np.arange(36, dtype=np.int32).reshape(6, 6), np.zeros((1, 1), np.int32), 0, np.int64(5))
    subpass = ParityPass(0, 500, np.int64(0), False, NOWHERE, np.uint64(7))
    energy, penalties, chosen = choose_sources(source, new, control, exemplar, repeats, subpass, 0, 1)
    assert tuple(new[0, 0]) == (4, 5)
    assert (energy, penalties, chosen) == (0, 0, 1)
