"""Presets: named defaults of parameters."""

from collections.abc import Mapping
from typing import Any


def with_preset(given: Any, presets: Mapping[str, Mapping[str, Any]]) -> Any:
    """The params that are ``given``, and those of the preset that they name.

    For a validator of mode ``before``: anything but a mapping, and an unknown preset, are left for pydantic to
    reject. Without a name it is the preset ``default``.
    """
    if not isinstance(given, dict) or not isinstance(given.get("preset", "default"), str):
        return given
    return {**presets.get(given.get("preset", "default"), {}), **given}
