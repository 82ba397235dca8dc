"""Builds the extension for Blender: its files, and the client of one file.

python hosts/blender/build.py [FOLDER]      writes FOLDER/texloom-VERSION.zip, by default into dist
"""

from __future__ import annotations

import re
import sys
import zipfile
from pathlib import Path
from typing import Any

import tomllib

HERE = Path(__file__).resolve().parent
CLIENT = HERE.parents[1] / "pipelines" / "bridge" / "client.py"
MANIFEST = "blender_manifest.toml"
_TEXTS = ("id", "version", "name", "tagline", "maintainer", "type", "blender_version_min")
_MOST = {"tagline": 64, "permissions": 64}  # characters
_PERMISSIONS = ("files", "network", "clipboard", "camera", "microphone")
_DATE = (2020, 1, 1, 0, 0, 0)  # of all files, so that equal sources make equal archives


def checked(manifest: dict[str, Any]) -> dict[str, Any]:
    """A manifest by Blender's rules for extensions; `ValueError` names the field that breaks one."""
    for name in _TEXTS:
        if not isinstance(manifest.get(name), str) or not manifest[name].strip():
            raise ValueError(f"{name}: is missing")
    rules = {
        "schema_version": manifest.get("schema_version") == "1.0.0",
        "id": re.fullmatch(r"[a-z][a-z0-9_]*", manifest["id"]),
        "version": re.fullmatch(r"\d+\.\d+\.\d+([-+].+)?", manifest["version"]),
        "type": manifest["type"] == "add-on",
        "tagline": len(manifest["tagline"]) <= _MOST["tagline"] and manifest["tagline"][-1].isalnum(),
        "blender_version_min": re.fullmatch(r"\d+\.\d+\.\d+", manifest["blender_version_min"]),
        "license": manifest.get("license")
        and all(re.fullmatch(r"SPDX:[A-Za-z0-9.+-]+", one) for one in manifest["license"]),
    }
    for name, reason in manifest.get("permissions", {}).items():
        is_short = 0 < len(reason) <= _MOST["permissions"] and reason[-1].isalnum()
        rules[f"permissions.{name}"] = name in _PERMISSIONS and is_short
    for name, is_kept in rules.items():
        if not is_kept:
            raise ValueError(f"{name}: {manifest.get(name, 'see permissions')} is not as Blender wants it")
    return manifest


def files() -> dict[str, bytes]:
    """The files of the extension, by name."""
    own = [HERE / MANIFEST, *sorted(one for one in HERE.glob("*.py") if one.name != Path(__file__).name)]
    found = {path.name: path.read_bytes() for path in own}
    licence = HERE.parents[1] / "LICENSE"
    return {**found, "texloom_client.py": CLIENT.read_bytes(), "LICENSE": licence.read_bytes()}


def build(folder: Path) -> Path:
    """Write the archive; its path."""
    contents = files()
    manifest = checked(tomllib.loads(contents[MANIFEST].decode()))
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{manifest['id']}-{manifest['version']}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in sorted(contents.items()):
            archive.writestr(zipfile.ZipInfo(name, _DATE), content, zipfile.ZIP_DEFLATED)
    return path


if __name__ == "__main__":
    print(build(Path(*sys.argv[1:2] or ["dist"])))
