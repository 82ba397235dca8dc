"""The jobs of this Blender, and where its texloom is."""

from __future__ import annotations

import bpy

from .controller import Jobs
from .texloom_client import Client


def _changed(_: Preferences, __: bpy.types.Context) -> None:
    JOBS.close()


class Preferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    __annotations__ = {
        "command": bpy.props.StringProperty(
            name="texloom", subtype="FILE_PATH", update=_changed,
            description="Path of texloom; empty: of the variable TEXLOOM, on the PATH, or of uv tool",
        ),
        "store": bpy.props.StringProperty(
            name="Store", subtype="DIR_PATH", update=_changed,
            description="Folder of its results; empty: texloom's own",
        ),
    }  # fmt: skip

    def draw(self, _: bpy.types.Context) -> None:
        self.layout.prop(self, "command")
        self.layout.prop(self, "store")


def _preferences() -> Preferences | None:
    addon = bpy.context.preferences.addons.get(__package__)
    return addon.preferences if addon else None


def _connected() -> Client:
    chosen = _preferences()
    command = bpy.path.abspath(chosen.command) if chosen and chosen.command else None
    store = bpy.path.abspath(chosen.store) if chosen and chosen.store else None
    return Client(command, store=store)


JOBS = Jobs(_connected)


def register() -> None:
    bpy.utils.register_class(Preferences)


def unregister() -> None:
    JOBS.close()
    bpy.utils.unregister_class(Preferences)
