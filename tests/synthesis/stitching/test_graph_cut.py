from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from tests.runs import run_with_progress
from tests.synthetic import picture, smooth_noise
from texloom.stages.synthesis.stitching.exemplar import lab_of
from texloom.stages.synthesis.stitching.graph_cut import GraphCut, GraphCutParams, Synthesis, graph_cut
from texloom.stages.synthesis.stitching.seams import UNIT, SeamCosts
from texloom.stages.vocabulary.arrays import Image

PLACEMENTS = ("random", "entire", "subpatch")


def texture(image: Image, seed: int = 1, **params: Any) -> GraphCut:
    params = {"size": (80, 90), "passes": 8, **params}
    return graph_cut(image, GraphCutParams(**params), np.random.default_rng(seed))


@pytest.fixture
def image(rng: np.random.Generator) -> Image:
    return picture(smooth_noise((48, 56, 3), 2.0, rng))


def energy(image: Image, match: np.ndarray, wrap: bool, gradients: bool = False) -> float:
    """Cost of all seams of a result."""
    costs = SeamCosts(lab_of(image) / np.float32(10), gradients, squared=True)
    total = 0
    for axis in (0, 1):
        one, other = match.astype(np.int32), np.roll(match, -1, axis).astype(np.int32)
        if not wrap:
            one, other = (np.delete(lines, -1, axis) for lines in (one, other))
        total += int(costs.between(axis, one.reshape(-1, 2), other.reshape(-1, 2)).sum())
    return total / UNIT


@pytest.mark.parametrize("placement", PLACEMENTS)
@pytest.mark.parametrize("wrap", [False, True])
def test_pixels_are_copies_and_energy_is_that_of_their_seams(image: Image, placement: str, wrap: bool) -> None:
    result = texture(image, placement=placement, tileable=wrap)
    copied = image.pixels[result.match[..., 0], result.match[..., 1]]
    np.testing.assert_array_equal(result.image.pixels, copied)
    assert result.energy == pytest.approx(energy(image, result.match, wrap), rel=1e-9)
    assert result.energy > 0
    assert result.image.wraps.both is wrap


@pytest.mark.parametrize("placement", PLACEMENTS)
@pytest.mark.parametrize("wrap", [False, True])
@pytest.mark.parametrize("gradients", [False, True])
def test_energy_never_rises(image: Image, placement: str, wrap: bool, gradients: bool) -> None:
    start = texture(image, placement=placement, tileable=wrap, gradients=gradients, passes=0)
    result, reports = run_with_progress(
        lambda: texture(image, placement=placement, tileable=wrap, gradients=gradients, passes=12)
    )
    energies = [start.energy] + [one.energy for one in reports if one.energy is not None]
    assert len(energies) == 13
    assert all(after <= before for before, after in itertools.pairwise(energies))
    assert energies[-1] == result.energy


@pytest.mark.parametrize("placement", PLACEMENTS)
def test_refinement_gains(image: Image, placement: str) -> None:
    before, after = (
        sum(texture(image, seed, placement=placement, looseness=0.1, passes=passes).energy for seed in range(3))
        for passes in (0, 20)
    )
    assert after < before


def test_locations_of_refinement(image: Image) -> None:
    """[Lin2004]_ Figure 46: all lower the cost of the start, each in its own way."""
    start = texture(image, passes=0).energy
    results = {
        name: texture(image, passes=12, location=name) for name in ("costliest", "random", "minima", "extrema")
    }
    assert all(result.energy <= start for result in results.values())
    assert results["costliest"].energy < start
    matches = [result.match for result in results.values()]
    assert all((one != other).any() for one, other in itertools.combinations(matches, 2))


def test_more_passes_go_on_from_fewer(image: Image) -> None:
    """The report after n passes is the result of n passes, so every pass can be looked at."""
    _, reports = run_with_progress(lambda: texture(image, passes=5))
    energies = [one.energy for one in reports if one.energy is not None]
    for passes in (1, 3, 5):
        assert texture(image, passes=passes).energy == energies[passes - 1]


def test_good_places_are_better_than_any(image: Image) -> None:
    random, entire, subpatch = (
        np.mean([texture(image, seed, placement=placement, passes=0).energy for seed in range(3)])
        for placement in PLACEMENTS
    )
    assert entire < random
    assert subpatch < random


def test_the_whole_exemplar_overlaps_by_a_quarter(image: Image) -> None:
    """As far as it can over a corner: places that leave a cut no room are not offered."""
    params = GraphCutParams(size=(80, 90), passes=0)
    synthesis = Synthesis(image, params, np.random.default_rng(0))
    synthesis.match[:30, :40] = 0
    top, window = np.array([25, 35]), synthesis.window
    error = synthesis.entire_error(top, window)
    filled = synthesis.match[..., 0] >= 0
    overlap = np.zeros(error.shape)
    for source in np.ndindex(error.shape):
        first = top - source
        rows, columns = (slice(max(0, at), max(0, at + side)) for at, side in zip(first, (48, 56), strict=True))
        overlap[source] = filled[rows, columns].sum()
    least = min(0.25 * 48 * 56, 0.6 * overlap.max())
    clear = np.abs(overlap - least) > 1e-2  # of rounding
    np.testing.assert_array_equal(np.isfinite(error)[clear], overlap[clear] > least)
    assert 0 < (overlap > least).mean() < 1


def test_a_small_result_is_cut_out(image: Image) -> None:
    results = [texture(image, seed, size=(30, 40)) for seed in range(4)]
    assert {result.energy for result in results} == {0}
    assert len({tuple(result.match[0, 0]) for result in results}) > 1


@pytest.mark.parametrize("size", [(16, 16), (17, 90), (90, 17), (31, 33), (40, 40)])
@pytest.mark.parametrize("placement", PLACEMENTS)
@pytest.mark.parametrize("wrap", [False, True])
def test_every_size_is_filled(image: Image, size: tuple[int, int], placement: str, wrap: bool) -> None:
    result = texture(image, size=size, placement=placement, tileable=wrap, passes=3)
    assert result.match.shape[:2] == size
    assert (result.match < [image.height, image.width]).all()
    assert result.energy == pytest.approx(energy(image, result.match, wrap), rel=1e-9)


@pytest.mark.parametrize("passes", [0, 5])
def test_progress_goes_to_the_end(image: Image, passes: int) -> None:
    _, reports = run_with_progress(lambda: texture(image, passes=passes))
    assert reports[-1].done == 1.0
