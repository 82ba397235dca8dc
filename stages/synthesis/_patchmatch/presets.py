"""Presets: params under one name that fill in what is not given."""

from collections.abc import Mapping
from typing import Any


def filled_in(given: Any, presets: Mapping[str, Mapping[str, Any]]) -> Any:
    """The params that are ``given``, and those of the preset that they name.

    For a validator of mode ``before``: what is no mapping, or names a preset that is none, is left for pydantic to
    refuse. Without a name it is the preset ``default``.
    """
    if not isinstance(given, dict) or not isinstance(given.get("preset", "default"), str):
        return given
    return {**presets.get(given.get("preset", "default"), {}), **given}
