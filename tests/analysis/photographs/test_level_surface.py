"""A surface whose lattice is bent and tilted a little becomes regular and level."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from tests.synthetic import LATTICES, bent, masked, stamped
from texloom.stages.analysis.photographs.level_surface import LevelSurface, LevelSurfaceParams, level_surface
from texloom.stages.analysis.regularity.deformed_lattice import DeformedLatticeParams, deformed_lattice
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import valid_pixels


def tilted(name: str, degrees: float) -> np.ndarray:
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    return LATTICES[name] @ np.array([[cosine, sine], [-sine, cosine]])


def level(image: Image, generators: np.ndarray, **params: bool) -> LevelSurface:
    return level_surface(image, generators.astype(np.float32), LevelSurfaceParams(**params))


@pytest.mark.parametrize("name", ["rectangular", "half_drop"])
def test_a_bent_and_tilted_lattice_becomes_regular_and_level(
    name: str, rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    generators = tilted(name, 1.2)
    image, _ = bent(generators, rng)
    with caplog.at_level(logging.WARNING):
        made = level(image, generators)
    assert "made straight and level" in caplog.text
    assert 3 <= made.table["moved"] <= 12
    np.testing.assert_allclose(made.generators, LATTICES[name], atol=0.5)
    before = deformed_lattice(image, DeformedLatticeParams(), generators.astype(np.float32))
    after = deformed_lattice(made.image, DeformedLatticeParams(), made.generators)
    assert after.deviation < 0.5 * before.deviation
    tilt = after.generators @ np.linalg.inv(made.generators.astype(np.float64))
    np.testing.assert_allclose(tilt, np.eye(2), atol=0.01)


def test_what_comes_from_beyond_or_is_excluded_is_not_used(rng: np.random.Generator) -> None:
    generators = tilted("rectangular", 1.2)
    image, _ = bent(generators, rng)
    valid = valid_pixels(level(image, generators).image)
    assert valid is not None
    assert not valid.all()
    assert valid[20:-20, 20:-20].all()
    usable = np.ones((image.height, image.width), bool)
    usable[100:130, 200:240] = False
    one, other = (level(masked(image, usable, value), generators).image for value in (0.0, 1.0))
    shown = valid_pixels(one)
    assert shown is not None
    assert not shown[110:120, 210:230].any()
    np.testing.assert_array_equal(one.color[shown], other.color[shown])


def test_a_surface_is_left_where_there_is_nothing_to_gain(rng: np.random.Generator) -> None:
    generators = LATTICES["rectangular"]
    regular = stamped(generators, rng)
    image, _ = bent(generators, rng)
    for one, given, params in (
        (regular, generators, {}),
        (image, generators, {"level": False}),
        (image, generators[:1], {}),
        (image, 0.61 * generators, {}),
    ):
        made = level(one, given, **params)
        assert made.image is one
        np.testing.assert_array_equal(made.generators, given.astype(np.float32))
        assert made.table["why"] == ""
