"""Doors, pipes, signs and sky are masked; clean surfaces are not; a given mask replaces the proposal."""

import logging

import numpy as np
import pytest

from benchmarks.foreign_parts import PARTS, WALLS, agreement, noise
from texloom.stages.analysis.photographs.foreign_parts import ForeignParts, ForeignPartsParams, foreign_parts
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.masks import valid_pixels

SIDE = 128


def wall(name: str) -> np.ndarray:
    return WALLS[name](np.random.default_rng(3), SIDE)


def searched(pixels: np.ndarray, **params: float) -> ForeignParts:
    return foreign_parts(Image(pixels, ("R", "G", "B")), ForeignPartsParams(**params))


@pytest.mark.parametrize(
    ("name", "part"),
    [("plaster", "door"), ("pebbles", "sign"), ("bricks", "sky"), ("bricks", "windows")],
)
def test_foreign_parts_are_masked(name: str, part: str, caplog: pytest.LogCaptureFixture) -> None:
    pixels, foreign = PARTS[part](np.random.default_rng(3), wall(name))
    with caplog.at_level(logging.WARNING):
        made = searched(pixels)
    found = made.mask.pixels[..., 0] < 0.5
    _, recall, both = agreement(found, foreign)
    assert recall > 0.97
    assert both > 0.5  # there is a margin of two pixels
    usable = valid_pixels(made.image)
    assert usable is not None
    np.testing.assert_array_equal(usable, ~found)
    assert made.table["masked"] == pytest.approx(found.mean(), abs=1e-3)
    assert "--source mask=foreign.png" in caplog.messages[0]


@pytest.mark.parametrize("name", WALLS)
def test_clean_surfaces_stay_whole(name: str) -> None:
    made = searched(wall(name))
    assert made.table["by"] == "none"
    assert made.table["masked"] == 0
    assert valid_pixels(made.image) is None


def test_windows_of_a_facade_are_explained_by_its_lattice() -> None:
    cell = np.full((32, 48, 3), 0.5, np.float32)
    cell[8:26, 12:34] = 0.03
    cell[10:16, 14:32] = (0.05, 0.1, 0.3)
    random = np.random.default_rng(0)
    facade = np.tile(cell, (6, 4, 1)) * random.normal(1, 0.03, (192, 192, 1)).astype(np.float32)
    facade[100:192, 60:140] = (0.3, 0.05, 0.02)
    image = Image(np.clip(facade, 0, 1), ("R", "G", "B"))
    generators = np.array([[32, 0], [0, 48]], np.float32)
    made = foreign_parts(image, ForeignPartsParams(), generators=generators)
    found = made.mask.pixels[..., 0] < 0.5
    assert made.table["by"] == "lattice"
    assert found[104:188, 64:136].mean() > 0.97
    assert found[:90].mean() < 0.02
    assert made.table["cells"] == pytest.approx((~found).sum() / (32 * 48), abs=0.1)


