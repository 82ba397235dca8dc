"""Signs that a surface from the front is not flat, of surfaces that are and are not."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from tests.synthetic import smooth_noise
from texloom.stages.analysis.photographs.flatness import Flatness, flatness
from texloom.stages.analysis.photographs.foreign_parts import ForeignPartsParams, foreign_parts
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SHAPE = (216, 288)
ROWS, COLUMNS = np.indices(SHAPE).astype(float)
DOWN, ACROSS = (ROWS - 108) / 225, (COLUMNS - 144) / 225


def colored(light: np.ndarray) -> Image:
    """A grey picture."""
    return Image(np.repeat(np.clip(light, 0, 1)[..., None], 3, axis=2).astype(np.float32), ("R", "G", "B"))


def proposed(unasked: bool) -> dict[str, Any]:
    """What a plane proposal without planes tells."""
    return {"taken": 0, "unasked": unasked, "planes": []}


def noise_at(rng: np.random.Generator, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """An even texture without lines, at places of it."""
    texture = 0.4 + 0.12 * smooth_noise((512, 512), 2, rng)
    return np.asarray(map_coordinates(texture, [rows, columns], order=1, mode="grid-wrap"))


def coffers(rng: np.random.Generator, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Dark squares with a period of 1."""
    dark = (np.mod(rows, 1) > 0.3) & (np.mod(columns, 1) > 0.3)
    return np.asarray(np.where(dark, 0.15, 0.5) + rng.normal(0, 0.01, rows.shape))


def dome(rng: np.random.Generator) -> Image:
    """From below, not in the middle."""
    down, across = ROWS - 90, COLUMNS - 170
    return colored(coffers(rng, np.hypot(down, across) / 22, np.arctan2(down, across) * 20 / (2 * np.pi)))


def judged(image: Image) -> Flatness:
    """All of it."""
    return flatness(image, np.ones(SHAPE, np.bool_))


def test_flat_surfaces_show_no_sign(rng: np.random.Generator) -> None:
    grid, turned = coffers(rng, ROWS / 20, COLUMNS / 20), coffers(rng, (ROWS + COLUMNS) / 30, (ROWS - COLUMNS) / 30)
    for light in (noise_at(rng, ROWS, COLUMNS), grid, turned, np.full(SHAPE, 0.5)):
        assert judged(colored(light)) == Flatness(0.0, 0.0, 0.0, 0.0)


def test_lines_of_a_dome_turn_around_its_point(rng: np.random.Generator) -> None:
    found = judged(dome(rng))
    assert found.is_curved
    assert "as in a dome" in found.reason


@pytest.mark.parametrize("turned", [False, True])
def test_even_texture_shows_perspective_by_its_directions(turned: bool, rng: np.random.Generator) -> None:
    along = DOWN if turned else ACROSS
    depth = 1 / (1 - 0.6 * along)
    found = judged(colored(noise_at(rng, 250 * DOWN * depth, 250 * ACROSS * depth)))
    assert found.keystone > 5
    assert not found.is_curved
    assert "as in perspective" in found.reason


@pytest.mark.parametrize("lying", [False, True])
def test_a_column_becomes_darker_and_finer_to_both_sides(lying: bool, rng: np.random.Generator) -> None:
    across = (ROWS - 108) / 125 if lying else (COLUMNS - 144) / 160
    angle = np.arcsin(across)
    places = (150 * angle, COLUMNS) if lying else (ROWS, 150 * angle)
    found = judged(colored(noise_at(rng, *places) * np.cos(angle)))
    assert found.falling > 0.05
    assert "as a column" in found.reason
    assert not judged(colored(noise_at(rng, *places))).falling
    assert not judged(colored(noise_at(rng, ROWS, COLUMNS) * np.cos(angle))).falling


def test_foreign_parts_refuses_domes_unless_all_is_kept(rng: np.random.Generator) -> None:
    image = dome(rng)
    with pytest.raises(InputError, match=r"is not flat.*as in a dome.*--set unlike=1000 takes it as flat"):
        foreign_parts(image, ForeignPartsParams())
    assert not foreign_parts(image, ForeignPartsParams(unlike=1000)).table["doubt"]


def test_perspective_is_told_where_no_lines_were_straightened(
    rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    depth = 1 / (1 - 0.6 * ACROSS)
    image = colored(noise_at(rng, 250 * DOWN * depth, 250 * ACROSS * depth))
    with caplog.at_level(logging.WARNING):
        unasked = foreign_parts(image, ForeignPartsParams(), plane=proposed(unasked=True)).table["doubt"]
    assert "as in perspective" in unasked
    assert unasked in caplog.messages
    assert not foreign_parts(image, ForeignPartsParams(), plane=proposed(unasked=False)).table["doubt"]


def test_several_surfaces_are_told_where_no_plane_is_evident(rng: np.random.Generator) -> None:
    light = noise_at(rng, ROWS, COLUMNS)
    both = np.where((COLUMNS > 210)[..., None], [0.1, 0.02, 0.02], light[..., None]).astype(np.float32)
    image = Image(both, ("R", "G", "B"))
    told = foreign_parts(image, ForeignPartsParams(), plane=proposed(unasked=True)).table
    assert told["masked"] > 0.2
    assert "no plane is evident" in told["doubt"]
    assert "--source mask=foreign.png" in told["doubt"]
    assert not foreign_parts(image, ForeignPartsParams()).table["doubt"]


def rough(rng: np.random.Generator) -> np.ndarray:
    """An even texture of much contrast."""
    return 0.4 + 6 * (noise_at(rng, ROWS, COLUMNS) - 0.4)


def folds() -> np.ndarray:
    """Light on folds that run down, as of cloth, from the side."""
    return np.asarray(0.15 + np.square(np.sin(COLUMNS / 40 + ROWS / 200)))


def test_light_and_contrast_change_together_in_folds(rng: np.random.Generator) -> None:
    found = judged(colored(rough(rng) * folds()))
    assert found.folding > 0
    assert not found.is_curved
    assert "folds" in found.reason


def test_stripes_of_other_tone_and_slow_light_are_no_folds(rng: np.random.Generator) -> None:
    texture = rough(rng)
    slow = 0.2 + 0.8 * (ROWS + COLUMNS) / 500
    for light in (texture * slow, 0.5 * folds() + 0.3 * (texture - 0.4) + 0.05):
        assert judged(colored(light)).folding == 0
