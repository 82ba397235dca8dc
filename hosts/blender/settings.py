"""What the panels ask for, kept in the scene; operators have properties of the same names."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from .requests import METHODS, PRESETS


def _choices(*names: str) -> list[tuple[str, str, str]]:
    return [(name, name.replace("_", " ").capitalize(), "") for name in names]


def _asked(kind: Callable[..., Any], **about: Any) -> Callable[..., Any]:
    """A property that is made where it stands, as operators do not keep what they were called with."""
    return partial(kind, **about)


def _text(name: str, description: str, **about: Any) -> Callable[..., Any]:
    return _asked(StringProperty, name=name, description=description, **about)


PROPERTIES = {
    "width": _asked(IntProperty, name="Width", default=1024, min=16, max=32768, subtype="PIXEL"),
    "height": _asked(IntProperty, name="Height", default=1024, min=16, max=32768, subtype="PIXEL"),
    "size": _asked(IntProperty, name="Size", default=1024, min=16, max=32768, subtype="PIXEL"),
    "tileable": _asked(
        EnumProperty, name="Tileable", items=_choices("off", "x", "y", "both"), default="both",
        description="The borders across which it repeats",
    ),
    "axes": _asked(
        EnumProperty, name="Axes", items=_choices("both", "x", "y"),
        description="x: left and right borders; y: top and bottom",
    ),
    "keep_size": _asked(BoolProperty, name="Keep Size", description="Patterns are not cut to whole periods"),
    "method": _asked(EnumProperty, name="Method", items=_choices(*METHODS)),
    "preset": _asked(EnumProperty, name="Preset", items=_choices(*PRESETS)),
    "seed": _asked(IntProperty, name="Seed", description="Equal seeds give equal results", default=7, min=0),
    "count": _asked(IntProperty, name="Variations", description="The next seeds", default=4, min=1, max=64),
    "mask": _text("Mask", "A picture of the same size, white where it is made anew; empty: what is transparent"),
    "exemplar": _text("Exemplar", "What the region is to look like; empty: what the picture was made from"),
    "path": _text("Source", "A folder of maps, or a photograph of a surface", subtype="FILE_PATH"),
    "texel_size": _asked(
        FloatProperty, name="Texel", default=1.0, min=0.0, soft_max=10.0, precision=3,
        description="Size of a pixel, mm; it scales the displacement. 0 on a mesh: as it comes out",
    ),
    "new_coordinates": _asked(BoolProperty, name="New UV Map", description="By Smart UV Project"),
    "turn": _asked(FloatProperty, name="Turn", description="Of the texture, degrees", min=-360, max=360),
    "use_curves": _asked(BoolProperty, name="Along Curves", description="Selected curves point to its top"),
    "direction": _text("Direction", "Attribute that points to its top: vectors, or colours, of which a half is 0"),
    "paint": _text("Paint", "Colour attribute that controls what lies where"),
    "control": _text("Control", "The control picture of the exemplar, whose values the paint has"),
    "source_folder": _text("Maps", "A folder of maps in place of the picture", subtype="DIR_PATH"),
}  # fmt: skip


def properties(*names: str) -> dict[str, Any]:
    """The annotations of an operator with these properties."""
    return {name: PROPERTIES[name](options={"SKIP_SAVE"}) for name in names}


class Settings(bpy.types.PropertyGroup):
    __annotations__ = {name: asked() for name, asked in PROPERTIES.items()}


def register() -> None:
    bpy.utils.register_class(Settings)
    bpy.types.Scene.texloom = PointerProperty(type=Settings)


def unregister() -> None:
    del bpy.types.Scene.texloom
    bpy.utils.unregister_class(Settings)
