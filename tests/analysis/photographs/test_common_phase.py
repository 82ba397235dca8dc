"""The phase between a texture and the scene around its place."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from texloom.stages.analysis.photographs.common_phase import CommonPhaseParams, common_phase
from texloom.stages.synthesis.per_pixel.per_pixel import flat
from texloom.stages.vocabulary.arrays import Image

SIDES = (24.0, 30.0)  # px of a repetition
HOLE = np.s_[60:110, 70:130]


def tiles(shape: tuple[int, int], sides: tuple[float, float], offset: tuple[float, float], seed: int) -> Image:
    """Tiles with dark joints, each with a corner of its own, and noise."""
    down, across = (
        (np.arange(size) + part) % side / side for size, side, part in zip(shape, sides, offset, strict=True)
    )
    light = 0.6 - 0.4 * ((down < 0.15)[:, None] | (across < 0.15))
    light = light + 0.3 * ((down > 0.7)[:, None] & (across > 0.7))
    noise = np.random.default_rng(seed).normal(0, 0.03, shape)
    return Image(np.repeat((light + noise)[..., None], 3, axis=2).astype(np.float32).clip(0, 1), ("R", "G", "B"))


def laid(scene: Image, texture: Image, generators: Any, **params: Any) -> np.ndarray:
    """Where the hole's pixels lie in the texture; 7 px away from the hole's own place without a common phase."""
    region = np.ones((scene.height, scene.width), bool)
    region[HOLE] = False
    own = np.moveaxis(np.indices(region.shape), 0, 2)[HOLE] + 7
    place = flat(region.shape), region, own.astype(np.float32), np.array([60, 70])
    parts = texture, np.array(generators, np.float32).reshape(-1, 2), scene
    return common_phase(*parts, *place, CommonPhaseParams(**params)).chart


@pytest.mark.parametrize("generators", [[(24, 0), (0, 30)], [(24, 30), (0, -30)]])
def test_texture_continues_the_scene(generators: Any) -> None:
    scene, texture = tiles((220, 240), SIDES, (5, 11), 1), tiles((150, 160), SIDES, (0, 0), 2)
    chart = laid(scene, texture, generators)
    expected = np.moveaxis(np.indices((scene.height, scene.width)), 0, 2)[HOLE] + [5, 11]
    off = (chart - expected + np.array(SIDES) / 2) % SIDES - np.array(SIDES) / 2
    assert np.abs(off).max() < 1.2


@pytest.mark.parametrize(
    ("sides", "generators", "params"),
    [(SIDES, [], {}), (SIDES, [(24, 0), (0, 30)], {"tolerance": 0}), ((24.0, 42.0), [(24, 0), (0, 30)], {})],
)
def test_other_textures_keep_their_own_place(sides: tuple[float, float], generators: Any, params: Any) -> None:
    scene, texture = tiles((220, 240), sides, (5, 11), 1), tiles((150, 160), SIDES, (0, 0), 2)
    chart = laid(scene, texture, generators, **params)
    np.testing.assert_array_equal(chart, np.moveaxis(np.indices((220, 240)), 0, 2)[HOLE] + 7)


def test_a_scene_of_which_nothing_is_seen() -> None:
    texture = tiles((150, 160), SIDES, (0, 0), 2)
    scene, region = tiles((220, 240), SIDES, (5, 11), 1), np.zeros((220, 240), bool)
    own = np.zeros((50, 60, 2), np.float32)
    place = flat(region.shape), region, own, np.array([60, 70])
    made = common_phase(texture, np.array([[24, 0], [0, 30]], np.float32), scene, *place, CommonPhaseParams())
    np.testing.assert_array_equal(made.chart, own)
