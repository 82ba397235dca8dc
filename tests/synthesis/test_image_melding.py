from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.runs import MemoryCheckpoints, run_with_progress, run_with_threads
from tests.synthetic import blobs, identity, masked, picture
from texloom.stages.arrays import Image
from texloom.stages.declare import InputError, find_stage
from texloom.stages.synthesis.image_melding import (
    ImageMelding,
    ImageMeldingParams,
    ImageMeldingScale,
    image_melding,
)
from texloom.stages.synthesis.initialise import InitialiseParams, initialise

SHAPE, SIZE = (40, 44), (56, 60)
"""an exemplar and a result, px"""


@pytest.fixture
def exemplar(rng: np.random.Generator) -> Image:
    return picture(blobs((*SHAPE, 3), rng))


def blocks(image: Image) -> np.ndarray:
    return initialise(image, InitialiseParams(size=SIZE, method="blocks"), np.random.default_rng(3)).match


def run(image: Image, start: np.ndarray | None = None, seed: int = 5, **options: Any) -> ImageMelding:
    inputs = {name: options.pop(name) for name in ("checkpoints",) if name in options}
    start = blocks(image) if start is None else start
    params = ImageMeldingParams(**{"preset": "fast", "coarsest": 24, **options})
    return image_melding(image, start, params, np.random.default_rng(seed), **inputs)


def assert_same(one: ImageMelding, other: ImageMelding) -> None:
    np.testing.assert_array_equal(one.image.pixels, other.image.pixels)
    np.testing.assert_array_equal(one.match, other.match)
    np.testing.assert_array_equal(one.occurrence, other.occurrence)
    assert one.scales == other.scales


def distances(one: np.ndarray, other: np.ndarray, side: int = 6) -> float:
    """Mean squared distance of the patches of ``one`` to the most similar ones of ``other``, by brute force."""
    windows = [
        np.lib.stride_tricks.sliding_window_view(pixels, (side, side), axis=(0, 1)).reshape(-1, side * side * 3)
        for pixels in (one, other)
    ]
    products = windows[0] @ windows[1].T
    squares = [(window**2).sum(axis=1) for window in windows]
    return float(np.maximum(0, squares[0][:, None] - 2 * products + squares[1]).min(axis=1).mean())


def test_an_exemplar_is_its_own_best_texture(exemplar: Image) -> None:
    result = run(exemplar, identity(SHAPE), coarsest=1000)
    inside = (slice(12, -12), slice(12, -12))
    np.testing.assert_array_equal(result.match[inside], identity(SHAPE)[inside])


def test_results_are_coherent(exemplar: Image) -> None:
    """Patches of the result are more like the exemplar's than those of random pixels are."""
    result = run(exemplar, preset="default")
    random = initialise(exemplar, InitialiseParams(size=SIZE, method="pixels"), np.random.default_rng(3)).image
    assert distances(result.image.pixels, exemplar.pixels) < 0.2 * distances(random.pixels, exemplar.pixels)


@pytest.mark.parametrize("tileable", [False, True])
def test_one_result_for_any_number_of_threads(
    exemplar: Image, tileable: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A result of many strips."""
    start = initialise(exemplar, InitialiseParams(size=(130, 40)), np.random.default_rng(3)).match
    results = run_with_threads(lambda: run(exemplar, start, tileable=tileable), monkeypatch, (1, 2, 2))
    assert_same(results[0], results[1])
    assert_same(results[0], results[2])
    assert (run(exemplar, start, seed=6, tileable=tileable).match != results[0].match).any()


@pytest.mark.parametrize("tileable", [False, True])
def test_shapes_ranges_and_progress(exemplar: Image, tileable: bool) -> None:
    start = blocks(exemplar)
    result, progress = run_with_progress(lambda: run(exemplar, start, tileable=tileable))
    assert result.image.pixels.shape == (*SIZE, 3)
    assert result.match.shape == (*SIZE, 2)
    assert (result.match < SHAPE).all()
    assert result.occurrence.mean() == pytest.approx(1, rel=1e-5)
    assert result.image.pixels.min() >= 0
    assert abs(result.image.pixels.mean() - exemplar.pixels.mean()) < 0.1
    done = [report.done for report in progress]
    assert done == sorted(done)
    assert done[-1] == pytest.approx(1)


def test_tileable_results_continue_across_their_borders(exemplar: Image) -> None:
    pixels = run(exemplar, tileable=True).image.pixels
    for axis in (0, 1):
        jumps = np.abs(pixels - np.roll(pixels, 1, axis)).mean(axis=(1 - axis, 2))
        assert jumps[0] < 1.5 * jumps[1:].mean()


@pytest.mark.parametrize("level", [1, 2])
def test_an_interrupted_run_resumes(exemplar: Image, level: int) -> None:
    options: dict[str, Any] = {"ratio": 1.2, "coarsest": 20}
    whole = MemoryCheckpoints(ImageMeldingScale)
    expected = run(exemplar, checkpoints=whole, **options)
    assert sorted(whole.saved) == list(range(1, len(expected.scales)))
    assert_same(run(exemplar, **options), expected)
    kept = MemoryCheckpoints(ImageMeldingScale)
    kept.saved = {scale: state for scale, state in whole.saved.items() if scale <= level}
    start = blocks(exemplar)
    resumed, progress = run_with_progress(lambda: run(exemplar, start, checkpoints=kept, **options))
    assert_same(resumed, expected)
    assert min(report.scale for report in progress) == level + 1


def test_masked_pixels_are_never_used(exemplar: Image) -> None:
    usable = np.ones(SHAPE, bool)
    usable[10:18, 20:30] = False
    results = [run(masked(exemplar, usable, value)) for value in (0.0, 9.0)]
    assert_same(*results)
    assert results[0].image.channels == exemplar.channels
    source = results[0].match
    assert usable[source[..., 0], source[..., 1]].all()


def test_maps_come_from_the_same_places(exemplar: Image) -> None:
    """A map that does not count leaves the colours unchanged, and is a plain average of the same sources."""
    height = 3 * exemplar.pixels[..., :1] - 40
    both = Image(np.concatenate([exemplar.pixels, height], axis=2), ("R", "G", "B", "height"))
    fixed = {"bias_color": 0, "bias_lightness": 0, "min_gain": 1, "max_gain": 1, "gradient_weight": 0}
    result, alone = run(both, weights={"height": 0}, **fixed), run(exemplar, **fixed)
    np.testing.assert_array_equal(result.image.pixels[..., :3], alone.image.pixels)
    red, voted = result.image.pixels[..., 0], result.image.pixels[..., 3]
    assert np.corrcoef(red.ravel(), voted.ravel())[0, 1] > 0.98


def test_grey_pictures_stay_grey(exemplar: Image) -> None:
    grey = picture(exemplar.pixels[..., 0])
    assert run(grey).image.channels == ("Y",)


def test_what_cannot_be_made_is_refused(exemplar: Image) -> None:
    check = find_stage("synthesis.image_melding").check
    assert check is not None
    with pytest.raises(InputError, match="too small for patches"):
        check(ImageMeldingParams(patch_size=32), {"image": picture(np.zeros((20, 20, 3)))})
    with pytest.raises(InputError, match="no whole patch"):
        run(masked(exemplar, identity(SHAPE)[..., 0] % 5 > 0, 0.0))
    with pytest.raises(ValueError, match="start points beyond"):
        run(exemplar, np.full((*SIZE, 2), 50, np.uint32))
