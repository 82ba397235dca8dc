"""The extension for Blender, installed and run in Blender: operators, node graphs, renders, undo, cancel.

python in_extension.py ARCHIVE FOLDER, with a Python that has `bpy`, what `tests.hosts.write` wrote, and TEXLOOM set
"""

from __future__ import annotations

import importlib
import itertools
import os
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np

MODULE = "bl_ext.user_default.texloom"
SIDE = 64
FAST = {"preset": "fast", "seed": 3}


def part(name: str) -> object:
    """A module of the extension."""
    return importlib.import_module(f"{MODULE}.{name}")


def install(archive: Path) -> None:
    """As a person does who drops the archive on Blender."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.extensions.package_install_files(filepath=str(archive), repo="user_default", enable_on_install=True)
    assert MODULE in bpy.context.preferences.addons


def pixels(image: bpy.types.Image) -> np.ndarray:
    values = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(values)
    return values.reshape(image.size[1], image.size[0], 4)


def exemplar(name: str = "dots", is_float: bool = False) -> bpy.types.Image:
    """A grid of dots, of which none is like another; red rises to the top."""
    row, column = np.mgrid[:SIDE, :SIDE].astype(np.float32)
    random = np.random.default_rng(1)
    dots = np.hypot(row % 16 - 8, column % 16 - 8) < 3 + 4 * random.random((4, 4)).repeat(16, 0).repeat(16, 1)
    values = np.stack([0.3 + 0.4 * dots, 0.2 + 0.5 * dots, 0.3 + 0.0 * row, 1 + 0 * row], axis=2)
    values[..., :3] += 0.05 * random.random((SIDE, SIDE, 3))
    image = bpy.data.images.new(name, SIDE, SIDE, float_buffer=is_float)
    if is_float:
        image.colorspace_settings.name = "Linear Rec.709"
    image.pixels.foreach_set(values.astype(np.float32).ravel())
    image.update()
    image.pack()
    return image


def call(name: str, **values: object) -> list[str]:
    """Run an operator as a script does, with an undo step; the names of the images that are new."""
    before = set(bpy.data.images.keys())
    assert getattr(bpy.ops.texloom, name)("EXEC_DEFAULT", True, **values) == {"FINISHED"}, name
    return sorted(set(bpy.data.images.keys()) - before)


def refused(name: str, **values: object) -> str:
    """The one line in which an operator refuses."""
    try:
        answer = getattr(bpy.ops.texloom, name)("EXEC_DEFAULT", True, **values)
    except RuntimeError as error:
        line = str(error).strip().removeprefix("Error: ")
        assert "\n" not in line, line
        return line
    raise AssertionError(f"{name} was not refused: {answer}")


def fresh() -> None:
    """An empty file whose first undo step is on the stack."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    bpy.ops.ed.undo_push(message="start")


def undone(*collections: str) -> None:
    """One step back, and no trace is left; one forward, and all is there again."""
    count = {name: len(getattr(bpy.data, name)) for name in collections}
    bpy.ops.ed.undo()
    lost = {name: count[name] - len(getattr(bpy.data, name)) for name in collections}
    assert all(lost.values()), lost
    bpy.ops.ed.redo()
    assert {name: len(getattr(bpy.data, name)) for name in collections} == count


# -- what is checked


def pictures() -> str:
    """Make tileable, larger and variations of 8 bits and of floats."""
    fresh()
    exemplar()
    bpy.ops.ed.undo_push(message="exemplar")
    (name,) = call("make_tileable", image="dots", keep_size=True, **FAST)
    given, made = pixels(bpy.data.images["dots"]), pixels(bpy.data.images[name])
    kept = np.abs(given - made).max(axis=2) == 0
    assert kept[24:40, 24:40].all(), "the middle has changed, or is upside down"
    assert not kept.all()
    undone("images")
    assert "dots" in bpy.data.images
    (name,) = call("larger", image="dots", width=96, height=80, method="quilting", tileable="off", seed=3)
    assert tuple(bpy.data.images[name].size) == (96, 80)
    assert bpy.data.images[name]["texloom_exemplar"] == "dots"
    assert bpy.data.images[name].packed_file is not None
    small = {"width": 48, "height": 48, "method": "quilting", "tileable": "off", "seed": 3}
    names = call("variations", image="dots", count=3, **small)
    three = [pixels(bpy.data.images[one]) for one in names]
    assert len(three) == 3
    assert all(np.abs(a - b).max() > 0 for a, b in itertools.pairwise(three))
    undone("images")
    bright = exemplar("bright", is_float=True)
    scaled = pixels(bright) * np.array((3, 3, 3, 1), np.float32)
    bright.pixels.foreach_set(scaled.ravel())
    (name,) = call("larger", image="bright", **small)
    made = bpy.data.images[name]
    assert made.is_float
    assert pixels(made)[..., :3].max() > 1.5, "light above 1 is lost"
    return "tileable, larger, variations, floats, one undo step each"


