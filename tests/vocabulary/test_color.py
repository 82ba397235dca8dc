from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from texloom.stages.vocabulary.color import (
    lab_from_linear,
    linear_from_lab,
    linear_from_srgb,
    srgb_codes,
    srgb_from_linear,
)


def lab(*color: float) -> np.ndarray:
    return lab_from_linear(np.float32(color).reshape(1, 1, 3))[0, 0]


@pytest.mark.parametrize(
    ("color", "expected"),
    [
        ((0, 0, 0), (0, 0, 0)),
        ((1, 1, 1), (100, 0, 0)),
        ((0.18, 0.18, 0.18), (49.496, 0, 0)),
        ((1, 0, 0), (53.24, 80.09, 67.20)),
        ((0, 1, 0), (87.74, -86.18, 83.18)),
        ((0, 0, 1), (32.30, 79.19, -107.86)),
    ],
)
def test_lab_of_known_colours(color: tuple[float, ...], expected: tuple[float, ...]) -> None:
    np.testing.assert_allclose(lab(*color), expected, atol=0.02)


def test_lab_agrees_with_scikit_image(rng: np.random.Generator) -> None:
    from skimage.color import rgb2lab

    encoded = rng.random((50, 60, 3)) ** 2
    values = lab_from_linear(linear_from_srgb(encoded).astype(np.float32))
    assert values.dtype == np.float32
    np.testing.assert_allclose(values, rgb2lab(encoded), atol=2e-3)


def test_lab_and_linear_light_are_inverse(rng: np.random.Generator) -> None:
    color = (rng.random((40, 50, 3)) ** 3).astype(np.float32)
    color[0] *= 0.01  # below the knee
    np.testing.assert_allclose(linear_from_lab(lab_from_linear(color)), color, atol=1e-5)


def test_lightness_goes_on_above_white_and_stops_below_black() -> None:
    assert lab(2, 2, 2)[0] == pytest.approx(116 * 2 ** (1 / 3) - 16, abs=0.01)
    np.testing.assert_array_equal(lab(-1, -0.5, -3), lab(0, 0, 0))


def test_lab_does_not_jump_at_the_knee() -> None:
    grey = np.linspace(0.0080, 0.0097, 2000, dtype=np.float32)
    lightness = lab_from_linear(np.repeat(grey, 3).reshape(1, -1, 3))[0, :, 0]
    assert (np.diff(lightness) > -1e-5).all()
    assert np.diff(lightness).max() < 3 * np.ptp(lightness) / 2000


@given(st.floats(0, 1))
def test_srgb_and_linear_light_are_inverse(value: float) -> None:
    one = np.array(value)
    assert srgb_from_linear(linear_from_srgb(one)) == pytest.approx(value, abs=2e-7)
    assert linear_from_srgb(srgb_from_linear(one)) == pytest.approx(value, abs=2e-7)


def test_all_bytes_survive_the_round_trip() -> None:
    encoded = (np.arange(256) / 255).astype(np.float32)
    back = srgb_from_linear(linear_from_srgb(encoded).astype(np.float32))
    np.testing.assert_array_equal(np.rint(back * 255), np.arange(256))
    assert (np.diff(back) > 0).all()


def test_known_srgb_values() -> None:
    np.testing.assert_allclose(linear_from_srgb(np.array([0.0, 0.5, 1.0])), [0, 0.214041, 1], atol=1e-6)
    np.testing.assert_allclose(srgb_from_linear(np.array([0.18, 0.0031308])), [0.461356, 0.04045], atol=1e-5)


def test_srgb_of_light_outside_its_range_is_clipped() -> None:
    np.testing.assert_allclose(srgb_from_linear(np.array([-3.0, 0.0, 1.0, 7.0])), [0, 0, 1, 1], atol=1e-12)


def test_large_pictures_are_converted_like_small_ones() -> None:
    color = np.random.default_rng(1).random((150, 1200, 3), np.float32)
    rows = np.concatenate([lab_from_linear(row[None]) for row in color])
    np.testing.assert_array_equal(lab_from_linear(color), rows)


def test_codes_are_those_of_the_curve_rounded(rng: np.random.Generator) -> None:
    codes = np.arange(256)
    reached = linear_from_srgb((codes[1:] - 0.5) / 255).astype(np.float32)
    near = (reached.view(np.int32)[:, None] + np.arange(-40, 41)).astype(np.int32).view(np.float32)
    light = np.concatenate([near.ravel(), rng.uniform(-0.2, 1.2, 10000).astype(np.float32)])
    expected = np.rint(srgb_from_linear(light) * np.float32(255)).astype(np.uint8)
    assert (srgb_codes(light) == expected).all()
    assert (srgb_codes(linear_from_srgb(codes / 255).astype(np.float32)) == codes).all()


def test_light_that_has_no_code_is_black_or_white() -> None:
    light = np.array([[-np.inf, -1.0, -0.0, np.nan], [1.0, 2.0, 65504.0, np.inf]], np.float32)
    assert srgb_codes(light).tolist() == [[0] * 4, [255] * 4]


def test_lab_keeps_what_is_not_finite_and_any_layout(rng: np.random.Generator) -> None:
    color = rng.uniform(-0.1, 1.5, (30, 40, 3)).astype(np.float32)
    whole = lab_from_linear(color)
    assert (lab_from_linear(np.asfortranarray(color)) == whole).all()
    assert (lab_from_linear(color[::2, 1::3]) == whole[::2, 1::3]).all()
    np.testing.assert_allclose(lab_from_linear(color.astype(np.float64)), whole, atol=1e-4)
    color[3, 4] = np.nan, 0.5, np.inf
    assert np.isnan(lab_from_linear(color)[3, 4]).any()
    np.testing.assert_array_equal(lab_from_linear(color)[4:], whole[4:])
