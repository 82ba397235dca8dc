"""Sources: the pictures, map sets, meshes and earlier results of a flow, checked by their headers."""

from __future__ import annotations

import dataclasses
import itertools
import os
import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import UInt8

from texloom.pipelines.errors import closest, one_line
from texloom.pipelines.media import (
    contradictions,
    locate,
    material_maps,
    material_set,
    meshes,
    stack,
    udim,
    voted_results,
)
from texloom.pipelines.media.conventions import ROLES
from texloom.pipelines.media.headers import Refusal
from texloom.pipelines.media.known_files import Inspected
from texloom.pipelines.media.material_maps import Map
from texloom.pipelines.media.part import WHOLE, Part
from texloom.pipelines.memory import check_memory
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import Facts
from texloom.stages.vocabulary.voted_patches import VotedPatches

SourceValue: TypeAlias = Image | np.ndarray | VotedPatches
"""a picture or map set, a `texloom.stages.vocabulary.arrays.Mesh`, or the patches of an earlier result"""
_COPIED = ("exemplar", "exemplars", "picture")  # sources whose pixels are copied, but those that alpha excludes
_MAX_FILES = 10_000  # among which a similar name is searched


class SourceError(InputError):
    """A source cannot be used, whichever step takes it."""


@dataclasses.dataclass(frozen=True)
class Source:
    """A picture, map set, mesh or earlier result that a flow starts from, opened but not decoded."""

    name: str
    reference: str
    height: int
    """px; 0 of a mesh"""
    width: int
    channels: tuple[str, ...]
    digest: str
    """SHA-256 of the files' content, the roles of maps and the version of the decoding; 64 hexadecimal digits"""
    maps: tuple[Map, ...] = ()
    """the files of a map set or frame stack; none for one picture"""
    notes: tuple[str, ...] = ()
    """files of a folder that are not used, and what was assumed of colours, for the user"""
    bits: int = 8
    """8 or 16 of integers, 32 where the values are floats; of a map set those of its albedo"""
    map_bits: Mapping[str, int] = dataclasses.field(default_factory=dict)
    """of each map, by its role, of one picture as of an albedo; see ``bits``"""
    kind: Literal["picture", "mesh", "patches"] = "picture"
    stored: str = ""
    """the folder in the store that holds its patches"""
    part: Part = WHOLE
    """what is taken of ``whole``"""
    whole: Source | None = None
    """the source as it is in the file, where a part is taken"""
    texel_size: float | None = None
    """side of a pixel, m, where texloom has written it into the file"""
    remembered: tuple[Map, ...] = ()
    """the files that an EXR of a material was made from, by what it says; they may be gone"""

    def taken(self, part: Part) -> Source:
        """The part as a source; `SourceError` where it is not inside."""
        if part == WHOLE:
            return self
        try:
            height, width = part.outline(self.height, self.width)
        except InputError as error:
            raise SourceError(f"{error} (sources.{self.name}: {stack.path_of(self.reference)})") from None
        digest = part.digest(self.digest)
        texel_size = None if self.texel_size is None else self.texel_size / part.reduce
        return dataclasses.replace(
            self, height=height, width=width, digest=digest, part=part, whole=self, texel_size=texel_size
        )

    @property
    def picture(self) -> str:
        """Its file's or folder's name without suffix, or that in a collection; of an array, the source's name."""
        return (
            self.name
            if self._is_array
            else Path(udim.plain_name(re.sub(r"^[a-z][a-z0-9]+:", "", self.reference))).stem
        )

    @property
    def holds_maps(self) -> bool:
        """Whether it is a material: files of maps, or an EXR that holds several, as texloom writes it."""
        return bool(self.maps) or len({*self.map_bits} & {*ROLES}) > 1

    @property
    def names(self) -> dict[str, str]:
        """The names of the files of maps that hold one alone, by role, without suffix."""
        stems = [one.stem for one in self.maps]
        own = [one for one in self.maps if one.is_plain and one.role in ROLES and stems.count(one.stem) == 1]
        return {one.role: one.stem for one in (*own, *self.remembered)}

    @cached_property
    def label(self) -> str:
        """For provenance; without folders, so that files may move."""
        return f"{self.name}: {'array' if self._is_array else Path(self.reference).name}"

    @property
    def _is_array(self) -> bool:
        """Whether a Python program gave it; its file or folder then has a digest as its name."""
        path = Path(self.reference)
        return any(re.fullmatch(r"[0-9a-f]{64}", name) for name in (path.stem, path.parent.name))

    def value(self) -> SourceValue:
        """A decoded picture, see `read`, a `texloom.stages.vocabulary.arrays.Mesh`, or patches."""
        if self.kind == "picture":
            return self.read()
        with _place(self.name, self.reference):
            if self.kind == "patches":
                return voted_results.read(self.stored)
            return meshes.read(self.reference, self.digest)

    def read(self) -> Image:
        """Decode a picture; `SourceError` where it is broken, not finite, or has changed since it was opened."""
        if self.whole is not None:
            return self.part.of(self.whole.read(), is_label=self.name.endswith("_guide"))
        with _place(self.name, self.reference):
            if stack.is_stack(self.reference):
                return stack.read(self.maps)
            if self.maps:
                return material_maps.read(self.maps, self.height, self.width)
            return locate.decode(self.reference, self.digest)

    def colour(self) -> UInt8[np.ndarray, "h w 3"]:
        """The colour of a picture in sRGB, 8 bits; as `read`, but faster where the file has it so."""
        if self.whole is not None or self.maps:
            return self.read().srgb
        with _place(self.name, self.reference):
            return locate.decode_colour(self.reference, self.digest)


