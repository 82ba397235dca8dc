"""Small pictures that match histograms alone."""

from __future__ import annotations

import numpy as np
import pytest

from tests.runs import run_with_threads
from tests.synthetic import picture, smooth_noise
from texloom.stages.synthesis.inverse.histogram_summary import HistogramSummaryParams, histogram_summary
from texloom.stages.vocabulary.declare import InputError


def test_colours_have_the_shares_of_the_texture(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Light spots on a dark ground."""
    light = smooth_noise((72, 96), 3.0, rng)[..., None] > 0.6
    pixels = np.where(light, 0.6, 0.1) + 0.1 * smooth_noise((72, 96, 3), 1.0, rng)
    texture, control = picture(pixels), picture(pixels[..., 0])
    one, two = run_with_threads(
        lambda: histogram_summary(
            texture, HistogramSummaryParams(size=(32, 40)), np.random.default_rng(1), control=control
        ),
        monkeypatch,
    )
    np.testing.assert_array_equal(one.image.pixels, two.image.pixels)
    np.testing.assert_array_equal(one.image.pixels, texture.pixels[one.source[..., 0], one.source[..., 1]])
    assert one.control is not None
    np.testing.assert_array_equal(one.control.pixels[..., 0], one.image.pixels[..., 0])
    assert (one.image.pixels[..., 0] > 0.5).mean() == pytest.approx((pixels[..., 0] > 0.5).mean(), abs=0.06)


def test_sizes_are_checked(rng: np.random.Generator) -> None:
    texture = picture(rng.random((40, 40, 3)))
    with pytest.raises(InputError, match="8 x 8 px is too small; its sides must be 10 px or more"):
        histogram_summary(texture, HistogramSummaryParams(size=(8, 8)), rng)
