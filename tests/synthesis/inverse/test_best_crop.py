"""The best crop, and the energy by which it is judged."""

from __future__ import annotations

import numpy as np
import pytest

from tests.runs import run_with_threads
from tests.synthetic import picture, smooth_noise
from texloom.stages.synthesis.inverse.best_crop import BestCropParams, best_crop
from texloom.stages.synthesis.inverse.energy import ExactEnergy
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError


@pytest.fixture
def patched(rng: np.random.Generator) -> Image:
    """Three materials: dark and coarse, light and fine, striped; all three meet at (40, 56) alone."""
    pixels = 0.3 * smooth_noise((80, 96), 3.0, rng)
    pixels[:40, 56:] = 0.7 + 0.3 * smooth_noise((40, 40), 0.8, rng)
    pixels[40:, 56:] = 0.5 + 0.2 * np.sin(np.arange(40)[:, None] * np.ones(40))
    return picture(pixels)


def exact(features: np.ndarray, planes: np.ndarray, size: int) -> tuple[float, float]:
    """Both terms by looking at every pair of neighbourhoods."""

    def windows(values: np.ndarray) -> np.ndarray:
        view = np.lib.stride_tricks.sliding_window_view(np.rint(values * 16) / 16, (size, size), axis=(0, 1))
        return view.reshape(-1, size * size * values.shape[2])

    theirs, ours = windows(features), windows(planes)
    far = ((theirs[:, None] - ours[None]) ** 2).sum(axis=2) / size**2
    return float(far.min(axis=1).mean()), float(far.min(axis=0).mean())


def test_terms_are_those_of_all_pairs(rng: np.random.Generator) -> None:
    """Neighbourhoods of so few values are their components, so the search misses nothing but by rounding."""
    features = (60 * np.stack([smooth_noise((24, 20), 1.5, rng) for _ in range(2)], axis=2)).astype(np.float32)
    planes = (60 * np.stack([smooth_noise((12, 14), 1.5, rng) for _ in range(2)], axis=2)).astype(np.float32)
    terms = ExactEnergy(features, 3, 10**6).of(planes)
    inverse, forward = exact(features, planes, 3)
    assert terms.inverse == pytest.approx(inverse, rel=0.02)
    assert terms.inverse >= inverse * (1 - 1e-9)
    assert terms.energy(0.5) == pytest.approx(terms.inverse + 0.5 * terms.forward)
    assert terms.forward == pytest.approx(forward, rel=0.02)


def test_a_part_has_nothing_foreign_and_the_whole_lacks_nothing(patched: Image) -> None:
    features = patched.pixels * 100
    judge = ExactEnergy(features, 7, 500)
    assert judge.inverse_of(features) == judge.forward_of(features) == 0
    part = judge.of(np.ascontiguousarray(features[10:40, 5:50]))
    assert part.forward == 0
    assert part.inverse > 100


def test_the_crop_holds_all_materials(patched: Image) -> None:
    result = best_crop(patched, patched.pixels * 100, BestCropParams(size=(36, 36), samples=128))
    top, left = result.source[0, 0].astype(int)
    np.testing.assert_array_equal(result.image.pixels, patched.pixels[top : top + 36, left : left + 36])
    assert top + 8 <= 40 <= top + 28
    assert left + 8 <= 56 <= left + 28


def test_no_other_crop_is_better_by_much(patched: Image) -> None:
    features = patched.pixels * 100
    judge = ExactEnergy(features, 7, 10**6)
    result = best_crop(patched, features, BestCropParams(size=(40, 30), samples=256))
    top, left = result.source[0, 0].astype(int)
    best = judge.inverse_of(features[top : top + 40, left : left + 30])
    others = [
        judge.inverse_of(features[row : row + 40, column : column + 30])
        for row in range(0, 41, 10)
        for column in range(0, 67, 11)
    ]
    assert best <= min(others) * 1.05


def test_same_bits_on_any_number_of_threads(patched: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    params = BestCropParams(size=(33, 36), samples=64)
    results = run_with_threads(lambda: best_crop(patched, patched.pixels * 100, params).source, monkeypatch)
    np.testing.assert_array_equal(*results)


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ((20, 97), "size: 97 x 20 px is larger than the texture of 96 x 80 px"),
        ((20, 6), "too small; its sides must be 7 px"),
        (None, "neither size nor the sides of a compaction"),
    ],
)
def test_wrong_sizes_are_refused(patched: Image, size: tuple[int, int] | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        best_crop(patched, patched.pixels, BestCropParams(size=size))
