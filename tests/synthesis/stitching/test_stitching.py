"""What all stitching methods have in common: sizes, tilings, seeds, refusals, maps and masks."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pydantic
import pytest

from tests.runs import run_with_progress, run_with_threads
from tests.synthetic import continued, jump, masked, picture, points, smooth_noise, tiled
from tests.wraps import X, Y
from texloom.stages.analysis.regularity.straighten import straighten
from texloom.stages.common.grids.border_steps import border_steps
from texloom.stages.lookup.registry import find_stage
from texloom.stages.synthesis.stitching.exemplar import Exemplar, lab_of
from texloom.stages.synthesis.stitching.overlap import compared
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, NoParams
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.normals import NORMAL, unit

PLAIN = ("quilting", "hybrid", "adaptive", "patch_based", "graph_cut")
"""methods without a lattice"""
METHODS = (*PLAIN, "near_regular", "regularised_patches")
BLENDING = ("hybrid", "adaptive", "patch_based", "near_regular", "regularised_patches")
SHAPE = (104, 120)
GENERATORS = np.array([[20.0, 0.0], [0.0, 24.0]])
MAPS = ("R", "G", "B", *NORMAL, "height")


def synthesise(method: str, image: Image, seed: int = 1, **params: object) -> Any:
    """A small result of any of the methods; the lattice, if any, is that of `GENERATORS`."""
    stage = find_stage(f"synthesis.{method}")
    defaults: dict[str, object] = {"size": (70, 90)}
    if method == "graph_cut":
        defaults = {"size": (110, 126), "passes": 2}
    elif method == "near_regular":
        defaults["choices"] = 1.0  # every tile is laid
    known: dict[str, Any] = {}
    if "vertices" in stage.inputs:
        vertices = points(GENERATORS, SHAPE, np.array([3.0, 5.0])).astype(np.float32)
        steps = np.rint((vertices - vertices[0]) @ np.linalg.inv(GENERATORS)).astype(np.int32)
        source = straighten(image, vertices, vertices, NoParams()).source
        known = {
            "generators": GENERATORS.astype(np.float32), "vertices": vertices, "regular": vertices, "steps": steps,
            "source": source,
        }  # fmt: skip
    lattice = {name: known[name] for name in stage.inputs if name in known}
    return stage.function(
        image, **lattice, params=stage.params(**{**defaults, **params}), rng=np.random.default_rng(seed)
    )


@pytest.fixture
def material(rng: np.random.Generator) -> Image:
    """Cells that are alike up to noise, with normals and height."""
    cells = np.tile(smooth_noise((20, 24, 4), 2.0, rng), (6, 5, 1))[: SHAPE[0], : SHAPE[1]]
    noisy = cells + rng.normal(0, 0.02, (*SHAPE, 4))
    slopes = [*np.gradient(5 * noisy[..., 3]), np.ones(SHAPE)]
    normal = unit(np.stack(slopes, axis=2).astype(np.float32))
    return Image(np.concatenate([noisy[..., :3], normal, noisy[..., 3:]], axis=2, dtype=np.float32), MAPS)


@pytest.fixture
def mask() -> np.ndarray:
    """A logo, and scratches."""
    usable = np.ones(SHAPE, bool)
    usable[30:44, 50:61] = False
    usable[90, 5:20] = False
    usable[66:70, 108] = False
    return usable


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize(
    ("method", "shape", "size"),
    [
        *product(("quilting", "patch_based"), [(8, 8), (9, 100)], [(16, 16), (31, 83)]),
        *product(PLAIN, [(16, 16), (17, 90)], [(16, 130), (41, 17)]),
        *product(METHODS, [SHAPE], [(60, 160), (97, 64)]),
    ],
)
def test_every_size_is_filled(
    method: str, shape: tuple[int, int], size: tuple[int, int], tileable: bool, rng: np.random.Generator
) -> None:
    cell = 1 + rng.random((20, 24, 5), np.float32)  # 0 marks a pixel that was never filled
    image = Image(np.tile(cell, (6, 5, 1))[: shape[0], : shape[1]].copy(), ("R", "G", "B", "A", "height"))
    result = synthesise(method, image, size=size, tileable=tileable)
    assert result.match.shape == (*size, 2)
    assert result.match.dtype == np.uint32
    assert (result.match < shape).all()
    assert result.image.pixels.shape == (*size, 5)
    assert result.image.channels == image.channels
    assert result.image.pixels.min() >= image.pixels.min() - 1e-6
    assert result.image.pixels.max() <= image.pixels.max() + 1e-6
    assert result.image.wraps.both is tileable


@pytest.mark.parametrize(
    ("cell", "drop", "size", "tileable"),
    [((16, 20), 0, (110, 130), False), ((13, 17), 7, (110, 130), False), ((12, 15), 0, (96, 105), True)],
)
@pytest.mark.parametrize(
    ("method", "params"),
    [
        ("quilting", {"block": 40}),
        ("quilting", {"block": 40, "tolerance": 0.0}),
        ("hybrid", {"patch": 16}),
        ("hybrid", {"patch": 16, "patch_tolerance": 0.0}),
        ("adaptive", {"patch": 16}),
        ("adaptive", {"patch": 16, "k": 1.0}),
        ("patch_based", {"patch": 24, "zone": 4, "tolerance": 0, "slack": 0}),
        ("graph_cut", {"looseness": 0.0001}),
        ("graph_cut", {"looseness": 0.0001, "placement": "subpatch"}),
    ],
)
def test_an_exact_tiling_is_continued_exactly(
    method: str,
    params: dict[str, Any],
    cell: tuple[int, int],
    drop: int,
    size: tuple[int, int],
    tileable: bool,
    rng: np.random.Generator,
) -> None:
    pattern = rng.random((*cell, 3))
    exemplar, _ = tiled(pattern, drop, (64, 72))
    result = synthesise(method, exemplar, size=size, tileable=tileable, **params)
    rounding = 1e-5 if method == "patch_based" else 0
    np.testing.assert_allclose(result.image.pixels, continued(pattern, drop, result.match), rtol=0, atol=rounding)
    assert getattr(result, "energy", 0) == getattr(result, "resynthesised", 0) == 0
    moves = (result.match.astype(int) - np.indices(size).transpose(1, 2, 0)).reshape(-1, 2)
    assert len(np.unique(moves, axis=0)) > 3  # more than one piece


@pytest.mark.parametrize("method", PLAIN)
def test_tileable_results_wrap(method: str, rng: np.random.Generator) -> None:
    image = picture(smooth_noise((*SHAPE, 3), 2.0, rng))
    params = {"patch": 16, "patch_tolerance": 0.01} if method == "adaptive" else {}

    def jumps(tileable: bool) -> list[float]:
        results = [synthesise(method, image, seed, size=(110, 126), tileable=tileable, **params) for seed in (1, 2)]
        return [jump(result.image.pixels) for result in results]

    assert max(jumps(True)) < 1.5
    assert min(jumps(False)) > 2.5


@pytest.mark.parametrize("wrap", [X, Y])
@pytest.mark.parametrize("method", METHODS)
def test_results_may_continue_along_one_axis(method: str, wrap: Wraps, rng: np.random.Generator) -> None:
    image = picture(smooth_noise((*SHAPE, 3), 2.0, rng))
    params = {"patch": 16, "patch_tolerance": 0.01} if method == "adaptive" else {}
    made = synthesise(method, image, 1, size=(110, 126), tileable=wrap, **params).image
    assert made.wraps == wrap
    steps = border_steps(made)
    assert steps[wrap.across] < 1.5
    assert steps[wrap.down] > 2


@pytest.mark.parametrize("method", METHODS)
def test_results_depend_on_the_seed_and_not_on_threads(
    method: str, material: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, other = run_with_threads(lambda: synthesise(method, material, tileable=True), monkeypatch)
    np.testing.assert_array_equal(one.image.pixels, other.image.pixels)
    np.testing.assert_array_equal(one.match, other.match)
    assert (synthesise(method, material, seed=2, tileable=True).match != one.match).any()


@pytest.mark.parametrize("method", METHODS)
def test_a_flat_grey_exemplar_stays_flat_and_grey(method: str) -> None:
    result = synthesise(method, picture(np.full(SHAPE, 0.5)))
    assert result.image.channels == ("Y",)
    np.testing.assert_allclose(result.image.pixels, 0.5, rtol=1e-6)


@pytest.mark.parametrize("method", METHODS[:-1])
def test_progress_rises_to_the_end(method: str, material: Image) -> None:
    done = [progress.done for progress in run_with_progress(lambda: synthesise(method, material))[1]]
    assert len(done) >= 2
    assert done == sorted(done)
    assert done[-1] == 1


@pytest.mark.parametrize(
    ("method", "params"),
    [
        *((method, {"size": (15, 100)}) for method in METHODS),
        *product(
            ["quilting"],
            [{"size": (50000, 50000)}, {"block": 5}, {"overlap": 0.0}, {"overlap": 0.4}, {"tolerance": -0.1},
             {"tolerance": float("nan")}, {"seam_refinement": -1}],
        ),
        *product(
            ["hybrid"],
            [{"patch": 7}, {"smallest": 0}, {"overlap": 0.0}, {"patch_tolerance": -0.1}, {"pixel_tolerance": -0.1},
             {"neighbourhood": 4}, {"similar": 0}],
        ),
        *product(["adaptive"], [{"k": -0.1}, {"k": 1.1}, {"k": float("nan")}]),
        *product(["patch_based"], [{"patch": 4}, {"zone": 0}, {"tolerance": -1}, {"variance": 0}]),
        *product(["graph_cut"], [{"placement": "best"}, {"passes": -1}, {"looseness": 0}]),
        *product(["near_regular"], [{"overlap": 0.0}, {"choices": 0.0}, {"shift": -1}, {"blend": 17}]),
        *product(["regularised_patches"], [{"strength": -1}, {"zone": 0}, {"zone": 0.6}, {"tolerance": 2}]),
    ],
)  # fmt: skip
def test_parameters_out_of_range_are_refused(method: str, params: dict[str, Any]) -> None:
    with pytest.raises(pydantic.ValidationError) as caught:
        find_stage(f"synthesis.{method}").params(**params)
    assert {str(error["loc"][0]) for error in caught.value.errors()} == set(params)


@pytest.mark.parametrize(
    ("method", "shape", "params", "message"),
    [
        ("quilting", (7, 100), {}, "image: 100 x 7 px is too small; the minimum is 8 x 8 px"),
        ("quilting", (40, 30), {"block": 31}, "block: 31 px is more than the image has, 30 x 40 px"),
        ("hybrid", (15, 100), {}, "image: 100 x 15 px is too small"),
        (
            "hybrid",
            (60, 40),
            {"patch": 32},
            "patch: 32 x 32 px and overlaps of 7 px are more than the image has, 40 x 60 px",
        ),
        ("adaptive", (15, 100), {}, "image: 100 x 15 px is too small"),
        ("patch_based", (7, 30), {}, "image: 30 x 7 px is too small"),
        ("patch_based", (64, 80), {"patch": 65}, "patch: 65 px does not fit into an exemplar of 80 x 64 px"),
        ("patch_based", (64, 80), {"patch": 20, "zone": 11}, "zone: 11 px is more than half a patch, 20 px"),
        ("graph_cut", (15, 60), {}, "image: 60 x 15 px is too small; the minimum is 16 x 16 px"),
        ("near_regular", (7, 40), {}, "image: 40 x 7 px is too small"),
        ("regularised_patches", (7, 30), {}, "image: 30 x 7 px is too small"),
    ],
)
def test_exemplars_that_do_not_suit_are_refused_before_anything_runs(
    method: str, shape: tuple[int, int], params: dict[str, Any], message: str
) -> None:
    stage = find_stage(f"synthesis.{method}")
    assert stage.check is not None
    stage.check(stage.params(**params), {})
    with pytest.raises(InputError, match=message) as caught:
        stage.check(stage.params(**params), {"image": picture(np.zeros(shape))})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("method", METHODS)
def test_values_must_be_finite(method: str) -> None:
    pixels = np.zeros(SHAPE)
    pixels[3, 4] = np.nan
    with pytest.raises(InputError, match="image: a value is not finite"):
        synthesise(method, picture(pixels))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("tileable", [False, True])
def test_no_masked_pixel_is_copied_or_looked_at(
    method: str, tileable: bool, material: Image, mask: np.ndarray
) -> None:
    """Results do not depend on what masked pixels hold, not even where it is no number."""
    one, other = (
        synthesise(method, masked(material, mask, poison), tileable=tileable) for poison in (1e6, float("nan"))
    )
    assert mask[one.match[..., 0], one.match[..., 1]].all()
    assert np.abs(one.image.pixels).max() < 3
    np.testing.assert_array_equal(one.image.pixels, other.image.pixels)
    np.testing.assert_array_equal(one.match, other.match)
    assert one.image.channels == MAPS
    if not tileable:
        unmasked = synthesise(method, material)
        assert not mask[unmasked.match[..., 0], unmasked.match[..., 1]].all()  # else the test proves nothing


def test_alpha_masks_too(material: Image, mask: np.ndarray) -> None:
    named = masked(material, mask, 1e6)
    result = synthesise("quilting", Image(named.pixels, (*MAPS, "A")))
    np.testing.assert_array_equal(result.match, synthesise("quilting", named).match)
    assert result.image.channels == (*MAPS, "A")
    assert (result.image.pixels[..., -1] == 1).all()


@pytest.mark.parametrize("method", METHODS)
def test_masks_that_leave_too_little_are_refused(method: str, material: Image) -> None:
    usable = np.zeros(SHAPE, bool)
    usable[::3, ::3] = True
    with pytest.raises(InputError, match="mask leaves") as caught:
        synthesise(method, masked(material, usable, 0))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("method", PLAIN)
def test_default_pieces_are_as_small_as_masks_ask(method: str, material: Image) -> None:
    """Stripes of 20 px, where pieces are larger by default."""
    usable = np.ones(SHAPE, bool)
    usable[:, 20::22] = False
    result = synthesise(method, masked(material, usable, 1e6))
    assert usable[result.match[..., 0], result.match[..., 1]].all()
    assert result.image.pixels.max() < 3


@pytest.mark.parametrize("method", METHODS)
def test_all_maps_come_from_one_place(method: str, material: Image) -> None:
    """Every map is the exemplar's at ``match``, up to blending; what is no blend agrees to the bit."""
    result = synthesise(method, material)
    assert result.image.channels == MAPS
    away = np.abs(result.image.pixels - material.pixels[result.match[..., 0], result.match[..., 1]])
    if method not in BLENDING:
        assert not away.any()
    copied = (away[..., :3] == 0).all(axis=2)
    assert not away[copied][:, 6].any()
    lengths = np.sqrt((result.image.pixels[..., 3:6].astype(np.float64) ** 2).sum(axis=2))
    np.testing.assert_allclose(lengths, 1, atol=0.008)


