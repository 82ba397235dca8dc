import itertools

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_flow
from skimage.measure import label

from texloom.stages.kernels.seams.piece_graph import cut_graph, number_pieces


@pytest.mark.parametrize("values", [1, 2, 3, 50])
def test_pieces_are_those_of_equal_values(values: int, rng: np.random.Generator) -> None:
    value = rng.integers(-values, values, (37, 23))
    number = np.empty(value.shape, np.int64)
    count = number_pieces(value, number)
    expected = label(value, connectivity=1, background=-1000) - 1
    np.testing.assert_array_equal(number, expected)
    assert count == expected.max() + 1


def total(price: np.ndarray, edges: np.ndarray, apart: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Cost of one or more choices."""
    moved = moved.astype(np.int64)
    alone = (1 - moved[..., edges[0]]) * moved[..., edges[1]]
    return np.asarray(moved @ price + alone @ apart)


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_no_choice_costs_less(share: float, rng: np.random.Generator) -> None:
    choices = np.array([*itertools.product((False, True), repeat=8)])
    for _ in range(50):
        edges = np.array([*itertools.permutations(range(8), 2)]).T
        edges = edges[:, rng.random(edges.shape[1]) < share]
        price, apart = rng.integers(-20, 20, 8), rng.integers(0, 12, edges.shape[1])
        moved = np.empty(8, bool)
        cut_graph(price, *edges, apart, moved)
        costs = total(price, edges, apart, choices)
        least = choices[costs == costs.min()]
        assert total(price, edges, apart, moved) == costs.min()
        assert moved.sum() == least.sum(axis=1).min()


def test_large_graphs_have_the_flow_of_another_method(rng: np.random.Generator) -> None:
    count, edges = 400, rng.integers(0, 400, (2, 3000))
    edges = np.unique(edges[:, edges[0] != edges[1]], axis=1)
    price, apart = rng.integers(-(10**6), 10**6, count), rng.integers(0, 10**5, edges.shape[1])
    moved = np.empty(count, bool)
    cut_graph(price, *edges, apart, moved)
    source, sink = np.full(count, count), np.full(count, count + 1)
    node = np.arange(count)
    ends = np.concatenate([edges[0], source, node]), np.concatenate([edges[1], node, sink])
    capacity = np.concatenate([apart, np.maximum(price, 0), np.maximum(-price, 0)]).astype(np.int32)
    flow = maximum_flow(csr_array((capacity, ends), shape=(count + 2,) * 2), count, count + 1).flow_value
    assert total(price, edges, apart, moved) == flow + np.minimum(price, 0).sum()


def test_nothing_moves_without_pieces_or_gain() -> None:
    nothing = np.zeros(0, np.int64)
    moved = np.empty(0, bool)
    cut_graph(nothing, nothing, nothing, nothing, moved)
    moved = np.empty(2, bool)
    cut_graph(np.array([0, 3]), np.array([0]), np.array([1]), np.array([5]), moved)
    assert not moved.any()
