"""Builds the archive of a plug-in: its files, those that plug-ins share, and the client of one file.

python3 hosts/build.py blender [FOLDER]     writes FOLDER/texloom-VERSION.zip, by default into dist
python3 hosts/build.py krita [FOLDER]       writes FOLDER/texloom-krita-VERSION.zip
"""

from __future__ import annotations

import re
import sys
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

try:
    import tomllib
except ImportError:
    sys.exit("hosts/build.py: needs Python 3.11 or later; this is " + sys.version.split()[0])

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
MANIFEST = HERE / "blender" / "blender_manifest.toml"
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


def _read(paths: Iterable[Path]) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(paths)}


def _modules(program: str) -> dict[str, bytes]:
    """The modules of a plug-in, which lie side by side, and the licence."""
    shared = {"texloom_client.py": (ROOT / "pipelines" / "bridge" / "client.py").read_bytes()}
    return shared | _read([*(HERE / "common").glob("*.py"), *(HERE / program).glob("*.py"), ROOT / "LICENSE"])


def blender() -> tuple[str, dict[str, bytes]]:
    """The extension's name and files."""
    contents = {MANIFEST.name: MANIFEST.read_bytes(), **_modules("blender")}
    manifest = checked(tomllib.loads(contents[MANIFEST.name].decode()))
    return f"{manifest['id']}-{manifest['version']}", contents


def krita() -> tuple[str, dict[str, bytes]]:
    """The plug-in's name and files: Krita finds the folder of its modules by an entry for the folder itself."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    folder = HERE / "krita"
    modules = {**_modules("krita"), **_read([folder / "Manual.html"])}
    outside = _read([folder / "texloom.desktop", folder / "texloom.action"])
    inside = {f"texloom/{name}": content for name, content in modules.items()}
    return f"texloom-krita-{version}", {**outside, "texloom/": b"", **inside}


PROGRAMS = {"blender": blender, "krita": krita}


def build(program: str, folder: Path) -> Path:
    """Write the archive; its path."""
    name, contents = PROGRAMS[program]()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, content in sorted(contents.items()):
            archive.writestr(zipfile.ZipInfo(entry, _DATE), content, zipfile.ZIP_DEFLATED)
    return path


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] not in PROGRAMS:
        sys.exit(__doc__)
    print(build(sys.argv[1], Path(*sys.argv[2:3] or ["dist"])))
