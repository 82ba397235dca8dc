"""What the shaders of hex tiling and of cells share: their maps, and how their templates are filled in."""

from pathlib import Path
from typing import Any

from texloom.stages.common.features.maps import map_channels
from texloom.stages.common.grids.wang import HASH_FACTORS
from texloom.stages.synthesis.endless.endless_shaders import SIGNED_FACTORS, named
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.normals import NORMAL
from texloom.stages.vocabulary.templates import templates

_TYPES = ("float", "vec2", "vec3", "vec4")


def shader_maps(image: Image) -> list[dict[str, Any]]:
    """Colour and further maps, as templates fill them in; `InputError` where one has more than four channels."""
    channels = {"color": list(range(1 if image.channels[0] == "Y" else 3)), **map_channels(image.channels)}
    maps = []
    for name, own in zip(named(channels), channels.values(), strict=True):
        if len(own) > len(_TYPES):
            raise InputError(f"image: {name} has {len(own)} channels; shaders have at most four")
        maps.append(
            {
                "name": name, "type": _TYPES[len(own) - 1], "count": len(own), "swizzle": "xyzw"[: len(own)],
                "is_normal": tuple(image.channels[index] for index in own) == NORMAL,
            }
        )  # fmt: skip
    return maps


def shader_texts(beside: str, values: dict[str, Any]) -> tuple[str, str, str, str]:
    """GLSL, HLSL, Godot and OSL by the templates that are called like the module ``beside``."""
    here = Path(beside)
    hashing = {"factors": [f"0x{factor:08x}" for factor in HASH_FACTORS], "signed_factors": SIGNED_FACTORS}

    def written(kind: str, is_godot: bool = False) -> str:
        template = templates(here.parent).get_template(f"{here.stem}.{kind}.j2")
        return str(template.render({**values, **hashing, "godot": is_godot})) + "\n"

    return written("glsl"), written("hlsl"), written("glsl", True), written("osl")
