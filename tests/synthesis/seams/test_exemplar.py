"""What is copied from and compared, and that every stitched synthesis heeds all maps and all masks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture, points, smooth_noise, tiled
from texloom.stages.analysis.straighten import straighten
from texloom.stages.arrays import Image
from texloom.stages.declare import InputError, NoParams, find_stage
from texloom.stages.masks import USABLE
from texloom.stages.normals import NORMAL, unit
from texloom.stages.synthesis._seams.exemplar import Exemplar, lab_of
from texloom.stages.synthesis._seams.overlap import compared

METHODS = ("quilting", "hybrid", "adaptive", "patch_based", "graph_cut", "near_regular", "regularised_patches")
BLENDING = ("hybrid", "adaptive", "patch_based", "near_regular", "regularised_patches")
SHAPE = (104, 120)
GENERATORS = np.array([[20.0, 0.0], [0.0, 24.0]])
MAPS = ("R", "G", "B", *NORMAL, "height")


def made(method: str, image: Image, seed: int = 1, **params: object) -> Any:
    """A small result of any of the methods; those on a lattice are told that of `GENERATORS`."""
    stage = find_stage(f"synthesis.{method}")
    usual: dict[str, object] = {"size": (70, 90)}
    if method == "graph_cut":
        usual = {"size": (110, 126), "passes": 2}
    elif method == "near_regular":
        usual["choices"] = 1.0  # every tile is laid
    known: dict[str, Any] = {}
    if "vertices" in stage.inputs:
        vertices = points(GENERATORS, SHAPE, np.array([3.0, 5.0])).astype(np.float32)
        steps = np.rint((vertices - vertices[0]) @ np.linalg.inv(GENERATORS)).astype(np.int32)
        source = straighten(image, vertices, vertices, NoParams()).source
        known = {
            "generators": GENERATORS.astype(np.float32), "vertices": vertices, "regular": vertices, "steps": steps,
            "source": source,
        }  # fmt: skip
    given = {name: known[name] for name in stage.inputs if name in known}
    return stage.function(
        image, **given, params=stage.params(**{**usual, **params}), rng=np.random.default_rng(seed)
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


def masked(image: Image, usable: np.ndarray, poison: float) -> Image:
    pixels = np.where(usable[..., None], image.pixels, np.float32(poison))
    return Image(np.concatenate([pixels, usable[..., None]], axis=2, dtype=np.float32), (*image.channels, USABLE))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("tileable", [False, True])
def test_no_masked_pixel_is_copied_or_looked_at(
    method: str, tileable: bool, material: Image, mask: np.ndarray
) -> None:
    """Results do not depend on what masked pixels hold, not even where it is no number."""
    one, other = (made(method, masked(material, mask, poison), tileable=tileable) for poison in (1e6, float("nan")))
    assert mask[one.match[..., 0], one.match[..., 1]].all()
    assert np.abs(one.image.pixels).max() < 3
    np.testing.assert_array_equal(one.image.pixels, other.image.pixels)
    np.testing.assert_array_equal(one.match, other.match)
    assert one.image.channels == MAPS
    if not tileable:
        free = made(method, material)
        assert not mask[free.match[..., 0], free.match[..., 1]].all()  # or the test would tell nothing


def test_alpha_masks_too(material: Image, mask: np.ndarray) -> None:
    named = masked(material, mask, 1e6)
    result = made("quilting", Image(named.pixels, (*MAPS, "A")))
    np.testing.assert_array_equal(result.match, made("quilting", named).match)
    assert result.image.channels == (*MAPS, "A")
    assert (result.image.pixels[..., -1] == 1).all()


@pytest.mark.parametrize("method", METHODS)
def test_masks_that_leave_too_little_are_refused(method: str, material: Image) -> None:
    usable = np.zeros(SHAPE, bool)
    usable[::3, ::3] = True
    with pytest.raises(InputError, match="mask leaves") as caught:
        made(method, masked(material, usable, 0))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("method", METHODS[:5])
def test_default_pieces_are_as_small_as_masks_ask(method: str, material: Image) -> None:
    """Stripes of 20 px, where pieces are larger by default."""
    usable = np.ones(SHAPE, bool)
    usable[:, 20::22] = False
    result = made(method, masked(material, usable, 1e6))
    assert usable[result.match[..., 0], result.match[..., 1]].all()
    assert result.image.pixels.max() < 3


@pytest.mark.parametrize("method", METHODS)
def test_all_maps_come_from_one_place(method: str, material: Image) -> None:
    """Every map is the exemplar's at ``match``, up to blending; what is no blend agrees to the bit."""
    result = made(method, material)
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
    result = made(method, image, weights={"normal": 0})
    lengths = np.sqrt((result.image.pixels[..., 3:6].astype(np.float64) ** 2).sum(axis=2))
    np.testing.assert_allclose(lengths, 1, atol=0.008)


@pytest.mark.parametrize("method", METHODS)
def test_maps_steer_as_they_are_weighed(method: str, material: Image) -> None:
    plain = Image(np.ascontiguousarray(material.pixels[..., :3]), ("R", "G", "B"))
    alone = made(method, plain).match
    weightless = made(method, material, weights={"normal": 0, "height": 0}).match
    np.testing.assert_array_equal(weightless, alone)
    assert (made(method, material).match != alone).any()
    stage = find_stage(f"synthesis.{method}")
    assert stage.check is not None
    with pytest.raises(InputError, match="weights: no map 'hight'"):
        stage.check(stage.params.model_validate({"weights": {"hight": 2}}), {"image": material})


@pytest.mark.parametrize("method", METHODS[:5])
def test_maps_alone_can_tell_where_to_cut(method: str, rng: np.random.Generator) -> None:
    """Colour is flat: the height goes on as smoothly as if it were the colour."""
    height = smooth_noise(SHAPE, 3.0, rng)[..., None].astype(np.float32)
    flat = np.full((*SHAPE, 3), 0.5, np.float32)
    image = Image(np.concatenate([flat, height], axis=2), ("R", "G", "B", "height"))

    def jumps(weights: dict[str, float]) -> float:
        """Mean step of the height over seams."""
        match = made(method, image, weights=weights).match.astype(int)
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
    found = exemplar.open_places(7, 11)
    assert found.shape == (SHAPE[0] - 6, SHAPE[1] - 10)
    for row, column in np.ndindex(found.shape):
        assert found[row, column] == mask[row : row + 7, column : column + 11].all()
    assert all(found[tuple(exemplar.anywhere(7, 11, rng))] for _ in range(50))
    assert exemplar.first_that_fits([80, 70, 50, 8], "block") == 2
    with pytest.raises(InputError, match="no whole block of 70 px; lower side or mask less"):
        exemplar.first_that_fits([80, 70], "block", "side")
    assert Exemplar(material, compared, 1.0, {}).first_that_fits([9999], "block") == 0


def test_only_values_that_are_used_must_be_finite(material: Image, mask: np.ndarray) -> None:
    Exemplar(masked(material, mask, float("nan")), compared, 1.0, {})
    with pytest.raises(InputError, match="image: a value is not finite"):
        Exemplar(picture(np.full((9, 9), np.inf)), compared, 1.0, {})
