from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest

from tests.runs import run_with_progress, run_with_threads
from tests.synthetic import WALL, in_step, jump, picture, smooth_noise, soiled_wall, spots, tiled
from tests.wraps import X, Y
from texloom.stages.analysis.similarity.appearance_stack import (
    AppearanceStack,
    AppearanceStackParams,
    appearance_stack,
)
from texloom.stages.common.geometry.jacobians import rotations
from texloom.stages.common.grids.border_steps import border_steps
from texloom.stages.common.per_pixel.levels import Level, Levels, Rect
from texloom.stages.lookup.registry import find_stage
from texloom.stages.synthesis.per_pixel.per_pixel import PerPixel, PerPixelParams, flat, per_pixel
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.normals import NORMAL

SHAPE = (48, 56)


@pytest.fixture(scope="module")
def image() -> Image:
    rng = np.random.default_rng(3)
    pixels = np.concatenate([smooth_noise((*SHAPE, 3), 2.5, rng), rng.random((*SHAPE, 2))], axis=2)
    return Image(pixels.astype(np.float32), ("R", "G", "B", "A", "height"))


@pytest.fixture(scope="module")
def stack(image: Image) -> AppearanceStack:
    return appearance_stack(image, AppearanceStackParams(coarsest=12))


@pytest.fixture(scope="module")
def control() -> Image:
    return picture(np.tile(np.linspace(0, 1, SHAPE[1]) ** 2.2, (SHAPE[0], 1)))


def made(
    image: Image, stack: AppearanceStack, seed: int = 1, inputs: dict[str, Any] | None = None, **params: Any
) -> PerPixel:
    checked = PerPixelParams.model_validate({"size": (40, 64), **params})
    rng = np.random.default_rng(seed)
    return per_pixel(
        image, stack.appearance, stack.basis, stack.candidates, stack.toroidal, checked, rng, **(inputs or {})
    )


def fixed_but_a_hole() -> dict[str, np.ndarray]:
    """All pixels of the exemplar but those of a rectangle, fixed where they are."""
    fixed = np.ones(SHAPE, bool)
    fixed[16:32, 20:40] = False
    return {"fixed": fixed, "fixed_match": np.stack(np.indices(SHAPE), axis=2).astype(np.uint32)}


def dominant_period(image: Image, axis: int) -> float:
    """Period of the strongest frequency along ``axis``, px."""
    pixels = image.pixels[..., 0]
    spectrum = np.abs(np.fft.rfft(pixels - pixels.mean(), axis=axis)).mean(axis=1 - axis)
    return pixels.shape[axis] / int(spectrum.argmax())


@pytest.mark.parametrize("tileable", [False, True])
def test_every_pixel_is_the_one_that_match_says(image: Image, stack: AppearanceStack, tileable: bool) -> None:
    result = made(image, stack, tileable=tileable)
    assert result.match.shape == (40, 64, 2)
    assert (result.match < SHAPE).all()
    assert result.image.channels == image.channels
    np.testing.assert_array_equal(result.image.pixels, image.pixels[result.match[..., 0], result.match[..., 1]])
    assert result.image.wraps.both is tileable
    # only whole neighbourhoods of an exemplar that is no torus
    assert (result.match >= 3).all()
    assert (result.match < np.array(SHAPE) - 3).all()


@pytest.mark.parametrize("controlled", [False, True])
def test_windows_of_an_endless_texture_are_identical(
    image: Image, stack: AppearanceStack, control: Image, controlled: bool
) -> None:
    rng = np.random.default_rng(8)
    inputs, extent = {}, None
    if controlled:
        inputs = {"control": control, "target": picture(smooth_noise((120, 150), 12, rng))}
        extent = (120, 150)
    large = made(image, stack, inputs=inputs, size=(120, 150)).match
    for _ in range(4):
        height, width = (int(side) for side in rng.integers(16, 50, 2))
        top, left = int(rng.integers(0, 120 - height)), int(rng.integers(0, 150 - width))
        window = made(image, stack, inputs=inputs, size=(height, width), origin=(top, left), extent=extent)
        np.testing.assert_array_equal(window.match, large[top : top + height, left : left + width])
    far = made(image, stack, size=(40, 40), origin=(-(2**29) - 20, 2**29))
    near = made(image, stack, size=(20, 20), origin=(-(2**29), 2**29 + 10))
    np.testing.assert_array_equal(near.match, far.match[20:, 10:30])


