"""What stands out on plain surfaces, of which little else is seen."""

from __future__ import annotations

import numpy as np

from tests.synthetic import smooth_noise
from texloom.stages.analysis.photographs.blemishes import blemishes
from texloom.stages.analysis.photographs.foreign_parts import ForeignPartsParams, foreign_parts
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import linear_from_lab

SHAPE = (180, 240)
ALL, NONE = np.ones(SHAPE, np.bool_), np.zeros(SHAPE, np.bool_)


def plaster(rng: np.random.Generator, deviation: float = 1.0) -> np.ndarray:
    """CIELAB that hardly varies, with light that falls off."""
    down = np.linspace(0, 1, SHAPE[0])[:, None]
    noise = smooth_noise(SHAPE, 1, rng)
    lightness = 60 - 8 * down + deviation * (noise - 0.5) / noise.std()
    return np.stack([lightness, 1 + 0 * lightness, 5 - 3 * down + 0 * lightness], axis=2).astype(np.float32)


def test_vents_of_a_plain_wall_are_found_whole(rng: np.random.Generator) -> None:
    lab = plaster(rng)
    vents = NONE.copy()
    vents[30:38, 50:60] = vents[30:38, 180:190] = True
    lab[vents] -= (15, 0, 0)
    found = blemishes(lab, ALL, NONE)
    assert found[vents].mean() > 0.95
    assert found[~vents].mean() < 0.005


def test_nothing_stands_out_where_details_are_usual(rng: np.random.Generator) -> None:
    plain = plaster(rng)
    assert not blemishes(plain, ALL, NONE).any()
    rough = plaster(rng, 4.0)
    rough[30:38, 50:60] -= (30, 0, 0)
    assert not blemishes(rough, ALL, NONE).any()
    dotted = plain.copy()
    for row in range(15, 180, 40):
        for column in range(15, 240, 40):
            dotted[row : row + 5, column : column + 5] -= (20, 0, 0)
    assert not blemishes(dotted, ALL, NONE).any()


def test_rims_of_foreign_parts_belong_to_these(rng: np.random.Generator) -> None:
    """Each of six windows has a dark rim, that no blemish alone may be as often."""
    lab, windows, rims = plaster(rng), NONE.copy(), NONE.copy()
    for row in (30, 110):
        for column in (30, 100, 170):
            windows[row : row + 40, column : column + 30] = True
            rims[row : row + 40, column - 4 : column] = True
    lab[rims] -= (8, 0, 0)
    lab[windows] = (20, 0, 0)
    found = blemishes(lab, ALL, windows)
    assert found[rims].mean() > 0.9
    assert not (found & windows).any()
    assert found[~rims].mean() < 0.01


def test_foreign_parts_masks_them(rng: np.random.Generator) -> None:
    lab = plaster(rng)
    lab = lab + np.linspace(0, 1, SHAPE[0])[:, None, None] * np.array([8, 0, 3])  # no drift
    lab[60:72, 100:112] -= (25, 0, 0)
    made = foreign_parts(Image(linear_from_lab(lab.astype(np.float32)), ("R", "G", "B")), ForeignPartsParams())
    assert (made.mask.pixels[62:70, 102:110] == 0).all()
    assert 0 < made.table["masked"] < 0.02
