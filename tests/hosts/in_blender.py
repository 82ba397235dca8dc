"""Opens what `tests.hosts.write` wrote in Blender: nodes, colour spaces, scale of the displacement, pixels.

python in_blender.py FOLDER, with a Python that has `bpy`
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np

SOCKETS = {
    "usda": {
        "Base Color": "{}_base_color.png sRGB",
        "Emission Color": "{}_emissive.png sRGB",
        "Metallic": "{}_metallic.png Non-Color Red",
        "Roughness": "{}_roughness.png Non-Color Red",
        "Alpha": "{}_opacity.png Non-Color Red",
        "Normal": "{}_normal.png Non-Color",
        "Displacement": "{}_height.png Non-Color Red",
    },
    "glb": {
        "Base Color": "{}_baseColor sRGB",
        "Emission Color": "{}_emissive sRGB",
        "Metallic": "{}_occlusionRoughnessMetallic Non-Color Blue",
        "Roughness": "{}_occlusionRoughnessMetallic Non-Color Green",
        "Normal": "{}_normal Non-Color",
    },
}
"""what feeds each socket of the surface and of the output"""
TEXEL = 0.001  # m
RELIEF = 0.05  # of the texture's side, white over black


def ascii_name(name: str) -> str:
    """A material's name as USD has it: letters that are not ASCII by their numbers."""
    return "".join(one if one.isascii() else f"u{ord(one):04x}" for one in name)


def fed(socket: bpy.types.NodeSocket) -> str:
    """The picture behind a socket, its colour space, and the channel that is taken of it."""
    channel = ""
    while socket.links:
        link = socket.links[0]
        node = link.from_node
        if node.type == "TEX_IMAGE":
            return f"{node.image.name} {node.image.colorspace_settings.name} {channel}".strip()
        channel = link.from_socket.name if node.type == "SEPARATE_COLOR" else channel
        socket = node.inputs["Height" if node.type == "DISPLACEMENT" else "Color"]
    return "nothing"


def main(folder: Path) -> None:
    """Raises `AssertionError` where Blender has something else than was written."""
    expected = json.loads((folder / "expected.json").read_text())
    for number, name in enumerate(expected["names"]):
        for layout, suffix in (("blender", "usda"), ("gltf", "glb")):
            count = check(folder / str(number) / layout / f"{name}.{suffix}", expected, name)
            print(
                f"Blender {bpy.app.version_string}: {name}.{suffix} right ({count} sockets, colour spaces, pixels)"
            )


def check(file: Path, expected: dict, name: str) -> int:
    """Import a material's document; how many sockets its pictures feed."""
    suffix = file.suffix[1:]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if suffix == "glb":
        bpy.ops.import_scene.gltf(filepath=str(file))
    else:
        bpy.ops.wm.usd_import(filepath=str(file))
    (material,) = [one for one in bpy.data.materials if one.name != "Dots Stroke"]
    assert material.name == (ascii_name(name) if suffix == "usda" else name), material.name
    nodes = material.node_tree.nodes
    surface = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    output = next(node for node in nodes if node.type == "OUTPUT_MATERIAL")
    sockets = {
        socket: fed((output if socket == "Displacement" else surface).inputs[socket]) for socket in SOCKETS[suffix]
    }
    wanted = {socket: what.format(name) for socket, what in SOCKETS[suffix].items()}
    assert sockets == wanted, sockets
    if suffix == "usda":
        displacement = next(node for node in nodes if node.type == "DISPLACEMENT")
        scale, right = displacement.inputs["Scale"].default_value, RELIEF * expected["side"] * TEXEL
        assert abs(scale - right) < 1e-5, (scale, right)
    starts = (f"{name}_base_color", f"{name}_baseColor")
    picture = next(one for one in bpy.data.images if one.name.startswith(starts))
    means = np.array(picture.pixels[:]).reshape(-1, 4)[:, :3].mean(axis=0)
    right = [expected["means"][channel] for channel in "RGB"]
    assert np.allclose(means, right, atol=0.01), (means, right)
    return len(sockets)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
