from __future__ import annotations

import numpy as np
import pydantic
import pytest

from tests.synthetic import continued, jump, picture, smooth_noise, tiled
from texloom.stages.arrays import Image
from texloom.stages.declare import InputError, find_stage
from texloom.stages.progress import Progress, listening
from texloom.stages.synthesis.hybrid import Hybrid, HybridParams, hybrid


def made(image: Image, seed: int = 1, **params: object) -> Hybrid:
    given = HybridParams(**{"size": (90, 100), "patch": 16, **params})  # type: ignore[arg-type]
    return hybrid(image, given, np.random.default_rng(seed))


@pytest.fixture
def image(rng: np.random.Generator) -> Image:
    return picture(smooth_noise((60, 70, 3), 2.0, rng))


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize(("shape", "patch"), [((16, 16), None), ((17, 90), 8), ((60, 70), None)])
@pytest.mark.parametrize("size", [(16, 16), (41, 83)])
def test_every_pixel_is_made(
    shape: tuple[int, int], patch: int | None, size: tuple[int, int], tileable: bool, rng: np.random.Generator
) -> None:
    pixels = rng.random((*shape, 5), np.float32) + 1  # 0 marks a pixel that was never filled
    result = made(Image(pixels, ("R", "G", "B", "A", "height")), size=size, patch=patch, tileable=tileable)
    assert result.match.shape == (*size, 2)
    assert result.match.dtype == np.uint32
    assert (result.match < shape).all()
    assert result.image.channels == ("R", "G", "B", "A", "height")
    assert result.image.pixels.min() >= 1
    assert result.image.pixels.max() <= 2
    assert result.tileable == tileable


@pytest.mark.parametrize("tileable", [False, True])
def test_match_is_exact_where_nothing_is_blended(image: Image, tileable: bool) -> None:
    result = made(image, pixel_tolerance=0, soften=False, tileable=tileable)
    np.testing.assert_array_equal(result.image.pixels, image.pixels[result.match[..., 0], result.match[..., 1]])
    assert result.resynthesised > 2000


def test_match_is_what_most_of_a_blended_pixel_is(image: Image) -> None:
    """All channels are blended alike, so even a map that is not compared stays near where its pixel is from."""
    maps = Image(np.concatenate([image.pixels, image.pixels[..., :1]], axis=2), ("R", "G", "B", "height"))
    result = made(maps)
    np.testing.assert_array_equal(result.image.pixels[..., 0], result.image.pixels[..., 3])
    away = np.abs(result.image.pixels - maps.pixels[result.match[..., 0], result.match[..., 1]]).max(axis=2)
    assert 0.4 < (away == 0).mean() < 1
    assert np.quantile(away, 0.99) < 0.2


@pytest.mark.parametrize(("cell", "drop"), [((7, 9), 0), ((8, 11), 3)])
@pytest.mark.parametrize("patch_tolerance", [0.0, 0.04])
def test_an_exact_tiling_goes_on_exactly(
    cell: tuple[int, int], drop: int, patch_tolerance: float, rng: np.random.Generator
) -> None:
    pattern = rng.random((*cell, 3))
    exemplar, _ = tiled(pattern, drop, (60, 70))
    result = made(exemplar, patch_tolerance=patch_tolerance)
    np.testing.assert_array_equal(result.image.pixels, continued(pattern, drop, result.match))
    assert result.resynthesised == 0
    assert result.patches == 6 * 7
    assert len(np.unique(result.match.astype(int)[0] - np.arange(100)[:, None], axis=0)) > 2


def test_a_tileable_tiling_wraps_exactly(rng: np.random.Generator) -> None:
    pattern = rng.random((9, 10, 3))
    exemplar, _ = tiled(pattern, 0, (50, 55))
    result = made(exemplar, size=(90, 100), tileable=True)
    np.testing.assert_array_equal(result.image.pixels, continued(pattern, 0, result.match))


def test_tileable_wraps(image: Image) -> None:
    assert max(jump(made(image, seed, tileable=True).image.pixels) for seed in range(2)) < 1.3
    assert min(jump(made(image, seed).image.pixels) for seed in range(2)) > 2


def test_tolerances_decide_what_is_split_and_made_anew(image: Image) -> None:
    cells = 6 * 7
    loose = made(image, patch_tolerance=1, pixel_tolerance=1)
    assert (loose.patches, loose.resynthesised) == (cells, 0)
    assert made(image, patch_tolerance=0, pixel_tolerance=1, smallest=8).patches == cells  # of 15 px: not split
    assert 2 * cells < made(image, patch_tolerance=0, pixel_tolerance=1, smallest=7).patches < 4 * cells
    some = made(image, patch_tolerance=0.002, smallest=4)
    assert cells < some.patches < 16 * cells
    assert 0 < some.resynthesised < made(image, pixel_tolerance=0.0005).resynthesised


def test_detail_is_kept(rng: np.random.Generator) -> None:
    """Fine grain is neither averaged away nor sharpened."""
    exemplar = picture(smooth_noise((70, 70, 3), 1.0, rng))
    fine = [np.abs(np.diff(made(exemplar, seed).image.pixels, axis=1)).mean() for seed in range(2)]
    assert 0.9 < np.mean(fine) / np.abs(np.diff(exemplar.pixels, axis=1)).mean() < 1.1


def test_the_seed_decides(image: Image) -> None:
    first, again, other = (made(image, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.image.pixels, again.image.pixels)
    np.testing.assert_array_equal(first.match, again.match)
    assert (first.match != other.match).any()


def test_threads_do_not_matter(image: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for count in ("1", "2", "3"):
        monkeypatch.setenv("TEXLOOM_THREADS", count)
        found.append(made(image, tileable=True).image.pixels)
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])


def test_progress_rises_to_the_end(image: Image) -> None:
    seen: list[Progress] = []
    with listening(seen.append):
        made(image)
    done = [progress.done for progress in seen]
    assert len(done) == 6
    assert done == sorted(done)
    assert done[-1] == 1


@pytest.mark.parametrize(
    "params",
    [
        {"size": (15, 100)},
        {"size": (16384, 16384)},
        {"patch": 7},
        {"smallest": 3},
        {"overlap": 0.0},
        {"patch_tolerance": -0.1},
        {"pixel_tolerance": 1.1},
        {"neighbourhood": 4},
        {"similar": 0},
    ],
)
def test_absurd_requests_are_refused(params: dict[str, object]) -> None:
    with pytest.raises(pydantic.ValidationError) as caught:
        HybridParams(**params)  # type: ignore[arg-type]
    assert {str(error["loc"][0]) for error in caught.value.errors()} == set(params)


@pytest.mark.parametrize(
    ("shape", "patch", "message"),
    [
        ((15, 100), None, "image: 15x100 px is too small"),
        ((60, 40), 32, "patch: 32 px and overlaps of 7 px are more than the image has, 60x40 px"),
    ],
)
def test_bad_exemplars_are_refused_before_anything_runs(
    shape: tuple[int, int], patch: int | None, message: str
) -> None:
    check = find_stage("synthesis.hybrid").check
    assert check is not None
    check(HybridParams(patch=patch), {})
    given = picture(np.zeros(shape))
    for refuse in (lambda: check(HybridParams(patch=patch), {"image": given}), lambda: made(given, patch=patch)):
        with pytest.raises(InputError, match=message) as caught:
            refuse()
        assert "\n" not in str(caught.value)


def test_values_that_are_no_numbers_are_refused() -> None:
    with pytest.raises(InputError, match="image: a value is not finite"):
        made(picture(np.full((40, 30), np.nan)))
