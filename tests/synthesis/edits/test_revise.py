from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.runs import run_with_progress, run_with_threads
from tests.synthetic import blobs, identity, masked, picture, tiled
from tests.wraps import X, Y
from texloom.stages.synthesis.edits.revise import Revised, ReviseParams, Revision, revise
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps

SHAPE, SIZE = (72, 80), (90, 84)
"""an exemplar and a texture, px"""

BOX = np.s_[30:48, 36:56]
OPTIONAL = ("guidance", "weight", "generators", "match")


@pytest.fixture
def exemplar(rng: np.random.Generator) -> Image:
    return picture(blobs((*SHAPE, 3), rng))


@pytest.fixture
def texture(rng: np.random.Generator) -> Image:
    """Of the same kind as the exemplar."""
    return picture(blobs((*SIZE, 3), rng))


def marked(*boxes: tuple[slice, slice], size: tuple[int, int] = SIZE) -> np.ndarray:
    region = np.zeros(size, bool)
    for box in boxes:
        region[box] = True
    return region


def run(texture: Image, exemplar: Image, region: np.ndarray, seed: int = 5, **options: Any) -> Revised:
    inputs = {name: options.pop(name) for name in OPTIONAL if name in options}
    params = ReviseParams(**{"preset": "fast", "margin": 20, **options})
    shown = picture(region.astype(np.float32))
    return revise(texture, exemplar, shown, params, np.random.default_rng(seed), **inputs)


def assert_only(result: Revised, texture: Image, region: np.ndarray) -> None:
    """Nothing but the region changes, and all its parts do."""
    np.testing.assert_array_equal(result.image.pixels[~region], texture.pixels[~region])
    assert (result.image.pixels[region] != texture.pixels[region]).any(axis=1).mean() > 0.9
    np.testing.assert_array_equal(result.keep, ~region)
    assert result.image.channels == texture.channels


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize(
    "boxes",
    [
        (BOX,),
        (np.s_[:10, :14],),
        (np.s_[5:12, 5:12], np.s_[70:80, 60:75]),
        (np.s_[40:50, :],),
    ],
    ids=["inside", "corner", "apart", "band"],
)
def test_only_the_region_changes(
    texture: Image, exemplar: Image, boxes: tuple[tuple[slice, slice], ...], tileable: bool
) -> None:
    region = marked(*boxes)
    assert_only(run(texture, exemplar, region, tileable=tileable), texture, region)


