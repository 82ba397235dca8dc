"""Distorted textures laid flat."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.flows.test_from_photographs import PLANE, REGION, plane, stripes
from tests.photographs import surfaces, unit_square
from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.photographs.unroll import Unroll, UnrollParams, unroll
from texloom.stages.synthesis.per_pixel.per_pixel import flat
from texloom.stages.vocabulary.declare import InputError


def test_a_plane_lies_as_its_homography_says(tmp_path: Path) -> None:
    photo = plane(stripes)
    surface = surfaces(photo, tmp_path, detail=0.6, patches=[{"corners": PLANE, "size": "1x2"}], region=[REGION])
    sharp = surface.region & (surface.level <= 0.5)
    made = unroll(photo, surface.jacobian, sharp[None], UnrollParams())
    back = unit_square(PLANE, *np.indices(sharp.shape))
    # beyond the patch Jacobians are a guess
    known = sharp & (back >= 0).all(axis=2) & (back <= 1).all(axis=2)
    away = (made.chart - back * [2, 1] * surface.scale)[known]
    wrong = np.abs(away - away.mean(axis=0)).max(axis=1)
    assert wrong.size > 5000
    assert wrong.max() < 0.25
    assert np.quantile(wrong, 0.99) < 0.05
    # the flat picture shows the stripes that the photograph is of
    usable = made.image.pixels[..., 3] > 0.5
    down, across = (np.moveaxis(np.indices(usable.shape), 0, 2) - away.mean(axis=0)).T / surface.scale
    seen, expected = made.image.pixels[..., 0][usable], stripes(down.T, across.T)[usable]
    assert np.count_nonzero(usable) > 2000
    assert np.corrcoef(seen, expected)[0, 1] > 0.85


def frontal(max_side: int = 64, hole: bool = False) -> tuple[np.ndarray, Unroll]:
    image = picture(smooth_noise((40, 60, 3), 1.5, np.random.default_rng(1)))
    sharp = np.ones((1, 40, 60), bool)
    sharp[0, 10:20, 30:35] = not hole
    return image.pixels, unroll(image, flat((40, 60)), sharp, UnrollParams(max_side=max_side))


def test_what_is_flat_stays() -> None:
    pixels, made = frontal()
    np.testing.assert_allclose(made.image.pixels[..., :3], pixels, atol=1e-5)
    assert (made.image.pixels[..., 3] == 1).all()
    np.testing.assert_allclose(made.chart, np.moveaxis(np.indices((40, 60)), 0, 2), atol=1e-3)


def test_of_a_large_texture_the_middle_is_shown() -> None:
    pixels, made = frontal(max_side=20)
    np.testing.assert_allclose(made.image.pixels[..., :3], pixels[10:30, 20:40], atol=1e-5)
    np.testing.assert_allclose(made.chart[10, 20], 0, atol=1e-3)


def test_holes_are_marked() -> None:
    pixels = frontal(hole=True)[1].image.pixels
    usable = pixels[..., 3]
    assert (pixels[10:20, 30:35, :3] == 0).all()
    assert (usable[10:20, 30:35] == 0).all()
    assert usable.sum() == 40 * 60 - 50


def test_nothing_sharp_is_told() -> None:
    image = picture(np.zeros((20, 20), np.float32))
    with pytest.raises(InputError, match="finest level"):
        unroll(image, flat((20, 20)), np.zeros((1, 20, 20), bool), UnrollParams())
