from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.synthesis.stitching.hybrid import Hybrid, HybridParams, hybrid
from texloom.stages.vocabulary.arrays import Image


def texture(image: Image, seed: int = 1, **params: Any) -> Hybrid:
    params = {"size": (90, 100), "patch": 16, **params}
    return hybrid(image, HybridParams(**params), np.random.default_rng(seed))


@pytest.fixture
def image(rng: np.random.Generator) -> Image:
    return picture(smooth_noise((60, 70, 3), 2.0, rng))


@pytest.mark.parametrize("tileable", [False, True])
def test_match_is_exact_where_nothing_is_blended(image: Image, tileable: bool) -> None:
    result = texture(image, pixel_tolerance=0, soften=False, tileable=tileable)
    np.testing.assert_array_equal(result.image.pixels, image.pixels[result.match[..., 0], result.match[..., 1]])
    assert result.resynthesised > 2000


def test_match_is_what_most_of_a_blended_pixel_is(image: Image) -> None:
    """All channels are blended alike, so even a map that is not compared stays near where its pixel is from."""
    maps = Image(np.concatenate([image.pixels, image.pixels[..., :1]], axis=2), ("R", "G", "B", "height"))
    result = texture(maps)
    np.testing.assert_array_equal(result.image.pixels[..., 0], result.image.pixels[..., 3])
    away = np.abs(result.image.pixels - maps.pixels[result.match[..., 0], result.match[..., 1]]).max(axis=2)
    assert 0.4 < (away == 0).mean() < 1
    assert np.quantile(away, 0.99) < 0.2


def test_tolerances_decide_what_is_split_and_made_anew(image: Image) -> None:
    cells = 6 * 7
    loose = texture(image, patch_tolerance=100, pixel_tolerance=100)
    assert (loose.patches, loose.resynthesised) == (cells, 0)
    assert (
        texture(image, patch_tolerance=0, pixel_tolerance=100, smallest=8).patches == cells
    )  # of 15 px: not split
    assert 2 * cells < texture(image, patch_tolerance=0, pixel_tolerance=100, smallest=7).patches < 4 * cells
    some = texture(image, patch_tolerance=0.15, smallest=4)
    assert cells < some.patches < 16 * cells
    assert 0 < some.resynthesised < texture(image, pixel_tolerance=0.02).resynthesised


def test_detail_is_kept(rng: np.random.Generator) -> None:
    """Fine grain is neither averaged away nor sharpened."""
    exemplar = picture(smooth_noise((70, 70, 3), 1.0, rng))
    fine = [np.abs(np.diff(texture(exemplar, seed).image.pixels, axis=1)).mean() for seed in range(2)]
    assert 0.9 < np.mean(fine) / np.abs(np.diff(exemplar.pixels, axis=1)).mean() < 1.1


def test_patches_of_any_sides(image: Image) -> None:
    """Sides are halved one by one until the smallest; then every patch may be a pixel."""
    loose = {"patch_tolerance": 100, "pixel_tolerance": 100}
    assert texture(image, patch="16x8", **loose).patches == 12 * 7
    assert texture(image, patch=(16, 8), **loose).patches == 6 * 13
    fine = texture(image, size=(20, 24), patch="16x8", patch_tolerance=0, smallest=1, tileable=True)
    assert fine.patches > 0.6 * 20 * 24


def test_tolerances_do_not_depend_on_contrast(image: Image) -> None:
    weak = Image(np.asarray(0.2 + 0.02 * image.pixels, np.float32), image.channels)
    strong, faint = (texture(one, patch_tolerance=0.15, smallest=4) for one in (image, weak))
    assert strong.patches > 6 * 7
    assert faint.patches == pytest.approx(strong.patches, rel=0.25)
