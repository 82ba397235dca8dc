"""The operators. Of pictures: that which ``image`` names, else that of the editor."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty

from . import images, material_requests, materials, pixels, requests, surfaces
from .running import Running, Task
from .session import JOBS
from .settings import properties
from .texloom_client import RunResult, TexloomError


def current(context: bpy.types.Context) -> bpy.types.Image | None:
    """The picture of an image editor, or of the active image node of a shader editor."""
    space = context.space_data
    if space is not None and space.type == "IMAGE_EDITOR":
        return space.image
    node = context.active_node if space is not None and space.type == "NODE_EDITOR" else None
    return node.image if node is not None and node.type == "TEX_IMAGE" else None


_OWNERS = ("materials", "worlds", "lights", "node_groups")


def _tree(owner: bpy.types.ID) -> bpy.types.NodeTree | None:
    """The nodes of a material or the like; a group is its own."""
    return owner if isinstance(owner, bpy.types.NodeTree) else getattr(owner, "node_tree", None)


class _Place:
    """Where a result is shown: names, as undo moves what has them."""

    def __init__(self, context: bpy.types.Context):
        space = context.space_data
        node = context.active_node if space is not None and space.type == "NODE_EDITOR" else None
        self._node: tuple[str, str, str] | None = None
        if node is not None:
            owners = [(kind, one) for kind in _OWNERS for one in getattr(bpy.data, kind)]
            found = next((one for one in owners if _tree(one[1]) == node.id_data), None)
            self._node = (found[0], found[1].name, node.name) if found else None
        self._editor = space.as_pointer() if space is not None and space.type == "IMAGE_EDITOR" else 0

    def show(self, image: bpy.types.Image) -> None:
        """Show a picture in the editor, or in the node, from which the operator was called."""
        if self._node is not None:
            kind, name, node_name = self._node
            owner = getattr(bpy.data, kind).get(name)
            node = _tree(owner).nodes.get(node_name) if owner is not None and _tree(owner) else None
            if node is not None and node.type == "TEX_IMAGE":
                node.image = image
        for screen in bpy.data.screens if self._editor else ():
            for area in screen.areas:
                if area.spaces.active.as_pointer() == self._editor and area.type == "IMAGE_EDITOR":
                    area.spaces.active.image = image


class _OfPicture(Running):
    """An operator that makes pictures from one."""

    suffix = ""

    def source(self, context: bpy.types.Context) -> bpy.types.Image:
        if self.image:
            return images.named(self.image, "image")
        found = current(context)
        if found is None:
            raise TexloomError("no picture is open; open one, or choose an image node")
        return found

    def made(self, context: bpy.types.Context, asked: list[requests.Request], exemplar: str = "") -> Task:
        source = self.source(context)
        names = (source.name, exemplar or source.name)
        return Task(asked, partial(_add_images, names, f"{Path(source.name).stem} {self.suffix}", _Place(context)))


def _add_images(names: tuple[str, str], name: str, place: _Place, results: list[RunResult]) -> str:
    like = bpy.data.images.get(names[0])
    made = [images.new(name, one.maps["albedo"], like, names[1]) for one in results]
    place.show(made[0])
    told = ", ".join(image.name for image in made)
    return f"{told}, {made[0].size[0]}x{made[0].size[1]} px"


class MakeTileable(_OfPicture, bpy.types.Operator):
    """Make a picture that repeats: a new band along its borders; all else stays"""

    bl_idname, bl_label, suffix = "texloom.make_tileable", "Make Tileable", "tileable"
    __annotations__ = {
        "image": StringProperty(options={"SKIP_SAVE"}),
        **properties("axes", "keep_size", "preset", "seed"),
    }

    def task(self, context: bpy.types.Context) -> Task:
        picture = images.sent(self.source(context))
        return self.made(
            context, requests.make_tileable(picture, self.axes, self.keep_size, self.preset, self.seed)
        )


class Larger(_OfPicture, bpy.types.Operator):
    """Make a larger texture that looks like the picture"""

    bl_idname, bl_label, suffix = "texloom.larger", "Larger Texture", "larger"
    _names = ("width", "height", "tileable", "method", "preset", "seed")
    __annotations__ = {"image": StringProperty(options={"SKIP_SAVE"}), **properties(*_names)}

    def task(self, context: bpy.types.Context) -> Task:
        sizes = (self.width, self.height, self.tileable, self.method, self.preset, self.seed)
        return self.made(context, requests.larger(images.sent(self.source(context)), *sizes))


class Variations(_OfPicture, bpy.types.Operator):
    """Make several textures that look like the picture, each with the next seed"""

    bl_idname, bl_label, suffix = "texloom.variations", "Variations", "variation"
    _names = ("width", "height", "tileable", "method", "preset", "seed", "count")
    __annotations__ = {"image": StringProperty(options={"SKIP_SAVE"}), **properties(*_names)}

    def task(self, context: bpy.types.Context) -> Task:
        sizes = (self.width, self.height, self.tileable, self.method, self.preset, self.seed, self.count)
        return self.made(context, requests.larger(images.sent(self.source(context)), *sizes))


class Fill(_OfPicture, bpy.types.Operator):
    """Fill what is transparent, or painted white in the mask, from the rest of the picture"""

    bl_idname, bl_label, suffix = "texloom.fill", "Fill Mask", "filled"
    __annotations__ = {"image": StringProperty(options={"SKIP_SAVE"}), **properties("mask", "preset", "seed")}

    def task(self, context: bpy.types.Context) -> Task:
        picture, holes = _masked(self.source(context), self.mask)
        return self.made(context, requests.fill(picture, holes, self.preset, self.seed))


class Revise(_OfPicture, bpy.types.Operator):
    """Make what is transparent, or painted white in the mask, anew, like the exemplar"""

    bl_idname, bl_label, suffix = "texloom.revise", "Revise Mask", "revised"
    __annotations__ = {
        "image": StringProperty(options={"SKIP_SAVE"}),
        **properties("mask", "exemplar", "tileable", "preset", "seed"),
    }

    def task(self, context: bpy.types.Context) -> Task:
        source = self.source(context)
        texture, region = _masked(source, self.mask)
        exemplar = images.named(self.exemplar or source.get(images.EXEMPLAR, ""), "exemplar")
        asked = requests.revise(texture, images.sent(exemplar), region, self.tileable, self.preset, self.seed)
        return self.made(context, asked, exemplar.name)


def _masked(source: bpy.types.Image, mask: str) -> tuple[Any, Any]:
    """What is sent of a picture, and its mask."""
    values = images.read(source)
    if mask:
        white = pixels.painted(images.read(images.named(mask, "mask")), values.shape[:2])
        return pixels.without_alpha(values), pixels.some(white, "white in the mask")
    return values[..., :3].copy(), pixels.some(pixels.transparent(values), "transparent")


class NewMask(bpy.types.Operator):
    """Add a black picture of the same size to paint the mask on"""

    bl_idname, bl_label, bl_options = "texloom.new_mask", "New Mask", {"UNDO"}
    __annotations__ = {"image": StringProperty(options={"SKIP_SAVE"})}

    def execute(self, context: bpy.types.Context) -> set[str]:
        source = bpy.data.images.get(self.image) if self.image else current(context)
        if source is None:
            self.report({"ERROR"}, f"New Mask: {self.image or 'no picture is open'}: there is no such picture")
            return {"CANCELLED"}
        mask = bpy.data.images.new(f"{Path(source.name).stem} mask", *source.size)
        mask.colorspace_settings.name = "Non-Color"
        context.scene.texloom.mask = mask.name
        _Place(context).show(mask) if not self.image else None
        self.report({"INFO"}, f"New Mask: paint white on {mask.name}, then fill or revise {source.name}")
        return {"FINISHED"}


class Material(Running, bpy.types.Operator):
    """Make a material with all its maps from a folder of maps, or from a photograph of a surface"""

    bl_idname, bl_label = "texloom.material", "Material"
    __annotations__ = properties("path", "size", "tileable", "texel_size", "preset", "seed")

    def task(self, context: bpy.types.Context) -> Task:
        path = bpy.path.abspath(self.path) if self.path else ""
        asked = material_requests.material(path, self.size, self.tileable, self.texel_size, self.preset, self.seed)
        active = context.view_layer.objects.active
        target = active.name if active is not None and active.type == "MESH" else ""
        return Task(asked, partial(_add_material, Path(path.rstrip("/\\")).stem, target, self.texel_size))


def _add_material(name: str, target: str, texel_size: float, results: list[RunResult]) -> str:
    material, notes = materials.from_files(name, results[0].files, texel_size=texel_size)
    where = bpy.data.objects.get(target)
    if where is not None:
        materials.assign(where, material)
    told = f"{material.name}{f' on {target}' if where is not None else ''}"
    return "; ".join([told, *notes])


class OnMesh(Running, bpy.types.Operator):
    """Make a texture on the active mesh without seams between its charts"""

    bl_idname, bl_label = "texloom.on_mesh", "Texture on Mesh"
    _names = ("source_folder", "size", "texel_size", "new_coordinates", "turn", "use_curves", "direction", "paint")
    __annotations__ = {"image": StringProperty(options={"SKIP_SAVE"}), **properties(*_names, "control", "seed")}

    def task(self, context: bpy.types.Context) -> Task:
        target = context.view_layer.objects.active
        if target is None or target.type != "MESH":
            raise TexloomError("no mesh is active; select one")
        folder = bpy.path.abspath(self.source_folder) if self.source_folder else ""
        if folder and not Path(folder).is_dir():
            raise TexloomError(f"source_folder: {folder}: no such folder")
        exemplar: Any = folder or images.sent(self._picture(context))
        chosen = context.selected_objects if self.use_curves else []
        curves = [one for one in chosen if one.type == "CURVE"]
        if self.use_curves and not curves:
            raise TexloomError("no curve is selected; select those that lie on the mesh, and the mesh last")
        surface = surfaces.of(
            target, new_coordinates=self.new_coordinates, curves=curves, direction=self.direction,
            control=self.paint,
        )  # fmt: skip
        kept = tempfile.TemporaryDirectory(prefix="texloom-")
        mesh = Path(kept.name, "mesh.glb")
        mesh.write_bytes(surface.content)
        try:
            asked = material_requests.on_mesh(
                exemplar, str(mesh), self.size, self.texel_size, self.turn, self.seed,
                control=images.sent(images.named(self.control, "control")) if self.control else None,
                has_control=bool(self.paint), has_maps=bool(folder),
            )  # fmt: skip
        except BaseException:
            kept.cleanup()
            raise
        name = Path(folder.rstrip("/\\")).name if folder else self._picture(context).name
        apply = partial(_add_surface, target.name, name, surface, "" if folder else name, self.texel_size)
        return Task(asked, apply, kept.cleanup)

    def _picture(self, context: bpy.types.Context) -> bpy.types.Image:
        found = images.named(self.image, "image") if self.image else current(context)
        if found is None:
            raise TexloomError("no exemplar; choose a picture or a folder of maps")
        return found


def _add_surface(
    target: str, name: str, surface: surfaces.Surface, exemplar: str, texel_size: float, results: list[RunResult]
) -> str:
    where = bpy.data.objects.get(target)
    if where is None or where.type != "MESH":
        raise TexloomError(f"{target}: the mesh is gone")
    if where.mode == "EDIT":
        raise TexloomError(f"{target}: is being edited; leave the edit mode, and run it again")
    if surface.new is not None:
        surfaces.add_layer(where.data, surface.new)
    title, notes = f"{Path(name).stem} on {target}", []
    if exemplar:
        image = images.new(title, results[0].maps["albedo"], bpy.data.images.get(exemplar), exemplar)
        material = materials.from_image(title, image, surface.layer)
    else:
        material, notes = materials.from_files(title, results[0].files, surface.layer, texel_size)
    materials.assign(where, material)
    return "; ".join([f"{material.name}, in the UV map {surface.layer}", *notes])


class Cancel(bpy.types.Operator):
    """Cancel what texloom makes"""

    bl_idname, bl_label = "texloom.cancel", "Cancel"

    def execute(self, _: bpy.types.Context) -> set[str]:
        JOBS.cancel_all()
        return {"FINISHED"}


CLASSES = (MakeTileable, Larger, Variations, Fill, Revise, NewMask, Material, OnMesh, Cancel)


def register() -> None:
    for one in CLASSES:
        bpy.utils.register_class(one)


def unregister() -> None:
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)
