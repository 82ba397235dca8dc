"""Procedural textures: repeatable, of every kind, with contours where parts meet."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.training.fields import bent, smooth_noise
from benchmarks.training.layouts import LAYOUTS
from benchmarks.training.pictures import draw_picture, picture_of


@pytest.mark.parametrize("kind", LAYOUTS)
def test_parts_have_about_the_requested_size(kind: str, rng: np.random.Generator) -> None:
    few, many = (len(np.unique(LAYOUTS[kind](256, unit, np.random.default_rng(3)))) for unit in (100.0, 20.0))
    assert few >= 2
    assert many >= few if kind == "stains" else many > 2 * few


@pytest.mark.parametrize("kind", LAYOUTS)
def test_same_seed_same_picture(kind: str) -> None:
    first, second = (draw_picture(kind, 96, 20.0, np.random.default_rng(11)) for _ in range(2))
    np.testing.assert_array_equal(first.color, second.color)
    np.testing.assert_array_equal(first.contours, second.contours)
    assert first.color.dtype == np.uint8
    assert first.color.shape == (96, 96, 3)
    assert first.color.std() > 0.5


def test_judged_pictures_are_not_those_of_training() -> None:
    train, judge = (picture_of(split, 4, 64, 7) for split in ("train", "judge"))
    assert train.kind == judge.kind
    assert (train.color != judge.color).mean() > 0.5


def test_most_contours_show() -> None:
    """Across contours pictures change more than elsewhere; there are contours, but not everywhere."""
    on, off = [], []
    for number in range(20):
        picture = picture_of("judge", number, 128, 7)
        grey = picture.color.astype(float).mean(axis=2)
        steep = np.hypot(*np.gradient(grey)) / (grey.std() + 1)
        on.append(steep[picture.contours].mean() if picture.contours.any() else 0)
        off.append(steep[~picture.contours].mean())
        assert picture.contours.mean() < 0.5
    assert np.mean(on) > 1.15 * np.mean(off)


def test_bending_keeps_part_numbers(rng: np.random.Generator) -> None:
    ids = rng.integers(0, 1000, (60, 60)).astype(np.int32)
    np.testing.assert_array_equal(bent(ids, (40, 40), 0.0, 0.0, rng), ids[10:50, 10:50])
    assert set(np.unique(bent(ids, (40, 40), 0.5, 4.0, rng))) <= set(np.unique(ids))


def test_noise_has_the_requested_period(rng: np.random.Generator) -> None:
    field = smooth_noise((256, 256), (40, 4), rng)
    down, across = (np.abs(np.diff(field, axis=axis)).mean() for axis in (0, 1))
    assert 5 < across / down < 20
    assert abs(field.std() - 1) < 0.4
