"""Hex tiling: the plane in Python, and its shaders."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.synthesis.endless.exemplars import colors, material, places
from tests.synthesis.endless.rendering import as_glsl, compiles_osl, rendered, sampled_by, validated
from tests.synthetic import smooth_noise
from texloom.stages.evaluation.hex_plane import HexPlaneParams, hex_plane
from texloom.stages.synthesis.endless.hex_shaders import HexShaders, HexShadersParams, hex_shaders
from texloom.stages.synthesis.endless.hex_tiling import HexTiling
from texloom.stages.synthesis.endless.mip_levels import pyramid_of
from texloom.stages.synthesis.endless.triangle_grid import tiles_at
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.normals import NORMAL

SIDE = 128
IMAGE = material()


def laid(image: Image, **params: float) -> tuple[HexTiling, HexShaders]:
    shaders = hex_shaders(image, HexShadersParams(**params))
    return HexTiling.of(image, shaders.layout), shaders


def levels_of(image: Image) -> dict[str, list[np.ndarray]]:
    """The samplers, with the encoding of normals in files."""
    made = {}
    for name, planes in (("color", slice(0, 3)), ("normal", slice(3, 6)), ("roughness", slice(6, 7))):
        values = image.pixels[..., planes] * 0.5 + 0.5 if name == "normal" else image.pixels[..., planes]
        wide = np.zeros((*values.shape[:2], 4), np.float32)
        wide[..., : values.shape[2]] = values
        made[f"{name}_map"] = pyramid_of(wide)
    return made


def main_of(result: str, scale: float) -> str:
    samplers = "".join(f"uniform sampler2D {name}_map;\n" for name in ("color", "normal", "roughness"))
    return (
        f"{samplers}out vec4 result;\nvoid main() {{\n"
        f"    vec2 uv = ((gl_FragCoord.xy - 0.5) * {scale} + 0.5 + vec2(-211.0, -150.0)) / HEX_SIZE;\n"
        "    Hex here = hexTiled(color_map, normal_map, roughness_map, uv, dFdx(uv), dFdy(uv));\n"
        f"    result = {result};\n}}\n"
    )


@pytest.mark.parametrize(("level", "rotation"), [(0.0, 0.0), (0.0, 180.0), (1.7, 30.0)])
def test_glsl_renders_the_reference(level: float, rotation: float) -> None:
    tiling, shaders = laid(IMAGE, rotation=rotation)
    expected = tiling.pixels(*places(SIDE, 2.0**level), level)
    for result, planes in (
        ("vec4(here.color, here.roughness)", [0, 1, 2, 6]),
        ("vec4(here.normal, here.roughness)", [3, 4, 5, 6]),
    ):
        text = shaders.glsl + main_of(result, 2.0**level)
        exact = rendered("#version 330\n#define HEX_EXACT\n" + text, levels_of(IMAGE), SIDE)
        assert (np.abs(exact - expected[..., planes]).max(axis=2) <= 1 / 255).mean() >= 0.999
        hardware = np.abs(rendered("#version 330\n" + text, levels_of(IMAGE), SIDE) - expected[..., planes])
        print(f"hardware filtering, level {level}: largest difference {hardware.max():.2g}")


@pytest.mark.parametrize("version", ["330", "300 es\nprecision highp float;\nprecision highp int;"])
def test_glsl_and_godot_compile(tmp_path: Path, version: str) -> None:
    shaders = laid(IMAGE, rotation=180)[1]
    main = main_of("vec4(here.color + here.normal, here.roughness)", 1.0)
    for define in ("", "#define HEX_EXACT\n"):
        validated(tmp_path / "hex.frag", f"#version {version}\n{define}{shaders.glsl}{main}")
    text = re.sub(
        r"^(uniform \w+ \w+) [:=][^;]*;", r"\1;", shaders.godot.replace("shader_type spatial;", ""), flags=re.M
    )
    built_in = "in vec2 UV; out vec3 ALBEDO; vec3 NORMAL_MAP; float ROUGHNESS;\n"
    validated(tmp_path / "godot.frag", f"#version {version}\n{built_in}{text}void main() {{ fragment(); }}\n")


HLSL_MAIN = """
Texture2D color_map : register(t0); Texture2D normal_map : register(t1); Texture2D roughness_map : register(t2);
SamplerState repeating : register(s3);
float4 main(float4 at : SV_Position) : SV_Target {
    float2 uv = (at.xy + float2(-211.0, -150.0)) / HEX_SIZE;
    float3 color; float3 normal; float roughness;
    HexTiled_float(color_map, normal_map, roughness_map, repeating, uv, color, normal, roughness);
    return RESULT;
}
"""


@pytest.mark.parametrize("rotation", [0.0, 180.0])
def test_hlsl_renders_the_reference(rotation: float, tmp_path: Path) -> None:
    """Translated to GLSL by way of SPIR-V; at level 0, where filtering of graphics cards is exact enough."""
    tiling, shaders = laid(IMAGE, rotation=rotation)
    expected = tiling.pixels(*places(SIDE))
    for result, planes in (("float4(color, roughness)", [0, 1, 2, 6]), ("float4(normal, roughness)", [3, 4, 5, 6])):
        glsl = as_glsl(tmp_path, shaders.hlsl + HLSL_MAIN.replace("RESULT", result))
        found = rendered(glsl, sampled_by(glsl, levels_of(IMAGE)), SIDE)
        close = np.abs(found - expected[..., planes]).max(axis=2)
        # Graphics cards place texels to 1/256 px; turned tiles lie between them.
        assert (close <= (1 / 255 if rotation == 0 else 4 / 255)).mean() >= 0.999, np.sort(close.ravel())[-20:]


def test_osl_compiles(tmp_path: Path) -> None:
    compiles_osl(tmp_path, "hex", laid(IMAGE, rotation=180)[1].osl)


def test_normals_are_those_of_the_heights_in_turned_tiles() -> None:
    height = smooth_noise((64, 64), 4, np.random.default_rng(8)).astype(np.float64) * 40
    down, across = (np.roll(height, -1, axis) / 2 - np.roll(height, 1, axis) / 2 for axis in (0, 1))
    vectors = np.stack([-across, down, np.ones_like(height)], axis=2)
    vectors /= np.sqrt(np.square(vectors).sum(axis=2, keepdims=True))
    planes = np.concatenate([np.full((64, 64, 3), 0.5), vectors, height[..., None]], axis=2).astype(np.float32)
    image = Image(planes, ("R", "G", "B", *NORMAL, "height")).wrapping(True)
    tiling, shaders = laid(image, rotation=180, exponent=16, tile=0.7)
    rows, columns = places(220)
    made = tiling.pixels(rows, columns)
    alone = tiles_at(rows, columns, shaders.layout["spacing"])[1].max(axis=0) > 0.75
    found = made[..., 3:5] / made[..., 5:6]
    expected = np.stack([-np.gradient(made[..., 6], axis=1), np.gradient(made[..., 6], axis=0)], axis=2)
    errors = np.abs(found - expected)[alone]
    assert errors.mean() < 0.1 * np.abs(expected[alone]).mean()
    assert np.abs(found - expected[..., ::-1])[alone].mean() > np.abs(expected[alone]).mean()  # mistaken axes
    np.testing.assert_allclose(np.square(made[..., 3:6]).sum(axis=2), 1, atol=1e-5)


def test_without_rotation_pixels_are_the_textures_where_one_tile_has_all_weight() -> None:
    tiling, shaders = laid(IMAGE, exponent=16, contrast=0)
    spacing = shaders.layout["spacing"]
    found = tiling.pixels(np.zeros((1, 1), np.float32), np.float32([[3 * spacing]]))
    distances = np.abs(IMAGE.pixels - found[0, 0]).max(axis=2)
    assert distances.min() < 0.05


def test_contrast_is_kept_better_by_lightness_and_narrow_zones() -> None:
    image = colors()
    spreads = []
    for params in ({"contrast": 0, "exponent": 1}, {}):
        tiling, _ = laid(image, **params)
        spreads.append(tiling.pixels(*places(300)).std() / image.pixels.std())
    assert spreads[0] < 0.85 < spreads[1]


def test_the_preview_is_the_reference() -> None:
    tiling, shaders = laid(IMAGE)
    plane = hex_plane(IMAGE, shaders.layout, HexPlaneParams(side=70)).image
    np.testing.assert_array_equal(plane.pixels, tiling.pixels(*places(70, 1.0, 0.0, 0.0))[..., :3])


def test_what_is_refused() -> None:
    with pytest.raises(InputError, match="does not continue across its borders"):
        hex_shaders(colors().wrapping(False), HexShadersParams())
    wide = Image(np.zeros((8, 8, 8), np.float32), ("R", "G", "B", *(f"spectrum.{index}" for index in range(5))))
    with pytest.raises(InputError, match="spectrum has 5 channels"):
        hex_shaders(wide.wrapping(True), HexShadersParams())