def masks() -> str:
    """Fill and revise what is painted, and what is transparent."""
    fresh()
    image = exemplar()
    values = pixels(image)
    values[30:40, 10:25, 3] = 0  # rows from below
    image.pixels.foreach_set(values.ravel())
    (filled,) = call("fill", image="dots", **FAST)
    made = pixels(bpy.data.images[filled])
    assert (made[..., 3] == 1).all()
    changed = np.abs(made - values)[..., :3].max(axis=2) > 0
    assert changed[30:40, 10:25].mean() > 0.5
    changed[30:40, 10:25] = False
    assert not changed.any(), "something else has changed"
    undone("images")
    bpy.ops.texloom.new_mask(image="dots")
    mask = bpy.data.images["dots mask"]
    assert bpy.context.scene.texloom.mask == "dots mask"
    white = pixels(mask)
    white[5:20, 40:60, :3] = 1
    mask.pixels.foreach_set(white.ravel())
    made[5:20, 40:60, :3] = (1, 0, 1)
    bpy.data.images[filled].pixels.foreach_set(made.ravel())
    (revised,) = call(
        "revise", image=filled, mask="dots mask", tileable="off", exemplar="", **FAST
    )  # its exemplar is known
    again = pixels(bpy.data.images[revised])
    changed = np.abs(again - made)[..., :3].max(axis=2) > 0
    assert changed[5:20, 40:60].all(), "what was wrong is still there"
    changed[5:20, 40:60] = False
    assert not changed.any(), "something else has changed"
    undone("images")
    return "fill and revise by alpha and by mask, all else bit-identical"


def editors() -> str:
    """In the image editor the open picture is taken, in the shader editor that of the active node."""
    fresh()
    exemplar()
    if not bpy.context.window_manager.windows:
        return "editors skipped: this Blender has no window"
    small = {"width": 48, "height": 48, "method": "quilting", "tileable": "off", "seed": 3}
    window = bpy.context.window_manager.windows[0]
    area = max(window.screen.areas, key=lambda one: one.width)
    area.type = "IMAGE_EDITOR"
    area.spaces.active.image = bpy.data.images["dots"]
    with bpy.context.temp_override(window=window, area=area):
        (name,) = call("larger", **small)
    assert area.spaces.active.image.name == name
    made = part("materials").from_image("wall", bpy.data.images["dots"])
    target = plane()
    part("materials").assign(target, made)
    area.type = "NODE_EDITOR"
    area.ui_type = "ShaderNodeTree"
    area.spaces.active.node_tree = made.node_tree
    made.node_tree.nodes.active = made.node_tree.nodes["base_color"]
    with bpy.context.temp_override(window=window, area=area, object=target, active_object=target):
        if bpy.context.active_node is None:  # which is set when the editor is drawn
            return "image editor; the shader editor skipped, as it has no active node without a window"
        (name,) = call("larger", **small)
    assert made.node_tree.nodes["base_color"].image.name == name
    return "image editor and shader editor take and show pictures"


def drawn() -> str:
    """The panels hand over every setting, and show what goes on."""
    fresh()
    panels, controller = part("panels"), part("controller")
    given: dict[str, dict[str, object]] = {}
    shown: list[object] = []

    class Layout(SimpleNamespace):
        def box(self) -> Layout:
            return self

        def prop(self, settings: object, name: str) -> None:
            assert hasattr(settings, name)

        def prop_search(self, settings: object, name: str, _: object, __: str) -> None:
            self.prop(settings, name)

        def progress(self, **values: object) -> None:
            shown.append(values)

        def operator(self, name: str) -> object:
            made = SimpleNamespace()
            given[name] = vars(made)
            return made

    session = part("session")
    session.JOBS.running.append(SimpleNamespace(progress=controller.Progress("running", 0.5, "half")))
    try:
        for panel in (panels.ImagePanel, panels.ShaderPanel, panels.ViewPanel):
            panel.draw(SimpleNamespace(layout=Layout(), groups=panel.groups), bpy.context)
    finally:
        session.JOBS.running.clear()
    assert shown == 3 * [{"factor": 0.5, "text": "half"}]
    made = {name: set(values) for name, values in given.items()}
    operators = {one.bl_idname: one for one in part("operators").CLASSES}
    assert set(made) == set(operators)
    for name, values in made.items():
        rna = getattr(bpy.ops.texloom, name.partition(".")[2]).get_rna_type()
        assert values == set(rna.properties.keys()) - {"rna_type", "image"}, name
    return f"{len(made)} operators in 3 panels, with all their settings"