def open_source(name: str, reference: str) -> Source:
    """Find a source and read its headers; nothing is decoded.

    Parameters
    ----------
    name : its name in the flow.
    reference : a file; a folder or YAML file of maps, see `texloom.pipelines.media.material_set`; or
        ``texloom:NAME`` or ``skimage:NAME`` for a picture that ships with texloom or scikit-image; after
        ``stack:``, a frame stack, see `texloom.pipelines.media.stack`; with ``<UDIM>`` in the file's name, all
        tiles as one picture. Content decides the format, see `texloom.pipelines.media.formats`: integers are
        taken as sRGB, floats (EXR, HDR, TIFF) as linear light; JSON of strokes is drawn.

    Raises
    ------
    SourceError
        ``sources.NAME: REFERENCE: problem``, where it cannot be used, or decoded within the memory limit.
    """
    with _place(name, reference):
        if stack.is_stack(reference):
            frames = stack.open_stack(reference)
            _check_memory(stack.memory_of(frames))
            channels, digest = stack.channels_of(frames), material_maps.digest_of(frames)
            height, width, bits = frames[0].height, frames[0].width, frames[0].bits
            notes = _notes(name, reference, *dict.fromkeys(frame.note for frame in frames))
            return Source(name, reference, height, width, channels, digest, frames, notes, bits, {"albedo": bits})
        if material_set.is_map_set(reference):
            maps, told = material_set.open_set(reference)
            _check_memory(material_maps.memory_of(maps))
            maps, more = contradictions.checked(maps)
            told = (*told, *more)
            channels, digest = material_maps.channels_of(maps), material_maps.digest_of(maps)
            texel_size = locate.inspect(maps[0].reference).texel_size
            notes = _notes(name, reference, *told, _told_of_texel(texel_size))
            bits_of = {one.role: one.bits for one in maps}
            height, width = maps[0].height, maps[0].width
            return Source(
                *(name, reference, height, width, channels, digest, maps, notes, maps[0].bits, bits_of),
                texel_size=texel_size,
            )
        seen = locate.inspect(reference)
        _check_memory(seen.memory)
        excluded = contradictions.told_of_alpha(seen, reference) if name in _COPIED else ""
    notes = _notes(name, reference, seen.note, excluded, _told_of_texel(seen.texel_size))
    roles = dict.fromkeys("albedo" if one in [*"RGBYA"] else one.partition(".")[0] for one in seen.channels)
    bits_of = {role: seen.original_bits.get(role, seen.bits) for role in roles}
    return Source(
        name,
        reference,
        seen.height,
        seen.width,
        seen.channels,
        seen.digest,
        notes=notes,
        bits=bits_of["albedo"],
        map_bits=bits_of,
        texel_size=seen.texel_size,
        remembered=tuple(_remembered(reference, seen, roles)),
    )


def _remembered(reference: str, seen: Inspected, roles: Collection[str]) -> Iterator[Map]:
    """The files that the maps of an EXR were made from, as far as it says; with its own, float, values."""
    facts = Facts.of(seen.facts)
    for role, stem in seen.names.items():
        if role in roles:
            size = seen.height, seen.width
            yield Map(role, reference, stem, *size, (), 32, facts.of_map(role), seen.digest, seen.memory)


def _told_of_texel(length: float | None) -> str:
    return "" if length is None else f"its header says that a pixel is {1000 * length:g} mm"


def _notes(name: str, reference: str, *told: str) -> tuple[str, ...]:
    return tuple(one_line(f"sources.{name}: {stack.path_of(reference)}: {note}") for note in told if note)


def open_mesh(name: str, reference: str) -> Source:
    """Find a mesh; only its bytes are read.

    Parameters
    ----------
    name : its name in the flow.
    reference : a file, see `texloom.pipelines.media.meshes`, or ``texloom:NAME``.

    Raises
    ------
    SourceError
        ``sources.NAME: REFERENCE: problem``, where it cannot be used.
    """
    with _place(name, reference):
        digest = meshes.inspect(reference)
    return Source(name, reference, 0, 0, (), digest, kind="mesh")


def open_patches(name: str, reference: str, store: Store) -> Source:
    """Find the patches of an earlier result in a store, see `texloom.pipelines.media.voted_results`.

    Parameters
    ----------
    name : its name in the flow.
    reference : an EXR of a run.

    Raises
    ------
    SourceError
        ``sources.NAME: REFERENCE: problem``, where there are none.
    """
    with _place(name, reference):
        stored, digest = voted_results.find(Path(reference), store)
    return Source(name, reference, 0, 0, (), digest, kind="patches", stored=stored)


def _check_memory(needed: int) -> None:
    if problem := check_memory(needed):
        raise Refusal(problem)


@contextmanager
def _place(name: str, reference: str) -> Iterator[None]:
    try:
        yield
    except Refusal as error:
        problem = str(error)
    except FileNotFoundError:
        problem = f"no such file{_similar_name(Path(stack.path_of(reference)))}"
    except OSError as error:
        problem = f"cannot be read: {error.strerror or error}"
    except MemoryError:
        problem = "too large for the memory of this machine"
    else:
        return
    raise SourceError(one_line(f"sources.{name}: {stack.path_of(reference)}: {problem}")) from None


def _similar_name(path: Path) -> str:
    """A hint at a file of a similar name in the same folder."""
    try:
        with os.scandir(path.parent) as entries:
            others = [entry.name for entry in itertools.islice(entries, _MAX_FILES)]
    except OSError:
        return ""
    return closest(path.name, [name for name in others if name != path.name])
