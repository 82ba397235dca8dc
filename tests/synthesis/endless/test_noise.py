"""By-example noise: Gaussian textures, tables, and the plane that they make."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.synthesis.endless.exemplars import colors, made, material, places
from texloom.stages.common.grids.wang import hashed
from texloom.stages.evaluation.endless_plane import EndlessPlaneParams, endless_plane
from texloom.stages.synthesis.endless.gaussian_texture import SIGMA, GaussianTextureParams, gaussian_texture
from texloom.stages.synthesis.endless.mip_levels import halved, pyramid_of
from texloom.stages.synthesis.endless.noise import Noise
from texloom.stages.synthesis.endless.triangle_grid import sharpened, shifts_of, tiles_at
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

# -- the grid


def test_weights_are_those_of_the_nearest_tiles_and_continuous() -> None:
    rows, columns = places(64, 0.5)
    vertices, weights = tiles_at(rows, columns, 16.0)
    np.testing.assert_allclose(weights.sum(axis=0), 1, atol=1e-5)
    assert weights.min() > -1e-6
    # tiles lie where barycentric coordinates say: the weighted middles of the three are the point itself
    middle = np.stack([vertices[:, 1] * 3**0.5 / 2, vertices[:, 0] + vertices[:, 1] / 2], axis=1) * 16
    np.testing.assert_allclose((weights[:, None] * middle).sum(axis=0), np.stack([rows, columns]), atol=1e-3)
    assert np.abs(np.diff(np.sort(weights, axis=0), axis=2)).max() < 0.5 / 16 * 2


def test_shifts_lie_in_the_texture_and_are_whole() -> None:
    vertices, _ = tiles_at(*places(64, 4.0), 8.0)
    down, across = shifts_of(vertices, (37, 53))
    assert down.min() >= 0
    assert across.min() >= 0
    assert len(np.unique(down)) == 37
    assert len(np.unique(across)) == 53
    bits = int(hashed(np.array(-3), np.array(5), 0))
    one = shifts_of(np.array([[5, -3]] * 3)[:, :, None], (37, 53))[:, 0, 0]
    assert one.tolist() == [(bits >> 16) * 37 // 65536, (bits % 65536) * 53 // 65536]


def test_sharper_weights_add_up_to_1() -> None:
    _, weights = tiles_at(*places(32), 11.0)
    sharp = sharpened(weights, 4.0)
    np.testing.assert_allclose(sharp.sum(axis=0), 1, atol=1e-5)
    np.testing.assert_allclose(sharp, weights**4 / (weights**4).sum(axis=0), atol=1e-5)
    assert sharpened(weights, 1.0) is weights


# -- the texture


def test_components_are_gaussian() -> None:
    texture, _ = made(colors())
    for channel in range(3):
        values = texture.first[..., channel].astype(np.float64)
        assert abs(values.mean() - 0.5) < 1e-4
        assert abs(values.std() / SIGMA - 1) < 0.01
        assert abs((((values - 0.5) / values.std()) ** 4).mean() - 3) < 0.15  # the kurtosis of a Gaussian
    assert (texture.first[..., 3] == 0.5).all()
    assert texture.second is None


def test_tables_lead_back_to_the_texture() -> None:
    """Where one tile has all the weight, the plane is the texture, shifted."""
    image = material()
    texture, noise = made(image, tile=0.5)
    spacing = texture.layout["spacing"]
    cell = np.array([[[2, 2]]] * 3).reshape(3, 2, 1)
    row, column = cell[0, 1, 0] * 3**0.5 / 2 * spacing, (cell[0, 0, 0] + cell[0, 1, 0] / 2) * spacing
    maps = noise.maps(np.float32([[row]]), np.float32([[column]]))
    down, across = (int(shift[0, 0]) for shift in shifts_of(cell, (image.height, image.width)))
    near = [
        image.pixels[(int(row) + down + y) % image.height, (int(column) + across + x) % image.width]
        for y in (0, 1)
        for x in (0, 1)
    ]
    low, high = np.min(near, axis=0) - 0.02, np.max(near, axis=0) + 0.02
    found = np.concatenate([maps[name][0, 0] for name in ("color", "normal", "roughness")])
    assert ((found >= low) & (found <= high)).all()


def test_equal_values_stay_equal_and_constant_maps_constant() -> None:
    pixels = colors().pixels.copy()
    pixels[10:30, 20:60] = pixels[10, 20]
    pixels = np.concatenate([pixels, np.full((*pixels.shape[:2], 1), 0.4, np.float32)], axis=2)
    texture, noise = made(Image(pixels, ("R", "G", "B", "roughness")).wrapping(True))
    assert np.ptp(texture.first[10:30, 20:60], axis=(0, 1)).max() == 0
    np.testing.assert_allclose(noise.maps(*places(20))["roughness"], 0.4, atol=1e-5)


def test_contrast_and_histogram_are_kept() -> None:
    image = material()
    texture, _ = made(image)
    plane = endless_plane(
        image, texture.first, texture.inverse, texture.layout, EndlessPlaneParams(side=400), texture.second
    )
    for measures in plane.table.values():
        assert abs(measures["contrast"] - 1) < 0.06
        assert measures["histogram"] < 0.04
    assert plane.image.shape == (400, 400, 3)


def test_contrast_would_not_be_kept_by_plain_blending() -> None:
    """So the test above can fail: the mean of three tiles has less contrast."""
    image = colors()
    _, noise = made(image, sharpness=1)
    plain = Noise(
        [np.full_like(level, 0.5) + (level - 0.5) * 0.6 for level in noise.pyramid], noise.inverse, noise.layout
    )
    contrast = plain.maps(*places(300))["color"].std(axis=(0, 1)) / image.pixels.std(axis=(0, 1))
    assert contrast.max() < 0.8


@pytest.mark.parametrize("level", [1, 2, 3])
def test_levels_have_the_tone_of_the_plane_seen_from_afar(level: int) -> None:
    _, noise = made(colors(96, 128))
    size = 2**level
    near = noise.maps(*places(256))["color"].reshape(256 // size, size, 256 // size, size, 3).mean(axis=(1, 3))
    rows, columns = (axis[::size, ::size] + np.float32((size - 1) / 2) for axis in places(256))
    far = noise.maps(rows, columns, float(level))["color"]
    error = np.abs(far.mean(axis=(0, 1)) / near.mean(axis=(0, 1)) - 1)
    assert error.max() < 0.06
    # with the table of level 0 it is darker, as the texture has few light places
    same = Noise(noise.pyramid, np.repeat(noise.inverse[:1], noise.layout["levels"], axis=0), noise.layout)
    assert same.maps(rows, columns, float(level))["color"].mean() < min(far.mean(), near.mean())


def test_halves_are_averages_over_areas() -> None:
    values = np.arange(5, dtype=np.float32)[:, None, None]
    np.testing.assert_allclose(halved(values)[:, 0, 0], [(0 + 1 + 2 / 2) / 2.5, (2 / 2 + 3 + 4) / 2.5])
    planes = np.random.default_rng(1).random((38, 53, 2)).astype(np.float32)
    levels = pyramid_of(planes)
    assert [level.shape[:2] for level in levels] == [(38, 53), (19, 26), (9, 13), (4, 6), (2, 3), (1, 1)]
    for level in levels:
        np.testing.assert_allclose(level.mean(axis=(0, 1)), planes.mean(axis=(0, 1)), atol=1e-5)


def test_normals_have_length_1_and_colour_no_negative_values() -> None:
    maps = made(material())[1].maps(*places(100))
    np.testing.assert_allclose(np.square(maps["normal"]).sum(axis=2), 1, atol=1e-5)
    assert maps["color"].min() >= 0


def test_the_same_bits_in_any_part_of_the_plane() -> None:
    noise = made(colors())[1]
    rows, columns = places(96)
    whole = noise.maps(rows, columns)["color"]
    np.testing.assert_array_equal(noise.maps(rows[40:60, 7:31], columns[40:60, 7:31])["color"], whole[40:60, 7:31])


def test_the_layout_is_plain_json() -> None:
    layout = made(material())[0].layout
    assert json.loads(json.dumps(layout)) == layout
    assert [one["name"] for one in layout["maps"]] == ["color", "normal", "roughness"]


# -- what is refused


def test_a_texture_with_borders_is_refused() -> None:
    with pytest.raises(InputError, match="does not continue across its borders"):
        gaussian_texture(colors().wrapping(False), GaussianTextureParams())


def test_too_many_maps_are_refused() -> None:
    pixels = np.repeat(colors(16, 16).pixels, 6, axis=2)
    names = ("R", "G", "B", *(f"map{index}" for index in range(15)))
    with pytest.raises(InputError, match="18 components"):
        gaussian_texture(Image(pixels, names).wrapping(True), GaussianTextureParams())