def refusals() -> str:
    """Errors are one line, and leave nothing behind."""
    fresh()
    exemplar()
    assert refused("larger", image="nothing") == "Larger Texture: image: nothing: there is no such picture"
    assert "no picture is open" in refused("larger")
    assert "nothing is transparent" in refused("fill", image="dots")
    bpy.data.images.new("small", 8, 8)
    assert "the mask has 8x8 px, the picture 64x64 px" in refused("fill", image="dots", mask="small")
    mask = exemplar("mask")
    values = pixels(mask)
    values[:] = 0
    values[:9, :9] = 1
    mask.pixels.foreach_set(values.ravel())
    assert "exemplar: no picture is chosen" in refused("revise", image="dots", mask="mask", exemplar="")
    assert "no such folder or picture" in refused("material", path="/nothing/here")
    assert "texel_size: 0 mm is not above 0" in refused("material", path=__file__, texel_size=0)
    assert "is neither a folder of maps nor one of" in refused("material", path=__file__)
    assert "no mesh is active" in refused("on_mesh", image="dots")
    line = refused("larger", image="small", width=48, height=48, method="near_regular", tileable="off")
    assert line.startswith("Larger Texture: "), line
    assert len(bpy.data.images) == 3
    assert not part("session").JOBS.running
    return "10 refusals, each in one line"


def plane() -> bpy.types.Object:
    bpy.ops.mesh.primitive_plane_add(size=2)
    return bpy.context.view_layer.objects.active


def fed(material: bpy.types.Material) -> dict[str, tuple[str, str]]:
    """Of each socket of the surface and the output: node type and colour space of the picture behind it."""
    found = {}
    for link in material.node_tree.links:
        if link.to_node.type not in ("BSDF_PRINCIPLED", "OUTPUT_MATERIAL"):
            continue
        node = link.from_node
        while node.type in ("NORMAL_MAP", "DISPLACEMENT"):
            node = node.inputs["Color" if node.type == "NORMAL_MAP" else "Height"].links[0].from_node
        if node.type == "TEX_IMAGE":
            found[link.to_socket.name] = (node.name, node.image.colorspace_settings.name)
    return found


def material(folder: Path) -> str:
    """A folder of maps to a material, as Blender's own importer of USD builds it."""
    fresh()
    plane()
    bpy.ops.ed.undo_push(message="plane")
    source = folder / "0" / "blender"
    call("material", path=str(source), size=SIDE, texel_size=1.0, **FAST)
    (made,) = [one for one in bpy.data.materials if one.name != "Dots Stroke"]
    right = {
        "Base Color": ("base_color", "sRGB"),
        "Roughness": ("roughness", "Non-Color"),
        "Metallic": ("metallic", "Non-Color"),
        "Alpha": ("opacity", "Non-Color"),
        "Emission Color": ("emissive", "sRGB"),
        "Normal": ("normal", "Non-Color"),
        "Displacement": ("height", "Non-Color"),
    }
    found = fed(made)
    assert {name: found.get(name) for name in right} == right, found
    assert bpy.context.view_layer.objects.active.data.materials[0] == made
    assert made.displacement_method == "DISPLACEMENT"
    assert made["texloom_texel_size_mm"] == 1.0
    displacement = next(node for node in made.node_tree.nodes if node.type == "DISPLACEMENT")
    assert abs(displacement.inputs["Scale"].default_value - 0.05 * SIDE * 0.001) < 1e-6
    heights = made.node_tree.nodes["height"].image
    assert heights.is_float, "heights have lost their 16 bits"
    assert all(node.image.packed_file for node in made.node_tree.nodes if node.type == "TEX_IMAGE")
    undone("materials", "images")
    return f"material of {len(found)} maps, packed, 16 bits kept, scale of the displacement right"


