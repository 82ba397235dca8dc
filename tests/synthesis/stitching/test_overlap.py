from __future__ import annotations

import numpy as np
import pytest

from tests.kernels.seams import naive
from tests.synthetic import picture, smooth_noise
from texloom.stages.synthesis.stitching.overlap import OverlapSearch, ReducedSearch, compared, pick
from texloom.stages.vocabulary.arrays import Image


@pytest.mark.parametrize(("shape", "size"), [((23, 31), (7, 5)), ((16, 16), (16, 16)), ((20, 9), (1, 9))])
def test_errors_are_those_of_every_place(
    shape: tuple[int, int], size: tuple[int, int], rng: np.random.Generator
) -> None:
    features = rng.random((*shape, 3), np.float32)
    template = rng.random((*size, 3), np.float32)
    mask = rng.random(size) < 0.5
    mask[0, 0] = True
    template[~mask] = 1e3  # is not looked at
    errors = OverlapSearch(features).errors(template, mask)
    assert errors.dtype == np.float32
    np.testing.assert_allclose(errors, naive.overlap_errors(features, template, mask), atol=2e-6)


def test_noise_bounds_the_error_at_an_exact_place(rng: np.random.Generator) -> None:
    features = (rng.random((200, 180, 3)) * 0.01 + 0.98).astype(np.float32)
    search = OverlapSearch(features)
    for row, column in rng.integers(0, 130, (20, 2)):
        template = features[row : row + 48, column : column + 40]
        mask = rng.random((48, 40)) < 0.3
        assert search.errors(template, mask)[row, column] <= search.noise(template, mask)


def test_pick_draws_all_that_are_good_enough(rng: np.random.Generator) -> None:
    errors = np.full((4, 5), 3, np.float32)
    errors[1, 2], errors[3, 4], errors[0, 1] = 1.0, 1.09, 1.2
    drawn = {tuple(int(v) for v in pick(errors, 0.1, 0.0, rng)) for _ in range(100)}
    assert drawn == {(1, 2), (3, 4)}
    assert {tuple(int(v) for v in pick(errors, 0.0, 0.0, rng)) for _ in range(100)} == {(1, 2)}


def test_differences_are_weighted_and_encoded() -> None:
    def steps(*color: float) -> float:
        both = compared(picture(np.array([[color, (0, 0, 0)]])))
        return float(((both[0, 0] - both[0, 1]) ** 2).sum())

    assert steps(1, 1, 1) == pytest.approx(1, abs=1e-6)
    assert steps(1, 0, 0) == pytest.approx(0.299, abs=1e-6)
    assert steps(0, 1, 0) == pytest.approx(0.587, abs=1e-6)
    assert steps(0.2140411, 0.2140411, 0.2140411) == pytest.approx(0.25, abs=1e-4)  # sRGB 0.5
    assert steps(4, 4, 4) > 2


def test_a_grey_picture_is_compared_as_grey_colour(rng: np.random.Generator) -> None:
    grey = rng.random((4, 5), np.float32)
    both = [compared(picture(grey)), compared(picture(np.repeat(grey[..., None], 3, axis=2)))]
    np.testing.assert_array_equal(*both)
    maps = Image(rng.random((4, 5, 5), np.float32), ("R", "G", "B", "A", "height"))
    assert compared(maps).shape == (4, 5, 3)


@pytest.mark.parametrize("most", [1000, 40, 20])  # squares of 1, 2 and 5 px
def test_the_best_places_are_found_among_means(most: int, rng: np.random.Generator) -> None:
    features = smooth_noise((90, 130, 3), 3.0, rng).astype(np.float32)
    search = ReducedSearch(features, most)
    free = np.ones((90 - 30 + 1, 130 - 24 + 1), bool)
    mask = np.ones((30, 24), bool)
    mask[8:22, 8:16] = False
    for row, column in rng.integers(0, 61, (8, 2)):
        template = np.where(mask[..., None], features[row : row + 30, column : column + 24], np.float32(7))
        assert tuple(search.best(template, mask, free, 1, 2)[0]) == (row, column)
        closed = free.copy()
        closed[row, column] = False
        places = search.best(template, mask, closed, 6, 2)
        assert len(places) == 6
        assert closed[tuple(places.T)].all()
        assert (row, column) not in {tuple(place) for place in places}
    assert len(search.best(template, mask, np.zeros_like(free), 6, 2)) == 0


def test_places_that_are_found_are_apart_and_in_order(rng: np.random.Generator) -> None:
    features = rng.random((40, 50, 2)).astype(np.float32)
    mask = np.ones((6, 5), bool)
    free = np.ones((35, 46), bool)
    places = ReducedSearch(features, 1000).best(features[3:9, 4:9], mask, free, 10, 3)
    errors = naive.overlap_errors(features, features[3:9, 4:9], mask)
    order = errors[tuple(places.T)]
    assert order[0] == pytest.approx(errors.min(), abs=1e-6)
    assert (np.diff(order) > -1e-6).all()
    for number, place in enumerate(places):
        assert all(np.abs(place - other).max() >= 3 for other in places[:number])
