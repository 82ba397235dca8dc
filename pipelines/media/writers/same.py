"""Maps of a material as its exemplar has them: the same file names, packing, inversion, green, bits and formats."""

from __future__ import annotations

import contextlib
import hashlib
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.media import udim
from texloom.pipelines.media.color_management import MODES
from texloom.pipelines.media.conventions import COLORS
from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.material_export import (
    channels_of,
    codes_of,
    facts_of_file,
    keep_codes,
    with_unit_normals,
)
from texloom.pipelines.media.material_maps import Map, holds_vectors, unread, with_curve, with_x_in_alpha
from texloom.pipelines.media.picture_facts import is_in_blocks
from texloom.pipelines.media.pillow_pictures import raw_mode
from texloom.pipelines.media.relief import relief_of
from texloom.pipelines.media.writers.encodings import can_encode, encoded
from texloom.pipelines.media.writers.layouts import tiles_of
from texloom.pipelines.store import codec
from texloom.pipelines.store.atomic import write_atomically
from texloom.pipelines.store.codec import ArtifactError
from texloom.pipelines.store.png_file import png, with_facts
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import Facts

_OF_OTHER_MODES = (".jpg", ".jpeg", ".tif", ".tiff", ".psd", ".png", ".bmp", ".gif", ".tga")
"""formats that may hold CMYK, Lab, palettes, or fewer than 8 bits"""
_FEW_BITS = {"1": "1 bit is", "L;2": "2 bits are", "L;4": "4 bits are"}
"""by the names of Pillow"""
_LOG = logging.getLogger(__name__)


def write_same(
    image: Image, folder: Path, like: Sequence[Map], delivery: Delivery, provenance: Mapping[str, Any]
) -> dict[str, str]:
    """Write the maps of an image into a folder, made if need be, in files as those of ``like``.

    Planes of packed files that hold no map of the image are what they were if that is one value or another plane,
    else white, which is told, as is what is not written.

    Returns
    -------
    file name to SHA-256 of the file, 64 hexadecimal digits.

    Raises
    ------
    ArtifactError
        The picture cannot be cut into the tiles of ``like``, or two files have the same name.
    """
    folder.mkdir(parents=True, exist_ok=True)
    image = with_unit_normals(image, next((min(16, one.bits) for one in like if one.role == "normal"), 8))
    files: dict[str, list[Map]] = {}
    for one in (each for first in like for each in (first, *first.twins)):
        if one not in like and one.role in COLORS:  # a variant's colours are not those of the one that was read
            _LOG.warning("%s: not written, as its colours were not read", Path(one.reference).name)
        elif channels_of(one.role, image.channels):
            files.setdefault(one.reference, []).append(one)
        else:
            _LOG.warning("%s: not written, as the result has no %s", Path(one.reference).name, one.role)
    written: dict[str, str] = {}
    for held in files.values():
        _tell_of_form(Path(held[0].reference))
        values = _values(image, held, delivery)
        for name, area in _areas(image, held[0], folder):
            if name in written:
                raise ArtifactError(f"{folder}: two maps are called {name}; --layout same needs different names")
            piece = np.ascontiguousarray(values[area])
            written[name] = _write(piece, folder / name, held, image, delivery, provenance)
    return written


def _tell_of_form(path: Path) -> None:
    """Say that a file is written in another form: DDS without blocks, as Pillow's lose too much, 26 to 34 dB on
    photographs; CMYK, Lab and palettes, also of greys, in RGB; fewer bits as 8.
    """
    import PIL.Image

    with contextlib.suppress(OSError, PIL.Image.DecompressionBombError):
        if path.suffix.lower() == ".dds":
            with path.open("rb") as file:
                if is_in_blocks(file.read(132)):
                    _LOG.warning("%s: written uncompressed, as blocks (BC1 to BC7) are only read", path.name)
        elif path.suffix.lower() in _OF_OTHER_MODES:
            with PIL.Image.open(path) as picture:
                if (name := MODES.get(picture.mode)) is not None:
                    _LOG.warning("%s: written in sRGB, as %s is only read", path.name, name)
                elif picture.mode in ("P", "PA"):
                    _LOG.warning("%s: written in RGB, as palettes are only read", path.name)
                elif (bits := _FEW_BITS.get(picture.mode) or _FEW_BITS.get(raw_mode(picture))) is not None:
                    _LOG.warning("%s: written in 8 bits, as %s only read", path.name, bits)


