"""USD as text: a plane or mesh with a UsdPreviewSurface material that binds the maps.

Specification: UsdPreviewSurface 2.6. Lengths are metres, Y is up.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import PurePosixPath

import numpy as np

from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.materialx import BoundMap, identifier
from texloom.stages.common.surface.mesh import indexed, width_of
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import TORUS, Wraps

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
_WRAP_MODES = {True: "repeat", False: "clamp"}


def stage(
    name: str,
    maps: Sequence[BoundMap],
    image: Image,
    delivery: Delivery,
    up: str = "./",
    mesh: np.ndarray | None = None,
) -> str:
    """The text of a USD stage.

    Parameters
    ----------
    name : of the material, see `identifier`.
    maps : files relative to the stage.
    image : gives the proportions of the plane; its longer side is 1 m without a texel size.
    up : what references to files begin with.
    mesh : what the image lies on, see `texloom.stages.vocabulary.arrays.Mesh`, m; None: the plane.
    """
    name = identifier(name)
    height, width = delivery.size(image.height, image.width) or (
        image.height / max(image.height, image.width),
        image.width / max(image.height, image.width),
    )
    if mesh is None:
        kind, geometry = "plane", _plane(height, width, delivery.udim or (1, 1))
    else:
        kind, geometry, width = "mesh", _mesh(mesh), width_of(mesh)
    is_alone = mesh is None and delivery.udim in (None, (1, 1))
    wraps = image.wraps if is_alone else TORUS  # coordinates of meshes and tiles lie beyond 0..1
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
        f'    def Mesh "{kind}" (',
        '        prepend apiSchemas = ["MaterialBindingAPI"]',
        "    )",
        "    {",
        *geometry,
        f"        rel material:binding = </{name}/{name}>",
        '        uniform token subdivisionScheme = "none"',
        "    }",
        "",
        f'    def Material "{name}"',
        "    {",
        f"        token outputs:surface.connect = </{name}/{name}/shader.outputs:surface>",
    ]
    if any(one.role == "height" for one in bound):
        lines.append(f"        token outputs:displacement.connect = </{name}/{name}/shader.outputs:displacement>")
    lines += [*_shader(name, bound), *_coordinates()]
    for one in bound:
        lines += _texture(name, one, one.relief.displacement(width), up, wraps)
    return "\n".join([*lines, "    }", "}", ""])


def _plane(height: float, width: float, udim: tuple[int, int]) -> list[str]:
    """Its attributes; the texture coordinates are those of ``udim`` rows and columns of tiles."""
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    points = np.column_stack([(unit - 0.5) * [width, height], np.zeros(4)])
    return _geometry([4], np.arange(4), points, np.tile([0, 0, 1], (4, 1)), unit * udim[::-1])


def _mesh(mesh: np.ndarray) -> list[str]:
    """Its attributes; equal corners are one vertex."""
    vertex, first = indexed(mesh)
    points = mesh[first]
    return _geometry([3] * (len(mesh) // 3), vertex, points[:, :3], points[:, 3:6], points[:, 6:8])


def _geometry(
    counts: list[int], indices: np.ndarray, points: np.ndarray, normals: np.ndarray, texture: np.ndarray
) -> list[str]:
    return [
        f"        float3[] extent = {_tuples(np.stack([points.min(axis=0), points.max(axis=0)]))}",
        f"        int[] faceVertexCounts = {counts}",
        f"        int[] faceVertexIndices = {indices.tolist()}",
        f"        normal3f[] normals = {_tuples(normals)} (",
        '            interpolation = "vertex"',
        "        )",
        f"        point3f[] points = {_tuples(points)}",
        f"        texCoord2f[] primvars:st = {_tuples(texture)} (",
        '            interpolation = "vertex"',
        "        )",
    ]


def _tuples(rows: np.ndarray) -> str:
    """An array of vectors."""
    form = f"({', '.join(['%.9g'] * rows.shape[1])})"
    return f"[{', '.join(form % tuple(row) for row in rows.tolist())}]"


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
        source = f"</{name}/{name}/{one.role}.outputs:{output}>"
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


def _texture(name: str, one: BoundMap, displacement: tuple[float, float], up: str, wraps: Wraps) -> list[str]:
    """``displacement``: scale and bias of heights, m."""
    scale, bias = displacement
    kind = _INPUTS[one.role][1]
    space = "sRGB" if one.encoded else "raw"
    lines = [
        "",
        f'        def Shader "{one.role}"',
        "        {",
        '            uniform token info:id = "UsdUVTexture"',
        f"            asset inputs:file = @{up}{_path(one.file)}@",
        f"            float2 inputs:st.connect = </{name}/{name}/st.outputs:result>",
        f'            token inputs:sourceColorSpace = "{space}"',
        f'            token inputs:wrapS = "{_WRAP_MODES[wraps.across]}"',
        f'            token inputs:wrapT = "{_WRAP_MODES[wraps.down]}"',
    ]
    if one.role == "normal":
        green = (-2, 1) if one.directx else (2, -1)
        lines.append(f"            float4 inputs:scale = (2, {green[0]}, 2, 1)")
        lines.append(f"            float4 inputs:bias = (-1, {green[1]}, -1, 0)")
    elif one.role == "height":
        # in all channels, although one is read: Blender takes the mean of red, green and blue
        lines.append(f"            float4 inputs:scale = ({', '.join([f'{scale:.9g}'] * 3)}, 1)")
        lines.append(f"            float4 inputs:bias = ({', '.join([f'{bias:.9g}'] * 3)}, 0)")
    output = "            float3 outputs:rgb" if kind.endswith("3f") else "            float outputs:r"
    return [*lines, output, "        }"]


def _path(file: str) -> str:
    if "@" in file or json.dumps(file, ensure_ascii=False) != f'"{file}"':
        raise ValueError(f"{file!r} cannot be named in USD")
    return str(PurePosixPath(file))