def render(path: Path) -> np.ndarray:
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CPU", 16, 0
    scene.cycles.use_denoising = False
    scene.render.resolution_x = scene.render.resolution_y = SIDE
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.filepath = str(path)
    if scene.world is None:
        scene.world = bpy.data.worlds.new("white")
    if scene.camera is None:
        camera = bpy.data.cameras.new("above")
        camera.type, camera.ortho_scale = "ORTHO", 2
        scene.camera = bpy.data.objects.new("above", camera)
        scene.camera.location = (0, 0, 2)
        light = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
        light.rotation_euler = (0.7, 0.3, 0)
        scene.collection.objects.link(scene.camera)
        scene.collection.objects.link(light)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    values = pixels(image)[..., :3].copy()
    bpy.data.images.remove(image)
    return values


def renders(folder: Path, out: Path) -> str:
    """Cycles shows the extension's material as it shows what Blender's USD importer makes of the same files."""
    fresh()
    source = folder / "0" / "blender"
    files = {f"maps/{one.name}": one.read_bytes() for one in source.iterdir() if one.is_file()}
    target = plane()
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide(number_cuts=40)
    bpy.ops.object.mode_set(mode="OBJECT")
    target.data.uv_layers[0].name = "st"  # as USD calls them
    ours, _ = part("materials").from_files("ours", files)
    (document,) = source.glob("*.usda")
    bpy.ops.wm.usd_import(filepath=str(document))
    (theirs,) = [one for one in bpy.data.materials if one.name not in ("ours", "Dots Stroke")]
    for other in [one for one in bpy.data.objects if one.type == "MESH" and one != target]:
        bpy.data.objects.remove(other)
    displaced = [node for node in theirs.node_tree.nodes if node.type == "DISPLACEMENT"]
    if displaced:  # stronger, so that it shows
        for node in (displaced[0], ours.node_tree.nodes["displacement"]):
            node.inputs["Scale"].default_value *= 30
        theirs.displacement_method = ours.displacement_method
    else:  # before Blender 4.4 USD's is not imported
        ours.node_tree.nodes.remove(ours.node_tree.nodes["displacement"])
    part("materials").assign(target, theirs)
    reference = render(out / "reference.exr")
    part("materials").assign(target, ours)
    seen = render(out / "ours.exr")
    difference = float(np.abs(seen - reference).mean())
    assert seen.std() > 0.02, "nothing is to be seen"
    ours.node_tree.nodes["bump"].inputs["Strength"].default_value = 0
    wrong = float(np.abs(render(out / "wrong.exr") - reference).mean())
    assert difference < 0.2 * wrong, (difference, wrong)
    shown = "" if displaced else ", without displacement, which this Blender does not import"
    return f"Cycles: {difference:.2g} from the reference; without normals {wrong:.2g}{shown}"


def surfaces(out: Path) -> str:
    """Texture on a mesh: its own UVs and new ones, curves, paint; in place on the surface."""
    fresh()
    exemplar()
    exemplar("control")
    bpy.ops.mesh.primitive_cube_add(size=0.1)  # its UVs are a cross, which wastes nothing
    cube = bpy.context.view_layer.objects.active
    name = cube.name
    bpy.ops.ed.undo_push(message="cube")
    before = [layer.name for layer in cube.data.uv_layers]
    (image,) = call("on_mesh", image="dots", size=128, texel_size=0)
    cube = bpy.data.objects[name]
    nodes = cube.data.materials[0].node_tree.nodes
    assert nodes["base_color"].image.name == image
    assert nodes["coordinates"].uv_map == before[0]
    undone("materials", "images")
    assert not bpy.data.objects[name].data.uv_layers.get("Texloom")
    cube = bpy.data.objects[name]
    while cube.data.uv_layers:
        cube.data.uv_layers.remove(cube.data.uv_layers[0])
    paint = cube.data.color_attributes.new("paint", "FLOAT_COLOR", "POINT")
    paint.data.foreach_set("color", np.linspace(0, 1, 4 * len(paint.data), dtype=np.float32))
    curve = bpy.data.curves.new("stroke", "CURVE")
    curve.dimensions = "3D"
    line = curve.splines.new("POLY")
    line.points.add(3)
    for point, x in zip(line.points, np.linspace(-0.05, 0.05, 4), strict=True):
        point.co = (x, 0.05, 0.05, 1)
    stroke = bpy.data.objects.new("stroke", curve)
    bpy.context.scene.collection.objects.link(stroke)
    stroke.select_set(True)
    cube.select_set(True)
    bpy.context.view_layer.objects.active = cube
    meshes, scenes = len(bpy.data.meshes), len(bpy.data.scenes)
    bpy.ops.ed.undo_push(message="painted")
    call("on_mesh", image="dots", size=128, texel_size=0, use_curves=True, paint="paint", control="control")
    cube = bpy.data.objects[name]
    assert (len(bpy.data.meshes), len(bpy.data.scenes)) == (meshes, scenes), "the copy is left"
    layer = cube.data.uv_layers["Texloom"]
    uvs = np.empty(2 * len(cube.data.loops), np.float32)
    layer.uv.foreach_get("vector", uvs)
    assert 0 <= uvs.min() < uvs.max() <= 1
    assert len(np.unique(uvs.reshape(-1, 2).round(4), axis=0)) > 8
    undone("materials", "images")
    stroke = bpy.data.objects["stroke"]
    stroke.location = (9, 9, 9)
    bpy.context.view_layer.update()
    assert "stroke: does not lie on the mesh" in refused("on_mesh", image="dots", size=128, use_curves=True)
    assert "choose the control picture" in refused("on_mesh", image="dots", size=128, paint="paint")
    return "on a mesh with its UVs and new ones, along a curve, by paint"