def test_every_seed_gives_another_result_which_any_number_of_threads_repeats(
    texture: Image, exemplar: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    region = marked(BOX)
    one, two = run_with_threads(lambda: run(texture, exemplar, region).image.pixels, monkeypatch, (1, 2))
    np.testing.assert_array_equal(one, two)
    others = [run(texture, exemplar, region, seed=seed).image.pixels[region] for seed in range(4)]
    assert len({pixels.tobytes() for pixels in (*others, one[region])}) == 5


def test_a_hole_in_a_copy_of_the_exemplar_is_healed(rng: np.random.Generator) -> None:
    """Whatever is in it; the right content is among the candidates."""
    exemplar = picture(blobs((120, 120, 3), rng))
    texture = Image(exemplar.pixels[10:110, 10:110].copy(), exemplar.channels)
    whole = texture.pixels.copy()
    region = marked(np.s_[44:56, 44:56], size=(100, 100))
    texture.pixels[region] = 0
    errors = [
        np.abs(run(texture, exemplar, region, seed=seed).image.pixels - whole)[region].mean() for seed in range(3)
    ]
    assert min(errors) < 0.2 * whole.std()


def test_a_region_across_the_border_continues_both_sides(exemplar: Image, texture: Image) -> None:
    """A tileable texture is revised as the same texture with its border elsewhere."""
    region = marked(np.s_[:8, 20:60], np.s_[-8:, 20:60])
    wrapped = run(texture, exemplar, region, tileable=True).image.pixels
    rolled = Image(np.roll(texture.pixels, 40, axis=0), texture.channels)
    expected = run(rolled, exemplar, np.roll(region, 40, axis=0), tileable=True).image.pixels
    np.testing.assert_array_equal(np.roll(wrapped, 40, axis=0), expected)


def test_a_texture_that_wraps_stays_so(exemplar: Image, texture: Image, caplog: pytest.LogCaptureFixture) -> None:
    region = marked(np.s_[:8, 20:60], np.s_[-8:, 20:60])
    asked = run(texture, exemplar, region, tileable=True).image
    assert not caplog.records
    kept = run(texture.wrapping(True), exemplar, region).image
    assert "keeps tiling" in caplog.text
    np.testing.assert_array_equal(kept.pixels, asked.pixels)
    assert kept.wraps == asked.wraps == TORUS
    undone = run(texture.wrapping(True), exemplar, region, tileable=False).image
    assert not undone.wraps
    assert (undone.pixels != asked.pixels).any()


@pytest.mark.parametrize("wrap", [X, Y])
def test_a_texture_that_wraps_along_one_axis_stays_so(exemplar: Image, texture: Image, wrap: Wraps) -> None:
    """A region across its border is revised as in the middle of the texture with its border elsewhere."""
    region = (
        marked(np.s_[:8, 20:60], np.s_[-8:, 20:60]) if wrap == Y else marked(np.s_[20:60, :8], np.s_[20:60, -8:])
    )
    axis = int(wrap == X)
    made = run(texture.wrapping(wrap), exemplar, region).image
    assert made.wraps == wrap
    rolled = Image(np.roll(texture.pixels, 40, axis), texture.channels)
    expected = run(rolled, exemplar, np.roll(region, 40, axis), tileable=wrap).image.pixels
    np.testing.assert_array_equal(np.roll(made.pixels, 40, axis), expected)


@pytest.mark.parametrize("shift", [(0, 0), (13, 22)])
def test_the_lattice_goes_on(shift: tuple[int, int], rng: np.random.Generator) -> None:
    """Elements keep their places, whatever the phase of the texture."""
    exemplar, generators = tiled(blobs((20, 28, 3), rng, 2.0), 0, (120, 140))
    noisy = Image(exemplar.pixels + rng.normal(0, 0.01, exemplar.shape).astype(np.float32), exemplar.channels)
    whole = np.roll(exemplar.pixels[:100, :112], shift, axis=(0, 1))
    region = marked(np.s_[30:66, 34:80], size=(100, 112))
    texture = Image(np.where(region[..., None], np.float32(0.5), whole), exemplar.channels)
    made = run(texture, noisy, region, generators=generators).image.pixels
    assert np.abs(made - whole)[region].mean() < 0.25 * whole.std()


def test_maps_are_revised_together(exemplar: Image, texture: Image) -> None:
    """They stay functions of each other."""

    def with_height(image: Image) -> Image:
        height = image.pixels[..., :1] ** 2
        return Image(np.concatenate([image.pixels, height], axis=2), (*image.channels, "height"))

    region = marked(BOX)
    whole = with_height(texture)
    result = run(whole, with_height(exemplar), region, smooth=())
    assert_only(result, whole, region)
    made = result.image.pixels[region]
    assert np.abs(made[:, 3] - made[:, 0] ** 2).mean() < 0.1 * made[:, 3].std()


def test_masked_pixels_of_the_exemplar_are_not_copied(exemplar: Image, texture: Image) -> None:
    usable = np.ones(SHAPE, bool)
    usable[:, 30:45] = False
    region = marked(BOX)
    one, other = (run(texture, masked(exemplar, usable, value), region) for value in (0.0, 9.0))
    assert_only(one, texture, region)
    np.testing.assert_array_equal(one.image.pixels, other.image.pixels)


def test_an_exemplar_whose_mask_leaves_no_patch_is_refused(exemplar: Image, texture: Image) -> None:
    usable = np.zeros(SHAPE, bool)
    usable[::8] = True
    with pytest.raises(InputError, match=r"^exemplar: its mask leaves no whole patch of \d+ px; lower patch_size"):
        run(texture, masked(exemplar, usable, 0.0), marked(BOX))


@pytest.mark.parametrize("spread", [False, True])
def test_holes_in_the_same_surroundings_are_covered_by_other_parts(exemplar: Image, spread: bool) -> None:
    """If blocks are spread: otherwise each is the one that is a copy of the surroundings."""
    copies = np.tile(identity((48, 48)), (1, 2, 1))
    texture = Image(exemplar.pixels[copies[..., 0], copies[..., 1]], exemplar.channels)
    region = marked(np.s_[18:30, 18:30], np.s_[18:30, 66:78], size=(48, 96))
    revision = Revision(exemplar, None, 1.0, None, ReviseParams())
    first, second = (np.random.default_rng(seed) for seed in (1, 2))
    start = revision.start(texture, region, copies, NOWHERE, first, second, block=24, spread=spread)
    same = (start == copies).all(axis=2)
    assert same[:, :48][region[:, :48]].all()
    assert same[:, 48:][region[:, 48:]].all() == (not spread)


def test_a_source_map_is_continued(exemplar: Image) -> None:
    match = identity((60, 75))[10:, 15:]
    texture = Image(exemplar.pixels[10:60, 15:75].copy(), exemplar.channels)
    region = marked(np.s_[20:30, 20:30], size=(50, 60))
    result = run(texture, exemplar, region, match=match)
    assert result.match is not None
    np.testing.assert_array_equal(result.match[~region], match[~region])
    assert (result.match < SHAPE).all()
    assert run(texture, exemplar, region).match is None


def test_transparent_pixels_stay_and_leave_no_trace(exemplar: Image, texture: Image) -> None:
    """Nothing is matched to pixels whose alpha is below a half."""
    region, clear = marked(BOX), marked(np.s_[30:48, 57:60])
    results = []
    for value in (0.0, 1.0):
        pixels = np.where(clear[..., None], np.float32(value), texture.pixels)
        alpha = (~clear)[..., None].astype(np.float32)
        image = Image(np.concatenate([pixels, alpha], axis=2), ("R", "G", "B", "A"))
        result = run(image, exemplar, region, smooth=())
        assert_only(result, image, region)
        results.append(result.image.pixels[region])
    np.testing.assert_array_equal(results[0], results[1])


def test_time_does_not_depend_on_the_size_of_the_texture(exemplar: Image, rng: np.random.Generator) -> None:
    """The same surroundings give the same result, whatever is beyond them."""
    large = picture(blobs((300, 280, 3), rng))
    region = marked(np.s_[140:150, 130:140], size=(300, 280))
    part = np.s_[120:170, 110:160]
    small = Image(np.ascontiguousarray(large.pixels[part]), large.channels)
    made = run(large, exemplar, region).image.pixels[part]
    np.testing.assert_array_equal(made, run(small, exemplar, region[part]).image.pixels)


def test_progress_is_told(exemplar: Image, texture: Image) -> None:
    _, told = run_with_progress(lambda: run(texture, exemplar, marked(BOX, np.s_[:8, :8])))
    done = [progress.done for progress in told]
    assert done == sorted(done)
    assert done[-1] == pytest.approx(1)


@pytest.mark.parametrize(
    ("region", "problem"),
    [
        (np.zeros(SIZE), "no pixel is white"),
        (np.ones(SIZE), "all pixels are white"),
        (np.ones((10, 10)), "must have the size of the texture"),
    ],
)
def test_regions_that_are_refused(exemplar: Image, texture: Image, region: np.ndarray, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        run(texture, exemplar, region)


def test_an_exemplar_without_the_maps_is_refused(exemplar: Image, texture: Image) -> None:
    deep = Image(np.concatenate([texture.pixels, texture.pixels[..., :1]], axis=2), ("R", "G", "B", "height"))
    with pytest.raises(InputError, match="lacks the channel height"):
        run(deep, exemplar, marked(BOX))
    with pytest.raises(InputError, match="too small"):
        run(picture(np.ones((15, 60, 3))), exemplar, marked(np.s_[:2, :2], size=(15, 60)))


def test_grey_and_colour(exemplar: Image, texture: Image, caplog: pytest.LogCaptureFixture) -> None:
    grey = Image(exemplar.pixels[..., :1].copy(), ("Y",))
    assert_only(run(texture, grey, marked(BOX)), texture, marked(BOX))
    assert "the exemplar is grey, taken as three equal channels, as the texture is in colour" in caplog.messages
    with pytest.raises(InputError, match="exemplar: is in colour and the texture grey"):
        run(Image(texture.pixels[..., :1].copy(), ("Y",)), exemplar, marked(BOX))
