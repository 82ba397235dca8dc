from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tests.synthetic import smooth_noise, tiled
from texloom.stages.synthesis.stitching import similar_places
from texloom.stages.synthesis.stitching.similar_places import UNKNOWN, SimilarPlaces


def everywhere(similar: SimilarPlaces) -> np.ndarray:
    """The places of all pixels, none of them `UNKNOWN`."""
    unknown = similar.places[..., 0, 0] == UNKNOWN if similar.places.shape[2] else np.zeros(0, bool)
    while unknown.any():
        similar.look_up(*np.argwhere(unknown)[0].tolist())
        unknown = similar.places[..., 0, 0] == UNKNOWN
    return similar.places


def test_similar_places_are_the_same_place_of_other_cells(rng: np.random.Generator) -> None:
    exemplar, _ = tiled(rng.random((11, 13, 3)), 0, (50, 60))
    similar = everywhere(SimilarPlaces(exemplar.pixels, 3))
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
    similar = everywhere(SimilarPlaces(features, 2))
    windows = np.lib.stride_tricks.sliding_window_view(features, (7, 7), axis=(0, 1)).reshape(34 * 38, -1)
    total, least = 0.0, 0.0
    for number in range(0, 34 * 38, 29):
        distance = ((windows - windows[number]) ** 2).sum(axis=1)
        distance[number] = np.inf
        row, column = similar[number // 38 + 3, number % 38 + 3, 0] - 3
        total += float(distance[row * 38 + column])
        least += float(distance.min())
    assert total < 1.3 * least


@pytest.mark.parametrize(("shape", "count"), [((7, 7), 3), ((30, 30), 0), ((8, 8), 4)])
def test_where_there_are_too_few_there_are_none(shape: tuple[int, int], count: int) -> None:
    similar = everywhere(SimilarPlaces(np.zeros((*shape, 3), np.float32), count))
    assert similar.shape == (*shape, count, 2)
    assert (similar == -1).all()


def test_equal_places_do_not_hide_each_other() -> None:
    similar = everywhere(SimilarPlaces(np.zeros((20, 20, 3), np.float32), 4))[3:-3, 3:-3]
    assert (similar >= 3).all()
    assert (similar != np.stack(np.mgrid[3:17, 3:17], axis=2)[:, :, None]).any(axis=3).all()


def test_large_exemplars_are_looked_up_at_some_places(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Smooth patterns are matched exactly, though few places are indexed."""
    monkeypatch.setattr(similar_places, "_MAX_INDEXED", 300)  # every third along both axes
    pattern = gaussian_filter(rng.random((11, 13, 3)), (2, 2, 0), mode="wrap")
    exemplar, _ = tiled((pattern - pattern.min()) / np.ptp(pattern), 0, (50, 60))
    similar = everywhere(SimilarPlaces(exemplar.pixels, 3))
    inner = similar[3:-3, 3:-3]
    assert ((inner >= 3) & (inner < [47, 57])).all()
    steps = inner - np.stack(np.mgrid[3:47, 3:57], axis=2)[:, :, None]
    assert (steps % [11, 13] == 0).all(axis=3).mean() > 0.9  # the others were moved inside
    assert steps.any(axis=3).mean() > 0.99


def test_places_do_not_depend_on_what_was_asked_before(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    features = smooth_noise((60, 71, 3), 1.5, rng).astype(np.float32)
    for limit in (10**6, 900):
        monkeypatch.setattr(similar_places, "_MAX_INDEXED", limit)
        whole, one = everywhere(SimilarPlaces(features, 3)), SimilarPlaces(features, 3)
        one.look_up(40, 37)
        known = one.places[..., 0, 0] != UNKNOWN
        assert known[40, 37]
        assert known[3:-3, 3:-3].mean() < 0.5
        np.testing.assert_array_equal(one.places[known], whole[known])