def modal() -> str:
    """The interface goes on: progress rises, others' events pass, cancel ends it and leaves nothing."""
    fresh()
    exemplar()
    running, session, requests = part("running"), part("session"), part("requests")
    applied: list[object] = []
    timers: list[object] = []

    class Probe(running.Running):
        bl_label = "Probe"

        def __init__(self) -> None:
            self.told: list[tuple[set[str], str]] = []

        def task(self, _: object) -> object:
            picture = part("images").sent(bpy.data.images["dots"])
            asked = requests.larger(picture, 700, 700, "both", "self_tuning", "default", 3)
            return running.Task(asked, lambda made: applied.append(made) or "made")

        def report(self, kind: set[str], text: str) -> None:
            self.told.append((kind, text))

    manager = SimpleNamespace(
        event_timer_add=lambda seconds, window: timers.append(seconds) or seconds,
        event_timer_remove=timers.remove,
        modal_handler_add=lambda operator: None,
    )
    context = SimpleNamespace(window_manager=manager, window=None, screen=None)
    probe = Probe()
    begun = time.monotonic()
    assert probe.invoke(context, None) == {"RUNNING_MODAL"}
    assert time.monotonic() - begun < 0.5, "the interface waits"
    running.bpy = SimpleNamespace(context=context)
    shares, texts = [], set()
    try:
        assert probe.modal(context, SimpleNamespace(type="MOUSEMOVE")) == {"PASS_THROUGH"}
        while len(texts) < 4:
            assert probe.modal(context, SimpleNamespace(type="TIMER")) == {"PASS_THROUGH"}
            (job,) = session.JOBS.running
            shares.append(job.progress.share)
            texts.add(job.progress.text)
            time.sleep(0.05)
        bpy.ops.texloom.cancel()
        while (answer := probe.modal(context, SimpleNamespace(type="TIMER"))) == {"PASS_THROUGH"}:
            time.sleep(0.05)
    finally:
        running.bpy = bpy
    assert answer == {"CANCELLED"}
    assert probe.told == [({"WARNING"}, "Probe: cancelled")], probe.told
    assert not applied
    assert not timers
    assert not session.JOBS.running
    return f"modal: {len(texts)} steps of progress, cancelled, nothing left"


def main(archive: Path, folder: Path) -> None:
    """Raises `AssertionError` where something is not right."""
    install(archive)
    print(f"Blender {bpy.app.version_string}: the extension is installed and enabled", flush=True)
    with tempfile.TemporaryDirectory() as kept:
        out = Path(kept)
        checks = (
            *(pictures, masks, refusals, modal, editors, drawn),
            *(lambda: material(folder), lambda: renders(folder, out), lambda: surfaces(out)),
        )
        chosen = os.environ.get("CHECKS")
        for number, check in enumerate(checks):
            if chosen and str(number) not in chosen:
                continue
            begun = time.monotonic()
            told = check()
            print(f"Blender {bpy.app.version_string}: {told} [{time.monotonic() - begun:.1f} s]", flush=True)
    bpy.ops.preferences.addon_disable(module=MODULE)
    assert not hasattr(bpy.types.Scene, "texloom")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
    sys.stdout.flush()
    os._exit(0)  # Blender as a module may crash when Python ends
