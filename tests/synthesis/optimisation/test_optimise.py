from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pydantic
import pytest

from tests.kernels.patchmatch import naive
from tests.runs import MemoryCheckpoints, run_with_progress, run_with_threads
from tests.synthetic import blobs, identity, masked, picture, smooth_noise, tiled
from tests.wraps import X, Y
from texloom.stages.lookup.registry import find_stage
from texloom.stages.synthesis.optimisation import optimise as optimise_module
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimisation.optimise import Optimised, OptimiseScale, optimise
from texloom.stages.synthesis.optimisation.optimise_params import PRESETS, OptimiseParams
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.normals import rounding
from texloom.stages.vocabulary.progress import Progress, listening
from texloom.stages.vocabulary.sizes import format_size

SHAPE, LARGE, SIZE = (56, 64), (96, 104), (72, 80)
"""an exemplar, a large one and a result, px"""

INPUTS = (
    "guidance", "weight", "generators", "keep", "given", "guiding", "checkpoints", "exemplar_guide", "target_guide",
    "contours", "rectangles",
)  # fmt: skip
"""optional arguments of the stage"""

QUICK = {"first_iterations": 6, "last_iterations": 2}
"""for what does not depend on how good the result is"""


@pytest.fixture
def exemplar(rng: np.random.Generator) -> Image:
    return picture(blobs((*SHAPE, 3), rng))


def random_start(image: Image, size: tuple[int, int] = SIZE, seed: int = 3) -> np.ndarray:
    return initialise(image, InitialiseParams(size=size), np.random.default_rng(seed)).match


def run(image: Image, start: np.ndarray | None = None, seed: int = 5, **options: Any) -> Optimised:
    inputs = {name: options.pop(name) for name in INPUTS if name in options}
    params = OptimiseParams(**{"preset": "fast", **options})
    start = random_start(image) if start is None else start
    return optimise(image, start, params, np.random.default_rng(seed), **inputs)


def assert_same(one: Optimised, other: Optimised) -> None:
    np.testing.assert_array_equal(one.image.pixels, other.image.pixels)
    np.testing.assert_array_equal(one.match, other.match)
    np.testing.assert_array_equal(one.occurrence, other.occurrence)
    assert one.scales == other.scales


@pytest.fixture
def large(rng: np.random.Generator) -> Image:
    """An exemplar whose middle is far from the patches that reach beyond it."""
    return picture(blobs((*LARGE, 3), rng))


