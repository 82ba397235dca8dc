"""The panels, which hand the scene's settings to the operators."""

from __future__ import annotations

from typing import ClassVar

import bpy

from .operators import CLASSES, Cancel, NewMask
from .session import JOBS

_OPERATORS = {one.bl_idname: one for one in CLASSES}


class _Panel:
    bl_region_type, bl_category = "UI", "Texloom"
    groups: ClassVar[tuple[tuple[str, ...], ...]] = ()
    """operators that share their settings, which are above them"""

    def draw(self, context: bpy.types.Context) -> None:
        layout, chosen = self.layout, context.scene.texloom
        for job in JOBS.running:
            layout.progress(factor=job.progress.share, text=job.progress.text)
        if JOBS.running:
            layout.operator(Cancel.bl_idname)
        for group in self.groups:
            box = layout.box()
            box.use_property_split = True
            shown = dict.fromkeys(name for one in group for name in settings_of(one) if name != "image")
            for name in shown:
                if name in ("mask", "exemplar", "control"):
                    box.prop_search(chosen, name, bpy.data, "images")
                else:
                    box.prop(chosen, name)
            if "mask" in shown:
                box.operator(NewMask.bl_idname)
            for one in group:
                button = box.operator(one)
                for name in settings_of(one):
                    if name != "image":
                        setattr(button, name, getattr(chosen, name))


def settings_of(operator: str) -> list[str]:
    """The properties of an operator."""
    return list(_OPERATORS[operator].__annotations__)


_PICTURES = (
    ("texloom.make_tileable",), ("texloom.larger", "texloom.variations"), ("texloom.fill", "texloom.revise"),
)  # fmt: skip


class ImagePanel(_Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_space_type = "TEXLOOM_PT_image", "Texloom", "IMAGE_EDITOR"
    groups = _PICTURES


class ShaderPanel(_Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_space_type = "TEXLOOM_PT_shader", "Texloom", "NODE_EDITOR"
    groups = (("texloom.material",), *_PICTURES, ("texloom.on_mesh",))

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.space_data.tree_type == "ShaderNodeTree"


class ViewPanel(_Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_space_type = "TEXLOOM_PT_view", "Texloom", "VIEW_3D"
    groups = (("texloom.material",), ("texloom.on_mesh",))


_CLASSES = (ImagePanel, ShaderPanel, ViewPanel)


def register() -> None:
    for one in _CLASSES:
        bpy.utils.register_class(one)


def unregister() -> None:
    for one in reversed(_CLASSES):
        bpy.utils.unregister_class(one)
