"""The stages that there are: those of texloom, found by the names of their files, and those of plug-ins."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import re
from pathlib import Path

from texloom.stages.lookup.plugins import plugins
from texloom.stages.vocabulary.declare import InputError, Stage, declared
from texloom.stages.vocabulary.interruption import raised_by_code

_PACKAGE = "texloom.stages"
_ROOT = Path(__file__).parents[1]
_DECLARES = re.compile(rb"^@stage\(", re.MULTILINE)

GROUPS = ("analysis", "synthesis", "evaluation")
"""the packages of `stages` that hold stages, lowest layer first"""


def stage_names() -> tuple[str, ...]:
    """The names of all stages, by layer and then by letter, then those of plug-ins; without importing them."""
    return (*shipped_stages(), *plugins("texloom.stages"))


@functools.cache
def shipped_stages() -> tuple[str, ...]:
    """The names of the stages of texloom itself."""
    return tuple(name for name, path in _files().items() if _DECLARES.search(path.read_bytes()))


@functools.cache
def _files() -> dict[str, Path]:
    """The files that may hold stages, by the names that these have: a file's room is no part of it."""
    paths = {group: sorted((_ROOT / group).rglob("*.py"), key=lambda path: path.stem) for group in GROUPS}
    return {f"{group}.{path.stem}": path for group in GROUPS for path in paths[group] if path.stem != "__init__"}


def _module(path: Path) -> str:
    return ".".join((_PACKAGE, *path.relative_to(_ROOT).with_suffix("").parts))


def find_stage(name: str) -> Stage:
    """Import and return the stage called ``name``; `KeyError` where there is none.

    Raises
    ------
    InputError : the module of a plug-in cannot be imported, or declares no stage of its name.
    """
    if name not in declared:
        path = _files().get(name)
        if path is None:
            return _plugin_stage(name)
        importlib.import_module(_module(path))
    return declared[name]


def _plugin_stage(name: str) -> Stage:
    plugin = plugins("texloom.stages")[name]
    try:
        importlib.import_module(plugin.module)
    except (Exception, SystemExit, KeyboardInterrupt) as error:
        if not isinstance(error, Exception) and not raised_by_code(error):
            raise
        problem = f"cannot be imported: {type(error).__name__}: {error}"
        raise InputError(f"stage {name} of {plugin.origin}: {' '.join(problem.split())}") from None
    if name not in declared:
        raise InputError(f"stage {name} of {plugin.origin}: its module declares no stage of its name")
    declared[name] = dataclasses.replace(declared[name], origin=plugin.origin)
    return declared[name]
