"""A YAML file of maps, see `texloom.pipelines.media.material_set`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from texloom.pipelines.errors import hint, shown
from texloom.pipelines.media import locate as picture_files
from texloom.pipelines.media.conventions import CONVENTION_OF, CONVENTIONS, ROLES
from texloom.pipelines.media.curves import CURVES
from texloom.pipelines.media.headers import Refusal
from texloom.pipelines.media.map_names import Claim, recognised_plane
from texloom.pipelines.yaml import read_document
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import UNITS

HEIGHT_UNIT = "height_unit"
"""the key of a YAML file that says the unit of heights"""
_ENTRY = ("file", "channel", "invert", "curve")
_KEYS = ("normal_convention", HEIGHT_UNIT, "resample")


def of_yaml(path: Path) -> tuple[Mapping[str, Sequence[Claim]], dict[str, Any]]:
    """Role to the file that it names, as one, and settings; `Refusal` where it is wrong."""
    try:
        document = read_document(path)
    except InputError as error:
        raise Refusal(str(error).removeprefix(f"{path}: ")) from None
    if not isinstance(document, dict):
        raise Refusal(f"must map the names of maps to files, got {shown(document)}")
    named: dict[str, list[Claim]] = {}
    settings: dict[str, Any] = {}
    for key, value in document.items():
        if key in _KEYS:
            settings[key] = value
            continue
        plane = recognised_plane(key) if isinstance(key, str) else None
        if plane is None:
            known = [*ROLES, *_KEYS]
            raise Refusal(f"{shown(key)} is no map{hint(str(key), known)}")
        role, inverted, green = plane
        given = _of_entry(key, value, path.parent)
        if role in named:
            raise Refusal(f"{key}: there is a file for {role} already")
        named[role] = [dataclasses.replace(given, inverted=given.inverted != inverted)]
        if green:
            settings.setdefault("normal_convention", CONVENTION_OF[green])
    if "bump" in named and "height" not in named:
        named["height"] = named.pop("bump")
    convention, resample = settings.get("normal_convention"), settings.get("resample", True)
    if convention not in (None, *CONVENTIONS):
        raise Refusal(f"normal_convention: must be opengl or directx, got {shown(convention)}")
    if (unit_of_height := settings.get(HEIGHT_UNIT)) not in (None, *UNITS):
        raise Refusal(f"{HEIGHT_UNIT}: must be one of {', '.join(UNITS)}, got {shown(unit_of_height)}")
    if not isinstance(resample, bool):
        raise Refusal(f"resample: must be true or false, got {shown(resample)}")
    return named, settings


def _of_entry(key: str, value: Any, folder: Path) -> Claim:
    """A file, or ``{file: x.png, channel: G, invert: true, curve: srgb}``, of a YAML file in ``folder``."""
    entry = value if isinstance(value, dict) and "file" in value else {"file": value}
    if other := next((one for one in entry if one not in _ENTRY), None):
        raise Refusal(f"{key}: {shown(other)} unknown; there are {', '.join(_ENTRY[:-1])} and {_ENTRY[-1]}")
    file, channel, invert = entry.get("file"), entry.get("channel", ""), entry.get("invert", False)
    if not isinstance(file, str) or not file:
        raise Refusal(f"{key}: must be a file, got {shown(value)}")
    if not isinstance(channel, str):
        raise Refusal(f"{key}.channel: must be the name of a channel, such as R, got {shown(channel)}")
    if not isinstance(invert, bool):
        raise Refusal(f"{key}.invert: must be true or false, got {shown(invert)}")
    if (curve := entry.get("curve", "")) not in ("", *CURVES):
        raise Refusal(f"{key}.curve: must be {' or '.join(CURVES)}, got {shown(curve)}")
    return Claim(str(folder / file) if picture_files.is_path(file) else file, channel, invert, curve=curve)
