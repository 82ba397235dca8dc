"""Directions along control maps, and textures that turn with them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.control.control_direction import (
    ControlDirection,
    ControlDirectionParams,
    control_direction,
)
from texloom.stages.analysis.similarity.appearance_stack import AppearanceStackParams, appearance_stack
from texloom.stages.common.features.control import from_painted
from texloom.stages.synthesis.per_pixel.per_pixel import PerPixelParams, per_pixel
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SIDE = 96
DEGREES = np.pi / 180


def painted(values: np.ndarray) -> Image:
    return from_painted(np.asarray(values[..., None], np.float32), ("Y",))


def directions(values: np.ndarray, image: Image | None = None, **params: object) -> ControlDirection:
    return control_direction(painted(values), ControlDirectionParams(**params), image)  # type: ignore[arg-type]


def off(angle: np.ndarray, true: np.ndarray | float, whole: float = 360) -> np.ndarray:
    """By how much directions, or with ``whole`` 180 orientations, differ, degrees."""
    return np.asarray(np.abs(((angle - true) / DEGREES + whole / 2) % whole - whole / 2))


def slope(degrees: float) -> np.ndarray:
    """Values that rise in a direction."""
    rows, columns = np.indices((SIDE, SIDE))
    return np.asarray((columns * np.cos(degrees * DEGREES) + rows * np.sin(degrees * DEGREES)) / (2 * SIDE) + 0.5)


def bend(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Distance to a line that bends, px."""
    middle = SIDE / 2 + 12 * np.sin(columns / SIDE * 2 * np.pi)
    return np.asarray(np.abs(rows - middle))


@pytest.mark.parametrize("degrees", [0, 45, 100, 180, 260, 330])
def test_slopes_rise_on_the_same_hand(degrees: float) -> None:
    found = directions(slope(degrees))
    hand = directions(slope(0)).angle[0, 0] / DEGREES
    assert off(found.angle, (degrees + hand) * DEGREES).max() < 2
    down = np.stack([found.jacobian[..., 0], found.jacobian[..., 2]], axis=2)  # rows and columns of one unit down
    assert off(np.arctan2(down[..., 0], down[..., 1]) + np.pi, degrees * DEGREES, 180).max() < 2


def test_rings_turn_all_the_way_without_a_break() -> None:
    rows, columns = np.indices((SIDE, SIDE)) - SIDE / 2
    radius = np.hypot(rows, columns)
    angle = directions(radius / SIDE, sigma=4).angle
    away = radius > 16
    assert off(angle, np.arctan2(rows, columns) + np.pi / 2, 180)[away].max() < 4
    for axis in (0, 1):
        steps = np.cos(np.diff(np.where(away, angle, np.nan), axis=axis))
        assert np.nanmin(steps) > 0.9


def test_all_channels_count() -> None:
    rows, columns = np.indices((SIDE, SIDE)) / SIDE
    plane = 0 * rows
    control = from_painted(np.stack([rows, plane, plane], axis=2).astype(np.float32), ("R", "G", "B"))
    assert off(control_direction(control, ControlDirectionParams()).angle, 0, 180).max() < 2
    control = from_painted(np.stack([plane, columns, plane], axis=2).astype(np.float32), ("R", "G", "B"))
    assert off(control_direction(control, ControlDirectionParams()).angle, np.pi / 2, 180).max() < 2


def test_even_regions_take_the_directions_around_them() -> None:
    control = np.clip(slope(60), 0.4, 0.7)
    found = directions(control, sigma=3)
    assert off(found.angle, 150 * DEGREES, 180).max() < 10


def test_an_even_map_has_a_direction() -> None:
    assert off(directions(np.full((SIDE, SIDE), 0.5)).angle, 0, 180).max() < 1e-3


def test_steps_of_eight_bits_are_no_contours() -> None:
    """A slope of less than a step of an 8-bit picture for each pixel."""
    coarse = np.round(255 * (0.3 + 0.2 * slope(20))) / 255
    assert np.quantile(off(directions(coarse).angle, 110 * DEGREES, 180), 0.9) < 6


def test_a_field_has_the_size_of_the_texture_or_the_wanted_one() -> None:
    control = slope(30)
    assert directions(control).angle.shape == (SIDE, SIDE)
    image = picture(np.zeros((48, 48)))
    assert directions(control, image).angle.shape == (48, 48)
    larger = directions(control, image, size=(120, 120))
    assert larger.jacobian.shape == (120, 120, 4)
    assert larger.picture.pixels.shape == (120, 120, 3)
    assert off(larger.angle, directions(control).angle[0, 0]).max() < 2
    with pytest.raises(InputError, match=r"control: 96 x 96 px has another aspect ratio than size, 50 x 100 px"):
        directions(control, size=(100, 50))
    with pytest.raises(InputError, match=r"control: 96 x 96 px has another aspect ratio than image, 60 x 30 px"):
        directions(control, picture(np.zeros((30, 60))))


def test_a_value_that_is_not_finite_is_refused() -> None:
    control = slope(30)
    control[3, 4] = np.nan
    with pytest.raises(InputError, match="control has values that are not finite"):
        directions(control)


def test_a_single_row_is_refused() -> None:
    assert directions(np.array([[0.0, 1.0], [0.0, 1.0]])).angle.shape == (2, 2)
    with pytest.raises(InputError, match=r"control: 5 x 1 px have no directions; the minimum is 2 x 2 px"):
        directions(np.zeros((1, 5)))


@pytest.mark.parametrize(("tileable", "shift"), [("both", (40, 17)), ("x", (0, 17)), ("y", (40, 0))])
def test_a_tileable_map_has_tileable_directions(
    tileable: str, shift: tuple[int, int], rng: np.random.Generator
) -> None:
    """Moved around where it wraps, the map has the same directions elsewhere."""
    values = smooth_noise((SIDE, SIDE), 8.0, rng)
    angle = directions(values, tileable=tileable).angle
    moved = directions(np.roll(values, shift, (0, 1)), tileable=tileable).angle
    assert np.quantile(off(moved, np.roll(angle, shift, (0, 1)), 180), 0.95) < 3


def test_a_line_turns_with_its_control(rng: np.random.Generator) -> None:
    """Of a line that runs down only, one is made that runs across and bends; without directions it falls apart."""
    rows, columns = np.indices((SIDE, SIDE))
    distance = bend(columns, rows)
    texture = 0.3 + 0.1 * smooth_noise((SIDE, SIDE), 1.0, rng)
    texture[distance < 2.5] = 0.9
    image, control = picture(texture), painted(np.clip(distance / 40, 0, 1))
    wanted = bend(rows, columns)
    target = painted(np.clip(wanted / 40, 0, 1))
    own, other = (control_direction(one, ControlDirectionParams()).jacobian for one in (control, target))
    cover = []
    for turned, to in ((own, other), (None, None)):
        stack = appearance_stack(image, AppearanceStackParams(), jacobian=turned)
        made = per_pixel(
            image, stack.appearance, stack.basis, stack.candidates, stack.toroidal,
            PerPixelParams(control_weight=5), np.random.default_rng(3), control, target, turned, to,
        )  # fmt: skip
        cover.append(float((made.image.pixels[..., 0] > 0.6)[wanted < 1].mean()))
    assert cover[0] > 0.97
    assert cover[1] < cover[0] - 0.05
