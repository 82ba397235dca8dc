"""Shaders of by-example noise: GLSL that runs, the others as their compilers see them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.synthesis.endless.exemplars import colors, made, material, places
from tests.synthesis.endless.rendering import as_glsl, compiles_osl, rendered, sampled_by, textures_of, validated
from texloom.stages.synthesis.endless.endless_shaders import EndlessShaders, endless_shaders, number
from texloom.stages.synthesis.endless.noise import Noise
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SIDE = 128
EXACT = "#version 330\n#define ENDLESS_EXACT\n"


@pytest.fixture(scope="module")
def set_of_maps() -> tuple[Noise, EndlessShaders]:
    texture, noise = made(material())
    return noise, endless_shaders(texture.layout)


def main_of(noise: Noise, result: str, scale: float) -> str:
    """The shader's ``main``: a square of pixels, each ``scale`` px of the texture, as `places` has them."""
    names = [f"gaussian_{page + 1}" for page in range(noise.pyramid[0].shape[2] // 4)] + ["inverse_table"]
    samplers = "".join(f"uniform sampler2D {name};\n" for name in names)
    position = f"(gl_FragCoord.xy - 0.5) * {scale} + 0.5 + vec2(-211.0, -150.0)"
    return (
        f"{samplers}out vec4 result;\nvoid main() {{\n    vec2 uv = ({position}) / ENDLESS_SIZE;\n"
        f"    Endless here = endless({', '.join(names)}, uv, dFdx(uv), dFdy(uv));\n    result = {result};\n}}\n"
    )


@pytest.mark.parametrize("level", [0.0, 1.0, 2.3, 9.0])
@pytest.mark.parametrize("result", ["vec4(here.color, here.roughness)", "vec4(here.normal, here.roughness)"])
def test_glsl_renders_the_reference(set_of_maps: tuple[Noise, EndlessShaders], level: float, result: str) -> None:
    noise, shaders = set_of_maps
    scale = 2.0**level
    maps = noise.maps(*places(SIDE, scale), level)
    expected = np.concatenate([maps["color" if "color" in result else "normal"], maps["roughness"]], axis=2)
    text = shaders.glsl + main_of(noise, result, scale)
    exact = rendered(EXACT + text, textures_of(noise), SIDE)
    assert (np.abs(exact - expected).max(axis=2) <= 1 / 255).mean() >= 0.999
    assert np.abs(exact).max() > 0.1
    hardware = np.abs(rendered("#version 330\n" + text, textures_of(noise), SIDE) - expected).max(axis=2)
    within = 100 * (hardware <= 1 / 255).mean()
    print(
        f"hardware filtering, level {level}: {within:.2f} % within 1/255, largest difference {hardware.max():.2g}"
    )


@pytest.mark.parametrize("sharpness", [1, 3.5])
def test_glsl_of_grey_textures_without_a_level_of_detail(sharpness: float) -> None:
    grey = Image(colors(37, 41).pixels[..., :1].copy(), ("Y",)).wrapping(True)
    texture, noise = made(grey, sharpness=sharpness, tile=0.6, entries=64)
    text = endless_shaders(texture.layout).glsl + main_of(noise, "vec4(here.color)", 1.0)
    found = rendered(EXACT + text, textures_of(noise), SIDE)[..., :1]
    assert (np.abs(found - noise.maps(*places(SIDE))["color"]) <= 1 / 255).mean() >= 0.999


def test_another_arrangement_would_be_found(set_of_maps: tuple[Noise, EndlessShaders]) -> None:
    noise, shaders = set_of_maps
    other = shaders.glsl.replace("0x7feb352du", "0x7feb352fu")
    found = rendered(EXACT + other + main_of(noise, "vec4(here.color, 1.0)", 1.0), textures_of(noise), SIDE)
    assert (np.abs(found[..., :3] - noise.maps(*places(SIDE))["color"]).max(axis=2) <= 1 / 255).mean() < 0.5


# -- compilers


@pytest.mark.parametrize("version", ["330", "300 es\nprecision highp float;\nprecision highp int;"])
def test_glsl_compiles(set_of_maps: tuple[Noise, EndlessShaders], tmp_path: Path, version: str) -> None:
    main = main_of(set_of_maps[0], "vec4(here.color, here.roughness)", 1.0)
    for define in ("", "#define ENDLESS_EXACT\n"):
        validated(tmp_path / "endless.frag", f"#version {version}\n{define}{set_of_maps[1].glsl}{main}")


def test_hlsl_compiles(set_of_maps: tuple[Noise, EndlessShaders], tmp_path: Path) -> None:
    main = (
        "Texture2D one : register(t0); Texture2D two : register(t1); Texture2D tables : register(t2);\n"
        "SamplerState repeating : register(s0); SamplerState clamped : register(s1);\n"
        "float4 main(float2 uv : TEXCOORD0) : SV_Target {\n    float3 color; float3 normal; float roughness;\n"
        "    Endless_float(one, two, repeating, tables, clamped, uv, color, normal, roughness);\n"
        "    return float4(color + normal, roughness);\n}\n"
    )
    options = ("-D", "-e", "main", "-S", "frag", "-V", "-o", "endless.spv")
    validated(tmp_path / "endless.hlsl", set_of_maps[1].hlsl + main, *options)
    assert (tmp_path / "endless.spv").stat().st_size > 1000


def test_hlsl_renders_the_reference(set_of_maps: tuple[Noise, EndlessShaders], tmp_path: Path) -> None:
    """Translated to GLSL by way of SPIR-V; at level 0, where filtering of graphics cards is exact enough."""
    noise, shaders = set_of_maps
    main = (
        "Texture2D gaussian_1 : register(t0); Texture2D gaussian_2 : register(t1);\n"
        "Texture2D inverse_table : register(t2);\n"
        "SamplerState one : register(s3); SamplerState two : register(s4);\n"
        "float4 main(float4 at : SV_Position) : SV_Target {\n"
        "    float2 uv = (at.xy + float2(-211.0, -150.0)) / ENDLESS_SIZE;\n"
        "    float3 color; float3 normal; float roughness;\n"
        "    Endless_float(gaussian_1, gaussian_2, one, inverse_table, two, uv, color, normal, roughness);\n"
        "    return float4(color, roughness);\n}\n"
    )
    glsl = as_glsl(tmp_path, shaders.hlsl + main)
    textures = sampled_by(glsl, textures_of(noise))
    assert len(textures) == 3
    maps = noise.maps(*places(SIDE))
    found = rendered(glsl, textures, SIDE)
    expected = np.concatenate([maps["color"], maps["roughness"]], axis=2)
    assert (np.abs(found - expected).max(axis=2) <= 1 / 255).mean() >= 0.999


def test_the_function_of_the_godot_shader_compiles_as_glsl(
    set_of_maps: tuple[Noise, EndlessShaders], tmp_path: Path
) -> None:
    """Godot's language is GLSL ES 3.0 but for the first line, hints, values of uniforms and the built-in names."""
    text = set_of_maps[1].godot.replace("shader_type spatial;", "")
    text = re.sub(r"^(uniform \w+ \w+) [:=][^;]*;", r"\1;", text, flags=re.M)
    built_in = "in vec2 UV; out vec3 ALBEDO; vec3 NORMAL_MAP; float ROUGHNESS;\n"
    head = "#version 300 es\nprecision highp float;\nprecision highp int;\n"
    validated(tmp_path / "endless.frag", f"{head}{built_in}{text}void main() {{ fragment(); }}\n")
    assert "NORMAL_MAP = here.normal * 0.5 + 0.5;" in text
    assert "ROUGHNESS = here.roughness;" in text


def test_osl_compiles(set_of_maps: tuple[Noise, EndlessShaders], tmp_path: Path) -> None:
    compiles_osl(tmp_path, "endless", set_of_maps[1].osl)


def test_numbers_are_exact_and_no_integers() -> None:
    values = np.float32([0, 1, -2, 0.1, 1e-8, 123456.78, 3.4e30])
    texts = [number(float(value)) for value in values]
    assert all(re.search(r"[.e]", text) for text in texts)
    np.testing.assert_array_equal(np.float32([float(text) for text in texts]), values)


def test_maps_of_more_than_four_channels_have_no_shader() -> None:
    layout = made(colors(16, 16))[0].layout
    wide = {**layout["maps"][0], "name": "spectrum", "channels": ["a", "b", "c", "d", "e"]}
    with pytest.raises(InputError, match="spectrum has 5 channels"):
        endless_shaders({**layout, "maps": [wide]})
