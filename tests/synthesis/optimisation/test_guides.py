"""Initialisation and optimisation under a guide."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.guided import bands, disc, labelled, painted
from tests.runs import run_with_threads
from tests.synthetic import masked
from texloom.stages.analysis.control.guide import GuideParams, guide
from texloom.stages.synthesis.optimisation.initialise import Initialised, InitialiseParams, initialise
from texloom.stages.synthesis.optimisation.optimise import Optimised, optimise
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SHAPE, SIZE = (96, 80), (96, 104)
QUICK = {"first_iterations": 6, "last_iterations": 2}


@pytest.fixture
def exemplar(rng: np.random.Generator) -> Image:
    return labelled(bands(SHAPE), rng)


def start(exemplar: Image, target: np.ndarray, **params: Any) -> tuple[Initialised, dict[str, Any]]:
    made = guide(exemplar, painted(bands(SHAPE)), painted(target), GuideParams())
    guides = {"exemplar_guide": made.exemplar, "target_guide": made.target}
    params = {"size": None, **params}
    return initialise(exemplar, InitialiseParams(**params), np.random.default_rng(1), **guides), guides


def run(exemplar: Image, target: np.ndarray, **params: Any) -> Optimised:
    first, guides = start(exemplar, target)
    params = {"preset": "fast", **params}
    return optimise(exemplar, first.match, OptimiseParams(**params), np.random.default_rng(2), **guides)


def followed(match: np.ndarray, target: np.ndarray) -> float:
    """Share of the pixels whose source has the wanted label."""
    return float((bands(SHAPE)[match[..., 0], match[..., 1]] == target).mean())


def test_the_start_has_the_size_of_the_target_and_follows_it(exemplar: Image) -> None:
    match = start(exemplar, disc(SIZE))[0].match
    assert match.shape[:2] == SIZE
    assert followed(match, disc(SIZE)) > 0.65
    assert start(exemplar, disc(SIZE), size=(50, 60))[0].match.shape[:2] == (50, 60)


def test_blocks_of_a_lattice_follow_too(exemplar: Image) -> None:
    made = guide(exemplar, painted(bands(SHAPE)), painted(disc(SIZE)), GuideParams())
    generators = np.float32([[4, 0], [0, 4]])
    match = initialise(
        exemplar,
        InitialiseParams(size=None),
        np.random.default_rng(1),
        None,
        generators,
        made.exemplar,
        made.target,
    ).match
    assert followed(match, disc(SIZE)) > 0.6


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("preset", ["default", "fast"])
def test_labels_are_followed(exemplar: Image, preset: str, tileable: bool) -> None:
    result = run(exemplar, disc(SIZE), preset=preset, tileable=tileable)
    assert followed(result.match, disc(SIZE)) > 0.95


def test_rare_labels_are_used_uniformly(exemplar: Image) -> None:
    """Where most of the target has the label of a fifth of the exemplar, all of this fifth is used."""
    result = run(exemplar, disc(SIZE))
    rare = result.occurrence[83:-4, 4:-4]
    assert np.quantile(rare, 0.1) > 0.25 * np.median(rare)


def test_tileable_results_continue_across_their_borders(exemplar: Image) -> None:
    pixels = run(exemplar, disc(SIZE), tileable=True).image.pixels
    # the corner's label ends at the border, which is a step of its own
    for axis, lines in ((0, slice(40, None)), (1, slice(30, None))):
        jumps = np.abs(pixels - np.roll(pixels, 1, axis)).mean(axis=2)
        border = jumps[0, lines] if axis == 0 else jumps[lines, 0]
        assert border.mean() < 1.5 * jumps.mean()


def test_one_result_for_any_number_of_threads(exemplar: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    results = run_with_threads(lambda: run(exemplar, disc((130, 60)), **QUICK), monkeypatch, (1, 2))
    np.testing.assert_array_equal(results[0].match, results[1].match)
    np.testing.assert_array_equal(results[0].image.pixels, results[1].image.pixels)


def test_maps_are_synthesised_along(exemplar: Image) -> None:
    height = exemplar.pixels.mean(axis=2, keepdims=True)
    material = Image(np.concatenate([exemplar.pixels, height], axis=2), (*exemplar.channels, "height"))
    result = run(material, disc(SIZE))
    assert result.image.channels == material.channels
    np.testing.assert_allclose(result.image.pixels[..., 3], result.image.pixels[..., :3].mean(axis=2), atol=1e-5)
    assert followed(result.match, disc(SIZE)) > 0.95


def test_masked_pixels_are_not_used(exemplar: Image) -> None:
    usable = np.ones(SHAPE, bool)
    usable[20:60, 20:50] = False
    result = run(masked(exemplar, usable, 0.7), disc(SIZE))
    assert usable[result.match[..., 0], result.match[..., 1]].all()
    assert followed(result.match, disc(SIZE)) > 0.95


def test_guides_that_do_not_fit_are_refused(exemplar: Image) -> None:
    first, guides = start(exemplar, disc(SIZE))
    params, random = OptimiseParams(), np.random.default_rng(0)
    with pytest.raises(ValueError, match="go together"):
        optimise(exemplar, first.match, params, random, exemplar_guide=guides["exemplar_guide"])
    with pytest.raises(InputError, match="size: give the size of the result"):
        initialise(exemplar, InitialiseParams(size=None), random)
    with pytest.raises(ValueError, match="guides of shapes"):
        optimise(exemplar, first.match, params, random, exemplar_guide=guides["exemplar_guide"][1:],
                 target_guide=guides["target_guide"])  # fmt: skip


def test_anything_may_lie_where_the_guide_asks_for_nothing(exemplar: Image) -> None:
    first, guides = start(exemplar, disc(SIZE))
    guides["target_guide"][:, 60:] = np.nan
    result = optimise(exemplar, first.match, OptimiseParams(preset="fast"), np.random.default_rng(2), **guides)
    assert followed(result.match[:, :50], disc(SIZE)[:, :50]) > 0.95
    again = initialise(exemplar, InitialiseParams(size=None), np.random.default_rng(1), **guides).match
    assert followed(again[:, :50], disc(SIZE)[:, :50]) > 0.7
