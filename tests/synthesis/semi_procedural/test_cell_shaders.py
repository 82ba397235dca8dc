"""Shaders of the cells of a lattice: rendered, and compiled by every compiler that is there."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.synthesis.endless.exemplars import places
from tests.synthesis.endless.rendering import as_glsl, compiles_osl, rendered, sampled_by, validated
from tests.synthesis.semi_procedural.exemplars import made_of_courses, wall_made
from texloom.stages.synthesis.endless.mip_levels import pyramid_of
from texloom.stages.synthesis.semi_procedural.cell_shaders import CellShaders, cell_shaders
from texloom.stages.synthesis.semi_procedural.cell_texture import CellTexture
from texloom.stages.synthesis.semi_procedural.cell_tiling import CellTiling
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, NoParams

SIDE = 128
MAPS = ("color", "normal", "roughness")
Laid = tuple[CellTexture, CellTiling, CellShaders]


@pytest.fixture(scope="module", params=["lattice", "courses"])
def laid(request: pytest.FixtureRequest) -> Laid:
    texture, tiling = wall_made() if request.param == "lattice" else made_of_courses()
    return texture, tiling, cell_shaders(texture.image, texture.window, texture.layout, NoParams())


def textures_of(texture: CellTexture) -> dict[str, list[np.ndarray]]:
    """The samplers, with the encoding of normals in files."""
    found = {}
    for name, planes in zip(MAPS, (slice(0, 3), slice(3, 6), slice(6, 7)), strict=True):
        values = texture.image.pixels[..., planes]
        wide = np.zeros((*values.shape[:2], 4), np.float32)
        wide[..., : values.shape[2]] = values * 0.5 + 0.5 if name == "normal" else values
        found[f"{name}_map"] = pyramid_of(wide)
    return {**found, "cell_window": [np.repeat(texture.window[..., None], 4, axis=2)]}


def main_of(result: str, scale: float) -> str:
    samplers = "".join(f"uniform sampler2D {name};\n" for name in (*(f"{one}_map" for one in MAPS), "cell_window"))
    return (
        f"{samplers}out vec4 result;\nvoid main() {{\n"
        f"    vec2 uv = ((gl_FragCoord.xy - 0.5) * {scale} + 0.5 + vec2(-211.0, -150.0)) / CELLS_UNIT;\n"
        "    Cells here = cells(color_map, normal_map, roughness_map, cell_window, uv, dFdx(uv), dFdy(uv));\n"
        f"    result = {result};\n}}\n"
    )


@pytest.mark.parametrize("level", [0.0, 1.7])
def test_glsl_renders_the_reference(laid: Laid, level: float) -> None:
    texture, tiling, shaders = laid
    expected = tiling.pixels(*places(SIDE, 2.0**level), level)
    for name, planes in (("color", [0, 1, 2, 6]), ("normal", [3, 4, 5, 6])):
        text = shaders.glsl + main_of(f"vec4(here.{name}, here.roughness)", 2.0**level)
        exact = rendered("#version 330\n#define CELLS_EXACT\n" + text, textures_of(texture), SIDE)
        assert (np.abs(exact - expected[..., planes]).max(axis=2) <= 1 / 255).mean() >= 0.999
        hardware = np.abs(rendered("#version 330\n" + text, textures_of(texture), SIDE) - expected[..., planes])
        within = 100 * (hardware.max(axis=2) <= 1 / 255).mean()
        print(f"hardware, level {level}: {within:.2f} % within 1/255, largest difference {hardware.max():.2g}")


def test_another_choice_of_cells_would_be_found(laid: Laid) -> None:
    texture, tiling, shaders = laid
    other = shaders.glsl.replace("0x7feb352du", "0x7feb352fu") + main_of("vec4(here.color, 1.0)", 1.0)
    found = rendered("#version 330\n#define CELLS_EXACT\n" + other, textures_of(texture), SIDE)[..., :3]
    assert (np.abs(found - tiling.pixels(*places(SIDE))[..., :3]).max(axis=2) <= 1 / 255).mean() < 0.9


@pytest.mark.parametrize("version", ["330", "300 es\nprecision highp float;\nprecision highp int;"])
def test_glsl_and_godot_compile(laid: Laid, tmp_path: Path, version: str) -> None:
    shaders = laid[2]
    for define in ("", "#define CELLS_EXACT\n"):
        main = main_of("vec4(here.color + here.normal, here.roughness)", 1.0)
        validated(tmp_path / "cells.frag", f"#version {version}\n{define}{shaders.glsl}{main}")
    text = re.sub(
        r"^(uniform \w+ \w+) [:=][^;]*;", r"\1;", shaders.godot.replace("shader_type spatial;", ""), flags=re.M
    )
    built_in = "in vec2 UV; out vec3 ALBEDO; vec3 NORMAL_MAP; float ROUGHNESS;\n"
    validated(tmp_path / "godot.frag", f"#version {version}\n{built_in}{text}void main() {{ fragment(); }}\n")


def test_hlsl_renders_the_reference(laid: Laid, tmp_path: Path) -> None:
    """Translated to GLSL by way of SPIR-V; at level 0, where filtering of graphics cards is exact enough."""
    texture, tiling, shaders = laid
    samplers = "".join(f"Texture2D {name} : register(t{at});\n" for at, name in enumerate(textures_of(texture)))
    main = (
        f"{samplers}SamplerState repeating : register(s4); SamplerState clamped : register(s5);\n"
        "float4 main(float4 at : SV_Position) : SV_Target {\n"
        "    float2 uv = (at.xy + float2(-211.0, -150.0)) / CELLS_UNIT;\n"
        "    float3 color; float3 normal; float roughness;\n    CellTiled_float(color_map, normal_map, "
        "roughness_map, repeating, cell_window, clamped, uv, color, normal, roughness);\n"
        "    return float4(color, roughness) + 0.0 * float4(normal, 0.0);\n}\n"
    )
    glsl = as_glsl(tmp_path, shaders.hlsl + main)
    textures = sampled_by(glsl, textures_of(texture))
    assert len(textures) >= 3
    close = np.abs(rendered(glsl, textures, SIDE) - tiling.pixels(*places(SIDE))[..., [0, 1, 2, 6]]).max(axis=2)
    assert (close <= 1 / 255).mean() >= 0.999, np.sort(close.ravel())[-20:]


def test_osl_compiles(laid: Laid, tmp_path: Path) -> None:
    compiles_osl(tmp_path, "cells", laid[2].osl)


def test_maps_of_more_than_four_channels_have_no_shader(laid: Laid) -> None:
    texture = laid[0]
    wide = Image(np.zeros((8, 8, 8), np.float32), ("R", "G", "B", *(f"spectrum.{index}" for index in range(5))))
    with pytest.raises(InputError, match="spectrum has 5 channels"):
        cell_shaders(wide, texture.window, texture.layout, NoParams())
