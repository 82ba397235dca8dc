"""Renders the plane of a .usda file under a light, seen straight on, as linear light; needs `bpy`.

    python tests/pipelines/media/render_plane.py FILE.usda SIDE X Y Z RESULT.npy

SIDE is that of the square plane and of the picture, px; X Y Z point towards the light: right, up, to the viewer.
"""

import math
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector


def render(file: Path, side: int, light: tuple[float, float, float]) -> np.ndarray:
    """Radiance, (side, side, 3), of which 1 is that of a white plane that faces the light."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=str(file))
    scene = bpy.context.scene
    for material in bpy.data.materials:
        for output in [one for one in material.node_tree.nodes if one.type == "OUTPUT_MATERIAL"]:
            for link in list(output.inputs["Displacement"].links):  # the preview does not show it
                material.node_tree.links.remove(link)
    right, up, viewer = light
    bpy.ops.object.light_add(type="SUN")
    sun = bpy.context.object
    sun.rotation_mode = "QUATERNION"
    sun.rotation_quaternion = Vector((right, -viewer, up)).to_track_quat("Z", "Y")
    sun.data.energy, sun.data.angle = math.pi, 0
    bpy.ops.object.camera_add(location=(0, -3, 0), rotation=(math.pi / 2, 0, 0))
    scene.camera = bpy.context.object
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 1
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.seed, scene.cycles.use_denoising = 16, 1, False
    scene.cycles.pixel_filter_type, scene.cycles.max_bounces = "BOX", 0
    scene.render.resolution_x = scene.render.resolution_y = side
    scene.render.image_settings.file_format = "OPEN_EXR"
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder, "plane.exr"))
        bpy.ops.render.render(write_still=True)
        picture = bpy.data.images.load(scene.render.filepath)
        return np.array(picture.pixels[:], np.float32).reshape(side, side, 4)[::-1, :, :3]


if __name__ == "__main__":
    name, pixels, *direction, made = sys.argv[1:]
    x, y, z = map(float, direction)
    np.save(made, render(Path(name), int(pixels), (x, y, z)))
