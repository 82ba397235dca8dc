"""The files of a project: ``texloom_project`` in a folder of pictures.

    texloom_project/
      project.json            version, and where one was
      materials/<id>.json     a material with its recipes and results
      thumbnails/<id>.png     what a variant looks like

Files are complete or absent, no links are followed, and other files are left alone; so is what this version cannot
read.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pydantic

from texloom.pipelines.errors import one_line, refused
from texloom.pipelines.store.folders import Folder
from texloom.pipelines.studio.library import PROJECT
from texloom.pipelines.studio.messages.projects import SCHEMA, Material, ProjectView
from texloom.stages.vocabulary.declare import InputError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

FOLDER = PROJECT
_PROJECT, _MATERIALS, _THUMBNAILS = "project.json", "materials", "thumbnails"
_MOST_BYTES = 2**24
"""of a file"""
_MOST_MATERIALS = 20_000
_MATERIAL_FILE = re.compile(r"([0-9a-f]{16})\.json")
_ID = re.compile(r"[0-9a-f]{16}")
_TAKEN = (errno.EWOULDBLOCK, errno.EACCES, errno.EAGAIN)


class ProjectFiles:
    """Reads and writes the files of a project; call it from any thread."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.place = folder / FOLDER
        self._writing = threading.Lock()

    # -- one server at a time

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the project for the ``with`` block; `InputError` where another server has it.

        The lock is on the folder itself, so that nothing is written before there is something to save. Where a file
        system has no locks there is none.
        """
        held = None
        try:
            if fcntl is not None:
                held = os.open(self.folder, os.O_RDONLY)
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in _TAKEN:
                assert held is not None
                os.close(held)
                raise refused(
                    f"{self.folder}: another studio has this project open; use that one, or end it first"
                ) from None
        try:
            yield
        finally:
            if held is not None:
                os.close(held)

    # -- reading

    def read_view(self) -> ProjectView:
        """Where one was; `InputError` where a newer version, or something else, has written the project."""
        found = self._content(_PROJECT, self.place / _PROJECT)
        if found is None:
            return ProjectView()
        try:
            return ProjectView.model_validate(found.get("view", {}))
        except pydantic.ValidationError:  # not worth more than to begin at the beginning
            return ProjectView()

    def read_materials(self) -> tuple[list[Material], list[str]]:
        """The materials, and why others cannot be read; those files are left alone."""
        try:
            with Folder.at(self.folder, FOLDER, _MATERIALS) as folder:
                names = sorted(filter(_MATERIAL_FILE.fullmatch, folder.names()))
                folder.remove_abandoned()
        except FileNotFoundError:
            return [], []
        except OSError as error:
            raise refused(f"{FOLDER}/{_MATERIALS}: {error.strerror}") from None
        materials, problems = [], []
        for name in names[:_MOST_MATERIALS]:
            try:
                materials.append(self._material(name))
            except InputError as error:
                problems.append(str(error))
        if len(names) > _MOST_MATERIALS:
            problems.append(f"{len(names) - _MOST_MATERIALS} materials more than {_MOST_MATERIALS} are left out")
        return materials, problems

    def _material(self, name: str) -> Material:
        found = self._content(f"{_MATERIALS}/{name}", self.place / _MATERIALS / name)
        try:
            material = Material.model_validate(found)
        except pydantic.ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"])
            raise InputError(one_line(f"{_MATERIALS}/{name}: {where}: {first['msg']}")) from None
        if f"{material.id}.json" != name:
            raise InputError(f"{_MATERIALS}/{name}: id: is that of another file")
        return material

    def _content(self, shown: str, path: Path) -> dict[str, Any] | None:
        """What a JSON file holds, none where it is not there; `InputError` where it is not of this version."""
        below = path.relative_to(self.folder).parts[:-1]
        try:
            with Folder.at(self.folder, *below) as folder:
                found = json.loads(folder.read(path.name, _MOST_BYTES))
        except FileNotFoundError:
            return None
        except OSError as error:
            raise refused(f"{FOLDER}/{shown}: {error.strerror}") from None
        except (ValueError, RecursionError) as error:
            raise refused(f"{FOLDER}/{shown}: cannot be read: {error}") from None
        version = found.get("version") if isinstance(found, dict) else None
        if not isinstance(version, int) or isinstance(version, bool) or version < 1:
            raise refused(f"{FOLDER}/{shown}: version: must be a number from 1 on")
        if version > SCHEMA:
            raise refused(
                f"{FOLDER}/{shown}: version {version} was written by a newer texloom, this one reads {SCHEMA}; "
                "install that one"
            )
        return dict(found)

    # -- writing

    def write_view(self, view: ProjectView) -> None:
        """Save where one is; `OSError` where that is not possible."""
        self._write((), _PROJECT, _json({"version": SCHEMA, "view": view.model_dump(mode="json")}))

    def write_material(self, material: Material) -> None:
        """Save a material; `OSError` where that is not possible."""
        content = _json(material.model_dump(mode="json") | {"version": SCHEMA})
        if len(content) > _MOST_BYTES:
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))
        self._write((_MATERIALS,), f"{material.id}.json", content)

    def write_thumbnail(self, variant: str, png: bytes) -> None:
        """Keep what a variant looks like, if that is possible."""
        with contextlib.suppress(OSError):
            self._write((_THUMBNAILS,), f"{variant}.png", png)

    def thumbnail(self, variant: str) -> bytes | None:
        """What a variant looks like, as a PNG; none where that is not known."""
        if not _ID.fullmatch(variant):
            return None
        with contextlib.suppress(OSError, ValueError), Folder.at(self.folder, FOLDER, _THUMBNAILS) as folder:
            return folder.read(f"{variant}.png", _MOST_BYTES)
        return None

    def _write(self, below: tuple[str, ...], name: str, content: bytes) -> None:
        with self._writing, contextlib.ExitStack() as stack:
            folder = stack.enter_context(Folder.at(self.folder))
            for one in (FOLDER, *below):
                folder = stack.enter_context(folder.child(one, create=True))
            folder.write(name, content, durable=True)


def _json(content: dict[str, Any]) -> bytes:
    return json.dumps(content, indent=1, ensure_ascii=False).encode() + b"\n"