def test_an_exact_tiling_continues(rng: np.random.Generator) -> None:
    """Where pieces of it meet, the correction finds the whole cells between them."""
    exemplar, _ = tiled(rng.random((8, 8, 3)), 0, (64, 64))
    stack = appearance_stack(exemplar, AppearanceStackParams(toroidal=True))
    match = made(exemplar, stack, size=(96, 96), jitter=0).match.astype(int)
    steps = [np.diff(match, axis=axis) for axis in (0, 1)]
    follows = [((step % 8) == np.eye(2, dtype=int)[axis]).all(axis=2) for axis, step in enumerate(steps)]
    assert min(part.mean() for part in follows) > 0.9
    assert len(np.unique((match - np.indices((96, 96)).transpose(1, 2, 0)).reshape(-1, 2), axis=0)) > 3


@pytest.mark.parametrize("tileable", [False, True])
def test_a_repetition_continues_in_phase(tileable: bool) -> None:
    """Cells of no whole number of pixels; on a torus they are stretched a little, so that they fit."""
    cell, side = 7.3, 160
    shape = (64, 72)
    exemplar = picture(sum(np.floor(index / cell) for index in np.indices(shape)) % 2)
    stack = appearance_stack(exemplar, AppearanceStackParams())
    generators = np.array([[cell, cell], [cell, -cell]], np.float32)
    wrong = {}
    for name, inputs in (("free", {}), ("in step", {"generators": generators})):
        light = (
            made(exemplar, stack, inputs=inputs, size=(side, side), tileable=tileable).image.pixels[..., 0] > 0.5
        )
        index = np.arange(side) / (side / np.rint(side / cell) if tileable else cell)
        starts = np.arange(0, 2, 0.125)
        boards = [np.floor(index[:, None] + i) + np.floor(index + j) for i in starts for j in starts]
        wrong[name] = min(np.mean(board % 2 != light) for board in boards)
    assert wrong["in step"] < 0.12
    assert wrong["free"] > 0.25


def test_a_regular_compaction_stays_regular_under_control(rng: np.random.Generator) -> None:
    """Though it is out of step itself, and control knows nothing of the bricks."""
    image, control, source = soiled_wall(rng)
    stack = appearance_stack(image, AppearanceStackParams())
    target = Image(smooth_noise((128, 144), 14, rng)[..., None].astype(np.float32), ("dirt",))
    inputs = {"control": control, "target": target}

    def regular(**further: Any) -> float:
        match = made(image, stack, inputs={**inputs, **further}, size=None).match
        return in_step(source[match[..., 0], match[..., 1]].astype(np.float64), WALL)

    assert regular(generators=WALL, source=source) > 0.9 > 0.6 > regular()


def test_distorted_texture_stays_in_phase(rng: np.random.Generator) -> None:
    """Tiles of different tones, at levels whose step is as large as a tile."""
    sides, shape = np.array([20, 26]), (180, 208)
    down, across = np.indices(shape)
    tones = rng.uniform(0.5, 1, (9, 8)).repeat(20, axis=0).repeat(26, axis=1)
    exemplar = picture(np.where((down % 20 < 3) | (across % 26 < 3), 0.1, tones) + rng.normal(0, 0.02, shape))
    stack = appearance_stack(exemplar, AppearanceStackParams(coarsest=6), jacobian=flat(shape))
    charts = {
        "chart": np.stack([down, across], axis=2),
        "target_chart": 7 + np.moveaxis(np.indices((64, 64)), 0, 2),
    }
    fields = {"jacobian": flat(shape), "target_jacobian": flat((64, 64)), "generators": np.diag(sides)}
    inputs = {name: values.astype(np.float32) for name, values in {**fields, **charts}.items()}
    positions = made(exemplar, stack, inputs=inputs, size=(64, 64)).positions
    assert positions is not None
    off = (positions - inputs["target_chart"] + sides / 2) % sides - sides / 2
    assert np.mean(np.hypot(*np.moveaxis(off, 2, 0))) < 2


