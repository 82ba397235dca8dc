"""Signs, cornices, pipes and cracks are left out; surfaces that show nothing once stay as they are."""

import logging

import numpy as np
import pytest

from benchmarks.foreign_parts import PARTS, WALLS
from texloom.stages.analysis.one_off.crossing_lines import crossing_line
from texloom.stages.analysis.one_off.one_off_parts import OneOffParts, OneOffPartsParams, one_off_parts
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import valid_pixels, with_usable

SIDE = 160


def wall(name: str) -> np.ndarray:
    return WALLS[name](np.random.default_rng(3), SIDE)


def searched(pixels: np.ndarray, one_off: str = "auto") -> OneOffParts:
    return one_off_parts(Image(pixels, ("R", "G", "B")), OneOffPartsParams(one_off=one_off))


def cracked(pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A dark line of three pixels that winds from border to border."""
    rows, columns = np.indices(pixels.shape[:2])
    line = np.abs(rows - 70 - 12 * np.sin(columns / 23)) < 1.5
    return np.where(line[..., None], 0.01, pixels).astype(np.float32), line


@pytest.mark.parametrize("name", WALLS)
def test_what_shows_nothing_once_stays_whole(name: str, caplog: pytest.LogCaptureFixture) -> None:
    pixels = wall(name)
    made = searched(pixels)
    assert made.table["done"] == "none"
    assert made.mask is made.picture is None
    assert valid_pixels(made.image) is None
    assert not caplog.messages


@pytest.mark.parametrize(("name", "part"), [("plaster", "pipe"), ("pebbles", "sign"), ("bricks", "sign")])
def test_parts_are_left_out(name: str, part: str, caplog: pytest.LogCaptureFixture) -> None:
    pixels, truth = PARTS[part](np.random.default_rng(3), wall(name))
    with caplog.at_level(logging.WARNING):
        made = searched(pixels)
    usable = valid_pixels(made.image)
    assert made.table["done"] == "left out"
    assert usable is not None
    assert (~usable)[truth].mean() > 0.95
    assert (~usable)[~truth].mean() < 0.06
    assert ".one_off=use" in caplog.messages[0]
    assert made.mask is not None
    np.testing.assert_array_equal(made.mask.pixels[..., 0] > 0.5, usable)


def test_a_doubtful_crack_from_border_to_border_is_left_out_on_request() -> None:
    pixels, line = cracked(wall("pebbles"))
    assert searched(pixels).table["done"] == "told"
    made = searched(pixels, "leave_out")
    assert made.mask is not None
    found = made.mask.pixels[..., 0] < 0.5
    assert made.table["done"] == "left out"
    assert len(made.table["lines"]) == 1
    assert found[line].mean() > 0.95
    assert found.mean() < 0.1


def test_cracks_in_both_directions_of_a_picture_are_alike() -> None:
    pixels, line = cracked(wall("plaster"))
    valid = np.ones(line.shape, np.bool_)
    across, down = (
        crossing_line(Image(np.ascontiguousarray(one), ("R", "G", "B")), valid)
        for one in (pixels, pixels.transpose(1, 0, 2))
    )
    assert across is not None
    assert down is not None
    assert (across.along, down.along) == (1, 0)
    np.testing.assert_array_equal(across.mask, down.mask.T)
    assert across.stands_out == pytest.approx(down.stands_out)


def test_several_cracks_are_how_the_surface_is() -> None:
    pixels, line = wall("pebbles"), cracked(wall("pebbles"))[1]
    for shift in (0, 40, 80, 120):
        pixels = np.where(np.roll(line, shift, axis=0)[..., None], np.float32(0.01), pixels)
    assert searched(pixels).table["lines"] == []


def with_pebbles(share: float) -> np.ndarray:
    """Plaster, the left of which is of green pebbles."""
    pixels = wall("plaster").copy()
    pixels[:, : int(share * SIDE)] = wall("pebbles")[:, : int(share * SIDE)] * (0.1, 0.6, 0.1)
    return pixels


def test_a_strip_of_up_to_a_third_is_left_out() -> None:
    made = searched(with_pebbles(0.25))
    usable = valid_pixels(made.image)
    assert made.table["done"] == "left out"
    assert usable is not None
    assert not usable[:, :38].any()
    assert usable[:, 46:].all()


@pytest.mark.parametrize(("one_off", "done"), [("auto", "left out"), ("keep_whole", "kept whole"), ("use", "none")])
def test_margins_that_were_found_before_are_told_here(one_off: str, done: str) -> None:
    """They are excluded in the image already, and may be of the size that it had before it was scaled."""
    image = Image.of(wall("plaster"))
    margins = np.arange(SIDE // 2)[:, None] < np.full(SIDE // 2, 10)
    strip = np.repeat(np.repeat(margins, 2, axis=0), 2, axis=1)
    made = one_off_parts(with_usable(image, ~strip), OneOffPartsParams(one_off=one_off), margins=margins)
    assert made.table["done"] == done
    assert made.table["share"] == (0 if one_off == "use" else pytest.approx(0.125, abs=0.01))
    assert made.kept.any() == (one_off == "keep_whole")
    assert (made.mask is None) == (one_off == "use")
    if made.mask is not None:
        np.testing.assert_array_equal(made.mask.pixels[..., 0] < 0.5, strip)
        assert "along a border" in made.table["why"]


def test_doubtful_parts_beside_margins_are_left_out_on_request() -> None:
    pixels, line = cracked(wall("pebbles"))
    strip = np.zeros(line.shape, np.bool_)
    strip[:20] = True
    image = with_usable(Image(pixels, ("R", "G", "B")), ~strip)
    for one_off, some in (("auto", False), ("leave_out", True)):
        made = one_off_parts(image, OneOffPartsParams(one_off=one_off), margins=strip)
        assert made.mask is not None
        assert (made.mask.pixels[..., 0][line] < 0.5).any() == some


def test_two_halves_are_told_but_used(caplog: pytest.LogCaptureFixture) -> None:
    pixels = with_pebbles(0.4)
    with caplog.at_level(logging.WARNING):
        made = searched(pixels)
    assert made.table["done"] == "told"
    assert valid_pixels(made.image) is None
    assert ".one_off=leave_out" in caplog.messages[0]
    assert valid_pixels(searched(pixels, "leave_out").image) is not None


def test_nothing_is_searched_where_all_is_to_be_used() -> None:
    pixels, _ = PARTS["sign"](np.random.default_rng(3), wall("bricks"))
    assert searched(pixels, "use").table["done"] == "none"


def test_a_wish_that_changes_nothing_is_told(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        assert searched(wall("plaster"), "leave_out").table["done"] == "none"
    assert "changes nothing" in caplog.messages[0]


@pytest.mark.parametrize(("count", "radius", "done"), [(1, 45, "told"), (12, 14, "none")])
def test_another_material_is_in_few_pieces(count: int, radius: int, done: str) -> None:
    """Twelve discs are what the exemplar is of, as flowers are; one as large as all of them is something else."""
    rng = np.random.default_rng(3)
    pixels = (np.array([0.05, 0.2, 0.05]) + rng.normal(0, 0.02, (SIDE, SIDE, 1))).astype(np.float32)
    rows, columns = np.indices((SIDE, SIDE))
    for number in range(count):
        row, column = (80, 80) if count == 1 else (28 + number // 4 * 52, 20 + number % 4 * 40)
        pixels[np.hypot(rows - row, columns - column) < radius] = 0.9
    assert searched(np.clip(pixels, 0, 1)).table["done"] == done


def test_a_joint_across_several_materials_is_left_out() -> None:
    """Paint that has come off in places shows wood, and the joint of two planks once."""
    rng = np.random.default_rng(3)
    pixels = (0.8 + rng.normal(0, 0.02, (250, SIDE, 3))).astype(np.float32)
    rows, columns = np.indices(pixels.shape[:2])
    for row in (28, 80, 172, 224):
        for column in (20, 60, 100, 140):
            pixels[np.hypot(rows - row, columns - column) < 14] = (0.3, 0.25, 0.2)
    assert searched(pixels).table["done"] == "none"
    pixels[125:127] = 0.01
    made = searched(pixels)
    usable = valid_pixels(made.image)
    assert made.table["done"] == "left out"
    assert usable is not None
    assert not usable[125:127].any()
    assert usable.mean() > 0.9
