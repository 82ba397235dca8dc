"""Control maps: resampling, and the planes that patches are compared by."""

from __future__ import annotations

import numpy as np

from tests.synthetic import picture
from texloom.stages.arrays import Image
from texloom.stages.color import linear_from_srgb, srgb_from_linear
from texloom.stages.common.control import fit_scale, resize_control
from texloom.stages.common.pyramid import resize


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
