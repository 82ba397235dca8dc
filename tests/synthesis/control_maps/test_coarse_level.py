"""The coarse level of a texture, and whether it is used."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.common.features.control import check_pair, fit_scale
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.synthesis.control_maps.coarse_choice import coarse_choice
from texloom.stages.synthesis.control_maps.coarse_level import CoarseLevelParams, coarse_level
from texloom.stages.synthesis.control_maps.joint_upsampling import along_control
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Params
from texloom.stages.vocabulary.frame_stacks import stack_channels


def pair() -> tuple[Image, Image]:
    """Land and sea; the land's colour drifts where control is constant."""
    land = np.arange(72)[None, :] < 30 + 6 * np.sin(np.arange(48)[:, None] / 7)
    drift = np.linspace(0.1, 0.6, 48)[:, None, None] * np.ones((1, 72, 3))
    colours = np.where(land[..., None], drift, [0.02, 0.05, 0.4])
    return picture(colours), Image(land.astype(np.float32)[..., None], ("height",))


def naive(coarse: np.ndarray, control: np.ndarray) -> np.ndarray:
    """`along_control`, pixel by pixel, for one channel of control from 0 to 1."""
    height, width = coarse.shape[:2]
    rows, columns = control.shape[:2]
    own = resize(control, height, width)[..., 0]
    made = np.zeros((rows, columns, coarse.shape[2]))
    for row in range(rows):
        for column in range(columns):
            y, x = (row + 0.5) * height / rows - 0.5, (column + 0.5) * width / columns - 0.5
            total = 0.0
            for down in range(round(y) - 2, round(y) + 3):
                for across in range(round(x) - 2, round(x) + 3):
                    at = min(max(down, 0), height - 1), min(max(across, 0), width - 1)
                    weight = 1.0
                    unlike = (control[row, column, 0] - own[at]) / 0.1
                    for distance in ((down - y) / 0.5, (across - x) / 0.5, unlike):
                        weight /= (1 + distance**2) ** 2
                    made[row, column] += weight * coarse[at]
                    total += weight
            made[row, column] /= total
    return made


def test_upsampling_is_that_of_a_loop_over_pixels(rng: np.random.Generator) -> None:
    control = (np.indices((23, 36)) // 10 % 2).any(axis=0).astype(np.float32)[..., None]
    coarse = rng.random((4, 6, 2)).astype(np.float32)
    np.testing.assert_allclose(along_control(coarse, control), naive(coarse, control), rtol=1e-4)


def test_a_border_of_control_stays_sharp_and_what_control_lacks_is_kept() -> None:
    texture, control = pair()
    made = coarse_level(texture, CoarseLevelParams(), control)
    assert made.image.pixels.shape == (4, 6, 3)
    own = lab_from_linear(texture.color)
    differences = np.abs(made.guide - own).max(axis=2)
    blurred = np.abs(coarse_level(texture, CoarseLevelParams()).guide - own).max(axis=2)
    assert np.quantile(differences, 0.95) < 0.5 * np.quantile(blurred, 0.95)
    land = control.pixels[..., 0] > 0
    assert np.corrcoef(made.guide[land][:, 0], own[land][:, 0])[0, 1] > 0.9


def test_a_grey_texture_has_a_grey_level() -> None:
    grey = Image(smooth_noise((48, 60), 3, np.random.default_rng(2))[..., None].astype(np.float32), ("Y",))
    made = coarse_level(grey, CoarseLevelParams(coarser=6))
    assert (made.image.channels, made.image.pixels.shape) == (("Y",), (8, 10, 1))
    assert np.abs(made.guide[..., 1:]).max() < 0.5


def test_the_frames_of_a_stack_have_one_guide() -> None:
    texture, control = pair()
    later = texture.pixels[..., ::-1] * 0.5
    stack = Image(np.concatenate([texture.pixels, later], axis=2), stack_channels(texture.channels, 2))
    made = coarse_level(stack, CoarseLevelParams(), control)
    assert (made.image.channels, made.image.pixels.shape) == (stack.channels, (4, 6, 6))
    alone = coarse_level(texture, CoarseLevelParams(), control)
    np.testing.assert_array_equal(made.image.pixels[..., :3], alone.image.pixels)
    planes = fit_scale(stack, control, 1.0).of_texture(stack)
    assert made.guide.shape == (*planes.shape[:2], 3)
    assert np.corrcoef(made.guide[..., 0].ravel(), planes[..., 0].ravel())[0, 1] > 0.9


def test_control_that_does_not_fit_is_refused() -> None:
    with pytest.raises(InputError, match="aspect ratio than texture"):
        check_pair(
            CoarseLevelParams(),
            {"texture": pair()[0], "control": picture(smooth_noise((20, 20), 2, np.random.default_rng(1)))},
        )


def noisy(image: Image, strength: float) -> Image:
    noise = smooth_noise((image.height, image.width), 3, np.random.default_rng(4))
    return picture(np.clip(image.pixels + strength * noise[..., None], 0, 1))


@pytest.mark.parametrize(("better", "asked"), [(True, True), (True, False), (False, True)])
def test_it_is_used_where_the_original_comes_nearer(better: bool, asked: bool) -> None:
    texture, control = pair()
    near, far = noisy(texture, 0.02), noisy(texture, 0.2)
    guide = coarse_level(texture, CoarseLevelParams(), control).guide
    plain, guided = (far, near) if better else (near, far)
    made = coarse_choice(texture, Params(), plain, guided, guide[:24], guide if asked else None)
    assert made.table["used"] is (better and asked)
    assert made.image is (guided if better and asked else plain)
    assert (made.table["guided"] < made.table["plain"]) is better
    for one in (made.exemplar_guide, made.target_guide):
        assert (one is not None) is (better and asked)