def test_windows_of_a_repetition_are_identical(image: Image, stack: AppearanceStack) -> None:
    inputs = {"generators": np.array([[8.5, 1.25], [-2, 11]], np.float32)}
    large = made(image, stack, inputs=inputs, size=(120, 150)).match
    window = made(image, stack, inputs=inputs, size=(30, 40), origin=(50, 70)).match
    np.testing.assert_array_equal(window, large[50:80, 70:110])
    assert (large != made(image, stack, size=(120, 150)).match).any()


def test_tileable_wraps(image: Image, stack: AppearanceStack) -> None:
    wrapped = [jump(made(image, stack, seed, tileable=True).image.color) for seed in range(3)]
    loose = [jump(made(image, stack, seed).image.color) for seed in range(3)]
    assert np.median(wrapped) < 1.6
    assert min(loose) > 2


@pytest.mark.parametrize("wrap", [X, Y])
def test_tileable_along_one_axis(image: Image, stack: AppearanceStack, wrap: Wraps) -> None:
    """Only along it must the levels divide the result."""
    size = (64, 75) if wrap == Y else (75, 64)
    results = [made(image, stack, seed, size=size, tileable=wrap).image for seed in range(3)]
    assert all(one.wraps == wrap for one in results)
    steps = np.median([border_steps(one) for one in results], axis=0)
    assert steps[int(wrap.across)] < 2.4  # as where it continues along both
    assert steps[int(wrap.down)] > 2.4
    with pytest.raises(InputError, match="cannot be tileable with"):
        made(image, stack, size=size, tileable=X if wrap == Y else Y)


def test_corrections_make_neighbours_fit(image: Image, stack: AppearanceStack) -> None:
    """Most neighbours continue each other, and those that do not differ less than the start's."""
    match = made(image, stack, size=(128, 128)).match.astype(int)
    follows = (np.diff(match, axis=1) == (0, 1)).all(axis=2)
    assert 0.5 < follows.mean() < 0.999
    colour = image.color[match[..., 0], match[..., 1]]
    seam = np.abs(np.diff(colour, axis=1)).mean(axis=2)[~follows].mean()
    random = np.abs(image.color[:, :28] - image.color[:, 28:]).mean()
    assert seam < 0.6 * random


def test_jitter_breaks_pieces_up(image: Image, stack: AppearanceStack) -> None:
    def pieces(jitter: float) -> float:
        match = made(image, stack, size=(128, 128), jitter=jitter).match.astype(int)
        return float((np.diff(match, axis=1) != (0, 1)).any(axis=2).mean())

    assert pieces(0) < pieces(1)


def test_the_result_follows_the_control(image: Image, stack: AppearanceStack, control: Image) -> None:
    target = picture(np.tile(np.linspace(1, 0, 96)[:, None] ** 2.2, (1, 96)))
    match = made(image, stack, inputs={"control": control, "target": target}, size=None, control_weight=5.0).match
    wanted = np.linspace(SHAPE[1] - 1, 0, 96)
    assert abs(match[..., 1].mean(axis=1)[8:-8] - wanted[8:-8]).mean() < 4
    assert match.shape == (96, 96, 2)


def test_spots_remain_under_a_smooth_target() -> None:
    """Where control is half, half is covered with spots; not all is half a spot."""
    contrasts = []
    for seed in (1, 2, 3):
        own = spots((96, 96), np.random.default_rng(seed))
        image = picture(own[..., None] * [0.6, 0.5, 0.4])
        stack = appearance_stack(image, AppearanceStackParams(coarsest=12))
        inputs = {"control": picture(own), "target": picture(np.full((96, 96), 0.5))}
        match = made(image, stack, seed, inputs, size=None, control_weight=3.0).match
        contrasts.append(own[match[..., 0], match[..., 1]].std())
    assert np.mean(contrasts) > 0.2


