"""Renders a sphere with each material set in a folder, as the program of its layout reads the files; needs `bpy`.

    python tests/pipelines/media/render_sphere.py FOLDER [SIDE]

FOLDER holds a folder for each layout; FOLDER/LAYOUT.png is its sphere. glTF and USD are imported by Blender's own
importers, the files of other layouts connected as those programs document them.
"""

import sys
from pathlib import Path

import bpy

TABLES = {
    "unreal": {"_BC": "color", "_ORM": "orm", "_N": "normal down"},
    # the mask map of HDRP, and Standard's metallic with smoothness in alpha, as Unity's manual has them
    "unity": {"_BaseMap": "color", "_MaskMap": "mask", "_Normal": "normal up"},
    "unity_standard": {"_AlbedoTransparency": "color", "_MetallicSmoothness": "mask", "_Normal": "normal up"},
    # ORMMaterial3D of Godot's class reference
    "godot": {"_albedo": "color", "_orm": "orm", "_normal": "normal up"},
    "arnold": {
        "_baseColor": "linear color", "_specularRoughness": "roughness", "_metalness": "metallic",
        "_normal": "normal up",
    },
    "substance": {
        "_basecolor": "color", "_roughness": "roughness", "_metallic": "metallic", "_normal": "normal down",
    },
}  # fmt: skip
"""end of a file's name to what it holds, for layouts without a document that Blender imports"""
REPEATS = 2.0
"""times that the texture goes around the sphere from pole to pole; twice that along the equator"""


def material_of(layout: str, folder: Path) -> bpy.types.Material:
    """The material of the files in a folder."""
    if layout == "gltf":
        bpy.ops.import_scene.gltf(filepath=str(next(folder.glob("*.glb"))))
    elif layout == "blender":
        bpy.ops.wm.usd_import(filepath=str(next(folder.glob("*.usda"))))
    else:
        return connected(TABLES[layout], folder)
    return next(one for one in bpy.data.materials if one.name != "Dots Stroke")


def connected(table: dict[str, str], folder: Path) -> bpy.types.Material:
    """A material of nodes for the files that a table names."""
    material = bpy.data.materials.new("connected")
    material.use_nodes = True
    tree = material.node_tree
    shader = tree.nodes["Principled BSDF"]
    for end, what in table.items():
        file = next((path for path in folder.iterdir() if path.stem.endswith(end)), None)
        if file is None:
            continue
        picture = tree.nodes.new("ShaderNodeTexImage")
        picture.image = bpy.data.images.load(str(file))
        picture.image.alpha_mode = "CHANNEL_PACKED"
        space = {"color": "sRGB", "linear color": "Linear Rec.709"}.get(what, "Non-Color")
        picture.image.colorspace_settings.name = space
        color = picture.outputs["Color"]
        planes = tree.nodes.new("ShaderNodeSeparateColor")
        tree.links.new(color, planes.inputs[0])
        red, green, blue = planes.outputs
        if what.endswith("color"):
            tree.links.new(color, shader.inputs["Base Color"])
        elif what in ("roughness", "metallic"):
            tree.links.new(red, shader.inputs[what.capitalize()])
        elif what == "orm":
            tree.links.new(green, shader.inputs["Roughness"])
            tree.links.new(blue, shader.inputs["Metallic"])
        elif what == "mask":
            tree.links.new(red, shader.inputs["Metallic"])
            tree.links.new(inverted(tree, picture.outputs["Alpha"]), shader.inputs["Roughness"])
        else:
            joined = tree.nodes.new("ShaderNodeCombineColor")
            for index, plane in enumerate((red, inverted(tree, green) if what == "normal down" else green, blue)):
                tree.links.new(plane, joined.inputs[index])
            bent = tree.nodes.new("ShaderNodeNormalMap")
            tree.links.new(joined.outputs[0], bent.inputs["Color"])
            tree.links.new(bent.outputs[0], shader.inputs["Normal"])
    return material


def inverted(tree: bpy.types.NodeTree, value: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """1 - ``value``."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = "SUBTRACT"
    node.inputs[0].default_value = 1
    tree.links.new(value, node.inputs[1])
    return node.outputs[0]


def render(material: bpy.types.Material, file: Path, side: int) -> None:
    """Write a picture of a sphere under two lights."""
    scene = bpy.context.scene
    for one in list(scene.objects):
        bpy.data.objects.remove(one)
    for output in [one for one in material.node_tree.nodes if one.type == "OUTPUT_MATERIAL"]:
        for link in list(output.inputs["Displacement"].links):  # no game engine does so by default
            material.node_tree.links.remove(link)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48)
    sphere = bpy.context.object
    bpy.ops.object.shade_smooth()
    sphere.data.materials.append(material)
    for corner in sphere.data.uv_layers[0].data:
        corner.uv = (corner.uv[0] * 2 * REPEATS, corner.uv[1] * REPEATS)
    sphere.data.uv_layers.new(name="st")  # a copy, by the name that the USD file reads
    bpy.ops.object.light_add(type="SUN", rotation=(0.6, 0.5, 0))
    bpy.context.object.data.energy = 3
    bpy.ops.object.light_add(type="AREA", location=(-3, -3, 1), rotation=(1.3, 0, -0.8))
    bpy.context.object.data.energy = 60
    bpy.ops.object.camera_add(location=(0, -4, 0), rotation=(1.5707963, 0, 0))
    scene.camera = bpy.context.object
    scene.camera.data.lens = 60
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.seed, scene.cycles.use_denoising = 32, 1, False
    scene.render.resolution_x = scene.render.resolution_y = side
    scene.render.filepath = str(file)
    scene.view_settings.view_transform = "Standard"
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    root, size = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 96
    for place in sorted(path for path in root.iterdir() if path.name in ("blender", "gltf", *TABLES)):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        render(material_of(place.name, place), root / f"{place.name}.png", size)
