from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.synthesis.stitching.adaptive import Adaptive, AdaptiveParams, adaptive
from texloom.stages.synthesis.stitching.hybrid import HybridParams, hybrid
from texloom.stages.synthesis.stitching.painted_blocks import painted_blocks
from texloom.stages.synthesis.stitching.patchwork import check_patch
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError


def texture(image: Image, **params: Any) -> Adaptive:
    params = {"size": (90, 100), "patch": 16, "patch_tolerance": 0.5, **params}
    return adaptive(image, AdaptiveParams(**params), np.random.default_rng(1))


@pytest.fixture
def image(rng: np.random.Generator) -> Image:
    return picture(smooth_noise((60, 70, 3), 2.0, rng))


@pytest.mark.parametrize("tileable", [False, True])
def test_at_0_it_is_hybrid_synthesis(image: Image, tileable: bool) -> None:
    result = texture(image, k=0.0, tileable=tileable)
    params = HybridParams(size=(90, 100), patch=16, patch_tolerance=0.5, tileable=tileable)
    other = hybrid(image, params, np.random.default_rng(1))
    np.testing.assert_array_equal(result.image.pixels, other.image.pixels)
    np.testing.assert_array_equal(result.match, other.match)
    assert (result.patches, result.resynthesised) == (other.patches, other.resynthesised)
    assert result.quilted == 1  # the first, which lies over nothing
    assert result.resynthesised > 0


@pytest.mark.parametrize("tileable", [False, True])
def test_at_1_it_is_quilting(image: Image, tileable: bool) -> None:
    """Patches that fit are cut, nothing is blended, and how single pixels would be repaired makes no difference."""
    result = texture(image, k=1.0, tileable=tileable, patch_tolerance=30)
    assert result.quilted == result.patches == 6 * 7
    assert result.resynthesised == 0
    np.testing.assert_array_equal(result.image.pixels, image.pixels[result.match[..., 0], result.match[..., 1]])
    other = texture(image, k=1.0, tileable=tileable, patch_tolerance=30, pixel_tolerance=0, similar=1, soften=False)
    np.testing.assert_array_equal(result.match, other.match)


def test_at_1_only_what_cannot_be_split_is_repaired(image: Image) -> None:
    result = texture(image, k=1.0, patch_tolerance=0.03, pixel_tolerance=0, smallest=7)
    assert 0 < result.patches - result.quilted < result.patches
    assert result.patches > 6 * 7


def test_less_is_repaired_as_k_rises(image: Image) -> None:
    results = [texture(image, k=k, pixel_tolerance=0.05) for k in (0.0, 0.3, 0.7, 1.0)]
    shares = [result.quilted / result.patches for result in results]
    assert shares == sorted(shares)
    assert len(set(shares)) >= 3
    repaired = [result.resynthesised for result in results]
    assert repaired == sorted(repaired, reverse=True)


@pytest.mark.parametrize(("k", "tolerance"), [(1.0, 1e4), (0.0, 1e4), (0.5, 0.5)])
def test_blocks_have_any_shape(image: Image, k: float, tolerance: float) -> None:
    """Bands that wind down the result, each cut by a wavy line."""
    row, column = np.indices((90, 100))
    bands = (column + 6 * np.sin(row / 7)) // 24 + 8 * ((row + 5 * np.cos(column / 5)) // 22)
    layout = picture(np.stack([bands / 80, bands % 2, bands % 3 / 2], axis=2))
    params = AdaptiveParams(size=(90, 100), patch_tolerance=tolerance, k=k)
    result = adaptive(image, params, np.random.default_rng(1), layout=layout)
    blocks = len(painted_blocks(layout))
    assert blocks >= 25
    if tolerance > 1:
        assert result.patches == blocks
        assert result.quilted == (blocks if k else 1)
    else:
        assert result.patches > blocks
    if k == 1:
        np.testing.assert_array_equal(result.image.pixels, image.pixels[result.match[..., 0], result.match[..., 1]])
    # patches are not as the bands: borders run where they are least visible
    steps = np.abs(np.diff(result.image.pixels, axis=1)).mean()
    assert steps < 1.3 * np.abs(np.diff(image.pixels, axis=1)).mean()


def test_a_layout_of_another_size_is_refused(image: Image) -> None:
    with pytest.raises(InputError, match="layout: 9 x 9 px for a result of 100 x 90 px"):
        check_patch(AdaptiveParams(size=(90, 100)), {"layout": picture(np.zeros((9, 9, 3)))})
    with pytest.raises(InputError, match="layout: a block of 100 x 90 px"):
        adaptive(image, AdaptiveParams(size=(90, 100)), np.random.default_rng(1), picture(np.zeros((90, 100, 3))))
