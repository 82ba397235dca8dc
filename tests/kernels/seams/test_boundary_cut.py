import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_flow

from tests.kernels.seams import naive
from texloom.stages.synthesis.stitching.cuts import Strips, cheapest_path, enclosed, laid_over

small = st.tuples(st.integers(1, 6), st.integers(1, 4)).flatmap(
    lambda shape: arrays(np.float32, shape, elements=st.integers(0, 9).map(float))
)


@given(small)
def test_no_path_costs_less(errors: np.ndarray) -> None:
    path = cheapest_path(errors)
    assert path.shape == errors.shape[:1]
    assert (np.abs(np.diff(path)) <= 1).all()
    assert errors[np.arange(len(path)), path].sum() == naive.cheapest_cut(errors)


def test_a_path_follows_the_only_gap(rng: np.random.Generator) -> None:
    gap = np.cumsum(rng.integers(-1, 2, 60)) + 60
    errors = np.ones((60, 121), np.float32)
    errors[np.arange(60), gap] = 0
    np.testing.assert_array_equal(cheapest_path(errors), gap)


def test_without_strips_all_is_new() -> None:
    assert laid_over(np.ones((5, 7), np.float32), Strips()).all()
    assert not Strips().mask((5, 7)).any()


def test_a_strip_covers_its_own_side() -> None:
    mask = Strips(top=1, left=2, bottom=3, right=4).mask((9, 11))
    expected = np.ones((9, 11), bool)
    expected[1:6, 2:7] = False
    np.testing.assert_array_equal(mask, expected)


@pytest.mark.parametrize("side", ["top", "left", "bottom", "right"])
def test_a_cut_keeps_the_outside_of_its_strip(side: str, rng: np.random.Generator) -> None:
    """What is outside the gap stays, on whichever side; the rest is new."""
    errors = rng.uniform(1, 2, (10, 10)).astype(np.float32)
    seen = {"left": errors, "top": errors.T, "right": errors[:, ::-1], "bottom": errors[::-1].T}[side]
    gap = np.array([1, 1, 2, 3, 2, 1, 0, 0, 1, 2])
    seen[np.arange(10), gap] = 0
    new = laid_over(errors, Strips(**{side: 4}))
    line = {"left": new, "top": new.T, "right": new[:, ::-1], "bottom": new[::-1].T}[side]
    np.testing.assert_array_equal(line, np.arange(10) >= gap[:, None])


def test_cuts_meet_in_corners(rng: np.random.Generator) -> None:
    errors = rng.random((12, 14), np.float32)
    alone = [laid_over(errors, Strips(**{side: 3})) for side in ("top", "left", "bottom", "right")]
    np.testing.assert_array_equal(laid_over(errors, Strips(3, 3, 3, 3)), np.logical_and.reduce(alone))


def framed(errors: np.ndarray, strips: Strips) -> np.ndarray:
    """With a line around it: what stands goes on there, or nothing stands."""
    wide = np.pad(errors, 1, mode="edge")
    for line, width in (
        (wide[0], strips.top),
        (wide[-1], strips.bottom),
        (wide[:, 0], strips.left),
        (wide[:, -1], strips.right),
    ):
        if not width:
            line[:] = -1
    return wide


def least_cut(errors: np.ndarray, core: np.ndarray) -> int:
    """Cost of the minimum cut between the outermost line and ``core``, whole numbers, by maximum flow."""
    number = np.arange(errors.size).reshape(errors.shape)
    outermost = np.ones(errors.shape, bool)
    outermost[1:-1, 1:-1] = False
    arcs = [
        (one.ravel(), other.ravel(), np.where(np.minimum(a, b) < 0, 0, a + b).ravel())
        for one, other, a, b in (
            (number[1:], number[:-1], errors[1:], errors[:-1]),
            (number[:, 1:], number[:, :-1], errors[:, 1:], errors[:, :-1]),
        )
    ]
    source, sink = errors.size, errors.size + 1
    for inside, ends in ((outermost, (np.full(outermost.sum(), source), number[outermost])),
                         (core, (number[core], np.full(core.sum(), sink)))):  # fmt: skip
        arcs.append((*ends, np.full(inside.sum(), 10**6)))
    tails, heads, values = (np.concatenate(column) for column in zip(*arcs, strict=True))
    both = (np.concatenate([tails, heads]), np.concatenate([heads, tails]))
    graph = csr_array((np.concatenate([values, values]).astype(np.int32), both), shape=(sink + 1, sink + 1))
    return int(maximum_flow(graph, source, sink).flow_value)


@pytest.mark.parametrize("seed", range(30))
def test_no_cut_around_a_rectangle_costs_less(seed: int) -> None:
    """Against maximum flow; with strips on all sides it may miss a little."""
    rng = np.random.default_rng(seed)
    errors = rng.integers(0, 10, (9, 12)).astype(np.float32)
    strips = Strips(*(int(width) for width in rng.choice([0, 2, 4], 4)))
    new, cost = enclosed(errors, strips)
    core = ~strips.mask((9, 12))
    assert new[core].all()
    wide = framed(errors, strips)
    assert naive.loop_cost(wide, np.pad(new, 1)) == cost
    least = least_cut(wide, np.pad(core, 1))
    if min(strips.top, strips.left, strips.bottom, strips.right):
        assert least <= cost <= 1.15 * least
    else:
        assert cost == least


def test_a_cut_may_go_back_and_around() -> None:
    """Along the only gap, which leads to and fro, where a path that only goes on would have to leave it."""
    errors = np.ones((12, 9), np.float32)
    gap = [(0, 2), (1, 2), (2, 2), (2, 3), (2, 4), (3, 4), (4, 4), (4, 3), (4, 2), (4, 1), (5, 1), (6, 1)]
    for place in gap:
        errors[place] = 0
    errors[6:, 1] = 0
    new, cost = enclosed(errors, Strips(left=6))
    assert cost <= len(gap) + 10
    assert not new[3, :3].any()
    assert new[3, 5:].all()
    straight = laid_over(errors, Strips(left=6))
    assert naive.loop_cost(framed(errors, Strips(left=6)), np.pad(straight, 1)) > cost


def test_cuts_that_cost_as_much_as_the_limit_are_given_up(rng: np.random.Generator) -> None:
    errors = rng.random((12, 14), np.float32)
    for strips in (Strips(3, 3), Strips(3, 3, 3, 3)):
        new, cost = enclosed(errors, strips)
        again, same = enclosed(errors, strips, cost * 1.001)
        np.testing.assert_array_equal(new, again)
        assert same == cost
        assert enclosed(errors, strips, cost)[1] == np.inf


def test_nothing_is_parted_where_nothing_stands() -> None:
    new, cost = enclosed(np.zeros((8, 9), np.float32), Strips())
    assert new.all()
    assert cost == 0