@pytest.mark.parametrize("occurrence", [0, 10])
def test_an_exemplar_is_its_own_best_texture(large: Image, occurrence: float) -> None:
    """At full size nothing can be improved."""
    inside = (slice(20, -20), slice(20, -20))
    result = run(large, identity(LARGE), coarsest=1000, occurrence=occurrence)
    assert len(result.scales) == 1
    np.testing.assert_array_equal(result.match[inside], identity(LARGE)[inside])
    np.testing.assert_allclose(result.image.pixels[inside], large.pixels[inside], atol=0.02)


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("preset", PRESETS)
def test_an_exemplar_survives_all_scales(large: Image, preset: str, tileable: bool) -> None:
    """Most of it, perhaps moved by a pixel, since a margin need not be whole at every scale."""
    result = run(large, identity(LARGE), preset=preset, tileable=tileable)
    moves = result.match.astype(int) - identity(LARGE)
    unique, counts = np.unique(moves[24:-24, 24:-24].reshape(-1, 2), axis=0, return_counts=True)
    assert counts.max() > 0.5 * counts.sum()
    assert np.abs(unique[counts.argmax()]).max() <= (0 if tileable else 1)


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("preset", ["default", "kaspar2015"])
def test_one_result_for_any_number_of_threads(
    exemplar: Image, preset: str, tileable: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A result of many strips."""
    params = {"preset": preset, "tileable": tileable, **QUICK}
    start = random_start(exemplar, (130, 40))
    results = run_with_threads(lambda: run(exemplar, start, **params), monkeypatch, (1, 2, 2))
    assert_same(results[0], results[1])
    assert_same(results[0], results[2])
    assert (run(exemplar, start, seed=6, **params).match != results[0].match).any()


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("preset", PRESETS)
def test_shapes_and_ranges(exemplar: Image, preset: str, tileable: bool) -> None:
    result = run(exemplar, preset=preset, tileable=tileable)
    assert result.image.pixels.shape == (*SIZE, 3)
    assert result.image.channels == exemplar.channels
    assert result.match.shape == (*SIZE, 2)
    assert (result.match < SHAPE).all()
    assert result.occurrence.shape == SHAPE
    assert result.image.pixels.min() > exemplar.pixels.min() - 1e-6
    assert result.image.pixels.max() < exemplar.pixels.max() + 1e-6
    last = result.scales[-1]
    margin = 0 if tileable else 2 * OptimiseParams(preset=preset).patch_size - 2  # type: ignore[arg-type]
    assert (last["height"], last["width"]) == (SIZE[0] + margin, SIZE[1] + margin)
    assert [scale["height"] for scale in result.scales] == sorted(scale["height"] for scale in result.scales)


def test_the_outermost_pixels_of_the_exemplar_are_used(exemplar: Image) -> None:
    """A border lets them be the middle of a patch."""
    outermost = np.ones(SHAPE, bool)
    outermost[5:-4, 5:-4] = False
    for border in (False, True):
        used = np.zeros(SHAPE, bool)
        used[tuple(np.moveaxis(run(exemplar, border=border, **QUICK).match, 2, 0))] = True
        assert used[outermost].any() == border


def test_the_best_of_several_starts_is_continued(exemplar: Image) -> None:
    """All but the coarsest scales are optimised once."""
    start = random_start(exemplar)
    one, some = (run(exemplar, start, starts=starts, coarsest=16, **QUICK) for starts in (1, 6))
    assert [scale["height"] for scale in some.scales] == [scale["height"] for scale in one.scales]
    assert (some.match != one.match).any()


def test_tileable_results_continue_across_their_borders(exemplar: Image) -> None:
    wrapped, open_ended = (run(exemplar, tileable=tileable).image.pixels for tileable in (True, False))
    for axis in (0, 1):
        jumps = [
            np.abs(pixels - np.roll(pixels, 1, axis)).mean(axis=(1 - axis, 2)) for pixels in (wrapped, open_ended)
        ]
        assert jumps[0][0] < 1.5 * jumps[0][1:].mean()
        assert jumps[1][0] > 2 * jumps[1][1:].mean()


@pytest.mark.parametrize("wrap", [X, Y])
def test_a_result_may_continue_along_one_axis(exemplar: Image, wrap: Wraps) -> None:
    made = run(exemplar, tileable=wrap).image
    assert made.wraps == wrap
    for axis in (0, 1):
        jumps = np.abs(made.pixels - np.roll(made.pixels, 1, axis)).mean(axis=(1 - axis, 2))
        assert (jumps[0] < 1.5 * jumps[1:].mean()) == wrap[axis]


def test_the_border_is_as_good_as_the_middle(exemplar: Image) -> None:
    """Sharpness of the outer pixels, which have a margin to be voted on by."""
    pixels = run(exemplar, preset="default").image.pixels
    steps = np.abs(np.diff(pixels, axis=1)).mean(axis=2)
    border = np.concatenate([steps[:4].ravel(), steps[-4:].ravel()]).mean()
    assert 0.6 < border / steps[8:-8].mean() < 1.6


def reports(image: Image, **params: Any) -> list[Progress]:
    start = random_start(image)
    return run_with_progress(lambda: run(image, start, **params))[1]


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("preset", PRESETS)
def test_energy_does_not_rise(exemplar: Image, preset: str, tileable: bool) -> None:
    """From the first round of a scale to its last; the first target of a scale is a mean, always.

    So where later targets match histograms, which costs energy, the second round is the first to compare with.
    """
    progress = reports(exemplar, preset=preset, tileable=tileable, most_use=None)  # a price that rises is in it
    for scale in range(1, progress[-1].scales + 1):
        energies = [report.energy for report in progress if report.scale == scale]
        assert all(energy is not None and energy > 0 for energy in energies)
        first = energies[scale <= round(0.5 * progress[-1].scales)]
        assert energies[-1] <= first * 1.001  # type: ignore[operator]


def test_energy_falls_in_every_round_of_plain_votes(exemplar: Image) -> None:
    """A mean is the best vote and a search takes nothing worse, but for rounding."""
    progress = reports(exemplar, histogram_share=0, occurrence=0, first_iterations=8)
    for scale in range(1, progress[-1].scales + 1):
        energies = np.array([report.energy for report in progress if report.scale == scale])
        assert (np.diff(energies) <= 1e-3 * energies[:-1]).all()


def test_optimising_lowers_the_difference_to_the_exemplar(exemplar: Image) -> None:
    """Each patch of the result against all of the exemplar, by brute force, before and after."""

    def difference(pixels: np.ndarray) -> float:
        windows = np.lib.stride_tricks.sliding_window_view
        known = windows(exemplar.pixels, (10, 10), axis=(0, 1)).reshape(-1, 300)
        patches = windows(pixels, (10, 10), axis=(0, 1))[::7, ::7].reshape(-1, 300)
        return float(((patches[:, None] - known[None]) ** 2).mean(axis=2).min(axis=1).mean())

    loose = InitialiseParams(size=SIZE, margin=0)  # blocks that nothing fits together
    start = initialise(exemplar, loose, np.random.default_rng(3)).match
    before = difference(exemplar.pixels[start[..., 0], start[..., 1]])
    assert difference(run(exemplar, start, preset="default").image.pixels) < 0.5 * before


@pytest.mark.parametrize("patch_size", [5, 10])
def test_occurrence_counts_what_the_match_uses(exemplar: Image, patch_size: int) -> None:
    """On a torus the match names all patches by the pixel in their middle."""
    result = run(exemplar, tileable=True, patch_size=patch_size, border=False)
    corners = np.moveaxis(result.match.astype(int), 2, 0) - patch_size // 2
    places = (SHAPE[0] - patch_size + 1, SHAPE[1] - patch_size + 1)
    even = SIZE[0] * SIZE[1] * patch_size**2 / (SHAPE[0] * SHAPE[1])
    expected = naive.occurrence_map(corners, patch_size, places) / even
    np.testing.assert_allclose(result.occurrence, expected, rtol=1e-6)
    for occurrence in (result.occurrence, run(exemplar, tileable=True, patch_size=patch_size).occurrence):
        assert occurrence.mean() == pytest.approx(1, rel=1e-5)


@pytest.mark.parametrize("preset", PRESETS)
def test_uniformity_evens_out_the_use(exemplar: Image, preset: str) -> None:
    start = random_start(exemplar)

    def unevenness(**options: Any) -> float:
        """Of four results, as one of this size differs by a tenth from another."""
        options |= {"preset": preset, "tileable": True, "relaxed_seams": False}
        results = (run(exemplar, start, seed, **options) for seed in range(5, 9))
        return float(np.mean([result.occurrence.std() for result in results]))

    free, usual, strict = unevenness(occurrence=0), unevenness(), unevenness(occurrence=100)
    assert strict < 0.95 * free
    assert strict < 1.05 * usual < 1.1 * free


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize(("starts", "first", "level"), [(1, 1, 1), (1, 1, 3), (2, 3, 3)])
def test_an_interrupted_run_resumes(exemplar: Image, starts: int, first: int, level: int, tileable: bool) -> None:
    params = {"preset": "default", "starts": starts, "tileable": tileable, "ratio": 1.2, "coarsest": 24, **QUICK}
    whole = MemoryCheckpoints(OptimiseScale)
    expected = run(exemplar, checkpoints=whole, **params)
    assert sorted(whole.saved) == list(range(first, len(expected.scales)))
    assert_same(run(exemplar, **params), expected)

    kept = MemoryCheckpoints(OptimiseScale)
    kept.saved = {scale: state for scale, state in whole.saved.items() if scale <= level}
    start = random_start(exemplar)
    resumed, progress = run_with_progress(lambda: run(exemplar, start, checkpoints=kept, **params))
    assert_same(resumed, expected)
    assert min(report.scale for report in progress) == level + 1


def test_a_checkpoint_holds_the_state_of_its_scale(exemplar: Image) -> None:
    kept = MemoryCheckpoints(OptimiseScale)
    result = run(exemplar, preset="default", patch_size=10, checkpoints=kept)
    for level, state in kept.saved.items():
        assert state.scales == result.scales[:level]
        size = (state.scales[-1]["height"], state.scales[-1]["width"])
        assert state.match.shape[:2] == (size[0] - 9, size[1] - 9)


@pytest.mark.parametrize("preset", PRESETS)
def test_progress_rises_to_the_end(exemplar: Image, preset: str) -> None:
    """Also where a scale ends early."""
    progress = reports(exemplar, preset=preset, tolerance=0.3)
    done = [report.done for report in progress]
    assert done == sorted(done)
    assert done[0] > 0
    assert done[-1] == pytest.approx(1)
    assert {report.scale for report in progress} == set(range(1, progress[-1].scales + 1))
    assert all(1 <= report.iteration <= report.iterations for report in progress)
    assert any(
        report.scale < after.scale and report.iteration < report.iterations for report, after in pairwise(progress)
    )


def test_previews_show_the_scale_at_work(exemplar: Image) -> None:
    previews: list[tuple[int, Image]] = []

    def look(progress: Progress) -> None:
        assert progress.preview is not None
        previews.append((progress.scale, progress.preview()))

    start = random_start(exemplar)
    params: dict[str, Any] = {"preset": "default", "patch_size": 10, "starts": 1}
    params |= {"relaxed_seams": False, "even_joints": False}
    with listening(look):
        result = run(exemplar, start, **params)
    for scale, image in previews:
        expected = result.scales[scale - 1]
        assert image.pixels.shape == (expected["height"], expected["width"], 3)
        assert np.isfinite(image.pixels).all()
    np.testing.assert_array_equal(previews[-1][1].pixels[9:-9, 9:-9], result.image.pixels)
    assert_same(run(exemplar, **params), result)  # looking changes nothing


@pytest.mark.parametrize("tileable", [False, True])
def test_maps_stay_in_register_with_colour(exemplar: Image, tileable: bool) -> None:
    """A map that is a linear function of a colour in the exemplar is the same function in the result."""
    height = 3 * exemplar.pixels[..., :1] - 40
    both = Image(np.concatenate([exemplar.pixels, height, height**0], axis=2), ("R", "G", "B", "height", "A"))
    options = {"tileable": tileable, "even_joints": False}
    result, alone = run(both, weights={"height": 0}, **options), run(exemplar, **options)
    assert result.image.channels == both.channels
    np.testing.assert_array_equal(result.image.pixels[..., :3], alone.image.pixels)
    np.testing.assert_array_equal(result.match, alone.match)
    red, voted, alpha = (result.image.pixels[..., c] for c in (0, 3, 4))
    np.testing.assert_allclose(voted, 3 * red - 40, atol=1e-3)
    np.testing.assert_allclose(alpha, 1, rtol=1e-6)


@pytest.mark.parametrize("guided", [False, True])
def test_maps_guide_where_colour_is_flat(guided: bool) -> None:
    """Stripes of a height map are continued in the result, unless the map is omitted."""
    _, across = np.indices(SHAPE)
    height = 7 + np.sin(2 * np.pi * across / 16)
    image = Image(
        np.stack([*[np.full(SHAPE, 0.4)] * 3, height], axis=2).astype(np.float32), ("R", "G", "B", "height")
    )
    start = initialise(image, InitialiseParams(size=SIZE, method="pixels"), np.random.default_rng(0)).match
    guidance = np.zeros(SHAPE, np.float32) if guided else None

    def unevenness(**params: Any) -> float:
        match = run(image, start, preset="default", patch_size=10, guidance=guidance, **params).match
        return float(np.abs(np.diff(height[match[..., 0], match[..., 1]], axis=0)).mean())

    assert unevenness() < 0.6 * unevenness(weights={"height": 0})


def test_normals_keep_unit_length(exemplar: Image, rng: np.random.Generator) -> None:
    """Within the rounding of 8 bits, though votes mix those that point elsewhere; kept pixels are unchanged."""
    normal = np.concatenate([2 * smooth_noise((*SHAPE, 2), 1.5, rng) - 1, np.full((*SHAPE, 1), 0.5)], axis=2)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    pixels = np.concatenate([exemplar.pixels, normal.astype(np.float32)], axis=2)
    image = Image(pixels, ("R", "G", "B", "normal.X", "normal.Y", "normal.Z"))
    keep = np.zeros(SIZE, bool)
    keep[30:40, 30:40] = True
    start = random_start(image)
    result = run(image, start, keep=keep, weights={"normal": 0})
    np.testing.assert_allclose(np.linalg.norm(result.image.pixels[..., 3:], axis=2), 1, atol=rounding(8) + 1e-6)
    np.testing.assert_array_equal(result.image.pixels[keep], pixels[tuple(start[keep].T)])


def test_the_weight_of_no_map_is_refused(exemplar: Image) -> None:
    check = find_stage("synthesis.optimise").check
    assert check is not None
    with pytest.raises(InputError, match="weights: no map 'heigth'; the image has none but colour"):
        check(OptimiseParams(weights={"heigth": 1}), {"image": exemplar})
    with pytest.raises(pydantic.ValidationError):
        OptimiseParams(weights={"height": -1})


def test_grey_is_as_good_as_colour(exemplar: Image) -> None:
    grey = exemplar.pixels[..., :1]
    one = run(picture(grey))
    three = run(picture(np.repeat(grey, 3, axis=2)))
    assert one.image.channels == ("Y",)
    assert one.image.pixels.shape == (*SIZE, 1)
    np.testing.assert_array_equal(one.match, three.match)
    np.testing.assert_allclose(one.image.pixels[..., 0], three.image.pixels[..., 1], rtol=1e-6)


@pytest.mark.parametrize("level", [0.0, 1e-6, 0.5, 20.0])
def test_a_constant_stays_constant(level: float) -> None:
    flat = picture(np.full((*SHAPE, 3), level))
    result = run(flat, guidance=np.zeros(SHAPE, np.float32), weight=3.0)
    np.testing.assert_allclose(result.image.pixels, np.float32(level), rtol=1e-5)


def test_guidance_leads_where_colour_is_flat() -> None:
    """Stripes of the guidance alone are continued in the result."""
    _, across = np.indices(SHAPE)
    guidance = (50 + 50 * np.sin(2 * np.pi * across / 16)).astype(np.float32)
    flat = picture(np.full((*SHAPE, 3), 0.4))
    start = initialise(flat, InitialiseParams(size=SIZE, method="pixels"), np.random.default_rng(0)).match

    def unevenness(**inputs: Any) -> float:
        match = run(flat, start, preset="default", **inputs).match
        return float(np.abs(np.diff(guidance[match[..., 0], match[..., 1]], axis=0)).mean())

    assert unevenness(guidance=guidance, weight=1.0) < 0.7 * unevenness()
    with pytest.raises(AssertionError):
        assert_same(run(flat, start, guidance=guidance), run(flat, start, guidance=guidance, weight=3.0))


def test_results_keep_a_lattice(rng: np.random.Generator) -> None:
    """Most of an exactly periodic exemplar's result is periodic, and more so with its generators."""
    image, generators = tiled(smooth_noise((16, 20, 3), 1.5, rng), 7, (80, 90))

    def irregularity(lattice: np.ndarray | None) -> float:
        irregular = []
        for seed in (1, 2):
            size = InitialiseParams(size=(96, 105))
            start = initialise(image, size, np.random.default_rng(seed), None, generators).match
            params = {"preset": "default", "patch_size": 10, "coarsest": 24}
            result = run(image, start, generators=lattice, **params).image.pixels
            irregular.append(np.abs(result[16:, 7:] - result[:-16, :-7]).mean() / result.std())
        return float(np.mean(irregular))

    assert irregularity(generators) < min(0.08, 0.6 * irregularity(None))


def test_cells_are_completed_where_nothing_is_kept(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    image, generators = tiled(smooth_noise((16, 20, 3), 1.5, rng), 7, (80, 90))
    start = random_start(image)
    completed = []
    monkeypatch.setattr(optimise_module, "complete_cells", lambda match, *_: completed.append(match.shape))
    run(image, start, generators=generators, **QUICK)
    assert completed == [(2, SIZE[0] + 9, SIZE[1] + 9)]
    run(image, start, generators=generators[:1], **QUICK)
    run(image, start, generators=generators, keep=np.eye(*SIZE, dtype=bool), **QUICK)
    run(image, start, **QUICK)
    assert len(completed) == 1


@pytest.mark.parametrize(("period", "weight"), [(50.0, 32.0), (20.0, 64.0)])
def test_lines_at_uneven_distances_are_kept_with_half_the_weight(
    period: float, weight: float, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of half a side or more is the period of such lines only; that of courses is shorter."""
    image = picture(smooth_noise((60, 90, 3), 1.5, rng))
    generators = np.array([[0, period]], np.float32)
    start = initialise(image, InitialiseParams(size=(70, 100)), np.random.default_rng(2), None, generators).match
    made = run(image, start, preset="fast", regularity=64.0, generators=generators)
    monkeypatch.setattr(optimise_module, "_LINES", 1.0)
    assert_same(made, run(image, start, preset="fast", regularity=weight, generators=generators))


@pytest.mark.parametrize(("width", "cells"), [(70, 4), (108, 5)])
def test_tileable_results_hold_whole_cells(width: int, cells: int, rng: np.random.Generator) -> None:
    """Cells of 20 px are pressed or stretched so that they fit; nearly all variation repeats with them."""
    image, generators = tiled(smooth_noise((16, 20, 3), 1.5, rng), 0, (80, 100))
    start = initialise(image, InitialiseParams(size=(96, width)), np.random.default_rng(2), None, generators).match

    def regular(**inputs: Any) -> float:
        pixels = run(image, start, preset="default", tileable=True, **inputs).image.pixels
        power = (np.abs(np.fft.rfft(pixels, axis=1)) ** 2).sum(axis=(0, 2))[1:]
        return float(power[cells - 1 :: cells].sum() / power.sum())

    assert regular(generators=generators) > 0.85
    assert regular() < 0.8


def test_a_preset_replaces_defaults() -> None:
    for name, values in PRESETS.items():
        assert OptimiseParams(preset=name).model_dump(include=set(values)) == values  # type: ignore[arg-type]
        params = OptimiseParams(preset=name, ratio=1.7, tolerance=0.5)  # type: ignore[arg-type]
        assert (params.ratio, params.tolerance) == (1.7, 0.5)
        assert params.schedule == OptimiseParams(preset=name).schedule  # type: ignore[arg-type]
        assert OptimiseParams(**params.model_dump()) == params
    assert OptimiseParams() == OptimiseParams(preset="default")


@pytest.mark.parametrize(
    "params",
    [{"preset": "best"}, {"preset": 3}, {"patch_size": 2}, {"patch_size": 33}, {"occurrence": -1}, {"ratio": 1.0},
     {"ratio": float("nan")}, {"first_iterations": 0}, {"patchsize": 8}],
)  # fmt: skip
def test_wrong_parameters_are_refused(params: dict[str, Any]) -> None:
    with pytest.raises(pydantic.ValidationError) as caught:
        OptimiseParams(**params)
    assert {str(error["loc"][0]) for error in caught.value.errors()} == set(params)


@pytest.mark.parametrize("shape", [(10, 64), (64, 9), (10, 10)])
def test_an_exemplar_must_be_larger_than_a_patch(shape: tuple[int, int], rng: np.random.Generator) -> None:
    image = picture(rng.random((*shape, 3)))
    check = find_stage("synthesis.optimise").check
    assert check is not None
    check(OptimiseParams(patch_size=8), {"image": image})
    check(OptimiseParams(), {})
    with pytest.raises(InputError, match=f"image: {format_size(shape)} is too small") as caught:
        check(OptimiseParams(), {"image": image})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("preset", PRESETS)
def test_the_smallest_exemplar_works(preset: str, tileable: bool, rng: np.random.Generator) -> None:
    image = picture(rng.random((13, 15, 3)))
    result = run(image, random_start(image, (40, 16)), preset=preset, tileable=tileable)
    assert result.image.pixels.shape == (40, 16, 3)
    assert (result.match < (13, 15)).all()


def test_a_torus_must_hold_a_patch(exemplar: Image) -> None:
    start = np.zeros((9, 40, 2), np.uint32)
    with pytest.raises(InputError, match="tileable result of 40 x 9 px does not hold a patch of 10 px"):
        run(exemplar, start, tileable=True)
    assert run(exemplar, start).image.pixels.shape == (9, 40, 3)


def test_inputs_must_fit_the_exemplar(exemplar: Image) -> None:
    with pytest.raises(ValueError, match="guidance of shape"):
        run(exemplar, guidance=np.zeros((SHAPE[1], SHAPE[0]), np.float32))
    start = random_start(exemplar)
    start[5, 5] = (0, SHAPE[1])
    with pytest.raises(ValueError, match="start points beyond"):
        run(exemplar, start)


def test_inputs_are_left_alone(exemplar: Image) -> None:
    start = random_start(exemplar)
    before = (exemplar.pixels.copy(), start.copy())
    run(exemplar, start, guidance=np.zeros(SHAPE, np.float32))
    np.testing.assert_array_equal(exemplar.pixels, before[0])
    np.testing.assert_array_equal(start, before[1])


@pytest.fixture
def usable() -> np.ndarray:
    """Two thirds of `large`: without a rectangle, a border and two single pixels."""
    mask = np.ones(LARGE, bool)
    mask[30:60, 50:80] = mask[:, :9] = False
    mask[80, 60] = mask[15, 30] = False
    return mask


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("preset", ["default", "fast"])
def test_masked_pixels_are_never_used(large: Image, usable: np.ndarray, preset: str, tileable: bool) -> None:
    """No pixel comes from one, no vote blends one in, and their values change nothing."""
    start = identity(LARGE)  # some of it is masked
    one, other = (
        run(masked(large, usable, value), start, preset=preset, tileable=tileable, **QUICK)
        for value in (0.0, 1000.0)
    )
    assert_same(one, other)
    assert one.image.channels == large.channels
    assert usable[tuple(np.moveaxis(one.match, 2, 0))].all()
    assert (one.occurrence[~usable] == 0).all()
    assert one.occurrence[usable].mean() == pytest.approx(1, rel=1e-5)
    assert other.image.pixels.max() <= large.pixels.max() + 1e-6
    assert one.image.pixels.min() >= large.pixels[usable].min() - 1e-6


def test_alpha_masks_as_a_mask_does(large: Image, usable: np.ndarray) -> None:
    marked = masked(large, usable, 5.0)
    alpha = Image(marked.pixels, (*large.channels, "A"))
    one, other = run(marked), run(alpha)
    np.testing.assert_array_equal(other.image.pixels[..., :3], one.image.pixels)
    np.testing.assert_array_equal(other.image.pixels[..., 3], 1)


def test_scales_with_too_few_unmasked_patches_are_omitted(large: Image) -> None:
    """Stripes that hold a patch, but not at half the size."""
    stripes = np.broadcast_to(np.arange(104) % 28 >= 14, (96, 104))
    result = run(masked(large, stripes, 9.0), preset="default")
    assert len(result.scales) < len(run(large, preset="default").scales)
    assert stripes[tuple(np.moveaxis(result.match, 2, 0))].all()
    with pytest.raises(InputError, match="leaves no whole patch of 15 px") as caught:
        run(masked(large, stripes, 9.0), patch_size=15)
    assert "\n" not in str(caught.value)


@pytest.fixture
def keep() -> np.ndarray:
    """A result of 104 x 96 px but for a hole in it and one at its corner."""
    mask = np.ones(LARGE, bool)
    mask[40:58, 30:52] = mask[:12, -15:] = False
    return mask


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("preset", ["default", "fast"])
def test_kept_pixels_are_bit_identical(large: Image, keep: np.ndarray, preset: str, tileable: bool) -> None:
    """Also masked ones, which occur nowhere else."""
    usable = keep.copy()
    usable[70:75, 10:15] = False
    image = Image(np.concatenate([large.pixels, usable[..., None]], axis=2, dtype=np.float32), ("R", "G", "B", "A"))
    result = run(image, identity(LARGE), preset=preset, tileable=tileable, keep=keep)
    np.testing.assert_array_equal(result.image.pixels[keep], image.pixels[keep])
    np.testing.assert_array_equal(result.match[keep], identity(LARGE)[keep])
    assert usable[tuple(result.match[~keep].T)].all()


def test_what_is_given_is_kept_under_a_large_exemplar(
    large: Image, keep: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whose planes are released before its last iterations, where nothing looks at them any more."""
    monkeypatch.setattr("texloom.stages.common.grids.working_size.MOST_PIXELS", 1000)
    given = large.with_pixels(np.ascontiguousarray(large.pixels[::-1]))
    result = run(large, identity(LARGE), preset="fast", keep=keep, given=given)
    np.testing.assert_array_equal(result.image.pixels[keep], given.pixels[keep])


@pytest.mark.parametrize("tileable", [False, True])
def test_holes_in_a_pattern_are_filled_with_the_pattern(
    keep: np.ndarray, tileable: bool, rng: np.random.Generator
) -> None:
    whole, _ = tiled(blobs((16, 26, 3), rng, 2.0), 0, LARGE)
    holes = masked(whole, keep, 0.0)
    filled = run(holes, identity(LARGE), preset="default", tileable=tileable, keep=keep).image.pixels
    spread = float(np.abs(whole.pixels - whole.pixels.mean(axis=(0, 1))).mean())
    assert float(np.abs(filled - whole.pixels)[~keep].mean()) < 0.25 * spread


def test_kept_pixels_of_a_picture_that_wraps_decide_whether_the_result_does(large: Image, keep: np.ndarray) -> None:
    torus = large.wrapping(True)
    asked = run(large, identity(LARGE), keep=keep, tileable=True)
    assert_same(run(torus, identity(LARGE), keep=keep), asked)
    assert asked.image.wraps.both
    assert not run(torus, identity(LARGE), keep=keep, tileable=False).image.wraps
    assert not run(torus).image.wraps  # of a new texture it says nothing


@pytest.mark.parametrize("wrap", [X, Y])
def test_kept_pixels_of_a_picture_that_wraps_along_one_axis(large: Image, keep: np.ndarray, wrap: Wraps) -> None:
    kept = run(large.wrapping(wrap), identity(LARGE), keep=keep)
    assert_same(kept, run(large, identity(LARGE), keep=keep, tileable=str(wrap)))
    assert kept.image.wraps == wrap


def test_guiding_pixels_are_matched_to_but_not_copied(large: Image, keep: np.ndarray) -> None:
    guiding = keep & (np.arange(keep.shape[1]) < keep.shape[1] // 2)
    params: dict[str, Any] = {"preset": "fast", "keep": keep}
    start = random_start(large, LARGE)
    whole, part = (run(large, start, guiding=mask, **params) for mask in (None, guiding))
    np.testing.assert_array_equal(part.image.pixels[~guiding], whole.image.pixels[~guiding])
    np.testing.assert_array_equal(part.match[~guiding], whole.match[~guiding])
    assert (part.match[guiding] != whole.match[guiding]).any()
    with pytest.raises(ValueError, match="guiding of shape"):
        run(large, start, guiding=guiding.T, **params)


def test_keeping_everything_is_a_copy(large: Image) -> None:
    start = random_start(large, (50, 60))
    result = run(large, start, keep=np.ones((50, 60), bool))
    np.testing.assert_array_equal(result.image.pixels, large.pixels[start[..., 0], start[..., 1]])
    np.testing.assert_array_equal(result.match, start)
    with pytest.raises(ValueError, match="keep of shape"):
        run(large, start, keep=np.ones((60, 50), bool))


@pytest.mark.parametrize("name", ["occurrence", "occurrence_coarse", "regularity"])
def test_values_beyond_all_measure_are_refused(name: str) -> None:
    """They ended in an OverflowError."""
    with pytest.raises(pydantic.ValidationError, match="less than or equal to"):
        OptimiseParams(**{name: 1e300})


def test_seams_are_relaxed_where_nothing_else_decides(exemplar: Image) -> None:
    start, params = random_start(exemplar), {"preset": "fast", "tileable": True, "whole_cells": False}
    plain, relaxed = (run(exemplar, start, **params, relaxed_seams=choice) for choice in (False, True))
    assert (plain.match != relaxed.match).any()
    assert plain.scales == relaxed.scales


def test_lines_of_a_checkerboard_are_straight() -> None:
    """Pieces ended a pixel off each other, as coarse scales are coarse."""
    rows, columns = np.indices((104, 104)) // 13
    squares = np.where((rows + columns) % 2, 0.9, 0.02).astype(np.float32)
    start = initialise(picture(squares), InitialiseParams(size=(160, 150)), np.random.default_rng(3)).match
    lattice = {"generators": np.array([[13, 13], [13, -13]], np.float32), "preset": "default", "starts": 1}
    made, bent = (
        run(picture(squares), start, **lattice, relaxed_seams=choice).image.pixels[..., 0] > 0.5
        for choice in (True, False)
    )
    for axis, across in ((0, 1), (1, 0)):
        changes = np.diff(made, axis=axis).any(axis=across)
        assert changes.sum() <= made.shape[axis] // 13 + 1
    assert np.diff(bent, axis=0).any(axis=1).sum() > 160 // 13 + 1


def test_seams_are_relaxed_and_joints_evened_under_a_guide_where_asked_for(
    exemplar: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = random_start(exemplar)
    ramps = [
        np.linspace(0, 9, shape[1], dtype=np.float32) for shape in ((exemplar.height, exemplar.width), start.shape)
    ]
    own, wanted = (
        np.tile(ramp, (rows, 1))[..., None] for ramp, rows in zip(ramps, (exemplar.height, len(start)), strict=True)
    )
    guided = {"exemplar_guide": own, "target_guide": wanted, "preset": "fast", "whole_cells": False}
    plain, off, on = (
        run(exemplar, start, **guided, **more)
        for more in ({}, {"relaxed_seams": False, "even_joints": False}, {"guided_seams": True})
    )
    assert_same(plain, off)
    assert (plain.match != on.match).any()
    assert plain.scales == on.scales
    one, two = run_with_threads(lambda: run(exemplar, start, **guided, guided_seams=True).image.pixels, monkeypatch)
    np.testing.assert_array_equal(one, two)


def test_seams_between_exemplars_of_cells_stay(monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> None:
    """Cells are completed there; else seams move."""
    image = picture(blobs((48, 96, 3), rng))
    start = rng.integers(0, 48, (64, 64, 2), dtype=np.uint32)
    own = np.repeat(np.float32([0, 9]), 48)[None, :, None] * np.ones((48, 1, 1), np.float32)
    wanted = np.repeat(np.float32([0, 9]), 32)[None, :, None] * np.ones((64, 1, 1), np.float32)
    inputs = {
        "exemplar_guide": own, "target_guide": wanted, "contours": np.zeros((48, 96), np.float32),
        "rectangles": np.array([[0, 0, 48, 48], [0, 48, 48, 48]], np.int32), "whole_cells": False,
    }  # fmt: skip
    plain, moved = (run(image, start, **inputs, guided_seams=choice).match for choice in (False, True))
    assert (plain != moved).any()

    class OfCells:
        consists = np.ones(1, bool)

    monkeypatch.setattr(
        "texloom.stages.synthesis.optimisation.optimise.SeveralCells",
        lambda *given: OfCells(),
    )
    np.testing.assert_array_equal(run(image, start, **inputs, guided_seams=True).match, plain)
