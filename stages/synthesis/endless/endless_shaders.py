"""Shaders of by-example noise: GLSL, HLSL, Godot and OSL."""

import dataclasses
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from texloom.stages.common.grids.wang import HASH_FACTORS
from texloom.stages.synthesis.endless.decorrelation import MapBasis
from texloom.stages.synthesis.endless.noise import PAGE
from texloom.stages.vocabulary.arrays import Glsl, GodotShader, Hlsl, Osl
from texloom.stages.vocabulary.declare import InputError, stage
from texloom.stages.vocabulary.templates import templates

SIGNED_FACTORS = [factor - (factor >> 31 << 32) for factor in HASH_FACTORS]
"""the same bits, for languages without unsigned numbers"""

_COMPONENTS = 4  # of a vector, at most
_TYPES = {
    "glsl": ("float", "vec2", "vec3", "vec4"),
    "gdshader": ("float", "vec2", "vec3", "vec4"),
    "hlsl": ("float", "float2", "float3", "float4"),
}


@dataclasses.dataclass(frozen=True)
class EndlessShaders:
    """Source text; all of them lay the same tiles."""

    glsl: Glsl
    """a function `endless`, which returns all maps"""
    hlsl: Hlsl
    """the same, and entries for Unity's Shader Graph and Unreal's Custom node"""
    godot: GodotShader
    """a spatial shader of Godot 4"""
    osl: Osl
    """a shader with an output for each map"""


@stage(version=1)
def endless_shaders(layout: dict[str, Any]) -> EndlessShaders:
    """Write shaders that sample a Gaussian texture, blend it, and look all maps of a material up.

    Parameters
    ----------
    layout : see `gaussian_texture`.

    Raises
    ------
    InputError
        a map has more than four channels.

    References
    ----------
    [HeitzNeyret2018]_, [DeliotHeitz2019]_ listings 1.1 to 1.4.
    """
    kinds = (("glsl", "glsl"), ("hlsl", "hlsl"), ("gdshader", "glsl"), ("osl", "osl"))
    here = Path(__file__)
    found = {kind: templates(here.parent).get_template(f"{here.stem}.{name}.j2") for kind, name in kinds}
    texts = {kind: template.render(_values(layout, kind)) + "\n" for kind, template in found.items()}
    return EndlessShaders(texts["glsl"], texts["hlsl"], texts["gdshader"], texts["osl"])


def named(maps: Iterable[str]) -> list[str]:
    """Names of maps that shaders can have, each once."""
    names = list[str]()
    for one in maps:
        name = re.sub(r"\W", "_", one, flags=re.ASCII)
        names.append(name if name not in names and name[0].isalpha() else f"map_{len(names) + 1}")
    return names


def _values(layout: dict[str, Any], kind: str) -> dict[str, Any]:
    """What a template fills in."""
    bases = [MapBasis.of(record) for record in layout["maps"]]
    low, span = layout["low"], layout["span"]
    maps, first = [], 0
    for basis, name in zip(bases, named(basis.name for basis in bases), strict=True):
        if len(basis.channels) > _COMPONENTS:
            raise InputError(f"layout: {basis.name} has {len(basis.channels)} channels; shaders have at most four")
        parts = [
            {
                "page": index // PAGE, "channel": index % PAGE,
                "low": number(low[index]), "span": number(span[index]),
                "axis": _vector(axis, kind), "axis_values": [number(one) for one in axis],
            }
            for index, axis in enumerate(basis.axes, first)
        ]  # fmt: skip
        first += basis.count
        types = _TYPES.get(kind, _TYPES["glsl"])
        maps.append(
            {
                "name": name, "kind": basis.kind, "parts": parts, "mean": _vector(basis.mean, kind),
                "mean_values": [number(one) for one in basis.mean], "count": basis.count,
                "type": types[len(basis.channels) - 1], "encoded": types[basis.count - 1],
                "zero": _vector([0.0] * basis.count, kind),
            }
        )  # fmt: skip
    return {
        "godot": kind == "gdshader", "maps": maps, "pages": list(range(1, -(-first // PAGE) + 1)),
        "size": layout["size"], "spacing": number(layout["spacing"]), "sharpness": layout["sharpness"],
        "levels": layout["levels"], "entries": layout["entries"],
        "across": number(3**-0.5), "twice": number(2 * 3**-0.5),
        "factors": [f"0x{factor:08x}" for factor in HASH_FACTORS],
        "signed_factors": SIGNED_FACTORS,
    }  # fmt: skip


def number(value: float) -> str:
    """A literal that every one of the languages reads as the same float of 32 bits."""
    text = f"{value:.9g}"
    return text if re.search(r"[.e]", text) else f"{text}.0"


def _vector(values: Any, kind: str) -> str:
    listed = [number(one) for one in values]
    if len(listed) == 1:
        return listed[0]
    return f"{_TYPES.get(kind, _TYPES['glsl'])[len(listed) - 1]}({', '.join(listed)})"
