"""What bidirectional similarity and image melding have in common."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.plain import BASELINES, SHAPE, SIZE, Baseline, distances
from tests.runs import MemoryCheckpoints, run_with_progress, run_with_threads
from tests.synthetic import blobs, identity, masked, picture
from texloom.stages.lookup.registry import find_stage
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

pytestmark = pytest.mark.parametrize("run", BASELINES, ids=lambda run: run.name)


@pytest.fixture
def exemplar(rng: np.random.Generator) -> Image:
    return picture(blobs((*SHAPE, 3), rng))


def assert_same(one: Any, other: Any) -> None:
    np.testing.assert_array_equal(one.image.pixels, other.image.pixels)
    np.testing.assert_array_equal(one.match, other.match)
    np.testing.assert_array_equal(one.occurrence, other.occurrence)
    assert one.scales == other.scales


def test_an_exemplar_is_its_own_best_texture(run: Baseline, exemplar: Image) -> None:
    result = run(exemplar, identity(SHAPE), coarsest=1000)
    inside = (slice(12, -12), slice(12, -12))
    np.testing.assert_array_equal(result.match[inside], identity(SHAPE)[inside])


def test_results_are_coherent(run: Baseline, exemplar: Image) -> None:
    """Patches of the result are more like the exemplar's than those of random pixels are."""
    result = run(exemplar, preset="default")
    random = initialise(exemplar, InitialiseParams(size=SIZE, method="pixels"), np.random.default_rng(3)).image
    assert distances(result.image.pixels, exemplar.pixels) < 0.2 * distances(random.pixels, exemplar.pixels)


@pytest.mark.parametrize("tileable", [False, True])
def test_one_result_for_any_number_of_threads(
    run: Baseline, exemplar: Image, tileable: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A result of many strips."""
    start = initialise(exemplar, InitialiseParams(size=(130, 40)), np.random.default_rng(3)).match
    results = run_with_threads(lambda: run(exemplar, start, tileable=tileable), monkeypatch, (1, 2, 2))
    assert_same(results[0], results[1])
    assert_same(results[0], results[2])
    assert (run(exemplar, start, seed=6, tileable=tileable).match != results[0].match).any()


@pytest.mark.parametrize("tileable", [False, True])
def test_shapes_ranges_and_progress(run: Baseline, exemplar: Image, tileable: bool) -> None:
    start = run.begin(exemplar)
    result, progress = run_with_progress(lambda: run(exemplar, start, tileable=tileable))
    assert result.image.pixels.shape == (*SIZE, 3)
    assert result.match.shape == (*SIZE, 2)
    assert (result.match < SHAPE).all()
    assert result.occurrence.mean() == pytest.approx(1, rel=1e-5)
    done = [report.done for report in progress]
    assert done == sorted(done)
    assert done[-1] == pytest.approx(1)


def test_tileable_results_continue_across_their_borders(run: Baseline, exemplar: Image) -> None:
    pixels = run(exemplar, tileable=True).image.pixels
    for axis in (0, 1):
        jumps = np.abs(pixels - np.roll(pixels, 1, axis)).mean(axis=(1 - axis, 2))
        assert jumps[0] < 1.5 * jumps[1:].mean()


@pytest.mark.parametrize("level", [1, 2])
def test_an_interrupted_run_resumes(run: Baseline, exemplar: Image, level: int) -> None:
    options: dict[str, Any] = {"ratio": 1.2, "coarsest": 20}
    whole = MemoryCheckpoints(run.state)
    expected = run(exemplar, checkpoints=whole, **options)
    assert sorted(whole.saved) == list(range(1, len(expected.scales)))
    assert_same(run(exemplar, **options), expected)
    kept = MemoryCheckpoints(run.state)
    kept.saved = {scale: state for scale, state in whole.saved.items() if scale <= level}
    start = run.begin(exemplar)
    resumed, progress = run_with_progress(lambda: run(exemplar, start, checkpoints=kept, **options))
    assert_same(resumed, expected)
    assert min(report.scale for report in progress) == level + 1


def test_masked_pixels_are_never_used(run: Baseline, exemplar: Image) -> None:
    usable = np.ones(SHAPE, bool)
    usable[10:18, 20:30] = False
    results = [run(masked(exemplar, usable, value)) for value in (0.0, 9.0)]
    assert_same(*results)
    assert results[0].image.channels == exemplar.channels
    source = results[0].match
    assert usable[source[..., 0], source[..., 1]].all()


def test_what_cannot_be_made_is_refused(run: Baseline, exemplar: Image) -> None:
    declared = find_stage(f"synthesis.{run.name}")
    assert declared.check is not None
    with pytest.raises(InputError, match="too small for patches"):
        declared.check(declared.params(patch_size=32), {"image": picture(np.zeros((20, 20, 3)))})
    with pytest.raises(InputError, match="no whole patch"):
        run(masked(exemplar, identity(SHAPE)[..., 0] % 5 > 0, 0.0))
    with pytest.raises(ValueError, match="start points beyond"):
        run(exemplar, np.full((*SIZE, 2), 50, np.uint32))
