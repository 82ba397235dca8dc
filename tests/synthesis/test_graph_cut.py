from __future__ import annotations

import itertools

import numpy as np
import pydantic
import pytest

from tests.synthetic import continued, picture, smooth_noise, tiled
from texloom.stages.arrays import Image
from texloom.stages.declare import InputError, find_stage
from texloom.stages.progress import Progress, listening
from texloom.stages.synthesis._seams.exemplar import lab_of
from texloom.stages.synthesis._seams.seams import UNIT, SeamCosts
from texloom.stages.synthesis.graph_cut import GraphCut, GraphCutParams, Synthesis, graph_cut

PLACEMENTS = ("random", "entire", "subpatch")


def texture(image: Image, seed: int = 1, **params: object) -> GraphCut:
    given = GraphCutParams(**{"size": (80, 90), "passes": 8, **params})  # type: ignore[arg-type]
    return graph_cut(image, given, np.random.default_rng(seed))


@pytest.fixture
def image(rng: np.random.Generator) -> Image:
    return picture(smooth_noise((48, 56, 3), 2.0, rng))


def energy(image: Image, match: np.ndarray, wrap: bool, gradients: bool = False) -> float:
    """Cost of all seams of a result."""
    costs = SeamCosts(lab_of(image) / np.float32(10), gradients, squared=True)
    found = 0
    for axis in (0, 1):
        one, other = match.astype(np.int32), np.roll(match, -1, axis).astype(np.int32)
        if not wrap:
            one, other = (np.delete(lines, -1, axis) for lines in (one, other))
        found += int(costs.between(axis, one.reshape(-1, 2), other.reshape(-1, 2)).sum())
    return found / UNIT


@pytest.mark.parametrize("placement", PLACEMENTS)
@pytest.mark.parametrize("wrap", [False, True])
def test_pixels_are_copies_and_energy_is_that_of_their_seams(image: Image, placement: str, wrap: bool) -> None:
    result = texture(image, placement=placement, tileable=wrap)
    copied = image.pixels[result.match[..., 0], result.match[..., 1]]
    np.testing.assert_array_equal(result.image.pixels, copied)
    assert result.energy == pytest.approx(energy(image, result.match, wrap), rel=1e-9)
    assert result.energy > 0
    assert result.tileable is wrap


@pytest.mark.parametrize("placement", PLACEMENTS)
@pytest.mark.parametrize("wrap", [False, True])
@pytest.mark.parametrize("gradients", [False, True])
def test_energy_never_rises(image: Image, placement: str, wrap: bool, gradients: bool) -> None:
    start = texture(image, placement=placement, tileable=wrap, gradients=gradients, passes=0)
    reports: list[Progress] = []
    with listening(reports.append):
        result = texture(image, placement=placement, tileable=wrap, gradients=gradients, passes=12)
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


def test_more_passes_go_on_from_fewer(image: Image) -> None:
    """The report after n passes is the result of n passes, so every pass can be looked at."""
    reports: list[Progress] = []
    with listening(reports.append):
        texture(image, passes=5)
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


@pytest.mark.parametrize("placement", ["entire", "subpatch"])
@pytest.mark.parametrize(("drop", "cell"), [(0, (16, 20)), (7, (13, 17))])
def test_a_periodic_texture_is_continued_exactly(
    placement: str, drop: int, cell: tuple[int, int], rng: np.random.Generator
) -> None:
    exemplar, _ = tiled(rng.random((*cell, 3)), drop, (64, 72))
    result = texture(exemplar, size=(110, 130), placement=placement, looseness=0.0001)
    pattern = exemplar.pixels[: cell[0], : cell[1]]
    np.testing.assert_array_equal(result.image.pixels, continued(pattern, drop, result.match))
    assert result.energy == 0


def test_tileable_continues_across_borders(rng: np.random.Generator) -> None:
    exemplar, _ = tiled(rng.random((16, 20, 3)), 0, (64, 72))
    result = texture(exemplar, size=(96, 120), tileable=True, looseness=0.0001)
    np.testing.assert_array_equal(result.image.pixels, np.roll(result.image.pixels, (16, 20), (0, 1)))
    assert result.energy == 0


def test_borders_of_tileable_results_are_like_any_line(image: Image) -> None:
    result = texture(image, size=(96, 96), tileable=True, passes=20)
    for axis in (0, 1):
        steps = np.abs(np.roll(result.image.pixels, -1, axis) - result.image.pixels)
        lines = steps.mean(axis=(1 - axis, 2))
        assert lines[-1] <= 1.2 * lines[:-1].max()


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


def test_maps_ride_along(image: Image, rng: np.random.Generator) -> None:
    height = smooth_noise((48, 56), 3.0, rng)[..., None].astype(np.float32)
    both = Image(np.concatenate([image.pixels, height], axis=2), (*image.channels, "height"))
    plain, rich = texture(image), texture(both, weights={"height": 0})
    np.testing.assert_array_equal(rich.match, plain.match)
    np.testing.assert_array_equal(rich.image.pixels[..., 3], height[rich.match[..., 0], rich.match[..., 1], 0])


def test_plain_and_tiny_exemplars(rng: np.random.Generator) -> None:
    assert texture(picture(np.full((30, 30, 3), 0.5))).energy == 0
    texture(picture(np.zeros((16, 16))), tileable=True)
    texture(picture(smooth_noise((16, 40), 1.0, rng)), size=(40, 40))


def test_same_seed_same_bits(image: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    results = []
    for threads in ("1", "4", "4"):
        monkeypatch.setenv("TEXLOOM_THREADS", threads)
        results.append(texture(image, tileable=True))
    for other in results[1:]:
        np.testing.assert_array_equal(other.match, results[0].match)
    assert (texture(image, seed=2).match != texture(image, seed=1).match).any()


def test_bad_requests(rng: np.random.Generator) -> None:
    small = picture(rng.random((15, 60, 3)))
    check = find_stage("synthesis.graph_cut").check
    assert check is not None
    check(GraphCutParams(), {})
    for refuse in (lambda: check(GraphCutParams(), {"image": small}), lambda: texture(small)):
        with pytest.raises(InputError, match="image: 15x60 px is too small to be cut, which takes 16x16 px"):
            refuse()


@pytest.mark.parametrize("params", [{"size": (8, 20)}, {"placement": "best"}, {"passes": -1}, {"looseness": 0}])
def test_params_have_bounds(params: dict[str, object]) -> None:
    with pytest.raises(pydantic.ValidationError):
        GraphCutParams(**params)  # type: ignore[arg-type]