def _values(image: Image, held: Sequence[Map], delivery: Delivery) -> np.ndarray:
    """The values of a file, (h, w, c): integers of its bits, or floats."""
    first = held[0]
    is_float = first.bits == 32
    if not is_float and any(one.role == "height" for one in held):
        relief_of(image).tell()
        image = relief_of(image).normalised(image)
    most = 1 if is_float else 2**first.bits - 1
    dtype = np.float32 if is_float else np.uint8 if first.bits == 8 else np.uint16
    values = np.full((image.height, image.width, len(first.file_channels)), most, dtype)
    planes = {one.plane for one in held}
    kept = unread(first, planes) if all(planes) else {}
    left = [name for name in first.file_channels if all(planes) and name not in {*planes, *kept}]
    if left:
        _LOG.warning("%s: %s written white", Path(first.reference).name, ", ".join(left))
    for one in held:
        names = channels_of(one.role, image.channels)
        curved = with_curve(image, one)
        codes = _floats(curved, names, one, delivery) if is_float else codes_of(
            curved, names, one.role, one.bits, one.directx
        )  # fmt: skip
        if one.role == "normal" and not is_float:
            codes = with_x_in_alpha(one, codes)
            keep_codes(codes, image, one)
        codes = most - codes if one.inverted else codes
        if one.plane:
            places = [one.file_channels.index(one.plane)]
        else:
            colors = [place for place, name in enumerate(one.file_channels) if name != "A"]
            places = [*range(len(one.file_channels))] if codes.shape[2] == len(one.file_channels) else colors
        values[..., places] = codes[..., : len(places)] if codes.shape[2] >= len(places) else codes[..., :1]
    for name, held_there in kept.items():
        if isinstance(held_there, str):
            constant = values[..., first.file_channels.index(held_there)]
        else:
            constant = np.asarray(held_there if is_float else round(most * held_there))
        values[..., first.file_channels.index(name)] = constant
    return values


def _floats(image: Image, names: Sequence[str], one: Map, delivery: Delivery) -> np.ndarray:
    shown = delivery.encoded(image) if one.role in COLORS else image
    values: np.ndarray = shown.pixels[..., [image.channels.index(name) for name in names]].copy()
    if one.role == "normal":
        values[..., 1] *= -1 if one.directx else 1
        values = values if holds_vectors(one) else np.asarray((values + 1) / 2, np.float32)
    return values


def _areas(image: Image, one: Map, folder: Path) -> list[tuple[str, tuple[slice, slice]]]:
    """Name and area of a file, or of each of its UDIM tiles."""
    path = Path(one.reference)
    if not udim.is_tiled(one.reference):
        name = path.name if path.suffix else f"{one.stem}.png"
        if not can_encode(path.suffix, one.bits, len(one.file_channels)):
            name = f"{path.stem}.png"
            _LOG.warning("%s: written as %s, as its format is not written with such values", path.name, name)
        return [(name, (slice(None), slice(None)))]
    try:
        tiles = udim.tiles_of(path)
    except ValueError as error:
        raise ArtifactError(f"{path}: {error}") from None
    cut = dict(tiles_of(image, (tiles.rows, tiles.columns), folder))
    numbers = udim.areas(tiles.rows, tiles.columns, tiles.rows, tiles.columns)
    return [(file.name, cut[str(number)]) for file, number in zip(tiles.files, numbers, strict=True)]


def _write(
    piece: np.ndarray,
    path: Path,
    held: Sequence[Map],
    image: Image,
    delivery: Delivery,
    provenance: Mapping[str, Any],
) -> str:
    """Write values in the format of a file's name; the digest."""
    first, suffix = held[0], path.suffix.lower()
    wraps = Facts() if udim.is_tiled(first.reference) else Facts(image.wraps)
    if suffix == ".png":
        plain = {first.role: facts_of_file(first.role, first.directx, relief_of(image))} if first.is_plain else {}
        content = png(piece, with_facts(provenance, wraps, piece.shape[0], piece.shape[1], plain))
    elif suffix == ".exr":
        part = Image(piece.astype(np.float32), first.file_channels, wraps)
        return codec.export(part, Image, path, provenance, delivery.exr_attributes(first.role in COLORS))
    elif suffix == ".tx":
        from texloom.pipelines.media.writers.tx import write_texture
        from texloom.pipelines.media.writers.writer_registry import writer_of

        if (writer := writer_of(path.name)) is not None:
            writer.check_installed(str(path))
        return write_texture(path, piece.astype(np.float32), delivery, first.role in COLORS, wraps.wraps)
    else:
        content = encoded(piece, path, first.bits)
    write_atomically(path, content)
    return hashlib.sha256(content).hexdigest()