@pytest.mark.parametrize("method", BLENDING)
def test_blended_normals_have_unit_length(method: str, rng: np.random.Generator) -> None:
    """Normals that turn about quickly: a blend of any two is far too short."""
    vectors = rng.normal(size=(*SHAPE, 3)).astype(np.float32)
    vectors[..., 2] = 0.3
    color, _ = tiled(smooth_noise((20, 24, 3), 2.0, rng), 0, SHAPE)
    noisy = color.pixels + rng.normal(0, 0.02, color.pixels.shape)
    image = Image(np.concatenate([noisy, unit(vectors)], axis=2, dtype=np.float32), ("R", "G", "B", *NORMAL))
    result = synthesise(method, image, weights={"normal": 0})
    lengths = np.sqrt((result.image.pixels[..., 3:6].astype(np.float64) ** 2).sum(axis=2))
    np.testing.assert_allclose(lengths, 1, atol=0.008)


@pytest.mark.parametrize("method", METHODS)
def test_maps_steer_as_they_are_weighed(method: str, material: Image) -> None:
    plain = Image(np.ascontiguousarray(material.pixels[..., :3]), ("R", "G", "B"))
    alone = synthesise(method, plain)
    weightless = synthesise(method, material, weights={"normal": 0, "height": 0})
    np.testing.assert_array_equal(weightless.match, alone.match)
    np.testing.assert_array_equal(weightless.image.pixels[..., :3], alone.image.pixels)
    assert (synthesise(method, material).match != alone.match).any()
    stage = find_stage(f"synthesis.{method}")
    assert stage.check is not None
    with pytest.raises(InputError, match="weights: no map 'hight'"):
        stage.check(stage.params.model_validate({"weights": {"hight": 2}}), {"image": material})


