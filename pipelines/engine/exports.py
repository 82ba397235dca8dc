"""Exports: the files that a run leaves in its ``--out`` folder. Those that are there already are left as they are.

The store keeps, under ``exports/``, a note of every export: from the key of what it was made of to the digests of
its files, and to what was told when they were written, which is told again wherever they are left. A file is
compared by what it holds, not by its place or by times that programs set, as a user may edit it, replace it, move
it or put an older copy back. So an export is neither read from the store nor written where the note, and every byte
of its files, say that it would come out the same; in all other cases it is written. Files of a large set are not
read again if they are still as a run left them, see `texloom.pipelines.store.history`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from texloom.pipelines.engine.code_digest import code_digest
from texloom.pipelines.engine.keys import canonical_json
from texloom.pipelines.media.delivery import AS_IS, SAME, Delivery
from texloom.pipelines.media.material_maps import Map
from texloom.pipelines.media.stack import ROLE
from texloom.pipelines.media.writers import registry
from texloom.pipelines.media.writers.registry import WriteJob
from texloom.pipelines.store import written
from texloom.pipelines.store.atomic import file_digest
from texloom.pipelines.store.history import file_state
from texloom.pipelines.store.result_files import small_file
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.frame_stacks import frame_count

States = dict[str, Any]
"""the key of an export, the `file_state` of each of its files, and where there is some, what was told"""
_FRAMES = "texloom.pipelines.media.frame_export"
_MAPS = "texloom.pipelines.media.material_export"
_SAME = "texloom.pipelines.media.writers.same"
_LAYOUTS = "texloom.pipelines.media.writers.layouts"


@cache
def _fields_of(delivery: Delivery) -> Mapping[str, Any]:
    return dataclasses.asdict(delivery)


@dataclasses.dataclass(frozen=True)
class Export:
    """What becomes a file, or a folder of maps."""

    path: Path
    is_folder: bool
    origin: str
    """digest of what it comes from: the manifest of a result, the content of a source"""
    about: Mapping[str, Any]
    """what this run adds to its provenance"""
    like: tuple[Map, ...] = ()
    """the maps whose files those of a folder are to be like"""
    delivery: Delivery = AS_IS
    material: str = ""
    """the material's name, with which files of a layout begin"""
    bits: Mapping[str, int] = dataclasses.field(default_factory=dict)
    """of what each map, by its role, is made from, the most: 8 or 16, 32 of floats"""
    mesh: str = ""
    """digest of what the mesh of a model comes from"""

    @property
    def _is_same(self) -> bool:
        """Whether it is a folder of files as the exemplar's."""
        return self.is_folder and self.delivery.layout == SAME

    @property
    def _module(self) -> str:
        """The module that writes it."""
        if self.is_folder:
            is_stack = bool(self.like) and self.like[0].role == ROLE
            if self._is_same:
                return _SAME
            return _LAYOUTS if self.delivery.layout else _FRAMES if is_stack else _MAPS
        if self.is_deep:
            return _MAPS
        writer = registry.writer_of(self.path.name)
        return "" if writer is None else writer.full_module

    @property
    def _form(self) -> str:
        """What of the name decides what the file holds."""
        if self.is_folder:
            return "/"
        if self.companions or self.path.suffix == ".glb":  # they hold their names
            return self.path.name
        writer = registry.writer_of(self.path.name)
        return self.path.suffix if writer is None else writer.suffix

    @property
    def companions(self) -> Path | None:
        """The folder of its other files, where it has some."""
        writer = None if self.is_folder else registry.writer_of(self.path.name)
        if writer is None or not writer.companions:
            return None
        return self.path.with_name(self.path.name.removesuffix(writer.suffix) + writer.companions)

    @cached_property
    def key(self) -> str:
        """SHA-256 of all that decides what its files hold, 64 hexadecimal digits."""
        parts: dict[str, Any] = {
            "code": code_digest(self._module),
            "form": self._form,
            "origin": self.origin,
            "about": self.about,
            "like": [
                [
                    *(one.role, one.stem, one.bits, one.directx, one.plane, one.inverted, one.curve),
                    Path(one.reference).name,
                ]
                for first in self.like
                for one in (first, *first.twins)
            ],
            "delivery": _fields_of(self.delivery),
            "material": self.material if self.delivery.layout else "",
        }
        if deep := sorted(role for role, bits in self.bits.items() if bits > 8):
            parts["deep"] = deep
        if self.mesh:
            parts["mesh"] = self.mesh
        return hashlib.sha256(canonical_json(parts).encode()).hexdigest()

    @property
    def is_deep(self) -> bool:
        """Whether it is a PNG of 16 bits, if it is an image: what it is made from has as many, or floats."""
        return not self.is_folder and self.path.suffix == ".png" and self.bits.get("albedo", 8) > 8

    def current(self, store: Store, known: States | None = None) -> States | None:
        """The states of its files, if they are there and would come out as they are; ``known``: the last run's."""
        note = f"{store.exports}/{self.key}"
        states = None if known is None else self._states(known["files"], known.get("told", []))
        if states is None or states != known or not all(states["files"].values()):
            try:
                noted = json.loads(small_file(note))
                files = noted["files"]
                states = self._states(files, list(map(str, noted["told"])))  # before the files are read
                # isfile, as reading a pipe would wait for its writer
                if not files or not all(
                    os.path.isfile(path) and file_digest(path) == digest  # noqa: PTH113
                    for path, digest in ((self._place(name), digest) for name, digest in files.items())
                ):
                    return None
            except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
                return None
        with contextlib.suppress(OSError), store.inside("exports") as folder:
            folder.touch(self.key)  # it was of use today
        return states

    def _note_below(self, runs: Path, files: Mapping[str, str], store: Store) -> None:
        """Note the files of a run without ``--out``, so that they can be removed one day."""
        if not self.path.is_relative_to(runs):
            return
        run, *others = self.path.relative_to(runs).parts
        if others:  # a file beside the folders of runs is none of theirs
            folder = runs / run
            paths = {self._place(name).relative_to(folder).as_posix(): digest for name, digest in files.items()}
            written.add(store.root, run, paths)

    def _states(self, names: Iterable[str], told: Sequence[str]) -> States:
        states: States = {"key": self.key, "files": {name: file_state(self._place(name)) for name in names}}
        return {**states, "told": [*told]} if told else states

    def _place(self, name: str) -> Path:
        """Where a file of the note is."""
        if not name:
            return self.path
        return (self.path if self.is_folder else self.path.parent) / name

    def write(
        self,
        store: Store,
        value: Any,
        hint: Any,
        provenance: Mapping[str, Any],
        mesh: Any = None,
        told: Sequence[str] = (),
    ) -> States:
        """Write an output of the type ``hint``, on a mesh if given, and the note of it; the states of its files.

        The digest of a single file is noted under an empty name, as its own name does not change what it holds.
        ``told``: a list to which what its writer tells is added meanwhile.

        Raises
        ------
        texloom.pipelines.store.codec.ArtifactError : the value cannot be written in this form.
        """
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self._is_same:
            from texloom.pipelines.media.writers.same import write_same

            files = write_same(value, self.path, self.like, self.delivery, provenance)
        elif self.is_folder and self.delivery.layout:
            from texloom.pipelines.media.writers.layouts import write_layout

            files = write_layout(value, self.path, self.material, self.delivery, provenance, self.bits)
        elif self.is_folder and isinstance(value, Image) and frame_count(value.channels) > 1:
            from texloom.pipelines.media.frame_export import write_frames

            files = write_frames(value, self.path, self.like, provenance, self.delivery)
        elif self.is_folder:
            from texloom.pipelines.media.material_export import write_maps

            files = write_maps(value, self.path, self.like, provenance, self.delivery, self.bits)
        elif self.is_deep and isinstance(value, Image):
            from texloom.pipelines.media.material_export import write_deep_png

            files = {"": write_deep_png(value, self.path, provenance)}
        else:
            files = registry.write(WriteJob(self.path, value, hint, provenance, self.delivery, mesh, self.bits))
        self._note_below(store.root / "runs", files, store)
        # Without a note it is written again next time, no more. The temporary file is in a small folder, which the
        # end of each run looks through.
        with contextlib.suppress(OSError), store.inside() as root, root.child("exports", create=True) as folder:
            folder.write(self.key, json.dumps({"files": files, "told": [*told]}).encode(), beside=root)
            for digest in {*files.values()}:  # by which `is_noted` knows the files
                folder.write(digest, b"{}", beside=root)
        return self._states(files, told)


def is_noted(store: Store, file: str | Path) -> bool:
    """Whether a run with this store wrote what the file holds."""
    try:
        note = file_digest(Path(file))
    except OSError:  # what cannot be read is not known
        return False
    try:
        with store.inside("exports") as folder:
            folder.touch(note)  # it was of use today
    except FileNotFoundError:
        return False
    except OSError:  # a store that can only be read
        return (store.exports / note).exists()
    return True
