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
        "Base Color": "moss_base_color.png sRGB",
        "Emission Color": "moss_emissive.png sRGB",
        "Metallic": "moss_metallic.png Non-Color Red",
        "Roughness": "moss_roughness.png Non-Color Red",
        "Alpha": "moss_opacity.png Non-Color Red",
        "Normal": "moss_normal.png Non-Color",
        "Displacement": "moss_height.png Non-Color Red",
    },
    "glb": {
        "Base Color": "moss_baseColor sRGB",
        "Emission Color": "moss_emissive sRGB",
        "Metallic": "moss_occlusionRoughnessMetallic Non-Color Blue",
        "Roughness": "moss_occlusionRoughnessMetallic Non-Color Green",
        "Normal": "moss_normal Non-Color",
    },
}
"""what feeds each socket of the surface and of the output"""
TEXEL = 0.001  # m
RELIEF = 0.05  # of the texture's side, white over black


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
    for layout, suffix in (("blender", "usda"), ("gltf", "glb")):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        file = str(folder / layout / f"moss.{suffix}")
        if suffix == "glb":
            bpy.ops.import_scene.gltf(filepath=file)
        else:
            bpy.ops.wm.usd_import(filepath=file)
        (material,) = [one for one in bpy.data.materials if one.name != "Dots Stroke"]
        nodes = material.node_tree.nodes
        surface = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
        output = next(node for node in nodes if node.type == "OUTPUT_MATERIAL")
        found = {
            name: fed((output if name == "Displacement" else surface).inputs[name]) for name in SOCKETS[suffix]
        }
        assert found == SOCKETS[suffix], found
        if suffix == "usda":
            displacement = next(node for node in nodes if node.type == "DISPLACEMENT")
            scale, wanted = displacement.inputs["Scale"].default_value, RELIEF * expected["side"] * TEXEL
            assert abs(scale - wanted) < 1e-5, (scale, wanted)
        picture = next(one for one in bpy.data.images if one.name.startswith(("moss_base_color", "moss_baseColor")))
        means = np.array(picture.pixels[:]).reshape(-1, 4)[:, :3].mean(axis=0)
        wanted = [expected["means"][name] for name in "RGB"]
        assert np.allclose(means, wanted, atol=0.01), (means, wanted)
        print(f"Blender {bpy.app.version_string}: .{suffix} right ({len(found)} sockets, colour spaces, pixels)")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
