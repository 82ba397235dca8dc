"""The nodes of a Principled material, as plain values."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import Any, NamedTuple

from .texloom_client import TexloomError

ROLES = ("base_color", "roughness", "metallic", "specular", "opacity", "emissive", "normal", "height", "ao")
"""maps as the layout `blender` names their files, in the order of the nodes"""
COLORS = ("base_color", "emissive")
_SOCKETS = {
    "base_color": "Base Color",
    "roughness": "Roughness",
    "metallic": "Metallic",
    "specular": "Specular IOR Level",
    "opacity": "Alpha",
    "emissive": "Emission Color",
}


class Relief(NamedTuple):
    """What heights from 0 to 1 are: metres = scale * height + bias."""

    scale: float
    bias: float = 0.0


class Node(NamedTuple):
    """A node: its `bl_idname`, place, properties, and values of its sockets."""

    kind: str
    place: tuple[float, float]
    properties: Mapping[str, Any] = {}
    values: Mapping[str, Any] = {}


class Plan(NamedTuple):
    """The whole tree: name to node, and links from (node, socket) to (node, socket)."""

    nodes: dict[str, Node]
    links: list[tuple[str, str, str, str]]
    notes: list[str]
    displacement: str
    """BUMP, DISPLACEMENT or BOTH, of the material"""


def plan(maps: set[str], relief: Relief | None, uv_map: str = "") -> Plan:
    """The nodes for maps by their roles, of `ROLES`; an image node has the name of its role."""
    if unknown := maps - set(ROLES):
        raise TexloomError(f"{min(unknown)}: no map of a Principled material")
    coordinates = Node("ShaderNodeUVMap", (-1000, 0), {"uv_map": uv_map})
    if not uv_map:
        coordinates = Node("ShaderNodeTexCoord", (-1000, 0))
    nodes = {
        "coordinates": coordinates,
        "mapping": Node("ShaderNodeMapping", (-800, 0)),
        "surface": Node("ShaderNodeBsdfPrincipled", (0, 300)),
        "output": Node("ShaderNodeOutputMaterial", (400, 300)),
    }
    links = [("coordinates", "UV", "mapping", "Vector"), ("surface", "BSDF", "output", "Surface")]
    notes = []
    for number, role in enumerate(one for one in ROLES if one in maps):
        nodes[role] = Node("ShaderNodeTexImage", (-600, 600 - 300 * number))
        links.append(("mapping", "Vector", role, "Vector"))
        if role in _SOCKETS:
            links.append((role, "Color", "surface", _SOCKETS[role]))
    if "emissive" in maps:
        nodes["surface"] = nodes["surface"]._replace(values={"Emission Strength": 1.0})
    if "normal" in maps:
        nodes["bump"] = Node("ShaderNodeNormalMap", (-250, -100), {"uv_map": uv_map})
        links += [("normal", "Color", "bump", "Color"), ("bump", "Normal", "surface", "Normal")]
    if "height" in maps and relief is not None:
        values = {"Scale": relief.scale, "Midlevel": -relief.bias / relief.scale if relief.scale else 0.0}
        nodes["displacement"] = Node("ShaderNodeDisplacement", (150, -200), {}, values)
        links += [
            ("height", "Color", "displacement", "Height"),
            ("displacement", "Displacement", "output", "Displacement"),
        ]
    if "ao" in maps:
        notes.append("occlusion is in the node 'ao', linked to nothing, as renderers compute it")
    return Plan(nodes, links, notes, "DISPLACEMENT" if "normal" in maps else "BOTH")


def role_of(file: str) -> str:
    """The role of a file of the layout `blender`; empty of documents."""
    stem, suffix = PurePosixPath(file).stem, PurePosixPath(file).suffix
    if suffix != ".png":
        return ""
    return next((role for role in sorted(ROLES, key=len, reverse=True) if stem.endswith(f"_{role}")), "")


def relief_in(document: str) -> Relief | None:
    """What a USD document of the layout `blender` says of its heights; None where it has none."""
    shader = re.search(r'def Shader "height"\s*\{(.*?)\n\s*\}', document, re.DOTALL)
    if shader is None:
        return None
    read = {name: re.search(rf"float4 inputs:{name} = \(([^,)]+),", shader[1]) for name in ("scale", "bias")}
    if read["scale"] is None:
        raise TexloomError("the material's document does not say the scale of its heights")
    return Relief(float(read["scale"][1]), float(read["bias"][1]) if read["bias"] else 0.0)
