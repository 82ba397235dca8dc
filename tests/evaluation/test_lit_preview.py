"""Lit planes against the formulas, a pixel at a time, and what must hold of any light."""

from __future__ import annotations

import math

import numpy as np
import pytest

from texloom.stages.evaluation.lit_preview import LitPreviewParams, light_directions, lit, lit_preview
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.normals import NORMAL, unit

MAPS = ("R", "G", "B", *NORMAL, "roughness", "metallic", "ao", "specular", "emissive.R", "emissive.G", "emissive.B")


def material(rng: np.random.Generator, sides: tuple[int, int] = (5, 6)) -> Image:
    pixels = rng.random((*sides, len(MAPS)), np.float32)
    pixels[..., 3:6] = unit(rng.normal((0, 0, 2), 0.7, (*sides, 3)).astype(np.float32))
    return Image(pixels, MAPS)


def reflected(pixel: dict[str, float], light: np.ndarray, params: LitPreviewParams, channel: int) -> float:
    """One channel of one pixel by the formulas of the papers."""
    n = np.array([pixel[name] for name in NORMAL], float)
    view = np.array([0.0, 0.0, 1.0])
    half = (light + view) / np.linalg.norm(light + view)
    nl, nv, nh = (max(0.0, float(n @ one)) for one in (light, view, half))
    color, metallic = pixel["RGB"[channel]], pixel["metallic"]
    straight = 0.08 * pixel["specular"] * (1 - metallic) + color * metallic
    diffuse = color * (1 - metallic)
    radiance = params.ambient * pixel["ao"] * (diffuse + straight) + pixel[f"emissive.{'RGB'[channel]}"]
    if nl == 0:
        return radiance
    alpha = max(0.05, pixel["roughness"]) ** 2
    tangent2 = 1 / nh**2 - 1
    distribution = alpha**2 / (math.pi * nh**4 * (alpha**2 + tangent2) ** 2)  # Walter et al., equation 33

    def masked(cosine: float) -> float:  # the term of Smith's shadowing that equation 34 is made of
        return (math.sqrt(1 + alpha**2 * (1 / cosine**2 - 1)) - 1) / 2

    shadowing = 1 / (1 + masked(nl) + masked(nv))
    fresnel = straight + (1 - straight) * (1 - float(half @ view)) ** 5
    specular = distribution * shadowing * fresnel / (4 * nl * nv)
    return radiance + params.brightness * math.pi * nl * ((1 - fresnel) * diffuse / math.pi + specular)


def test_every_pixel_follows_the_formulas(rng: np.random.Generator) -> None:
    image, params = material(rng), LitPreviewParams(ambient=0.1)
    for light in light_directions(3, 20.0):
        radiance = lit(image, light, params)
        for row, column in np.ndindex(5, 6):
            pixel = dict(zip(MAPS, image.pixels[row, column].tolist(), strict=True))
            if pixel[NORMAL[2]] < 0.05:
                continue
            expected = [reflected(pixel, light.astype(float), params, channel) for channel in range(3)]
            np.testing.assert_allclose(radiance[row, column], expected, rtol=1e-3)


def test_the_light_goes_around() -> None:
    lights = light_directions(4, 30.0)
    np.testing.assert_allclose(np.linalg.norm(lights, axis=1), 1, rtol=1e-6)
    np.testing.assert_allclose(lights[:, 2], 0.5, rtol=1e-6)
    assert np.sign(lights[:, :2]).tolist() == [[-1, 1], [1, 1], [1, -1], [-1, -1]]


def test_slopes_towards_the_light_are_brighter() -> None:
    row, column = np.mgrid[:20, :20]
    bump = np.exp(-((row - 9.5) ** 2 + (column - 9.5) ** 2) / 20).astype(np.float32)
    image = Image(np.stack([np.full_like(bump, 0.5), bump], axis=2), ("Y", "height"))
    upper_left = lit(image, light_directions(4, 35.0)[0], LitPreviewParams(relief=0.3))[..., 0]
    assert upper_left[6, 6] > 1.5 * upper_left[13, 13]
    np.testing.assert_allclose(upper_left, upper_left.T, rtol=1e-4)
    flat = Image(np.full((4, 4, 1), 0.5, np.float32), ("Y",))
    assert np.ptp(lit(flat, light_directions(4, 35.0)[0], LitPreviewParams())) == 0


def test_exemplar_and_result_are_rows_and_lights_columns(rng: np.random.Generator) -> None:
    params = LitPreviewParams(lights=3, side=16)
    image, exemplar = material(rng, (40, 30)), material(rng, (12, 9))
    preview = lit_preview(image, params, exemplar).image
    assert preview.channels == ("R", "G", "B")
    assert (preview.height, preview.width) == (12 + 8 + 16, 3 * 16 + 2 * 8)
    light = light_directions(3, params.elevation)[1]
    np.testing.assert_array_equal(preview.pixels[:12, 24:33], lit(exemplar, light, params))
    shown = Image(image.pixels[:16, :16], image.channels)
    np.testing.assert_array_equal(preview.pixels[20:, 24:40], lit(shown, light, params))
    alone = lit_preview(image, params).image
    np.testing.assert_array_equal(alone.pixels, preview.pixels[20:])


@pytest.mark.parametrize("channels", [("Y",), ("R", "G", "B", "A"), ("Y", *NORMAL), ("R", "G", "B", "specular.R")])
def test_any_map_may_be_missing(rng: np.random.Generator, channels: tuple[str, ...]) -> None:
    if "specular.R" in channels:
        channels = (*channels, "specular.G", "specular.B")
    image = Image(rng.random((16, 16, len(channels)), np.float32), channels)
    preview = lit_preview(image, LitPreviewParams()).image.pixels
    assert np.isfinite(preview).all()
    assert preview.min() >= 0
