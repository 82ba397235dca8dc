from __future__ import annotations

import logging
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pydantic
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from tests.runs import MemoryCheckpoints, run_with_progress, run_with_threads
from tests.synthetic import WALL, in_step, picture, smooth_noise, soiled_wall, spots
from texloom.pipelines.media.sources import open_source
from texloom.stages.analysis.control.orientation_field import OrientationFieldParams, orientation_field
from texloom.stages.lookup.registry import find_stage
from texloom.stages.synthesis.reconstruction import discrete_synthesis as discrete
from texloom.stages.synthesis.reconstruction.reconstruct import (
    PRESETS,
    Reconstructed,
    ReconstructParams,
    ReconstructScale,
    _plan,
    reconstruct,
)
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear, srgb_from_linear
from texloom.stages.vocabulary.declare import InputError

SHAPE = (72, 80)
SOLVERS = ("optimise", "discrete", "mixed")


def data(planes: np.ndarray, *names: str) -> Image:
    """Numbers that are no light."""
    planes = np.ascontiguousarray(np.atleast_3d(planes), np.float32)
    return Image(planes, names or tuple(f"control{c}" for c in range(planes.shape[2])))


def materials(mask: np.ndarray, rng: np.random.Generator) -> Image:
    """Red spots where ``mask`` is set, elsewhere blue stripes."""
    spots = np.clip(3 * smooth_noise(mask.shape, 2, rng) - 1, 0, 1)[..., None] * [0.5, 0.1, 0.05]
    spots += [0.2, 0.02, 0.02]
    stripes = (0.5 + 0.5 * np.sin(np.indices(mask.shape)[1] * 0.9))[..., None] * [0.02, 0.05, 0.5] + 0.02
    stripes = stripes + smooth_noise(mask.shape, 1, rng)[..., None] * 0.03
    return picture(np.where(mask[..., None] > 0.5, spots, stripes))


def disc(shape: tuple[int, int], row: float, column: float, radius: float) -> np.ndarray:
    down, across = np.indices(shape)
    return (np.hypot(down - row, across - column) < radius).astype(np.float32)


@pytest.fixture
def control() -> Image:
    return data(np.maximum(disc(SHAPE, 20, 22, 16), disc(SHAPE, 55, 60, 14)))


@pytest.fixture
def texture(control: Image, rng: np.random.Generator) -> Image:
    return materials(control.pixels[..., 0], rng)


def blurred(planes: np.ndarray, sigma: float) -> np.ndarray:
    """Means around each pixel, stretched to 0..1."""
    means = gaussian_filter(planes, sigma)
    return (means - means.min()) / np.ptp(means)


def own_places(shape: tuple[int, int]) -> np.ndarray:
    return np.ascontiguousarray(np.indices(shape).transpose(1, 2, 0).astype(np.uint32))


def run(image: Image, control: Image | None, target: Image | None, seed: int = 5, **params: Any) -> Reconstructed:
    """With ``params`` and further inputs."""
    inputs = {name: params.pop(name) for name in params.keys() - ReconstructParams.model_fields.keys()}
    return reconstruct(image, ReconstructParams(**params), np.random.default_rng(seed), control, target, **inputs)


def assert_same(one: Reconstructed, other: Reconstructed) -> None:
    np.testing.assert_array_equal(one.image.pixels, other.image.pixels)
    np.testing.assert_array_equal(one.match, other.match)
    assert one.scales == other.scales
    assert one.correlation == other.correlation


