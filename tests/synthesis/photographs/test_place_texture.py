"""Texture in photographs: detail that neither aliases nor blurs, and holes that are filled in their own light."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.photographs import psnr, reduced
from tests.synthetic import blobs, picture, smooth_noise
from texloom.stages.analysis.photographs.hole_window import HoleWindowParams, hole_window
from texloom.stages.synthesis.per_pixel.per_pixel import flat
from texloom.stages.synthesis.photographs.place_texture import PlaceTextureParams, place_texture
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SHAPE = (96, 120)


def placed(exemplar: Image, positions: np.ndarray, stretch: float = 1.0, **params: Any) -> np.ndarray:
    """All pixels of a photograph that shows the exemplar ``stretch`` times as large."""
    shape = positions.shape[:2]
    photo, everywhere = picture(np.zeros((*shape, 3))), np.ones(shape, bool)
    return place_texture(
        positions.astype(np.float32),
        exemplar,
        flat((exemplar.height, exemplar.width)),
        flat(shape) * np.float32(stretch),
        photo,
        everywhere,
        PlaceTextureParams(**params),
    ).image.pixels


def grid(shape: tuple[int, int], step: float) -> np.ndarray:
    """Positions that cover an exemplar from its first pixel's border."""
    return np.asarray((np.stack(np.indices(shape), axis=2) + 0.5) * step - 0.5)


@pytest.mark.parametrize("factor", [4, 8])
def test_reduced_texture_has_the_contrast_of_its_means(factor: int) -> None:
    """[Eisenacher2008]_ Figure 13."""
    fine = picture(np.repeat(blobs((256, 320), np.random.default_rng(3))[..., None], 3, axis=2))
    wanted = reduced(fine.color, factor)
    made = placed(fine, grid((256 // factor, 320 // factor), factor), 1 / factor)
    assert psnr(made, wanted) > 50
    assert made.std() / wanted.std() == pytest.approx(1, abs=0.01)


def test_magnified_texture_has_no_blocks() -> None:
    coarse = picture(smooth_noise((40, 50, 3), 2, np.random.default_rng(4)))
    made = placed(coarse, grid((160, 200), 0.25), 4.0)
    steps = np.abs(np.diff(made[20:-20, 20:-20], axis=1)).mean(axis=(0, 2))
    by_phase = [steps[phase::4].mean() for phase in range(4)]
    assert max(by_phase) / min(by_phase) < 1.2


def test_pieces_of_magnified_texture_fade_into_each_other() -> None:
    shades = picture(np.repeat(np.where(np.arange(60) < 30, 0.2, 0.8)[None, :, None], 40, axis=0).repeat(3, axis=2))
    for factor, most in ((1, 0.59), (4, 0.35)):
        positions = grid((20 * factor, 20 * factor), 1 / factor) + 5
        positions[:, 10 * factor :, 1] += 30  # from the dark half to the bright one
        made = placed(shades, positions, factor)
        steps = np.abs(np.diff(made[..., 0], axis=1))
        assert (steps.max() > most) == (factor == 1)
        beside = np.s_[:, 8 * factor : 12 * factor]
        assert set(np.unique(np.delete(made[..., 0], np.r_[beside[1]], axis=1).round(4))) == {
            np.float32(0.2),
            np.float32(0.8),
        }


@pytest.mark.parametrize("light", [0.0, 1.0])
def test_texture_takes_over_the_light_of_the_hole(light: float, rng: np.random.Generator) -> None:
    shadow = np.where(np.arange(SHAPE[1]) < SHAPE[1] // 2, 0.4, 1.0)[:, None]
    scene = picture(shadow * (0.4 + 0.1 * rng.random((*SHAPE, 3))))
    own = grid(SHAPE, 1.0).astype(np.float32)
    fine = picture(0.3 + 0.2 * rng.random((*SHAPE, 3)))
    params = PlaceTextureParams(light=light, softness=4)
    everywhere = np.ones(SHAPE, bool)
    made = place_texture(own, fine, flat(SHAPE), flat(SHAPE), scene, everywhere, params).image.pixels
    dark, bright = made[:, :40].mean(), made[:, -40:].mean()
    assert dark / bright == pytest.approx(0.4 if light else 1, rel=0.1)


def test_what_has_its_size_is_copied() -> None:
    fine = picture(np.random.default_rng(5).random((*SHAPE, 3)))
    np.testing.assert_allclose(placed(fine, grid(SHAPE, 1)), fine.pixels, atol=1e-6)
    np.testing.assert_allclose(placed(fine, grid(SHAPE, 1), reach=32.0), fine.pixels, atol=1e-4)


def test_a_hole_takes_the_light_around_it() -> None:
    """A copy from a bright part into a dark one."""
    noise = 0.3 + 0.3 * smooth_noise((*SHAPE, 3), 1.5, np.random.default_rng(6))
    photo = picture(noise * np.linspace(1, 0.2, SHAPE[1])[None, :, None])
    hole = np.zeros(SHAPE, bool)
    hole[40:60, 80:100] = True
    positions = (grid(SHAPE, 1) - np.where(hole[..., None], [0, 70], 0)).astype(np.float32)
    arguments = (positions, photo, flat(SHAPE), flat(SHAPE), photo, hole)
    plain, lit = (
        place_texture(*arguments, PlaceTextureParams(reach=reach), ~hole, around=~hole).image.pixels
        for reach in (None, 64.0)
    )
    np.testing.assert_array_equal(lit[~hole], photo.pixels[~hole])
    np.testing.assert_allclose(plain[hole], photo.pixels[np.roll(hole, -70, axis=1)], atol=1e-6)
    own = photo.pixels[hole]
    assert np.abs(plain[hole].mean() / own.mean() - 1) > 1
    assert lit[hole].mean() == pytest.approx(own.mean(), rel=0.1)
    assert lit[hole].std() == pytest.approx(own.std(), rel=0.3)


def test_threads_do_not_matter(on_threads: Any) -> None:
    fine = picture(np.random.default_rng(7).random((*SHAPE, 3)))
    np.testing.assert_array_equal(*on_threads(lambda: placed(fine, grid(SHAPE, 1.1), 0.7, reach=8.0)))


def test_what_does_not_fit_is_refused() -> None:
    nothing = np.zeros(SHAPE, bool)
    with pytest.raises(InputError, match=r"^hole: empty; give its polygons in the geometry file"):
        hole_window(nothing, flat(SHAPE), HoleWindowParams())
    photo, positions = picture(np.zeros((*SHAPE, 3))), np.zeros((*SHAPE, 2), np.float32)
    arguments = (positions, photo, flat(SHAPE), flat(SHAPE), photo)
    with pytest.raises(InputError, match=r"^hole: no pixel is marked"):
        place_texture(*arguments, nothing, PlaceTextureParams())
    with pytest.raises(ValueError, match="goes beyond the photograph"):
        place_texture(*arguments, ~nothing, PlaceTextureParams(), corner=np.array([1, 0]))
