"""Levels of a distorted texture."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.photographs.gaussian_stack import GaussianStack, GaussianStackParams, gaussian_stack
from texloom.stages.synthesis.per_pixel.per_pixel import flat

SHAPE = (120, 150)


def stack(light: np.ndarray, stretch: float = 1.0, **params: Any) -> tuple[np.ndarray, GaussianStack]:
    """Of noise under light, seen from the front; px an element."""
    grey = 0.4 + 0.3 * smooth_noise(SHAPE, 1.0, np.random.default_rng(1))
    region = np.zeros(SHAPE, bool)
    region[5:-5, 5:-5] = True
    jacobian = np.ascontiguousarray(flat(SHAPE) * np.float32(stretch))
    level = np.full(SHAPE, -np.log2(stretch), np.float32)
    made = gaussian_stack(picture(grey * light), jacobian, level, region, GaussianStackParams(**params))
    return grey[5:-5, 5:-5], made


def test_the_finest_level_is_the_photograph() -> None:
    grey, made = stack(np.ones(SHAPE))
    np.testing.assert_allclose(made.image.pixels[..., 0], grey, atol=1e-6)


def test_pixels_finer_than_elements_are_averaged_as_an_element_is() -> None:
    grey, made = stack(np.ones(SHAPE), stretch=4.0)
    from scipy.ndimage import uniform_filter

    # as much of the variance is left as the mean over an element's area leaves
    inner = np.s_[10:-10, 10:-10]
    left = made.image.pixels[..., 0][inner].var() / grey[inner].var()
    assert abs(left / (uniform_filter(grey, 4)[inner].var() / grey[inner].var()) - 1) < 0.1


def test_light_that_varies_slowly_is_taken_out() -> None:
    slope = np.linspace(0.5, 1.5, SHAPE[1]) * np.ones(SHAPE)
    spread = {}
    for even in (0.0, 0.5, 1.0):
        _, made = stack(slope, even=even)
        left, right = (made.sharp.pixels[:, columns, 0].mean() for columns in (slice(20, 31), slice(110, 121)))
        spread[even] = np.log(right / left)
        np.testing.assert_array_equal(made.image.pixels, made.sharp.pixels)  # the finest level needs no blur here
    assert spread[0.0] > 0.6
    assert abs(spread[0.5] / spread[0.0] - 0.5) < 0.15
    assert abs(spread[1.0]) < 0.15


def test_even_light_keeps_detail() -> None:
    grey, made = stack(np.ones(SHAPE), even=1.0)
    assert np.corrcoef(made.image.pixels[..., 0].ravel(), grey.ravel())[0, 1] > 0.97


@pytest.mark.parametrize(("light", "used"), [(1.0, True), (0.7, False)])
def test_distant_parts_are_used_where_they_have_the_same_colours(light: float, used: bool) -> None:
    grey = 0.4 + 0.3 * smooth_noise(SHAPE, 1.0, np.random.default_rng(1))
    far = np.broadcast_to(np.arange(SHAPE[1]) > 90, SHAPE)
    level = np.where(far, 1.0, 0.0).astype(np.float32)
    jacobian = flat(SHAPE) * np.exp2(-level)[..., None]
    photo, region = picture(grey * np.where(far, light, 1)), np.ones(SHAPE, bool)
    one, other = (
        gaussian_stack(photo, jacobian, level, region, GaussianStackParams(distant=distant))
        for distant in (True, False)
    )
    if used:
        assert one.valid[:, far].any()
        assert not other.valid[:, far].any()
    else:
        np.testing.assert_array_equal(one.valid, other.valid)
        np.testing.assert_array_equal(one.stack, other.stack)