def right(result: Reconstructed, target: np.ndarray) -> float:
    """Share of pixels that are red where they should be and blue where they should be."""
    red = result.image.pixels[..., 0] > result.image.pixels[..., 2]
    return float((red == (target > 0.5)).mean())


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_texture_is_its_own_reconstruction(texture: Image, control: Image, solver: str) -> None:
    """From its own control map and its own pixels, nothing can be improved at any scale."""
    result = run(texture, control, control, start=own_places(SHAPE), solver=solver)
    assert (result.match == own_places(SHAPE)).mean() > 0.99
    np.testing.assert_allclose(result.image.pixels, texture.pixels, atol=1e-3)
    assert len(result.scales) > 1
    assert max(scale["energy"] - scale["price"] for scale in result.scales) < 0.01


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("tileable", [False, True])
def test_the_result_follows_control(
    texture: Image, control: Image, preset: str, solver: str, tileable: bool
) -> None:
    """Two materials go where a new map wants them."""
    target = disc((90, 100), 45, 50, 28)
    result = run(texture, control, data(target), preset=preset, solver=solver, tileable=tileable)
    assert result.image.pixels.shape == (90, 100, 3)
    assert right(result, target) > 0.95
    sources = control.pixels[result.match[..., 0], result.match[..., 1], 0]
    assert (sources == target).mean() > 0.95
    assert result.image.wraps.both is tileable
    assert result.correlation > 0.5
    assert result.notes == []


def test_without_weight_control_is_not_followed(texture: Image, control: Image) -> None:
    """The test above can fail."""
    target = disc(SHAPE, 36, 40, 20)
    assert right(run(texture, control, data(target), control_weight=1e-6, occurrence=0.0), target) < 0.9


