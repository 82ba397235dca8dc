"""Picture files of sources: locating, opening, digests."""

from __future__ import annotations

import dataclasses
import difflib
import hashlib
import importlib.util
import io
import json
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from texloom.pipelines.errors import one_of
from texloom.pipelines.media import decode as pictures
from texloom.pipelines.media import known_files, udim
from texloom.pipelines.media.headers import Refusal, check_size
from texloom.pipelines.media.known_files import Inspected
from texloom.pipelines.store.atomic import file_digest
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import NOWHERE, Facts

_VERSION = 4  # to be raised when files are decoded to other values
_LARGEST = 2**31  # bytes
_EXEMPLARS = Path(__file__).parents[2] / "configs" / "exemplars"


@contextmanager
def opened(path: Path) -> Iterator[io.BufferedReader]:
    """Open a regular file; `Refusal` where it is none or too large."""
    # Before opening, as opening a pipe waits for its writer.
    status = path.stat()
    if stat.S_ISDIR(status.st_mode):
        raise Refusal("is a folder, not a file")
    if not stat.S_ISREG(status.st_mode):
        raise Refusal("is not a regular file")
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size == 0:
            raise Refusal("is empty")
        if size > _LARGEST:
            raise Refusal(f"is too large: {size} bytes, at most {_LARGEST}")
        yield file


def inspect(reference: str, data: bool = False, layered: bool = False) -> Inspected:
    """What the header of a picture tells, and its digest; it is not decoded.

    For ``data`` and ``layered`` see `texloom.pipelines.media.decode.read_header`.
    """
    if udim.is_tiled(reference):
        return _inspect_tiles(reference, data)[0]
    path, known, state = locate(reference), known_files.current(), ""
    if known is not None:
        found, state = known.find(path, f"{data} {layered}")
        if found is not None:
            return found
    with opened(path) as file:
        read = pictures.read_header(file, data, layered)
        header = read.height, read.width, read.channels, read.bits, read.memory
        facts = read.facts.record()
        seen = Inspected(*header, _digest(file), read.note, read.original_bits, facts, read.texel_size, read.names)
    if known is not None:
        known.add(path, state, seen)
    return seen


def decode(reference: str, digest: str, data: bool = False, layered: bool = False) -> Image:
    """Decode a picture; `Refusal` where it is broken, not finite, or not the one of that digest."""
    if udim.is_tiled(reference):
        return _decode_tiles(reference, digest, data)
    with _unchanged(reference, digest) as file:
        picture = pictures.read_header(file, data, layered)
        pixels = picture.decode()
    return Image(pixels, picture.channels, picture.facts)


def decode_colour(reference: str, digest: str) -> UInt8[np.ndarray, "h w 3"]:
    """The colour of a picture in sRGB, 8 bits, clipped to 0..1, without alpha; `Refusal` as of `decode`."""
    if udim.is_tiled(reference):
        return _decode_tiles(reference, digest, data=False).srgb
    with _unchanged(reference, digest) as file:
        picture = pictures.read_header(file)
        if picture.codes is None:
            return Image(picture.decode(), picture.channels).srgb
        codes = picture.codes()
    return codes[..., :3] if picture.channels[0] == "R" else np.repeat(codes[..., :1], 3, axis=2)


@contextmanager
def _unchanged(reference: str, digest: str) -> Iterator[io.BufferedReader]:
    """The file of a picture; `Refusal` where it is not, or no longer at the end, the one of a digest."""
    with opened(locate(reference)) as file:
        before = os.fstat(file.fileno())
        if _digest(file) != digest:
            raise Refusal("has changed since the run began")
        yield file
        after = os.fstat(file.fileno())
        if (before.st_mtime_ns, before.st_size) != (after.st_mtime_ns, after.st_size):
            raise Refusal("has changed while it was read")


