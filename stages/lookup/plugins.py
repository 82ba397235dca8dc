"""Stages and flows of other packages: installed ones by their entry points, and folders under development.

A package declares modules of stages under ``texloom.stages`` and packages of YAML flows under ``texloom.flows``:

    [project.entry-points."texloom.stages"]
    gpdm = "texloom_gpdm.gpdm"

The variable ``TEXLOOM_PLUGINS`` names folders, separated as those of PATH, whose ``pyproject.toml`` declares the
same; they need not be installed, and come before what is.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib.metadata
import os
import sys
from pathlib import Path
from typing import Any, Literal

VARIABLE = "TEXLOOM_PLUGINS"
Group = Literal["texloom.stages", "texloom.flows"]


@dataclasses.dataclass(frozen=True)
class Plugin:
    """A module that another package offers."""

    module: str
    """for stages also the stage's name"""
    distribution: str
    version: str

    @property
    def origin(self) -> str:
        """Distribution and version; part of the keys of its stages."""
        return f"{self.distribution} {self.version}"


def plugins(group: Group) -> dict[str, Plugin]:
    """Module to plug-in, by name; nothing is imported.

    Raises
    ------
    InputError : a folder of ``TEXLOOM_PLUGINS`` has no usable ``pyproject.toml``.
    """
    return _plugins(group, os.environ.get(VARIABLE, ""))


@functools.cache
def _plugins(group: Group, folders: str) -> dict[str, Plugin]:
    found: dict[str, Plugin] = {}
    for entry in importlib.metadata.entry_points(group=group):
        if entry.dist is not None:
            found[entry.module] = Plugin(entry.module, entry.dist.name, entry.dist.version)
    for folder in filter(None, folders.split(os.pathsep)):
        found |= _in_folder(group, Path(folder).absolute())
    return {module: found[module] for module in sorted(found)}


def _in_folder(group: Group, folder: Path) -> dict[str, Plugin]:
    import tomllib

    try:
        project: Any = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        modules = dict(project.get("entry-points", {}).get(group, {})).values()
        found = {str(module): Plugin(str(module), str(project["name"]), str(project.get("version", "development")))
                 for module in modules}  # fmt: skip
    except OSError as error:
        problem = f"pyproject.toml: {error.strerror}"
    except (ValueError, KeyError, TypeError, AttributeError):
        problem = "pyproject.toml: must be TOML with a name and entry points under [project]"
    else:
        source = str(folder / "src" if (folder / "src").is_dir() else folder)
        if found and source not in sys.path:
            sys.path.insert(0, source)
        return found
    from texloom.stages.vocabulary.declare import InputError  # it imports pydantic, which lists of flows do without

    raise InputError(f"{VARIABLE}: {folder}: {problem}")
