"""Expansion moves in tiles."""

from typing import Any

import numpy as np
import pytest

from texloom.stages.kernels.seams.expansion import expand_in_tiles
from texloom.stages.kernels.seams.minimum_cut import NO_CELLS, NO_PRICE, cut_window, window_cost
from texloom.stages.kernels.seams.window_state import FILLED, FREE, KEPT
from texloom.stages.synthesis.stitching.seams import UNIT, SeamCosts

SIDE = 48  # px, of the exemplar


def naive(
    costs: tuple[Any, ...],
    price: np.ndarray,
    places: np.ndarray,
    source: np.ndarray,
    tile: np.ndarray,
    least: np.ndarray,
) -> None:
    """The same for one tile, displacement by displacement."""
    top, left, height, width = tile.tolist()
    rows, columns = np.arange(top, top + height // 2 * 2), np.arange(left, left + width // 2 * 2)
    view = np.ix_(rows % source.shape[1], columns % source.shape[2])
    here = np.stack(np.meshgrid(np.arange(rows.size), np.arange(columns.size), indexing="ij"))
    shift = source[:, *view] - here
    coarse = shift[:, ::2, ::2]
    values, counts = np.unique(coarse.reshape(2, -1), axis=1, return_counts=True)
    inner = np.zeros(coarse.shape[1:], bool)
    inner[1:-1, 1:-1] = True

    def cut(old: np.ndarray, new: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        taken = np.zeros(state.shape, bool)
        pixels = [np.ascontiguousarray(np.moveaxis(one // 2, 0, 2).astype(np.int32)) for one in (old, new)]
        window = costs, NO_CELLS, price, *pixels, state.astype(np.int8)
        cut_window(*window, taken)
        return taken, [window_cost(*window, choice) for choice in (np.zeros_like(taken), taken)]

    old = (shift + here)[:, ::2, ::2]
    if cut(old, old, np.where(inner, FILLED, KEPT))[1][0] < least[1]:
        return
    for index in np.argsort(-counts, kind="stable"):
        value = values[:, index, None, None]
        if counts[index] < least[0]:
            continue
        new = here[:, ::2, ::2] + value
        block = [new + np.array(step)[:, None, None] for step in ((0, 0), (0, 1), (1, 0), (1, 1))]
        inside = np.all([(one >= 0) & (one < np.array(places.shape)[:, None, None]) for one in block], axis=(0, 1))
        own = (shift[:, ::2, ::2] == value).all(axis=0)
        may = inside & inner & ~own
        may[may] = np.all([places[one[0][may], one[1][may]] for one in block], axis=0)
        old = (shift + here)[:, ::2, ::2]
        new = np.where(may | own, new, 0)
        taken, totals = cut(old, new, np.where(may, FREE, np.where(own & inner, FILLED, KEPT)))
        if totals[1] < totals[0]:
            moved = np.repeat(np.repeat(taken & may, 2, axis=0), 2, axis=1)
            shift = np.where(moved, value, shift)
    source[:, *view] = shift + here


def pieces(rng: np.random.Generator, sides: tuple[int, int]) -> np.ndarray:
    """Sources in rectangles with a displacement each."""
    source = np.indices(sides) + 8
    for _ in range(12):
        top, left = rng.integers(0, np.array(sides) - 8)
        part = np.s_[:, top : top + rng.integers(6, 24), left : left + rng.integers(6, 24)]
        source[part] = np.indices(sides)[part] + rng.integers(-6, 12, 2)[:, None, None]
    return np.clip(source, 2, SIDE - 4).astype(np.int32)


@pytest.mark.parametrize("priced", [False, True])
def test_tiles_are_as_the_naive_ones(rng: np.random.Generator, priced: bool) -> None:
    features = rng.uniform(0, 40, (SIDE // 2, SIDE // 2, 4)).astype(np.float32)
    costs = SeamCosts(features, gradients=True, squared=True, offset=8.0).given
    price = rng.integers(0, 3 * UNIT, features.shape[:2]).astype(np.int32) if priced else NO_PRICE
    places = rng.random((SIDE - 2, SIDE - 2)) > 0.02
    source = pieces(rng, (40, 37))
    expected, before = source.copy(), source.copy()
    tiles = np.array([[30, 0, 20, 20], [30, 20, 20, 17], [10, 0, 20, 20], [10, 20, 19, 13]])  # the first go around
    least = np.array([6, 2 * UNIT])
    for span in ((0, 3), (3, 4)):
        expand_in_tiles(costs, price, places, source, tiles, least, *span)
    for tile in tiles:
        naive(costs, price, places, expected, tile, least)
    assert (source != before).any()
    assert np.array_equal(source, expected)
    changed = (source != before).any(axis=0)
    assert places[source[0][changed], source[1][changed]].all()


def test_a_tile_without_a_seam_worth_it_is_left(rng: np.random.Generator) -> None:
    features = rng.uniform(0, 40, (SIDE // 2, SIDE // 2, 3)).astype(np.float32)
    costs = SeamCosts(features, gradients=False, squared=True).given
    source = pieces(rng, (32, 32))
    before = source.copy()
    for least, same in ((np.array([6, 2**40]), True), (np.array([10**6, 0]), True), (np.array([6, 0]), False)):
        expand_in_tiles(
            costs, NO_PRICE, np.ones((SIDE, SIDE), bool), source, np.array([[0, 0, 32, 32]]), least, 0, 1,
        )  # fmt: skip
        assert np.array_equal(source, before) == same