def small_tiles() -> np.ndarray:
    """Of 32 columns, of coarse grain and their own tones, with a corner of dull ones; joints are one pixel wide."""
    random = np.random.default_rng(5)
    tone = np.exp(random.normal(0, 0.12, (32, 32)))
    tone[:9, :9] *= 0.6
    rows, columns = np.indices((640, 640))
    joint = (rows % 20 == 0) | (columns % 20 == 0)
    grain = 1 + 0.25 * noise(random, (640, 640), 1.5)
    light = np.where(joint, 0.12, 0.3) * tone[rows // 20, columns // 20] * grain
    return np.repeat(np.clip(light, 0, 1).astype(np.float32)[..., None], 3, axis=2)


def test_plants_before_small_tiles_are_masked_and_dull_tiles_are_not() -> None:
    """At the size at which is searched a tile has 15 px, too few for a mean cell that explains the picture."""
    pixels = small_tiles()
    random = np.random.default_rng(6)
    leaves = noise(random, (640, 640), 4.0) > -0.8
    rows, columns = np.indices((640, 640))
    plant = leaves & (np.hypot(rows - 640, columns - 640) < 200)
    pixels = np.where(plant[..., None], [0.03, 0.1, 0.02] * np.exp(random.normal(0, 0.4, (640, 640, 1))), pixels)
    generators = np.array([[20, 0], [0, 20]], np.float32)
    made = foreign_parts(Image(pixels.astype(np.float32), ("R", "G", "B")), ForeignPartsParams(), generators)
    found = made.mask.pixels[..., 0] < 0.5
    assert made.table["by"] == "lattice"
    assert found[plant].mean() > 0.95
    assert not found[:400, :400].any()


def test_lined_surfaces_that_do_not_repeat_are_doubted(caplog: pytest.LogCaptureFixture) -> None:
    """As a facade with string courses, of which a texture joins pieces."""
    lined = wall("plaster")
    for row in (9, 20, 31, 50, 66, 77, 95, 111):
        lined[row : row + 2] *= 0.78
    assert not searched(wall("plaster")).table["doubt"]
    with caplog.at_level(logging.WARNING):
        assert "joins pieces" in str(searched(lined).table["doubt"])
    assert any("--crop" in message for message in caplog.messages)
    image = Image(lined, ("R", "G", "B"))
    generators = np.array([[0, 24]], np.float32)
    assert not foreign_parts(image, ForeignPartsParams(), generators).table["doubt"]


def test_of_several_surfaces_the_main_one_is_taken() -> None:
    random = np.random.default_rng(3)
    pixels, other, third = (WALLS[name](random, 192) for name in ("pebbles", "bricks", "plaster"))
    main = np.ones((192, 192), np.bool_)
    pixels[:96] = other[:96]
    pixels[:100, 120:] = third[:100, 120:]
    for row, column in ((20, 15), (20, 70), (20, 140)):
        pixels[row : row + 50, column : column + 32] = np.linspace(0.02, 0.3, 32)[None, :, None]
    main[:96], main[:100, 120:] = False, False
    made = searched(pixels)
    taken = made.mask.pixels[..., 0] > 0.5
    assert "the picture shows several surfaces" in made.table["doubt"]
    assert taken[main].mean() > 0.85
    assert taken[~main].mean() < 0.01
    # of a plane that is little of the photograph, it is too little
    plane = {"taken": 1, "unasked": False, "extended": 1.0, "planes": [{"area": 0.15}]}
    with pytest.raises(InputError, match="several surfaces do"):
        foreign_parts(Image(pixels, ("R", "G", "B")), ForeignPartsParams(), plane=plane)


def test_what_shutters_surround_is_masked_with_them() -> None:
    """A pane that mirrors what the wall looks like; but not the wall between a door and the street."""
    pixels = wall("plaster").copy()
    for rows, columns in (
        (slice(16, 24), slice(30, 96)),
        (slice(16, 66), slice(30, 48)),
        (slice(16, 66), slice(78, 96)),
    ):
        pixels[rows, columns] = (0.3, 0.02, 0.02)
    pixels[118:] = (0.02, 0.02, 0.02)
    pixels[90:, 56:68] = (0.02, 0.02, 0.02)
    found = searched(pixels).mask.pixels[..., 0] < 0.5
    assert found[18:62, 32:94].all()
    assert found[120:].all()
    assert found[76:114, :48].mean() < 0.1
    assert found[76:114, 76:].mean() < 0.1


def test_large_values_keep_all() -> None:
    pixels, _ = PARTS["door"](np.random.default_rng(3), wall("plaster"))
    assert searched(pixels, unlike=1000).table["by"] == "none"


def test_a_given_mask_replaces_the_proposal() -> None:
    pixels, _ = PARTS["door"](np.random.default_rng(3), wall("plaster"))
    white = np.ones((SIDE, SIDE, 3), np.float32)
    white[:40] = 0
    image = Image(pixels, ("R", "G", "B"))
    made = foreign_parts(image, ForeignPartsParams(), mask=Image(white, ("R", "G", "B")))
    np.testing.assert_array_equal(made.mask.pixels, white)
    assert made.table["by"] == "mask"


def test_the_proposal_given_back_is_the_same() -> None:
    pixels, _ = PARTS["door"](np.random.default_rng(3), wall("plaster"))
    first = searched(pixels)
    again = foreign_parts(Image(pixels, ("R", "G", "B")), ForeignPartsParams(), mask=first.mask)
    np.testing.assert_array_equal(again.image.pixels, first.image.pixels)


def test_too_few_cells_are_refused() -> None:
    pixels, _ = PARTS["door"](np.random.default_rng(3), wall("plaster"))
    image = Image(pixels, ("R", "G", "B"))
    generators = np.array([[120, 0], [0, 120]], np.float32)
    with pytest.raises(InputError, match=r"no surface stands out.*--set unlike=1000"):
        foreign_parts(image, ForeignPartsParams(), generators=generators)


def test_what_was_excluded_stays_so_and_has_no_influence() -> None:
    pixels, _ = PARTS["door"](np.random.default_rng(3), wall("plaster"))
    alpha = np.ones((SIDE, SIDE, 1), np.float32)
    alpha[:, :20] = 0
    other = pixels.copy()
    other[:, :20] = (0, 1, 0)
    one, two = (
        foreign_parts(Image(np.concatenate([colors, alpha], 2), ("R", "G", "B", "A")), ForeignPartsParams())
        for colors in (pixels, other)
    )
    np.testing.assert_array_equal(one.mask.pixels, two.mask.pixels)
    assert not one.mask.pixels[:, :20].any()


def test_what_nobody_sees_is_not_foreign() -> None:
    grey = np.full((SIDE, SIDE, 3), 0.4, np.float32)
    grey += np.random.default_rng(1).normal(0, 0.001, grey.shape).astype(np.float32)
    grey[30:70, 40:80] *= 1.01
    assert searched(grey).table["by"] == "none"
