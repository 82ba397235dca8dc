"""Sources: pictures and map sets that a flow starts from, checked by their headers and read into linear light."""

from __future__ import annotations

import dataclasses
import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from texloom.pipelines.errors import closest
from texloom.pipelines.media import locate, material_set
from texloom.pipelines.media.decode import Refusal
from texloom.pipelines.media.material_set import Map
from texloom.stages.arrays import Image
from texloom.stages.declare import InputError

_NEIGHBOURS = 10_000  # files among which a nearly right name is looked for


class SourceError(InputError):
    """A source cannot be used, whichever step takes it."""


@dataclasses.dataclass(frozen=True)
class Source:
    """A picture or map set that a flow starts from, opened but not decoded."""

    name: str
    reference: str
    height: int
    width: int
    channels: tuple[str, ...]
    digest: str
    """SHA-256 of all that decides what is read: the content of the files, the roles of maps, the version of the
    decoding; 64 hexadecimal digits"""
    maps: tuple[Map, ...] = ()
    """the files of a map set; none for one picture"""
    notes: tuple[str, ...] = ()
    """what the user should know of how it was understood"""

    def read(self) -> Image:
        """Decode it; `SourceError` where it is broken, not finite, or not what was opened."""
        with _place(self.name, self.reference):
            if self.maps:
                return material_set.read(self.maps, self.height, self.width)
            return locate.decode(self.reference, self.digest)


def open_source(name: str, reference: str) -> Source:
    """Find a source and read its headers; nothing is decoded.

    Parameters
    ----------
    name : what the flow calls it.
    reference : a file; a folder or YAML file of maps, see `texloom.pipelines.media.material_set`; or
        ``skimage:NAME`` for a picture that ships with scikit-image. Formats are told by content: PNG, JPEG, TIFF,
        WebP, BMP (8 and 16 bits are taken as sRGB), 32-bit float TIFF and EXR (linear light).

    Raises
    ------
    SourceError
        ``sources.NAME: REFERENCE: problem`` for all that can be told without decoding.
    """
    with _place(name, reference):
        if material_set.is_map_set(reference):
            found = material_set.open_set(reference)
            notes = tuple(f"sources.{name}: {_one_line(reference)}: {_one_line(note)}" for note in found.notes)
            size = (found.height, found.width)
            return Source(name, reference, *size, found.channels, found.digest, found.maps, notes)
        header, digest = locate.inspect(reference)
    return Source(name, reference, header.height, header.width, header.channels, digest)


@contextmanager
def _place(name: str, reference: str) -> Iterator[None]:
    try:
        yield
    except Refusal as error:
        problem = str(error)
    except FileNotFoundError:
        problem = f"no such file{_neighbour(Path(reference))}"
    except OSError as error:
        problem = f"cannot be read: {error.strerror or error}"
    except MemoryError:
        problem = "too large for the memory of this machine"
    else:
        return
    raise SourceError(f"sources.{name}: {_one_line(reference)}: {_one_line(problem)}") from None


def _neighbour(path: Path) -> str:
    """A hint at a file of nearly that name in the same folder."""
    try:
        with os.scandir(path.parent) as entries:
            others = [entry.name for entry in itertools.islice(entries, _NEIGHBOURS)]
    except OSError:
        return ""
    return closest(path.name, [name for name in others if name != path.name])


def _one_line(text: str) -> str:
    # Names of files and of channels may hold line breaks and worse.
    return text if text.isprintable() else ascii(text)