@pytest.mark.parametrize("method", PLAIN)
def test_maps_alone_can_tell_where_to_cut(method: str, rng: np.random.Generator) -> None:
    """Colour is flat: the height goes on as smoothly as if it were the colour."""
    height = smooth_noise(SHAPE, 3.0, rng)[..., None].astype(np.float32)
    flat = np.full((*SHAPE, 3), 0.5, np.float32)
    image = Image(np.concatenate([flat, height], axis=2), ("R", "G", "B", "height"))

    def jumps(weights: dict[str, float]) -> float:
        """Mean step of the height over seams."""
        match = synthesise(method, image, weights=weights).match.astype(int)
        cut = (np.diff(match, axis=1) != (0, 1)).any(axis=2)
        return float(np.abs(np.diff(height[match[..., 0], match[..., 1], 0], axis=1))[cut].mean())

    assert jumps({}) < 0.7 * jumps({"height": 0.0})


@pytest.mark.parametrize(("color", "white"), [(compared, 1.0), (lab_of, 100.0)])
def test_maps_do_not_loosen_tolerances(color: Any, white: float, material: Image) -> None:
    """Colour and maps vary as much as colour alone, half each."""
    plain = Exemplar(Image(material.pixels[..., :3], ("R", "G", "B")), color, white, {}).features
    both = Exemplar(material, color, white, {}).features
    variance = both.var(axis=(0, 1), dtype=np.float64)
    assert variance.sum() == pytest.approx(plain.var(axis=(0, 1), dtype=np.float64).sum(), rel=1e-3)
    assert variance[:3].sum() == pytest.approx(variance[3:].sum(), rel=0.03)


def test_open_places_and_draws(mask: np.ndarray, material: Image, rng: np.random.Generator) -> None:
    exemplar = Exemplar(masked(material, mask, 0), compared, 1.0, {})
    places = exemplar.open_places(7, 11)
    expected = np.lib.stride_tricks.sliding_window_view(mask, (7, 11)).all(axis=(2, 3))
    np.testing.assert_array_equal(places, expected)
    assert all(places[tuple(exemplar.anywhere(7, 11, rng))] for _ in range(50))
    assert exemplar.first_that_fits([80, 70, 50, 8], "block") == 2
    with pytest.raises(InputError, match="no whole block of 70 px; lower side or mask less"):
        exemplar.first_that_fits([80, 70], "block", "side")
    assert Exemplar(material, compared, 1.0, {}).first_that_fits([9999], "block") == 0
