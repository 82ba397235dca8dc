import numpy as np
import pytest

from tests.kernels.compaction import naive
from texloom.stages.kernels.compaction.tree import drop_vectors, fold_sizes, folded_into, split_nodes


def two_clouds(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Vectors around two points, and which of them each is of."""
    which = rng.integers(0, 2, 60)
    places = rng.integers(-300, 300, (2, 32))
    return (places[which] + rng.integers(-20, 21, (60, 32))).astype(np.int16), which


def test_a_node_is_split_where_its_members_are_apart(rng: np.random.Generator) -> None:
    vectors, which = two_clouds(rng)
    order, halves = np.arange(60), vectors.reshape(-1, 16)
    means, out = np.zeros((4, 16), np.int16), [np.zeros(1, np.int64), np.zeros(1), np.zeros(1, np.int64)]
    medoid, distortion, left = out
    whole = (np.zeros(1, np.int64), np.full(1, 60))
    split_nodes(halves, order, np.empty(60, np.int64), *whole, 1.0, 10, means, medoid, distortion, left, 0, 1)
    first = order[: left[0]]
    assert set(which[first]) != set(which[order[left[0] :]])
    assert len(set(which[first])) == 1
    exact = vectors.astype(np.float64)
    assert distortion[0] == pytest.approx(((exact - exact.mean(axis=0)) ** 2).sum())
    far = ((exact - np.rint(exact.mean(axis=0))) ** 2).sum(axis=1)
    assert far[medoid[0]] == far.min()
    np.testing.assert_array_equal(means.reshape(2, 32)[0], np.rint(exact[first].mean(axis=0)))

    leaf = np.empty(60, np.int32)
    drop_vectors(halves, np.array([1, -1, -1], np.int32), np.concatenate([means, means, means]), leaf, 0, 60)
    np.testing.assert_array_equal(np.flatnonzero(leaf == 1), np.sort(first))


def random_tree(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parents, left children, distortions."""
    parent, child, distortion = [-1], [-1], [1000.0]
    for _ in range(12):
        node = int(rng.choice(np.flatnonzero(np.array(child) < 0)))
        child[node] = len(parent)
        parts = rng.uniform(0, distortion[node] / 2, 2)
        parent += [node, node]
        child += [-1, -1]
        distortion += parts.tolist()
    return np.array(parent, np.int32), np.array(child, np.int32), np.array(distortion)


@pytest.mark.parametrize("seed", range(5))
def test_nodes_fold_in_the_order_of_their_cost(seed: int) -> None:
    parent, child, distortion = random_tree(np.random.default_rng(seed))
    fold = np.empty(parent.size, np.int32)
    fold_sizes(parent, child, distortion, fold)
    assert fold.tolist() == naive.folding(parent.tolist(), child.tolist(), distortion.tolist())
    for leaves in range(1, 14):
        owner = np.empty(parent.size, np.int32)
        folded_into(parent, fold, leaves, owner)
        kept = {int(owner[node]) for node in np.flatnonzero(child < 0)}
        assert len(kept) <= leaves
        for node in range(1, parent.size):
            above = parent[node]
            folded = owner[above] != above or fold[above] > leaves
            assert owner[node] == (owner[above] if folded else node)
