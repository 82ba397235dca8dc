from __future__ import annotations

from typing import Any

import numpy as np
import pydantic
import pytest

from tests.synthetic import continued, jump, picture, smooth_noise, tiled
from texloom.stages.arrays import Image
from texloom.stages.declare import InputError, find_stage
from texloom.stages.synthesis.adaptive import Adaptive, AdaptiveParams, adaptive
from texloom.stages.synthesis.hybrid import HybridParams, hybrid


def made(image: Image, seed: int = 1, **params: Any) -> Adaptive:
    given = AdaptiveParams(**{"size": (90, 100), "patch": 16, "patch_tolerance": 0.01, **params})
    return adaptive(image, given, np.random.default_rng(seed))


@pytest.fixture
def image(rng: np.random.Generator) -> Image:
    return picture(smooth_noise((60, 70, 3), 2.0, rng))


@pytest.mark.parametrize("tileable", [False, True])
def test_at_0_it_is_hybrid_synthesis(image: Image, tileable: bool) -> None:
    result = made(image, k=0.0, tileable=tileable)
    params = HybridParams(size=(90, 100), patch=16, patch_tolerance=0.01, tileable=tileable)
    other = hybrid(image, params, np.random.default_rng(1))
    np.testing.assert_array_equal(result.image.pixels, other.image.pixels)
    np.testing.assert_array_equal(result.match, other.match)
    assert (result.patches, result.resynthesised) == (other.patches, other.resynthesised)
    assert result.quilted == 1  # the first, which lies over nothing
    assert result.resynthesised > 0


@pytest.mark.parametrize("tileable", [False, True])
def test_at_1_it_is_quilting(image: Image, tileable: bool) -> None:
    """Patches that fit are cut, nothing is blended, and how single pixels would be repaired makes no difference."""
    result = made(image, k=1.0, tileable=tileable, patch_tolerance=0.5)
    assert result.quilted == result.patches == 6 * 7
    assert result.resynthesised == 0
    np.testing.assert_array_equal(result.image.pixels, image.pixels[result.match[..., 0], result.match[..., 1]])
    other = made(image, k=1.0, tileable=tileable, patch_tolerance=0.5, pixel_tolerance=0, similar=1, soften=False)
    np.testing.assert_array_equal(result.match, other.match)


def test_at_1_only_what_cannot_be_split_is_repaired(image: Image) -> None:
    result = made(image, k=1.0, patch_tolerance=0.0005, pixel_tolerance=0, smallest=7)
    assert 0 < result.patches - result.quilted < result.patches
    assert result.patches > 6 * 7


def test_less_is_repaired_as_k_rises(image: Image) -> None:
    results = [made(image, k=k, pixel_tolerance=0.001) for k in (0.0, 0.3, 0.7, 1.0)]
    shares = [result.quilted / result.patches for result in results]
    assert shares == sorted(shares)
    assert len(set(shares)) >= 3
    repaired = [result.resynthesised for result in results]
    assert repaired == sorted(repaired, reverse=True)


@pytest.mark.parametrize("k", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("size", [(16, 16), (41, 83)])
def test_every_pixel_is_made(k: float, size: tuple[int, int], tileable: bool, rng: np.random.Generator) -> None:
    pixels = rng.random((50, 40, 5), np.float32) + 1  # 0 marks a pixel that was never filled
    exemplar = Image(pixels, ("R", "G", "B", "A", "height"))
    result = made(exemplar, size=size, tileable=tileable, k=k, patch_tolerance=0.1)
    assert result.match.shape == (*size, 2)
    assert (result.match < (50, 40)).all()
    assert result.image.channels == exemplar.channels
    assert result.image.pixels.min() >= 1
    assert result.tileable == tileable


@pytest.mark.parametrize("k", [0.5, 1.0])
@pytest.mark.parametrize(("cell", "drop"), [((7, 9), 0), ((8, 11), 3)])
def test_an_exact_tiling_goes_on_exactly(
    k: float, cell: tuple[int, int], drop: int, rng: np.random.Generator
) -> None:
    pattern = rng.random((*cell, 3))
    exemplar, _ = tiled(pattern, drop, (60, 70))
    result = made(exemplar, k=k)
    np.testing.assert_array_equal(result.image.pixels, continued(pattern, drop, result.match))
    np.testing.assert_array_equal(result.image.pixels, exemplar.pixels[result.match[..., 0], result.match[..., 1]])
    assert result.quilted == result.patches


def test_tileable_wraps(image: Image) -> None:
    assert max(jump(made(image, seed, tileable=True).image.pixels) for seed in range(2)) < 1.5
    assert min(jump(made(image, seed).image.pixels) for seed in range(2)) > 2


def test_seed_and_threads(image: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for count in ("1", "2", "3"):
        monkeypatch.setenv("TEXLOOM_THREADS", count)
        found.append(made(image).image.pixels)
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])
    assert (made(image, 2).image.pixels != found[0]).any()


@pytest.mark.parametrize("k", [-0.1, 1.1, float("nan")])
def test_absurd_requests_are_refused(k: float) -> None:
    with pytest.raises(pydantic.ValidationError, match="k\n"):
        AdaptiveParams(k=k)


def test_bad_exemplars_are_refused_before_anything_runs() -> None:
    check = find_stage("synthesis.adaptive").check
    assert check is not None
    tiny = picture(np.zeros((15, 100)))
    for refuse in (lambda: check(AdaptiveParams(), {"image": tiny}), lambda: made(tiny)):
        with pytest.raises(InputError, match="image: 15x100 px is too small"):
            refuse()
