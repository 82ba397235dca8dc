"""Control maps: resampling, and the planes that patches are compared by."""

from __future__ import annotations

import numpy as np

from tests.synthetic import picture
from texloom.stages.common.features.control import fit_scale, resize_control
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import linear_from_srgb, srgb_from_linear


def test_painted_values_are_resampled_and_not_linear_light(rng: np.random.Generator) -> None:
    painted = rng.random((8, 6, 4), np.float32)
    light = linear_from_srgb(painted[..., :3])
    control = Image(np.concatenate([light, painted[..., 3:]], axis=2, dtype=np.float32), ("R", "G", "B", "wetness"))
    large = resize_control(control, 32, 24)
    expected = resize(painted, 32, 24, bilinear=True)
    np.testing.assert_allclose(srgb_from_linear(large.pixels[..., :3]), expected[..., :3], atol=1e-5)
    np.testing.assert_array_equal(large.pixels[..., 3], expected[..., 3])
    assert resize_control(control, 8, 6) is control


def test_resampled_control_gives_the_planes_of_coarse_control(rng: np.random.Generator) -> None:
    texture = picture(rng.random((32, 24, 3), np.float32))
    control = Image(rng.normal(0, 1, (8, 6, 1)).astype(np.float32), ("Y",))  # also below 0 and above 1
    scale = fit_scale(texture, control, 1.0)
    direct = scale.of_control(control, 32, 24)
    np.testing.assert_allclose(scale.of_control(resize_control(control, 32, 24), 32, 24), direct, atol=1e-3)


def test_values_are_moved_apart_where_the_texture_changes(rng: np.random.Generator) -> None:
    elevation = rng.random((64, 64), np.float32)
    elevation[:, :48] = 0.25 + 0.01 * elevation[:, :48]  # a shore at .255, and mountains
    light = np.where(elevation < 0.255, 0.1, 0.6) + 0.02 * rng.random((64, 64), np.float32)
    texture = picture(np.repeat(light[..., None], 3, axis=2).astype(np.float32))
    control = Image(elevation[..., None], ("elevation",))

    def step(linear: bool) -> float:
        scale = fit_scale(texture, control, 1.0, linear)
        low, high = scale.of_control(Image(np.array([[[0.252], [0.258]]], np.float32), ("elevation",)), 1, 2)[
            0, :, 0
        ]
        return float(high - low) / scale.strength

    assert step(linear=True) < 0.01
    assert step(linear=False) > 0.15


def test_a_texture_in_proportion_to_control_leaves_its_values(rng: np.random.Generator) -> None:
    values = rng.random((64, 64, 1), np.float32)
    lightness = np.repeat(50 * values, 3, axis=2)
    texture = picture(np.where(lightness > 8, ((lightness + 16) / 116) ** 3, lightness / 903.3).astype(np.float32))
    scale = fit_scale(texture, Image(values, ("height",)), 1.0)
    planes = scale.of_control(Image(values, ("height",)), 64, 64)[..., 0] / scale.strength
    expected = (values[..., 0] - values.min()) / np.ptp(values)
    np.testing.assert_allclose(planes, expected, atol=0.02)
