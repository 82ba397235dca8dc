"""Sources: the pictures that a flow starts from, checked by their headers and read into linear light."""

from __future__ import annotations

import dataclasses
import difflib
import hashlib
import importlib.util
import io
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipelines import pictures
from stages.arrays import Image
from stages.declare import InputError

_VERSION = 1  # raised when the same file is decoded to other values
_LARGEST_FILE = 2**31  # bytes


@dataclasses.dataclass(frozen=True)
class Source:
    """A picture that a flow starts from, opened but not decoded."""

    name: str
    reference: str
    height: int
    width: int
    channels: tuple[str, ...]
    digest: str
    """SHA-256 of the file's content and of the version of the decoding, 64 hexadecimal digits"""

    def read(self) -> Image:
        """Decode the picture; `InputError` where it is broken, not finite, or not the file that was opened."""
        with _place(self.name, self.reference), _opened(_locate(self.reference)) as file:
            before = os.fstat(file.fileno())
            if _digest(file) != self.digest:
                raise pictures.Refusal("has changed since the run began")
            header = pictures.read_header(file)
            pixels = header.decode()
            # What was decoded must be what was digested.
            after = os.fstat(file.fileno())
            if (before.st_mtime_ns, before.st_size) != (after.st_mtime_ns, after.st_size):
                raise pictures.Refusal("has changed while it was read")
        return Image(pixels, header.channels)


def open_source(name: str, reference: str) -> Source:
    """Find a source and read its header; nothing is decoded.

    Parameters
    ----------
    name : what the flow calls it.
    reference : a file, or ``skimage:NAME`` for a picture that ships with scikit-image. Formats are told by content:
        PNG, JPEG, TIFF, WebP, BMP (8 and 16 bits are taken as sRGB), 32-bit float TIFF and EXR (linear light).

    Raises
    ------
    InputError
        ``sources.NAME: REFERENCE: problem`` for all that can be told without decoding.
    """
    with _place(name, reference), _opened(_locate(reference)) as file:
        header = pictures.read_header(file)
        digest = _digest(file)
    return Source(name, reference, header.height, header.width, header.channels, digest)


@contextmanager
def _place(name: str, reference: str) -> Iterator[None]:
    try:
        yield
    except pictures.Refusal as error:
        problem = str(error)
    except FileNotFoundError:
        problem = "no such file"
    except OSError as error:
        problem = f"cannot be read: {error.strerror or error}"
    except MemoryError:
        problem = "too large for the memory of this machine"
    else:
        return
    raise InputError(f"sources.{name}: {_one_line(reference)}: {_one_line(problem)}") from None


def _one_line(text: str) -> str:
    # Names of files and of channels may hold line breaks and worse.
    return text if text.isprintable() else ascii(text)


@contextmanager
def _opened(path: Path) -> Iterator[io.BufferedReader]:
    # Asked before opening, since opening a pipe would wait for its writer.
    status = path.stat()
    if stat.S_ISDIR(status.st_mode):
        raise pictures.Refusal("is a folder, not a file")
    if not stat.S_ISREG(status.st_mode):
        raise pictures.Refusal("is not a regular file")
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size == 0:
            raise pictures.Refusal("is empty")
        if size > _LARGEST_FILE:
            raise pictures.Refusal(f"is too large: {size} bytes, at most {_LARGEST_FILE}")
        yield file


def _digest(file: io.BufferedReader) -> str:
    file.seek(0)
    content = hashlib.file_digest(file, "sha256").hexdigest()
    return hashlib.sha256(f"{_VERSION}:{content}".encode()).hexdigest()


def _locate(reference: str) -> Path:
    scheme, colon, name = reference.partition(":")
    if not colon or not re.fullmatch(r"[a-z][a-z0-9]+", scheme):
        if "\0" in reference:
            raise pictures.Refusal("a file name cannot hold a zero byte")
        return Path(reference)
    if scheme != "skimage":
        raise pictures.Refusal(f"no such kind of source, '{scheme}:'; give a file or skimage:NAME")
    shipped = _skimage_pictures()
    if name not in shipped:
        close = difflib.get_close_matches(name, list(shipped), n=1, cutoff=0.6)
        hint = f"; did you mean 'skimage:{close[0]}'?" if close else f"; there is {', '.join(shipped)}"
        raise pictures.Refusal(f"no such picture ships with scikit-image{hint}")
    return shipped[name]


def _skimage_pictures() -> dict[str, Path]:
    """The pictures inside scikit-image's package, found without importing it; it would download others."""
    spec = importlib.util.find_spec("skimage")
    if spec is None or not spec.submodule_search_locations:
        raise pictures.Refusal("scikit-image is not installed")
    folder = Path(spec.submodule_search_locations[0]) / "data"
    return {path.stem: path for path in sorted(folder.glob("*")) if path.suffix in (".png", ".jpg")}
