"""Excluded pixels: how they are marked and replaced."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.masks import (
    USABLE,
    count_excluded,
    fill_excluded,
    nearest_valid,
    tell_holes,
    valid_pixels,
    without_usable,
)


def marked(pixels: np.ndarray, *marks: tuple[str, np.ndarray]) -> Image:
    planes = [pixels, *(mark[..., None].astype(np.float32) for _, mark in marks)]
    return Image(np.concatenate(planes, axis=2), ("R", "G", "B", *(name for name, _ in marks)))


def test_alpha_and_mask_both_count(rng: np.random.Generator) -> None:
    pixels = rng.random((5, 7, 3), np.float32)
    alpha, mask = np.ones((5, 7)), np.ones((5, 7))
    assert valid_pixels(picture(pixels)) is None
    assert valid_pixels(marked(pixels, ("A", alpha), (USABLE, mask))) is None
    alpha[1, 2], alpha[4, 4], mask[3, 3] = 0.49, 0.5, 0
    valid = valid_pixels(marked(pixels, ("A", alpha), (USABLE, mask)))
    assert valid is not None
    assert np.argwhere(~valid).tolist() == [[1, 2], [3, 3]]
    with pytest.raises(InputError, match="excludes every pixel"):
        valid_pixels(marked(pixels, ("A", 0 * alpha)))


def test_nearest_equals_a_search_of_all(rng: np.random.Generator) -> None:
    valid = rng.random((9, 11)) < 0.15
    nearest = nearest_valid(valid)
    places = np.argwhere(valid)
    for row, column in np.ndindex(valid.shape):
        least = ((places - (row, column)) ** 2).sum(axis=1).min()
        own = nearest[:, row, column]
        assert valid[tuple(own)]
        assert ((own - (row, column)) ** 2).sum() == least


def test_boxes_count_what_is_masked(rng: np.random.Generator) -> None:
    valid = rng.random((9, 12)) < 0.6
    counts = count_excluded(valid, 3, 5)
    assert counts.shape == (7, 8)
    for row, column in np.ndindex(counts.shape):
        assert counts[row, column] == (~valid[row : row + 3, column : column + 5]).sum()


def test_filling_forgets_what_is_masked_and_leaves_the_rest(rng: np.random.Generator) -> None:
    pixels, valid = rng.random((8, 9, 3), np.float32), rng.random((8, 9)) < 0.7
    other = np.where(valid[..., None], pixels, np.float32(99))
    one, two = (fill_excluded(marked(values, (USABLE, valid))).pixels for values in (pixels, other))
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(one[valid][:, :3], pixels[valid])
    assert one[..., :3].max() <= 1


def test_the_mark_does_not_go_along(rng: np.random.Generator) -> None:
    pixels = rng.random((4, 5, 3), np.float32)
    plain = without_usable(marked(pixels, (USABLE, np.ones((4, 5))), ("height", np.zeros((4, 5)))))
    assert plain.channels == ("R", "G", "B", "height")
    np.testing.assert_array_equal(plain.pixels[..., :3], pixels)
    image = picture(pixels)
    assert without_usable(image) is image


def test_holes_of_a_result_are_told(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    pixels, alpha = rng.random((5, 8, 3), np.float32), np.ones((5, 8))
    log = logging.getLogger("texloom.test")
    tell_holes(log, picture(pixels))
    tell_holes(log, marked(pixels, ("A", alpha)))
    assert caplog.messages == []
    alpha[1, 2:4] = 0.4
    tell_holes(log, marked(pixels, ("A", alpha)))
    assert caplog.messages == [
        "the result has holes: 5 % of its pixels are transparent, as they were kept; the flow fill fills the "
        "transparent pixels of a picture"
    ]