def _inspect_tiles(reference: str, data: bool) -> tuple[Inspected, udim.Tiles, list[str]]:
    """What the headers of UDIM tiles tell of the whole picture, the tiles, and their digests."""
    try:
        tiles = udim.tiles_of(locate(reference))
    except ValueError as error:
        raise Refusal(str(error)) from None
    seen = []
    for file in tiles.files:
        try:
            seen.append(inspect(str(file), data))
        except Refusal as error:
            raise Refusal(f"{file.name} {error}") from None
    first = seen[0]
    alike = first.height, first.width, first.channels, first.bits
    for file, one in zip(tiles.files, seen, strict=True):
        if (one.height, one.width, one.channels, one.bits) != alike:
            raise Refusal(f"{file.name} has another size, channels or bits than {tiles.files[0].name}")
    height, width = tiles.rows * first.height, tiles.columns * first.width
    check_size(height, width)
    digests = [one.digest for one in seen]
    digest = hashlib.sha256(json.dumps([tiles.rows, tiles.columns, digests]).encode()).hexdigest()
    memory = height * width * 4 * len(first.channels) + max(one.memory for one in seen)
    header = height, width, first.channels, first.bits, memory
    facts = dataclasses.replace(Facts.of(first.facts), wraps=NOWHERE).record()  # a tile alone does not wrap
    whole = Inspected(*header, digest, first.note, first.original_bits, facts, first.texel_size)
    return whole, tiles, digests


def _decode_tiles(reference: str, digest: str, data: bool) -> Image:
    whole, tiles, digests = _inspect_tiles(reference, data)
    if whole.digest != digest:
        raise Refusal("has changed since the run began")
    pixels = np.empty((whole.height, whole.width, len(whole.channels)), np.float32)
    areas = udim.areas(whole.height, whole.width, tiles.rows, tiles.columns).values()
    for file, one, area in zip(tiles.files, digests, areas, strict=True):
        try:
            tile = decode(str(file), one, data)
        except Refusal as error:
            raise Refusal(f"{file.name} {error}") from None
        pixels[area] = tile.pixels
    return Image(pixels, whole.channels, Facts.of(whole.facts))


def _digest(file: io.BufferedReader) -> str:
    content = file_digest(file)
    return hashlib.sha256(f"{_VERSION}:{content}".encode()).hexdigest()


def is_path(reference: str) -> bool:
    """Whether a reference is a path, and not as ``texloom:NAME``."""
    return not re.match(r"[a-z][a-z0-9]+:", reference)


def locate(reference: str) -> Path:
    """The path of a reference, which need not exist; `Refusal` where the reference is wrong."""
    if is_path(reference):
        if "\0" in reference:
            raise Refusal("a file name cannot hold a zero byte")
        return Path(reference)
    scheme, _, name = reference.partition(":")
    if scheme not in ("texloom", "skimage"):
        raise Refusal(f"no such kind of source, '{scheme}:'; give a file, texloom:NAME or skimage:NAME")
    shipped = _pictures(_EXEMPLARS) if scheme == "texloom" else _skimage_pictures()
    if name not in shipped:
        close = difflib.get_close_matches(name, list(shipped), n=1, cutoff=0.6)
        hint = f"; did you mean '{scheme}:{close[0]}'?" if close else one_of(shipped)
        raise Refusal(f"no such picture ships with {'scikit-image' if scheme == 'skimage' else scheme}{hint}")
    return shipped[name]


def shipped_pictures() -> list[str]:
    """References of the pictures that ship with texloom and scikit-image."""
    shipped = {"texloom": _pictures(_EXEMPLARS), "skimage": _skimage_pictures()}
    return [f"{scheme}:{name}" for scheme, pictures in shipped.items() for name in pictures]


def _skimage_pictures() -> dict[str, Path]:
    """The pictures in scikit-image's package, which is not imported; it would download others."""
    spec = importlib.util.find_spec("skimage")
    if spec is None or not spec.submodule_search_locations:
        raise Refusal("scikit-image is not installed")
    return _pictures(Path(spec.submodule_search_locations[0]) / "data")


def _pictures(folder: Path) -> dict[str, Path]:
    return {path.stem: path for path in sorted(folder.glob("*")) if path.suffix in (".png", ".jpg")}
