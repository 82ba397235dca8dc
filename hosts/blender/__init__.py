"""Texloom in Blender 4.2 and later. `build.py` makes the extension, with ``texloom_client.py`` beside this file."""

from . import operators, panels, session, settings

_PARTS = (session, settings, operators, panels)


def register() -> None:
    """What Blender calls when the extension is enabled."""
    for part in _PARTS:
        part.register()


def unregister() -> None:
    """What Blender calls when it is disabled, or ends."""
    for part in reversed(_PARTS):
        part.unregister()
