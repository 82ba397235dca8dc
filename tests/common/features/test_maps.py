"""What maps besides colour add to the comparison of patches."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import smooth_noise
from texloom.stages.common.features.maps import check_weights, map_channels, map_features
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

NAMES = ("R", "G", "B", "A", "normal.X", "normal.Y", "height", "usable")


def many(planes: list[np.ndarray], names: list[str]) -> Image:
    pixels = np.stack([np.ones_like(planes[0]), *planes], axis=2).astype(np.float32)
    return Image(pixels, ("Y", *names))


def test_what_belongs_together() -> None:
    assert map_channels(NAMES) == {"normal": [4, 5], "height": [6]}
    assert map_channels(("Y", "roughness")) == {"roughness": [1]}
    assert map_channels(("R", "G", "B", "A")) == {}


def test_weights_are_of_maps() -> None:
    check_weights({"normal": 2.0, "normal.Y": 0.0, "height": 1.0}, NAMES)
    for name in ("R", "A", "usable", "hight"):
        with pytest.raises(InputError, match=f"no map '{name}'; the image has normal, height, normal.X, normal.Y"):
            check_weights({name: 1.0}, NAMES)
    with pytest.raises(InputError, match=r"; did you mean 'height'\?"):
        check_weights({"hight": 1.0}, NAMES)
    with pytest.raises(InputError, match="the image has none but colour"):
        check_weights({"height": 1.0}, ("R", "G", "B"))


def test_all_maps_together_vary_as_colour_does(rng: np.random.Generator) -> None:
    """Whatever their units and ranges."""
    planes = [scale * smooth_noise((40, 50), 2.0, rng) + offset for scale, offset in ((1, 0), (300, -50), (0.1, 0))]
    result = map_features(many(planes, ["a", "b", "c"]), 20.0, {}, None)
    assert result.shape == (40, 50, 3)
    assert result.reshape(-1, 3).var(axis=0).sum() == pytest.approx(400, rel=1e-3)
    np.testing.assert_allclose(result.mean(axis=(0, 1)), 0, atol=1e-3)
    twice = map_features(many(planes, ["a", "b", "c"]), 20.0, {"a": 2.0, "b": 2.0, "c": 2.0}, None)
    np.testing.assert_allclose(np.abs(twice), 2 * np.abs(result), rtol=1e-3, atol=1e-3)


def test_components_keep_differences(rng: np.random.Generator) -> None:
    planes = [smooth_noise((30, 30), 2.0, rng) for _ in range(3)]
    result = map_features(many(planes, ["a", "a.b", "c"]), 10.0, {}, None)
    scaled = np.stack([plane / plane.std() * 10 / np.sqrt(2) for plane in planes], axis=2)
    scaled[..., :2] *= planes[0].std() / np.hypot(planes[0].std(), planes[1].std())
    scaled[..., 1] *= planes[1].std() / planes[0].std()
    steps = (np.diff(result, axis=0) ** 2).sum(axis=2)
    np.testing.assert_allclose(steps, (np.diff(scaled, axis=0) ** 2).sum(axis=2), rtol=0.02, atol=0.02)


def test_maps_that_go_together_cost_no_more_than_one(rng: np.random.Generator) -> None:
    one = smooth_noise((30, 30), 2.0, rng)
    assert map_features(many([one, 3 - 2 * one, one + 5], ["a", "b", "c"]), 20.0, {}, None).shape[2] == 1
    five = [smooth_noise((30, 30), 1.0, rng) for _ in range(5)]
    assert map_features(many(five, list("abcde")), 20.0, {}, None).shape[2] == 5
    assert map_features(many(five, list("abcde")), 20.0, {}, None, 3).shape[2] == 3


def test_flat_maps_and_those_of_no_weight_are_left_out(rng: np.random.Generator) -> None:
    flat = 0.5 + 0.001 * smooth_noise((30, 30), 0.5, rng)
    one = smooth_noise((30, 30), 2.0, rng)
    alone = map_features(many([one], ["height"]), 20.0, {}, None)
    np.testing.assert_array_equal(map_features(many([flat, one], ["metallic", "height"]), 20.0, {}, None), alone)
    both = many([smooth_noise((30, 30), 1.0, rng), one], ["roughness", "height"])
    np.testing.assert_array_equal(map_features(both, 20.0, {"roughness": 0.0}, None), alone)
    assert map_features(many([one], ["height"]), 20.0, {"height": 0.0}, None).shape == (30, 30, 0)
    assert map_features(many([0 * one], ["height"]), 20.0, {}, None).shape == (30, 30, 0)


def test_masked_pixels_count_for_nothing(rng: np.random.Generator) -> None:
    planes = [smooth_noise((30, 30), 2.0, rng) for _ in range(2)]
    usable = rng.random((30, 30)) < 0.8
    one, other = (
        map_features(many([np.where(usable, plane, sign) for plane in planes], ["a", "b"]), 20.0, {}, usable)[
            usable
        ]
        for sign in (0.0, 0.9)
    )
    np.testing.assert_array_equal(one, other)
