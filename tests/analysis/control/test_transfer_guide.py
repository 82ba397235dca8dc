"""A picture as a guide for the texture that renders it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import masked, picture
from texloom.stages.analysis.control.transfer_guide import TransferGuide, TransferGuideParams, transfer_guide
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimisation.optimise import optimise
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.vocabulary.arrays import Image


@pytest.fixture
def exemplar(rng: np.random.Generator) -> Image:
    """Grain, from dark at the left to bright at the right."""
    slope = np.linspace(0.05, 0.6, 64)[:, None]
    return picture((slope * (0.8 + 0.4 * rng.random((64, 64, 1)))).astype(np.float32).repeat(3, axis=2))


def halves(low: float, high: float, size: tuple[int, int] = (48, 60)) -> Image:
    """A picture that is darker at the left."""
    values = np.where(np.arange(size[1]) < size[1] // 2, low, high)
    return picture(np.broadcast_to(values[None, :, None], (*size, 3)).astype(np.float32))


def guide(exemplar: Image, shown: Image, **params: Any) -> TransferGuide:
    return transfer_guide(exemplar, shown, TransferGuideParams(**{"detail": 0, **params}))


def test_lightness_is_compared_by_rank(exemplar: Image) -> None:
    """Whatever the picture's contrast, a half of it asks for the darker half of the exemplar."""
    found, faint = guide(exemplar, halves(0.1, 0.9)), guide(exemplar, halves(0.4, 0.41))
    np.testing.assert_array_equal(found.target, faint.target)
    whole = found.exemplar.max()
    np.testing.assert_allclose(np.unique(found.target) / whole, [0.25, 0.75], atol=0.01)
    order = np.argsort(exemplar.pixels[..., 0].ravel(), kind="stable")
    assert (np.diff(found.exemplar[..., 0].ravel()[order]) >= 0).all()


def test_edges_are_a_plane_of_their_own(exemplar: Image, rng: np.random.Generator) -> None:
    own, shown = rng.random((64, 64), dtype=np.float32), rng.random((48, 60), dtype=np.float32)
    found = transfer_guide(exemplar, halves(0.1, 0.9), TransferGuideParams(), own, shown)
    assert (found.exemplar.shape, found.target.shape) == ((64, 64, 2), (48, 60, 2))
    ratio = found.exemplar[..., 1] / own
    np.testing.assert_allclose(ratio, ratio[0, 0], rtol=1e-5)
    np.testing.assert_allclose(found.target[..., 1] / shown, ratio[0, 0], rtol=1e-5)
    without = transfer_guide(exemplar, halves(0.1, 0.9), TransferGuideParams(edges=0), own, shown)
    assert without.target.shape[2] == 1


def test_what_is_transparent_asks_for_nothing_and_what_is_excluded_does_not_count(exemplar: Image) -> None:
    asked = np.ones((48, 60), bool)
    asked[:24] = False
    found = guide(exemplar, masked(halves(0.1, 0.9), asked, 0.0))
    assert np.isnan(found.target[:20]).all()
    assert not np.isnan(found.target[28:]).any()
    usable = np.ones((64, 64), bool)
    usable[32:] = False
    half = guide(masked(exemplar, usable, 1.0), halves(0.1, 0.9))
    ranks = half.exemplar[:32, :, 0]
    assert ranks.min() < 0.01 * ranks.max()


def test_size_and_weight(exemplar: Image) -> None:
    found = guide(exemplar, halves(0.1, 0.9), size=(96, 120), weight=2)
    assert found.target.shape == (96, 120, 1)
    np.testing.assert_allclose(found.exemplar, 2 * guide(exemplar, halves(0.1, 0.9)).exemplar, rtol=1e-6)


def test_a_texture_renders_the_picture(exemplar: Image) -> None:
    found = guide(exemplar, halves(0.1, 0.9))
    guides = {"exemplar_guide": found.exemplar, "target_guide": found.target}
    start = initialise(exemplar, InitialiseParams(size=None), np.random.default_rng(1), **guides)
    texture = optimise(
        exemplar, start.match, OptimiseParams(preset="fast", patch_size=6), np.random.default_rng(2), **guides
    )
    dark, bright = texture.image.pixels[:, :24].mean(), texture.image.pixels[:, 36:].mean()
    assert bright > 1.8 * dark


def test_light_and_dark_of_elements_alone_is_followed_more_closely(
    rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    """Sixteen squares of 32 px or 4,096 of 2 px: of the small ones no area is light or dark."""
    strengths = []
    for side in (32, 2):
        values = np.where(rng.permutation(np.arange((128 // side) ** 2) % 2 == 0), 0.1, 0.5)
        values = values.reshape(128 // side, -1).repeat(side, 0).repeat(side, 1)
        strengths.append(guide(picture(values[..., None].astype(np.float32).repeat(3, 2)), halves(0.1, 0.9)))
    assert 2 < strengths[1].exemplar.max() / strengths[0].exemplar.max() <= 2.5**1.5
    assert not caplog.records
    flat = np.full((64, 64, 3), 0.3, np.float32)
    guide(picture(flat), halves(0.1, 0.9))
    assert "nearly as light everywhere (its areas differ by 0.0 CIELAB units)" in caplog.text