@pytest.mark.parametrize("block", [6, 24])
def test_a_rare_control_value_can_fill_the_result(block: int, rng: np.random.Generator) -> None:
    wanted = np.zeros((64, 64))
    wanted[44:60, 40:56] = 1
    pixels = smooth_noise((64, 64, 3), 2.0, rng) + wanted[..., None]
    stack = appearance_stack(picture(pixels).wrapping(True), AppearanceStackParams(coarsest=12))
    inputs = {"control": picture(wanted), "target": picture(np.ones((96, 96)))}
    params = {"size": None, "block": block, "coherence": 1.1, "control_weight": 3.0}
    match = made(picture(pixels), stack, inputs=inputs, **params).match
    assert (wanted[match[..., 0], match[..., 1]] == 0).mean() < 0.03


def test_a_target_beyond_control_gives_notes(image: Image, caplog: pytest.LogCaptureFixture) -> None:
    """A quarter of the target is above all values, and of those in it the upper half is in one row only."""
    stack = appearance_stack(image.wrapping(True), AppearanceStackParams(coarsest=24))
    ramp = np.linspace(0, 0.5, SHAPE[0])[:, None] * np.ones(SHAPE)
    ramp[SHAPE[0] // 2] = 1
    target = picture(np.linspace(0, 4 / 3, 96)[:, None] * np.ones((96, 96)))

    def notes(target: Image) -> list[str]:
        inputs = {"control": picture(ramp), "target": target}
        return made(image, stack, inputs=inputs, size=None).notes

    assert notes(picture(ramp)) == []
    with caplog.at_level(logging.WARNING):
        beyond, rare = notes(target)
    assert caplog.messages == [beyond, rare]
    assert "beyond the control map's values" in beyond
    assert "too rare in control" in rare


def test_a_hole_is_filled_and_its_border_fits(image: Image) -> None:
    inputs = fixed_but_a_hole()
    fixed, own = inputs.values()
    stack = appearance_stack(image, AppearanceStackParams(coarsest=24), valid=np.stack([fixed, fixed]))
    match = made(image, stack, inputs=inputs, size=SHAPE).match
    np.testing.assert_array_equal(match[fixed], own[fixed])
    assert fixed[match[..., 0], match[..., 1]].all()

    def seams(source: np.ndarray) -> float:
        colour = image.color[source[..., 0], source[..., 1]]
        return float(np.abs(colour[16:32, [19, 39]] - colour[16:32, [20, 40]]).mean())

    free = [seams(np.where(fixed[..., None], own, made(image, stack, seed, size=SHAPE).match)) for seed in range(3)]
    assert seams(match) < 0.85 * np.mean(free)


def test_fixed_pixels_are_continued(image: Image, stack: AppearanceStack) -> None:
    """A hole in the exemplar itself is best filled with what was there."""
    inputs = fixed_but_a_hole()
    match = made(image, stack, inputs=inputs, size=SHAPE).match
    assert (match == inputs["fixed_match"]).all(axis=2).mean() > 0.98


def test_a_flat_jacobian_changes_nothing(
    image: Image, stack: AppearanceStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If both start from the same pieces."""
    begin, starts = Levels._start, []

    def start(levels: Levels, level: Level, area: Rect) -> Rect:
        changed = begin(levels, level, area)
        if level.distortion is None:
            starts.append(levels.tables.pixels_of(level.states[0]))
        else:
            level.states[0][:] = levels._positions(levels.tables.places_of(*starts[0]))
        return changed

    monkeypatch.setattr(Levels, "_start", start)
    plain = made(image, stack)
    bent = made(image, stack, inputs={"jacobian": flat(SHAPE), "target_jacobian": flat((40, 64))})
    np.testing.assert_array_equal(bent.match, plain.match)


def test_a_distorted_result_is_distorted(rng: np.random.Generator) -> None:
    """Stripes of a flat exemplar become wider, and turn."""
    stripes = np.sin(np.arange(64) * 2 * np.pi / 8)
    exemplar = picture(np.tile(0.5 + 0.3 * stripes[:, None], (1, 64)) + rng.normal(0, 0.01, (64, 64)))
    stack = appearance_stack(exemplar, AppearanceStackParams(toroidal=True))

    for jacobian, axis, period in (([1, 0, 0, 1], 0, 8), ([1.5, 0, 0, 1.5], 0, 12), ([0, 1, 1, 0], 1, 8)):
        field = np.tile(np.array(jacobian, np.float32), (128, 128, 1))
        result = made(exemplar, stack, inputs={"target_jacobian": field}, size=(128, 128), jitter=0)
        assert dominant_period(result.image, axis) == pytest.approx(period, rel=0.1)


def test_a_distorted_exemplar_is_flattened(rng: np.random.Generator) -> None:
    stripes = 0.5 + 0.3 * np.sin(np.arange(96) * 2 * np.pi / 12)
    exemplar = picture(np.tile(stripes, (64, 1)) + rng.normal(0, 0.01, (64, 96)))
    field = np.tile(np.array([1, 0, 0, 1.5], np.float32), (64, 96, 1))
    stack = appearance_stack(exemplar, AppearanceStackParams(), jacobian=field)
    result = made(exemplar, stack, inputs={"jacobian": field}, size=(128, 128), jitter=0)
    assert dominant_period(result.image, 1) == pytest.approx(8, rel=0.15)


def test_normals_turn_with_the_texture(image: Image) -> None:
    normals = np.broadcast_to(np.array([0.6, 0.0, 0.8], np.float32), (*SHAPE, 3))
    whole = Image(np.concatenate([image.color, normals], axis=2), ("R", "G", "B", *NORMAL))
    turns = {"none": None, "across": 0.0, "down": np.pi / 2}

    def field(turn: str, shape: tuple[int, int]) -> np.ndarray | None:
        angle = turns[turn]
        return None if angle is None else rotations(np.full(shape, angle, np.float32))

    for own, to, wanted in (
        ("none", "across", (0.6, 0, 0.8)), ("none", "down", (0, -0.6, 0.8)),
        ("down", "across", (0, 0.6, 0.8)), ("down", "down", (0.6, 0, 0.8)),
    ):  # fmt: skip
        jacobian, target = field(own, SHAPE), field(to, (40, 64))
        stack = appearance_stack(whole, AppearanceStackParams(coarsest=12), jacobian=jacobian)
        result = made(whole, stack, inputs={"jacobian": jacobian, "target_jacobian": target})
        np.testing.assert_allclose(result.image.pixels[..., 3:], np.broadcast_to(wanted, (40, 64, 3)), atol=1e-5)


def test_the_seed_decides(image: Image, stack: AppearanceStack) -> None:
    first, again, other = (made(image, stack, seed).match for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_threads_do_not_matter(
    image: Image, stack: AppearanceStack, control: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    inputs = {"control": control, "target": picture(np.tile(np.linspace(0, 1, 240), (200, 1)))}
    one, two, three = run_with_threads(
        lambda: made(image, stack, inputs=inputs, size=None).match, monkeypatch, (1, 2, 3)
    )
    np.testing.assert_array_equal(two, one)
    np.testing.assert_array_equal(three, one)


def test_a_constant_exemplar_gives_a_constant_result() -> None:
    exemplar = picture(np.full((32, 32), 0.5))
    stack = appearance_stack(exemplar, AppearanceStackParams())
    assert (made(exemplar, stack).image.pixels == np.float32(0.5)).all()


@pytest.mark.parametrize(
    ("sizes", "params", "message"),
    [
        ({"control": (48, 60)}, {}, "control: 60 x 48 px has another aspect ratio than image"),
        (
            {"target": (48, 60)},
            {"size": (48, 90)},
            "target: 60 x 48 px has another aspect ratio than size, 90 x 48 px",
        ),
        ({}, {"tileable": True, "origin": (0, 8)}, r"origin: \[0, 8\] for a tileable result"),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_runs(
    image: Image, sizes: dict[str, tuple[int, int]], params: dict[str, Any], message: str
) -> None:
    check = find_stage("synthesis.per_pixel").check
    assert check is not None
    maps = {name: picture(np.zeros(size)) for name, size in sizes.items()}
    with pytest.raises(InputError, match=message):
        check(PerPixelParams.model_validate(params), {"image": image, **maps})


def test_sides_that_cannot_be_tileable_are_refused_before_anything_runs(
    image: Image, stack: AppearanceStack
) -> None:
    analysis, check = find_stage("analysis.appearance_stack"), find_stage("synthesis.per_pixel").check
    assert analysis.outlines is not None
    assert check is not None
    known = {"image": image, **analysis.outlines(AppearanceStackParams(coarsest=12), {"image": image})}
    assert known["appearance"].shape == stack.appearance.shape[1:]
    assert known["appearance"].levels == len(stack.appearance)
    message = "^size: 64 x 44 px cannot be tileable with 3 levels, which takes multiples of 8; 64x48 can$"
    with pytest.raises(InputError, match=message):
        check(PerPixelParams(size=(44, 64), tileable=True), known)
    with pytest.raises(InputError, match=r"^size: 36 x 36 px cannot be tileable"):
        check(PerPixelParams(tileable=True), {**known, "target": picture(np.zeros((36, 36)))})
    for params in ({"size": (44, 64)}, {"size": (40, 64), "tileable": True}, {"tileable": True}):
        check(PerPixelParams.model_validate(params), known)
    distorted = {"image": image, "jacobian": flat(SHAPE)}
    assert not analysis.outlines(AppearanceStackParams(), distorted), "known when they have been found"


def test_bad_inputs_are_refused(image: Image, stack: AppearanceStack, control: Image) -> None:
    wet, plain = Image(control.pixels, ("wet",)), picture(np.zeros(SHAPE))
    beyond = {"fixed": np.ones((40, 64), bool), "fixed_match": np.full((40, 64, 2), 50, np.uint32)}
    repeating = {"generators": np.array([[8, 0], [0, 8]], np.float32), "jacobian": flat(SHAPE)}
    cases: list[tuple[type[Exception], dict[str, Any], str]] = [
        (InputError, {"control": control}, "control and target go together"),
        (InputError, {"control": control, "target": wet}, "target: channels wet"),
        (InputError, {"control": plain, "target": control}, "control: every channel is constant"),
        (InputError, {"target_jacobian": np.zeros((4, 4, 4), np.float32)}, "target_jacobian: a pixel has no area"),
        (ValueError, beyond, "fixed_match goes beyond"),
        (ValueError, repeating, "chart: missing, though the exemplar is distorted and repeats"),
    ]
    for error, inputs, message in cases:
        with pytest.raises(error, match=f"^{message}.*$"):
            made(image, stack, inputs=inputs, size=SHAPE if "target" in inputs else (40, 64))
    message = "size: 64 x 44 px cannot be tileable with 3 levels, which takes multiples of 8; 64x48 can"
    with pytest.raises(InputError, match=message):
        made(image, stack, tileable=True, size=(44, 64))
    with pytest.raises(ValueError, match="analysis of 56 x 48 px for an image"):
        made(picture(np.zeros((40, 40))), stack)


def test_progress_goes_to_the_end(image: Image, stack: AppearanceStack) -> None:
    _, reports = run_with_progress(lambda: made(image, stack))
    done = [report.done for report in reports]
    assert len(done) == len(stack.appearance)
    assert done == sorted(done)
    assert done[-1] == 1.0


def test_coarse_colours_tell_apart_what_control_does_not() -> None:
    rng = np.random.default_rng(11)
    shade = np.where(np.arange(64)[:, None] < 32, 0.25, 0.6) + np.zeros((64, 64))
    image = picture(np.clip(shade + 0.05 * rng.normal(size=shade.shape), 0, 1))
    guide = lab_from_linear(np.repeat(np.float32(shade)[..., None], 3, axis=2))
    stack = appearance_stack(image, AppearanceStackParams(coarsest=12))
    ramp = picture(np.tile(np.linspace(0, 1, 64), (64, 1)))
    wanted = guide[::-1].copy()  # what is bright lies above

    def off(**guides: np.ndarray) -> float:
        result = made(image, stack, 3, {"control": ramp, "target": ramp, **guides}, size=(64, 64))
        return float(np.abs(result.image.pixels[..., 0] - shade[::-1]).mean())

    assert off(exemplar_guide=guide, target_guide=wanted) < 0.4 * off()
    with pytest.raises(ValueError, match="go together"):
        off(exemplar_guide=guide)
