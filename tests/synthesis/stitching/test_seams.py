from __future__ import annotations

import itertools

import numpy as np
import pytest

from texloom.stages.kernels.seams.window_state import ABSENT, FILLED, FREE, KEPT
from texloom.stages.synthesis.stitching.seams import UNIT, SeamCosts, cheapest_cut

STEPS = ((1, 0), (0, 1))


def cost(
    features: np.ndarray, gradients: bool, axis: int, one: np.ndarray, other: np.ndarray, power: int = 1
) -> int:
    """A seam's cost by its definition."""
    if (one + STEPS[axis] == other).all():
        return 0

    def at(place: np.ndarray) -> np.ndarray:
        row, column = np.clip(place, 0, np.array(features.shape[:2]) - 1)
        return features[row, column].astype(float)

    def slope(place: np.ndarray) -> float:
        inside = np.clip(place, 0, np.array(features.shape[:2]) - 1)
        return float(np.linalg.norm(at(inside + STEPS[axis]) - at(inside - STEPS[axis])) / 2)

    ahead, back = one + STEPS[axis], other - STEPS[axis]
    value = float(np.linalg.norm(at(one) - at(back)) ** power + np.linalg.norm(at(ahead) - at(other)) ** power)
    if gradients:
        value /= slope(one) + slope(ahead) + slope(back) + slope(other) + 0.5
    return min(round(value * UNIT), 80 * UNIT)


def total(features: np.ndarray, gradients: bool, match: np.ndarray, present: np.ndarray) -> int:
    """Energy of all ``present`` pixels."""
    energy = 0
    for axis, step in enumerate(STEPS):
        for y, x in np.ndindex(match.shape[0] - step[0], match.shape[1] - step[1]):
            t = (y + step[0], x + step[1])
            if present[y, x] and present[t]:
                energy += cost(features, gradients, axis, match[y, x].astype(int), match[t].astype(int))
    return energy


@pytest.mark.parametrize("squared", [False, True])
@pytest.mark.parametrize("gradients", [False, True])
def test_costs_are_as_defined(gradients: bool, squared: bool, rng: np.random.Generator) -> None:
    features = rng.random((6, 7, 3), dtype=np.float32)
    costs = SeamCosts(features, gradients, squared)
    one = rng.integers(0, [6, 7], (60, 2)).astype(np.int32)
    other = rng.integers(0, [6, 7], (60, 2)).astype(np.int32)
    for axis in (0, 1):
        values = costs.between(axis, one, other)
        expected = [
            cost(features, gradients, axis, *pair, power=1 + squared) for pair in zip(one, other, strict=True)
        ]
        np.testing.assert_allclose(values, expected, atol=1)
        assert (costs.between(axis, one, one + np.int32(STEPS[axis])) == 0).all()  # one piece has no seams


def test_pieces_that_agree_cost_nothing() -> None:
    features = np.tile(np.random.default_rng(0).random((4, 5, 3), dtype=np.float32), (3, 3, 1))
    one = np.array([[4, 5]], np.int32)
    assert SeamCosts(features, True).between(1, one, one + np.int32([[4, 1]])) == 0
    assert SeamCosts(features, True).between(1, one, one + np.int32([[3, 1]])) > 0


def overlap(rng: np.random.Generator, pieces: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Old pixels from several pieces, a new piece and what may change, 5x5 with eight or nine free pixels."""
    at = np.stack(np.indices((5, 5)), axis=-1)
    offsets = rng.integers(0, 12, (pieces, 2))
    old = (at + offsets[rng.integers(0, pieces, (5, 5))]).astype(np.int32)
    new = (at + rng.integers(0, 12, 2)).astype(np.int32)
    state = np.full((5, 5), KEPT, np.int8)
    state[1:4, 1:4] = FREE
    state[rng.integers(1, 4), rng.integers(1, 4)] = rng.choice([FREE, KEPT, FILLED])
    state[:, 4] = ABSENT
    state[4, 1:3] = FILLED
    return old, new, state


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("pieces", [1, 3])
def test_cut_is_the_cheapest_of_all(seed: int, pieces: int) -> None:
    """Against every choice of the free pixels."""
    rng = np.random.default_rng(seed)
    features = rng.random((16, 16, 3), dtype=np.float32)
    costs = SeamCosts(features, gradients=False)
    old, new, state = overlap(rng, pieces)
    present = state != ABSENT

    def energy(taken: np.ndarray) -> int:
        match = np.where(taken[..., None], new, old)
        total_cost = 0
        for axis, step in enumerate(STEPS):
            s, t = (slice(0, 5 - step[0]), slice(0, 5 - step[1])), (slice(step[0], 5), slice(step[1], 5))
            both = present[s] & present[t]
            total_cost += int(costs.between(axis, match[s][both], match[t][both]).sum())
        return total_cost

    taken, gain = cheapest_cut(costs, old, new, state)
    assert (taken[state == FILLED]).all()
    assert not taken[(state == KEPT) | (state == ABSENT)].any()
    choice = state == FILLED
    untouched = energy(choice)
    assert untouched == pytest.approx(
        total(features, False, np.where(choice[..., None], new, old), present), abs=20
    )
    costs_of_choices = []
    for bits in itertools.product((False, True), repeat=int((state == FREE).sum())):
        choice[state == FREE] = bits
        costs_of_choices.append(energy(choice))
    assert energy(taken) == min(costs_of_choices)
    assert gain == untouched - min(costs_of_choices)


@pytest.mark.parametrize("seed", range(20))
def test_a_cut_never_costs_more_than_none(seed: int) -> None:
    """Over gradients costs are no metric, and the cut may miss the best; but it is no worse than leaving all."""
    rng = np.random.default_rng(seed)
    features = rng.random((16, 16, 3), dtype=np.float32)
    old, new, state = overlap(rng, 4)
    state[state == FILLED] = KEPT
    taken, gain = cheapest_cut(SeamCosts(features, gradients=True), old, new, state)
    present = state != ABSENT
    before, after = (total(features, True, match, present) for match in (old, np.where(taken[..., None], new, old)))
    assert gain >= 0
    assert before - after == pytest.approx(gain, abs=20)


def test_nothing_changes_where_nothing_is_won(rng: np.random.Generator) -> None:
    """A piece that agrees with the old at no gain is not taken."""
    features = np.full((16, 16, 3), 0.5, np.float32)
    old, new, state = overlap(rng, 3)
    state[state == FILLED] = KEPT
    taken, gain = cheapest_cut(SeamCosts(features, gradients=True), old, new, state)
    assert gain == 0
    assert not taken.any()


def test_nothing_free() -> None:
    at = np.stack(np.indices((3, 3)), axis=-1).astype(np.int32)
    state = np.full((3, 3), FILLED, np.int8)
    taken, gain = cheapest_cut(SeamCosts(np.zeros((4, 4, 3), np.float32), False), at, at, state)
    assert taken.all()
    assert gain == 0
