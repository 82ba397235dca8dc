"""Presets: named defaults of parameters."""

from collections.abc import Mapping
from typing import Any


def with_preset(values: Any, presets: Mapping[str, Mapping[str, Any]]) -> Any:
    """``values`` of parameters, completed by the preset that they name, else by ``default``.

    For a validator of mode ``before``: anything but a mapping, and an unknown preset, are left for pydantic to
    reject.
    """
    if not isinstance(values, dict) or not isinstance(values.get("preset", "default"), str):
        return values
    return {**presets.get(values.get("preset", "default"), {}), **values}