@pytest.mark.parametrize("solver", SOLVERS)
def test_one_result_for_any_number_of_threads(
    texture: Image, control: Image, solver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = data(smooth_noise((140, 80), 8, np.random.default_rng(2)))

    def synthesise(seed: int = 5) -> Reconstructed:
        return run(texture, control, target, seed, preset="fast", solver=solver)

    first, *others = run_with_threads(synthesise, monkeypatch, (1, 2, 2))
    for other in others:
        assert_same(other, first)
    assert (synthesise(6).match != first.match).any()


@pytest.mark.parametrize("solver", SOLVERS)
def test_an_interrupted_run_continues(
    texture: Image, control: Image, solver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # so small that places that look alike are taken over from the first scale
    monkeypatch.setattr("texloom.stages.synthesis.reconstruction.solvers.LARGEST", 2000)
    target = data(disc(SHAPE, 36, 40, 20))
    expected = run(texture, control, target, solver=solver)
    assert len(expected.scales) > 1
    checkpoints = MemoryCheckpoints(ReconstructScale, until=1)
    run(texture, control, target, solver=solver, checkpoints=checkpoints)
    resumed, seen = run_with_progress(lambda: run(texture, control, target, solver=solver, checkpoints=checkpoints))
    assert_same(resumed, expected)
    assert min(progress.scale for progress in seen) == 2
    height, width = checkpoints.saved[1].image.pixels.shape[:2]
    assert (height, width) == (expected.scales[0]["height"], expected.scales[0]["width"])


def test_progress_rises_to_the_end(texture: Image, control: Image) -> None:
    _, seen = run_with_progress(lambda: run(texture, control, control, preset="fast"))
    done = [progress.done for progress in seen]
    assert done == sorted(done)
    assert done[-1] == pytest.approx(1)
    assert seen[-1].preview is not None
    assert seen[-1].preview().pixels.shape == (*SHAPE, 3)


def test_maps_stay_in_register_with_colour(texture: Image, control: Image) -> None:
    """A map that is a linear function of a colour in the exemplar is the same function in the result."""
    height = 3 * texture.pixels[..., :1] - 40
    both = Image(np.concatenate([texture.pixels, height, height**0], axis=2), ("R", "G", "B", "height", "A"))
    result = run(both, control, data(disc(SHAPE, 36, 40, 20)), preset="fast")
    assert result.image.channels == both.channels
    red, voted, alpha = (result.image.pixels[..., c] for c in (0, 3, 4))
    np.testing.assert_allclose(voted, 3 * red - 40, atol=1e-4)
    np.testing.assert_array_equal(alpha, 1)
    mean = run(both, control, control, preset="fast", last_vote="mean").image.pixels
    np.testing.assert_allclose(mean[..., 3], 3 * mean[..., 0] - 40, atol=1e-3)


def test_maps_are_compared(control: Image) -> None:
    """A grey texture whose materials differ in a further map only."""
    down = np.indices(SHAPE)[0]
    grain = np.random.default_rng(0).random(SHAPE) * 0.02 + 0.4
    texture = Image(np.stack([grain, np.sin(down * 0.7)], axis=2).astype(np.float32), ("Y", "height"))
    result = run(texture, control, control, preset="fast", control_weight=0.01).image.pixels[..., 1]
    across = np.abs(np.diff(result, axis=1)).mean()
    assert across < 0.25 * np.abs(np.diff(result, axis=0)).mean()


def test_control_may_be_coarser_and_the_result_of_any_size(texture: Image, control: Image) -> None:
    coarse = data(control.pixels[::4, ::4])
    result = run(texture, coarse, coarse, size=(144, 160), preset="fast")
    assert result.image.pixels.shape == (144, 160, 3)
    fine = np.kron(control.pixels[..., 0], np.ones((2, 2)))
    assert right(result, fine) > 0.8


def test_an_unrelated_control_gives_a_note(caplog: pytest.LogCaptureFixture) -> None:
    rng = np.random.default_rng(3)
    image = picture(smooth_noise((*SHAPE, 3), 3, rng))
    unrelated = data(smooth_noise(SHAPE, 6, rng))
    with caplog.at_level(logging.WARNING):
        result = run(image, unrelated, unrelated, preset="fast")
    assert result.correlation < 0.05
    assert len(result.notes) == 1
    assert "explains" in result.notes[0]
    assert caplog.messages == result.notes


def test_explained_replaces_the_estimate(texture: Image, control: Image) -> None:
    result = run(texture, control, control, explained=0.02)
    assert result.correlation == 0.02
    assert "2.0%" in result.notes[0]


@pytest.mark.skipif("TEXLOOM_TEXTURES" not in os.environ, reason="needs pictures")
def test_shuffled_control_of_a_real_texture_gives_a_note() -> None:
    """The failure case of [Wei2008]_, Figure 9: a map that has nothing to do with its texture."""
    folder = Path(os.environ["TEXLOOM_TEXTURES"]) / "globally_varying"
    texture, control = (
        open_source("picture", str(folder / f"rusty_metal053C_{name}.jpg")).read()
        for name in ("color", "control_metallic")
    )
    texture, control = (
        Image(np.ascontiguousarray(image.pixels[:640:4, :640:4]), image.channels) for image in (texture, control)
    )
    mixed = np.random.default_rng(0).permutation(control.pixels.reshape(-1, control.pixels.shape[2]))
    shuffled = Image(mixed.reshape(control.pixels.shape), control.channels)
    good, bad = (run(texture, by, by, preset="fast", solver="discrete") for by in (control, shuffled))
    assert good.correlation > 0.3
    assert good.notes == []
    assert bad.correlation < 0.05
    assert len(bad.notes) == 1


def test_a_target_beyond_control_gives_a_note(texture: Image, control: Image) -> None:
    target = data(3 * disc(SHAPE, 36, 40, 20))
    result = run(texture, control, target, preset="fast")
    assert right(result, target.pixels[..., 0]) > 0.9
    assert ["beyond" in note for note in result.notes] == [True]


def test_bad_input_is_refused(texture: Image, control: Image, rng: np.random.Generator) -> None:
    many = Image(rng.random((*SHAPE, 60), np.float32), ("Y", *(f"map{c}" for c in range(59))))
    broken = picture(np.where(texture.pixels > 0.3, np.nan, texture.pixels))
    coloured = picture(np.repeat(control.pixels, 3, axis=2) * [1, 2, 3])
    _, jacobian = rings((40, 40))
    discrete = {"solver": "discrete"}
    cases: list[tuple[dict[str, Any], str]] = [
        ({"image": many}, "image and control: 63 channels do not fit patches of 8 px; at most 46 do"),
        ({"image": broken}, "image has values that are not finite"),
        ({"control": data(np.full((*SHAPE, 1), np.inf))}, "control has values that are not finite"),
        ({"target": data(np.full((*SHAPE, 1), np.nan))}, "target has values that are not finite"),
        ({"control": data(np.ones(SHAPE))}, "control: every channel is constant"),
        ({"control": picture(control.pixels), "target": coloured}, "target: channels R G B do not match"),
        ({"control": None, "size": SHAPE}, "control and target go together"),
        ({"target": None, "size": SHAPE}, "control and target go together"),
        ({"control": None, "target": None}, "without a target, give the size"),
        ({"target_jacobian": jacobian}, "only the discrete solver follows it; solver is optimise"),
        ({"target_jacobian": 0 * jacobian, **discrete}, "target_jacobian: a pixel has no area"),
    ]
    for change, message in cases:
        with pytest.raises(InputError, match=f"{message}.*$"):
            run(**{"image": texture, "control": control, "target": control} | change)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(("tileable", "coarsest"), [(False, 32), (True, 32), (False, 20)])
def test_a_texture_without_control_is_stationary(
    solver: str, tileable: bool, coarsest: int, rng: np.random.Generator
) -> None:
    image = materials(np.zeros((60, 64)), rng)
    params: dict[str, Any] = {"preset": "fast", "solver": solver, "tileable": tileable, "coarsest": coarsest}
    result = run(image, None, None, size=(80, 70), **params)
    assert coarsest == 32 or len(result.scales) > 1
    assert result.image.pixels.shape == (80, 70, 3)
    assert (result.correlation, result.notes) == (0.0, [])
    assert result.image.pixels[..., 2].std() == pytest.approx(image.pixels[..., 2].std(), rel=0.3)


def test_discrete_pixels_do_not_repeat_on_smooth_targets(rng: np.random.Generator) -> None:
    """A target of one value over a texture with smooth places: those must not win everywhere."""
    ramp = np.broadcast_to(np.linspace(0, 1, 96), (96, 96))
    rough = smooth_noise((96, 96), 1, rng)
    bumps = smooth_noise((96, 96), 6, rng) > 0.5
    texture = picture((0.3 + 0.3 * ramp + 0.2 * rough * bumps)[..., None] * [1, 0.9, 0.7])
    target = data(np.linspace(0.4, 0.6, 120)[None, :] * np.ones((90, 1)))
    result = run(texture, data(ramp), target, solver="discrete")
    places = result.match.astype(int)
    use = np.bincount((places[..., 0] * 96 + places[..., 1]).ravel())
    wanted = 0.2 * 96**2  # pixels of the exemplar whose control is asked for
    assert use.max() < 8 * 90 * 120 / wanted
    assert (places[:, 1:] == places[:, :-1]).all(axis=2).mean() < 0.005


def test_patches_are_laid_first_where_a_texture_repeats() -> None:
    mixed, discrete = (ReconstructParams(solver=solver) for solver in ("mixed", "discrete"))
    sizes = (96, 96), (120, 90)
    assert _plan(*sizes, discrete, regular=True) == _plan(*sizes, mixed, regular=False)
    assert all(scale.places == scale.exemplar for scale in _plan(*sizes, discrete, regular=False))
    assert _plan(*sizes, mixed, regular=False)[0].places < (32, 32)


@pytest.mark.parametrize("solver", ["discrete", "mixed"])
def test_spots_remain_under_a_smooth_target(solver: Any) -> None:
    """Where control is half, half is covered with spots; not all is half a spot."""
    contrasts = []
    for seed in (1, 2, 3):
        own = spots((96, 96), np.random.default_rng(seed))
        image, target = picture(own[..., None] * [0.6, 0.5, 0.4]), data(np.full((96, 96), 0.5))
        match = run(image, data(own), target, seed, solver=solver, control_weight=10.0).match
        contrasts.append(own[match[..., 0], match[..., 1]].std())
    assert np.mean(contrasts) > 0.34


def test_the_little_that_control_asks_for_is_not_copied_side_by_side() -> None:
    """A gradient from the darkest to the brightest control of noise, both of which are rare."""
    copies = []
    for seed in (1, 2, 4):
        rough = smooth_noise((96, 96), 1.5, np.random.default_rng(seed))
        target = data(np.broadcast_to(np.linspace(0, 1, 128), (96, 128)))
        params: dict[str, Any] = {"solver": "discrete", "control_weight": 1.0, "patch_size": 16}
        image, own = picture(rough[..., None] * [0.6, 0.5, 0.4]), data(blurred(rough, 5))
        match = run(image, own, target, **params).match.astype(np.int64)
        number = match[..., 0] * 96 + match[..., 1]
        near = [(down, across) for down in range(7) for across in range(-6, 7) if (down, across) > (0, 0)]
        copies.append(sum((np.roll(number, step, (0, 1)) == number)[6:, 6:-6].mean() for step in near))
    assert np.mean(copies) < 0.1


@pytest.mark.parametrize("solver", SOLVERS)
def test_guides_decide_what_control_leaves_open(solver: str, control: Image, texture: Image) -> None:
    """Two colours for each value of control, of which the guides say where each lies."""
    bright = (np.indices(SHAPE)[1] < 40)[..., None]
    exemplar = picture(np.where(bright, texture.color + 0.25, texture.color))
    guide = lab_from_linear(picture(np.where(bright, 0.3, 0.05) + 0 * texture.color).color)
    turned = np.ascontiguousarray(guide[:, ::-1])
    made = run(
        exemplar, control, control, solver=solver, exemplar_guide=guide, target_guide=turned[::2, ::2].copy()
    )
    light = lab_from_linear(made.image.color)[..., 0]
    assert light[:, 50:].mean() > light[:, :30].mean() + 15
    with pytest.raises(ValueError, match="go together"):
        run(exemplar, control, control, exemplar_guide=guide)
    with pytest.raises(ValueError, match="for an exemplar of"):
        run(exemplar, control, control, exemplar_guide=guide[1:], target_guide=guide)


def test_use_is_even_among_pixels_of_equal_control(rng: np.random.Generator) -> None:
    """Half a target of one material uses each of its places, though they are few."""
    mask = np.zeros((64, 64))
    mask[:, :16] = 1
    texture = materials(mask, rng)
    target = np.zeros((96, 96))
    target[:, 48:] = 1
    result = run(texture, data(mask), data(target), solver="discrete", occurrence=1.0)
    assert right(result, target) > 0.95
    use = np.zeros((64, 64))
    np.add.at(use, (result.match[..., 0], result.match[..., 1]), 1)
    cells = use[:, :16].reshape(8, 8, 4, 4).sum(axis=(1, 3)) / (96 * 48 / 32)
    assert cells.min() > 0.25
    assert cells.max() < 3


@pytest.mark.parametrize("solver", ["discrete", "mixed"])
def test_a_river_stays_one_line(solver: Any, rng: np.random.Generator) -> None:
    rows, columns = np.indices((96, 96))

    def distance(swing: float) -> np.ndarray:
        return np.abs(columns - 48 - swing * np.sin(rows / 14))

    def river(away: np.ndarray) -> np.ndarray:
        return away < 4

    own, wanted = distance(20), distance(-12)
    image = picture(
        np.where(river(own)[..., None], [0.03, 0.05, 0.3], [0.2, 0.4, 0.1])
        * (0.8 + 0.2 * rng.random((96, 96, 1)))
    )  # fmt: skip
    params = ReconstructParams(solver=solver, control_weight=1.0, patch_size=16)
    control, target = (data(np.minimum(away, 30)) for away in (own, wanted))
    result = reconstruct(image, params, np.random.default_rng(5), control=control, target=target)
    wet = river(own)[tuple(np.moveaxis(result.match.astype(np.int64), 2, 0))]
    assert wet[wanted < 2].mean() > 0.98
    assert not wet[wanted > 7].any()


def test_a_river_turns_where_the_exemplar_has_it_in_one_direction(rng: np.random.Generator) -> None:
    rows, columns = np.indices((96, 96))
    away = np.hypot(columns - 48, np.maximum(np.abs(rows - 48) - 28, 0))  # a short piece, from top to bottom
    bends = np.abs(rows - 48 - 24 * np.sin(columns / 15))
    noise = 0.5 + 0.5 * rng.random((96, 96, 1))
    image = picture(np.where((away < 4)[..., None], [0.03, 0.05, 0.3], [0.2, 0.4, 0.1]) * noise)
    params = ReconstructParams(solver="discrete", control_weight=1.0, patch_size=16)
    control, target = (data(np.minimum(distance, 60)) for distance in (away, bends))
    result = reconstruct(image, params, np.random.default_rng(5), control=control, target=target)
    wet = (away < 4)[tuple(np.moveaxis(result.match.astype(np.int64), 2, 0))]
    assert wet[bends < 1].mean() > 0.95
    assert wet[bends > 7].mean() < 0.01


def test_pieces_of_a_toroidal_exemplar_continue_across_its_border(rng: np.random.Generator) -> None:
    image = picture(np.repeat(smooth_noise((48, 48), 2, rng)[..., None], 3, axis=2))

    def crossings(toroidal: bool) -> float:
        """Share of neighbours that are copied from two ends of the exemplar."""
        params = ReconstructParams(solver="discrete", size=(96, 96))
        match = reconstruct(image.wrapping(toroidal), params, np.random.default_rng(3)).match.astype(np.int64)
        assert (match < 48).all()
        return float((match[:, 1:] - match[:, :-1] == (0, -47)).all(axis=2).mean())

    assert crossings(toroidal=False) < 0.001 < 0.004 < crossings(toroidal=True)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_regular_texture_stays_regular_under_control(solver: str, rng: np.random.Generator) -> None:
    """Though the exemplar is out of step itself, and control knows nothing of the bricks."""
    image, control, source = soiled_wall(rng)
    target = data(smooth_noise((128, 144), 14, rng), "dirt")

    def regular(**inputs: Any) -> float:
        match = run(image, control, target, solver=solver, **inputs).match
        return in_step(source[match[..., 0], match[..., 1]].astype(np.float64), WALL)

    assert regular(generators=WALL, source=source) > 0.9 > 0.6 > regular()


def test_wrong_sizes_are_refused_before_anything_runs(texture: Image, control: Image) -> None:
    """From headers alone."""
    check = find_stage("synthesis.reconstruct").check
    assert check is not None
    good = {"image": texture, "control": control, "target": control}
    check(ReconstructParams(), good)
    check(ReconstructParams(), {})
    changes: list[tuple[dict[str, Image], dict[str, Any], str]] = [
        ({"control": data(control.pixels[:, :60])}, {}, "control: 60 x 72 px has another aspect ratio than image"),
        ({"target": data(control.pixels, "dirt")}, {}, "target: channels dirt do not match those of control"),
        ({}, {"size": (72, 60)}, "target: 80 x 72 px has another aspect ratio than size, 60 x 72 px"),
        ({}, {"patch_size": 32, "size": (27, 30)}, "does not hold more than one patch of 32 px"),
        ({"image": data(texture.pixels[:8], "R", "G", "B")}, {}, "image: 80 x 8 px is too small"),
    ]
    for change, params, message in changes:
        inputs = good | change
        headers = {
            name: SimpleNamespace(height=image.height, width=image.width, channels=image.channels)
            for name, image in inputs.items()
        }
        with pytest.raises(InputError, match=f"{message}.*$"):
            check(ReconstructParams(**params), headers)
        with pytest.raises(InputError, match=message):
            run(**inputs, **params)


def test_grey_and_colour_maps_are_interchangeable(texture: Image, control: Image) -> None:
    grey = picture(control.pixels)
    colour = picture(np.repeat(control.pixels, 3, axis=2))
    results = [run(texture, *maps, preset="fast") for maps in ((grey, grey), (grey, colour))]
    assert_same(*results)
    one, other = (run(texture, colour, target, preset="fast") for target in (colour, grey))
    assert_same(one, other)


def test_a_start_must_fit(texture: Image, control: Image) -> None:
    for start in (own_places((72, 81)), own_places(SHAPE) + np.uint32(70)):
        with pytest.raises(ValueError, match="start of shape"):
            run(texture, control, control, start=start)


def test_wrong_parameters_are_refused() -> None:
    for params in ({"preset": "best"}, {"control_weight": 0}, {"size": (8, 8)}, {"solver": "magic"}, {"patch": 8}):
        with pytest.raises(pydantic.ValidationError):
            ReconstructParams(**params)  # type: ignore[arg-type]
    for name, values in PRESETS.items():
        assert ReconstructParams(preset=name).model_dump(include=set(values)) == values  # type: ignore[arg-type]
    assert ReconstructParams() == ReconstructParams(preset="default")


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("tileable", [False, True])
def test_pixels_are_copies(texture: Image, control: Image, tileable: bool, solver: str) -> None:
    target = data(smooth_noise((90, 60), 9, np.random.default_rng(4)))
    params: dict[str, Any] = {"preset": "fast", "tileable": tileable, "size": (45, 30)}
    result = run(texture, control, target, solver=solver, **params)
    assert result.image.pixels.shape == (45, 30, 3)
    np.testing.assert_array_equal(
        result.image.pixels, texture.pixels[result.match[..., 0], result.match[..., 1]], strict=True
    )
    if solver == "optimise":
        soft = run(texture, control, target, last_vote="mean", **params)
        assert soft.match.shape == result.match.shape
        assert detail(soft.image) < detail(result.image)


def detail(image: Image) -> float:
    return float(np.abs(np.diff(image.pixels, axis=0)).mean())


def test_inputs_are_not_changed(texture: Image, control: Image) -> None:
    start = own_places(SHAPE)
    before = [array.copy() for array in (texture.pixels, control.pixels, start)]
    run(texture, control, control, start=start, preset="fast")
    for array, copy in zip((texture.pixels, control.pixels, start), before, strict=True):
        np.testing.assert_array_equal(array, copy)


def straight() -> Image:
    """Dashed stripes along the rows."""
    rows, columns = np.indices((64, 64))
    dashes = np.sin(rows // 8 * 2.4 + columns / 4) > 0
    return picture(0.15 + 0.6 * (0.5 + 0.5 * np.sin(2 * np.pi * rows / 8)) * (0.4 + 0.6 * dashes))


def rings(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """The direction along rings, and the Jacobians that turn rows along them."""
    rows, columns = np.indices(shape) - np.array(shape)[:, None, None] / 2 + 0.5
    angle = np.arctan2(rows, columns) + np.pi / 2
    sine, cosine = np.sin(angle), np.cos(angle)
    return angle, np.stack([cosine, sine, -sine, cosine], axis=2).astype(np.float32)


def test_texture_runs_along_the_jacobians() -> None:
    angle, jacobian = rings((96, 112))
    result = run(straight(), None, None, solver="discrete", coarsest=16, patch_size=3, target_jacobian=jacobian)
    assert result.image.pixels.shape == (96, 112, 1)
    assert len(result.scales) > 1
    measured = orientation_field(result.image, OrientationFieldParams()).angle
    error = np.abs((measured - angle + np.pi / 2) % np.pi - np.pi / 2)
    away = np.hypot(*(np.indices(angle.shape) - np.array([48, 56])[:, None, None])) > 16
    assert np.degrees(np.median(error[away])) < 12
    # stripes are as far apart as in the exemplar: a turn does not stretch
    flat = run(straight(), None, None, solver="discrete", coarsest=16, patch_size=3, size=(96, 112))
    assert detail(result.image) == pytest.approx(detail(flat.image), rel=0.5)


def weave(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Lightness of a plain weave of light threads along rows and dark ones along columns, 8 px apart."""
    across, along = np.abs(np.sin(np.pi * rows / 8)), np.abs(np.sin(np.pi * columns / 8))
    weft_is_above = (np.floor(rows / 8) + np.floor(columns / 8)) % 2 == 0
    return 0.1 + np.where(weft_is_above, 0.5 + 0.2 * across, 0.1 + 0.2 * along)


def test_a_weave_stays_woven_along_a_field_of_directions() -> None:
    shape, reach = (80, 96), np.arange(-6, 7)
    rows, columns = np.indices(shape)
    angle = 0.5 * np.sin(2 * np.pi * (rows + columns) / 240)
    sine, cosine = np.sin(angle), np.cos(angle)
    jacobian = np.stack([cosine, sine, -sine, cosine], axis=2).astype(np.float32)
    result = run(
        picture(weave(*np.indices((64, 64)))), None, None,
        solver="discrete", coarsest=16, patch_size=12, occurrence=0.1, target_jacobian=jacobian,
    )  # fmt: skip
    light = srgb_from_linear(result.image.pixels[..., 0])
    phases = np.stack(np.meshgrid(range(16), range(16), indexing="ij"), axis=-1).reshape(-1, 2, 1, 1)
    ideal = srgb_from_linear(weave(reach[:, None] + phases[:, 0], reach + phases[:, 1]))
    errors = []
    for row in range(20, shape[0] - 20, 8):
        for column in range(20, shape[1] - 20, 8):
            turn = jacobian[row, column].reshape(2, 2)
            at = np.einsum("ab,bij->aij", turn, np.stack(np.meshgrid(reach, reach, indexing="ij")))
            seen = map_coordinates(light, at + np.array([row, column])[:, None, None], order=1)
            errors.append(((ideal - seen) ** 2).mean(axis=(1, 2)).min())
    # of the variance of the weave; a straight one has .95
    assert np.mean(errors) < 0.5 * ideal.var()


def test_jacobians_that_do_not_turn_change_nothing_at_one_scale(
    texture: Image, control: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But for repeats, which are penalised without Jacobians only."""
    monkeypatch.setattr(discrete, "_REPEAT_PENALTY", 0.0)
    flat = np.broadcast_to(np.array([1, 0, 0, 1], np.float32), (90, 100, 4))
    target = data(disc((90, 100), 45, 50, 28))
    params: dict[str, Any] = {"solver": "discrete", "coarsest": 72, "first_iterations": 4, "last_iterations": 4}
    one = run(texture, control, target, **params)
    other = run(texture, control, target, target_jacobian=flat, **params)
    assert (one.match == other.match).mean() > 0.98
    assert right(other, target.pixels[..., 0]) > 0.95


def test_oriented_results_do_not_depend_on_threads_or_interruptions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _, jacobian = rings((80, 70))
    params: dict[str, Any] = {"solver": "discrete", "preset": "fast", "target_jacobian": jacobian, "coarsest": 16}
    one, other = run_with_threads(lambda: run(straight(), None, None, **params), monkeypatch, (1, 2))
    assert_same(one, other)
    checkpoints = MemoryCheckpoints(ReconstructScale, until=1)
    for _ in range(2):
        assert_same(run(straight(), None, None, checkpoints=checkpoints, **params), one)
    assert checkpoints.saved[1].places is not None
