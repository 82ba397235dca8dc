"""USD as text: a plane with a UsdPreviewSurface material that binds the maps.

Specification: UsdPreviewSurface 2.6. Lengths are metres, Y is up.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import PurePosixPath

from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.materialx import DISPLACEMENT, BoundMap
from texloom.stages.arrays import Image

_INPUTS = {
    "albedo": ("diffuseColor", "color3f"),
    "emissive": ("emissiveColor", "color3f"),
    "normal": ("normal", "normal3f"),
    "roughness": ("roughness", "float"),
    "metallic": ("metallic", "float"),
    "ao": ("occlusion", "float"),
    "opacity": ("opacity", "float"),
    "height": ("displacement", "float"),
}
"""role to the shader's input and its type"""


def stage(name: str, maps: Sequence[BoundMap], image: Image, delivery: Delivery, up: str = "./") -> str:
    """The text of a USD stage.

    Parameters
    ----------
    name : of the material, a USD identifier.
    maps : files relative to the stage.
    image : gives the proportions of the plane; its longer side is 1 m without a texel size.
    up : what references to files begin with.
    """
    height, width = delivery.size(image.height, image.width) or (
        image.height / max(image.height, image.width),
        image.width / max(image.height, image.width),
    )
    rows, columns = delivery.udim or (1, 1)
    bound = [one for one in maps if one.role in _INPUTS]
    lines = [
        "#usda 1.0",
        "(",
        f'    defaultPrim = "{name}"',
        "    metersPerUnit = 1",
        '    upAxis = "Y"',
        ")",
        "",
        f'def Xform "{name}"',
        "{",
        '    def Mesh "plane" (',
        '        prepend apiSchemas = ["MaterialBindingAPI"]',
        "    )",
        "    {",
        f"        float3[] extent = [({-width / 2:.9g}, {-height / 2:.9g}, 0), "
        f"({width / 2:.9g}, {height / 2:.9g}, 0)]",
        "        int[] faceVertexCounts = [4]",
        "        int[] faceVertexIndices = [0, 1, 2, 3]",
        f"        rel material:binding = </{name}/material>",
        "        normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)]",
        f"        point3f[] points = [{', '.join(_corners(width, height))}]",
        f"        texCoord2f[] primvars:st = [(0, 0), ({columns}, 0), ({columns}, {rows}), (0, {rows})] (",
        '            interpolation = "vertex"',
        "        )",
        '        uniform token subdivisionScheme = "none"',
        "    }",
        "",
        '    def Material "material"',
        "    {",
        f"        token outputs:surface.connect = </{name}/material/shader.outputs:surface>",
    ]
    if any(one.role == "height" for one in bound):
        lines.append(f"        token outputs:displacement.connect = </{name}/material/shader.outputs:displacement>")
    lines += [*_shader(name, bound), *_coordinates()]
    for one in bound:
        lines += _texture(name, one, DISPLACEMENT * width, up)
    return "\n".join([*lines, "    }", "}", ""])


def _corners(width: float, height: float) -> list[str]:
    return [f"({x * width / 2:.9g}, {y * height / 2:.9g}, 0)" for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def _shader(name: str, maps: Sequence[BoundMap]) -> list[str]:
    lines = [
        "",
        '        def Shader "shader"',
        "        {",
        '            uniform token info:id = "UsdPreviewSurface"',
    ]
    for one in maps:
        shader_input, kind = _INPUTS[one.role]
        output = "rgb" if kind.endswith("3f") else "r"
        source = f"</{name}/material/{one.role}.outputs:{output}>"
        lines.append(f"            {kind} inputs:{shader_input}.connect = {source}")
    return [*lines, "            token outputs:displacement", "            token outputs:surface", "        }"]


def _coordinates() -> list[str]:
    return [
        "",
        '        def Shader "st"',
        "        {",
        '            uniform token info:id = "UsdPrimvarReader_float2"',
        '            string inputs:varname = "st"',
        "            float2 outputs:result",
        "        }",
    ]


def _texture(name: str, one: BoundMap, displacement: float, up: str) -> list[str]:
    kind = _INPUTS[one.role][1]
    space = "sRGB" if one.encoded else "raw"
    lines = [
        "",
        f'        def Shader "{one.role}"',
        "        {",
        '            uniform token info:id = "UsdUVTexture"',
        f"            asset inputs:file = @{up}{_path(one.file)}@",
        f"            float2 inputs:st.connect = </{name}/material/st.outputs:result>",
        f'            token inputs:sourceColorSpace = "{space}"',
        '            token inputs:wrapS = "repeat"',
        '            token inputs:wrapT = "repeat"',
    ]
    if one.role == "normal":
        green = (-2, 1) if one.directx else (2, -1)
        lines.append(f"            float4 inputs:scale = (2, {green[0]}, 2, 1)")
        lines.append(f"            float4 inputs:bias = (-1, {green[1]}, -1, 0)")
    elif one.role == "height":
        lines.append(f"            float4 inputs:scale = ({displacement:.9g}, 1, 1, 1)")
    output = "            float3 outputs:rgb" if kind.endswith("3f") else "            float outputs:r"
    return [*lines, output, "        }"]


def _path(file: str) -> str:
    if "@" in file or json.dumps(file) != f'"{file}"':
        raise ValueError(f"{file!r} cannot be named in USD")
    return str(PurePosixPath(file))
