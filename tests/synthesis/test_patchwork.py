from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from stages.synthesis import _patchwork
from stages.synthesis._cuts import Strips
from stages.synthesis._patchwork import (
    PatchworkParams,
    dilation_order,
    feather,
    patch_and_overlap,
    similar_places,
)
from tests.synthetic import smooth_noise, tiled


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ((192, 256), (32, 7)),
        ((512, 600), (64, 13)),
        ((2000, 1023), (64, 13)),
        ((46, 46), (32, 7)),
        ((16, 99), (8, 3)),
    ],
)
def test_patches_suit_their_exemplar(shape: tuple[int, int], expected: tuple[int, int]) -> None:
    assert patch_and_overlap(shape, PatchworkParams()) == expected


def test_the_feather_falls_evenly_with_the_steps_from_the_cell() -> None:
    weights = feather((7, 8), Strips(top=3, left=0, bottom=0, right=3), 3)
    np.testing.assert_allclose(weights[3:, :5], 1)
    np.testing.assert_allclose(weights[:3, 0], [0.25, 0.5, 0.75])
    np.testing.assert_allclose(weights[5, 5:], [0.75, 0.5, 0.25])
    np.testing.assert_allclose(np.diag(weights[:3, 7:4:-1]), [0.25, 0.5, 0.75])
    assert weights[2, 7] == weights[0, 5] == np.float32(0.25)


def test_torn_pixels_come_in_the_order_of_dilation() -> None:
    kept = np.zeros((5, 6), bool)
    kept[:, :2] = True
    torn = ~kept
    torn[2, 3] = False  # neither kept nor torn: a hole that growth goes around
    order = dilation_order(kept, torn)
    assert len(order) == torn.sum() == len(np.unique(order, axis=0))
    assert torn[tuple(order.T)].all()
    assert order[:5].tolist() == [[row, 2] for row in range(5)]
    assert order[5:9].tolist() == [[row, 3] for row in (0, 1, 3, 4)]
    assert order[-1].tolist() == [2, 5]


def test_what_growth_does_not_reach_comes_last() -> None:
    kept, torn = np.zeros((2, 3, 6), bool)
    kept[1, 0] = torn[1, 1] = torn[0, 5] = torn[1, 5] = True
    assert dilation_order(kept, torn).tolist() == [[1, 1], [0, 5], [1, 5]]
    assert dilation_order(kept, np.zeros_like(torn)).shape == (0, 2)


def test_similar_places_are_the_same_place_of_other_cells(rng: np.random.Generator) -> None:
    exemplar, _ = tiled(rng.random((11, 13, 3)), 0, (50, 60))
    similar = similar_places(exemplar.pixels, 3)
    inner = similar[3:-3, 3:-3]
    assert (similar[:3] == -1).all()
    assert (similar[:, -3:] == -1).all()
    steps = inner - np.stack(np.mgrid[3:47, 3:57], axis=2)[:, :, None]
    assert (steps % [11, 13] == 0).all()
    assert steps.any(axis=3).all()  # never the place itself
    assert ((inner >= 3) & (inner < [47, 57])).all()


def test_similar_places_look_alike(rng: np.random.Generator) -> None:
    """Nearly as much as the nearest of all: compared with a full search."""
    features = smooth_noise((40, 44, 3), 1.5, rng).astype(np.float32)
    similar = similar_places(features, 2)
    windows = np.lib.stride_tricks.sliding_window_view(features, (7, 7), axis=(0, 1)).reshape(34 * 38, -1)
    found, least = 0.0, 0.0
    for number in range(0, 34 * 38, 29):
        distance = ((windows - windows[number]) ** 2).sum(axis=1)
        distance[number] = np.inf
        row, column = similar[number // 38 + 3, number % 38 + 3, 0] - 3
        found += float(distance[row * 38 + column])
        least += float(distance.min())
    assert found < 1.3 * least


@pytest.mark.parametrize(("shape", "count"), [((7, 7), 3), ((30, 30), 0), ((8, 8), 4)])
def test_where_there_are_too_few_there_are_none(shape: tuple[int, int], count: int) -> None:
    similar = similar_places(np.zeros((*shape, 3), np.float32), count)
    assert similar.shape == (*shape, count, 2)
    assert (similar == -1).all()


def test_equal_places_do_not_hide_each_other() -> None:
    similar = similar_places(np.zeros((20, 20, 3), np.float32), 4)[3:-3, 3:-3]
    assert (similar >= 3).all()
    assert (similar != np.stack(np.mgrid[3:17, 3:17], axis=2)[:, :, None]).any(axis=3).all()


def test_large_exemplars_are_looked_up_at_some_places(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What varies slowly is found to the pixel, though few places are looked up."""
    monkeypatch.setattr(_patchwork, "_MOST", 300)  # every third along both axes
    pattern = gaussian_filter(rng.random((11, 13, 3)), (2, 2, 0), mode="wrap")
    exemplar, _ = tiled((pattern - pattern.min()) / np.ptp(pattern), 0, (50, 60))
    similar = similar_places(exemplar.pixels, 3)
    inner = similar[3:-3, 3:-3]
    assert ((inner >= 3) & (inner < [47, 57])).all()
    steps = inner - np.stack(np.mgrid[3:47, 3:57], axis=2)[:, :, None]
    assert (steps % [11, 13] == 0).all(axis=3).mean() > 0.9  # the others were moved inside
    assert steps.any(axis=3).mean() > 0.99
