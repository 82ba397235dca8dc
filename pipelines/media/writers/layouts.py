"""Material sets as programs expect them: file names, packed channels, direction of green, bits, UDIM tiles."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import logging
import re
import unicodedata
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.media import udim as udim_tiles
from texloom.pipelines.media.conventions import COLORS, LAYOUTS, ROLES, Layout, LayoutFile, role_of
from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.material_export import (
    channels_of,
    codes_of,
    facts_of_file,
    tell_of_grey,
    with_unit_normals,
)
from texloom.pipelines.media.materialx import BoundMap, document
from texloom.pipelines.media.relief import Relief, relief_of
from texloom.pipelines.store.atomic import write_atomically
from texloom.pipelines.store.codec import ArtifactError
from texloom.pipelines.store.png_file import png, with_facts
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import TORUS, Facts, Wraps
from texloom.stages.vocabulary.sizes import format_size, size_value

_WITHOUT = {"ao": 1.0, "roughness": 1.0, "1-roughness": 0.0, "metallic": 0.0, "": 1.0, "height": 0.5}
"""value of a packed plane whose map the material does not have; 1 of others"""
_MAX_NAME = 64
_LOG = logging.getLogger(__name__)


def material_name(text: str) -> str:
    """``text`` as the name of a material: letters of any script (NFC), digits and _, a letter first."""
    name = re.sub(r"\W+", "_", unicodedata.normalize("NFC", text)).strip("_")[:_MAX_NAME]
    return name if name[:1].isalpha() else f"material_{name}".rstrip("_")


def parts_of(image: Image, layout: Layout) -> list[LayoutFile]:
    """The files that an image has maps for."""
    return [part for part in layout.written if any(_has(image, role) for role in part.planes)]


def _has(image: Image, role: str) -> bool:
    return bool(role) and bool(channels_of(role_of(role)[0], image.channels))


def with_bits(part: LayoutFile, fed: Mapping[str, int]) -> LayoutFile:
    """The part with 16 bits where a map in it is made from more than 8; ``fed``: role to bits."""
    roles = (role_of(plane)[0] for plane in part.planes)
    return dataclasses.replace(part, bits=16) if any(fed.get(role, 8) > 8 for role in roles) else part


def levels_of(image: Image, part: LayoutFile, directx: bool) -> np.ndarray:
    """The integers of a file, (h, w, c)."""
    if part.role:
        return codes_of(image, channels_of(part.role, image.channels), part.role, part.bits, directx)
    planes, most = [], 2**part.bits - 1
    for plane in part.planes:
        role, inverted = role_of(plane)
        if _has(image, plane):
            codes = codes_of(image, channels_of(role, image.channels)[:1], role, part.bits, directx)
            planes.append(most - codes if inverted else codes)
        else:
            white = np.full((image.height, image.width, 1), most, np.uint8 if part.bits == 8 else np.uint16)
            planes.append((white * _WITHOUT.get(plane, 1.0)).astype(white.dtype))
    return np.concatenate(planes, axis=2)


def bound_maps(image: Image, layout: Layout, files: Mapping[str, str]) -> list[BoundMap]:
    """What a document binds, of ``files``: suffix of a part to a file's name."""
    bound, relief = [], relief_of(image)
    if layout.kind == "tx" and relief.is_normalised:  # floats
        relief = Relief(unit=relief.unit)
    for part in parts_of(image, layout):
        if part.role and part.suffix in files:
            planes = min(3, len(channels_of(part.role, image.channels)))
            encoded = part.role in COLORS and layout.kind == "png"
            bound.append(BoundMap(part.role, files[part.suffix], planes, encoded, layout.directx, relief))
    return bound


def write_maps_of(
    image: Image,
    folder: Path,
    name: str,
    layout: Layout,
    delivery: Delivery,
    provenance: Mapping[str, Any],
    fed: Mapping[str, int],
) -> tuple[dict[str, str], dict[str, str]]:  # fmt: skip
    """Write the maps of an image as a layout has them into a folder, made if need be; ``fed``: see `with_bits`.

    Returns
    -------
    suffix of a part to the name of its file, with ``<UDIM>`` where there are tiles; and file name to digest.
    """
    folder.mkdir(parents=True, exist_ok=True)
    is_whole = delivery.udim in (None, (1, 1))
    wraps = image.wraps if is_whole else Wraps()  # a tile alone does not
    files: dict[str, str] = {}
    written: dict[str, str] = {}
    relief = relief_of(image)
    if layout.kind == "png" and any(part.role == "height" for part in layout.parts):
        relief.tell()
        image = relief.normalised(image)
    for part in (with_bits(one, fed) for one in parts_of(image, layout)):
        stem = f"{layout.prefix}{name}_{part.suffix}"
        files[part.suffix] = f"{stem}.<UDIM>.{layout.kind}" if delivery.udim else f"{stem}.{layout.kind}"
        is_tx = layout.kind == "tx"
        said = {part.role: facts_of_file(part.role, layout.directx, relief)} if part.role else {}
        values = _linear(image, part, layout, delivery) if is_tx else levels_of(image, part, layout.directx)
        for tile, area in tiles_of(image, delivery.udim, folder):
            file = files[part.suffix].replace("<UDIM>", tile)
            piece = np.ascontiguousarray(values[area])
            if is_tx:
                from texloom.pipelines.media.writers.tx import write_texture

                color = part.role in COLORS
                written[file] = write_texture(folder / file, piece, delivery, color, wraps)
            else:
                height, width = piece.shape[:2]
                content = png(piece, with_facts(provenance, Facts(wraps), height, width, said))
                write_atomically(folder / file, content)
                written[file] = hashlib.sha256(content).hexdigest()
    if relief.is_normalised and not layout.document and any(part.role == "height" for part in layout.parts):
        file = f"{layout.prefix}{name}_height.json"
        content = (json.dumps(relief.record(), indent=2) + "\n").encode()
        write_atomically(folder / file, content)
        written[file] = hashlib.sha256(content).hexdigest()
    return files, written


def tiles_of(image: Image, udim: tuple[int, int] | None, folder: Path) -> Iterator[tuple[str, tuple[slice, slice]]]:
    """Number and area of each UDIM tile, 1001 at the lower left; one area without a number where there are none.

    Neighbouring tiles continue each other, as they are cut from one picture.
    """
    if udim is None:
        yield "", (slice(None), slice(None))
        return
    rows, columns = udim
    if image.height % rows or image.width % columns:
        raise ArtifactError(
            f"{folder}: {format_size(image)} cannot be cut into {size_value(udim)} equal tiles; change --size"
        )
    areas = udim_tiles.areas(image.height, image.width, rows, columns)
    for number in sorted(areas):
        yield str(number), areas[number]


def _linear(image: Image, part: LayoutFile, layout: Layout, delivery: Delivery) -> np.ndarray:
    """The floats of a tx file, (h, w, c): linear colour, data as they are, normals as 0..1."""
    shown = delivery.encoded(image) if part.role in COLORS else image
    names = channels_of(part.role, image.channels)
    values: np.ndarray = shown.pixels[..., [image.channels.index(name) for name in names]]
    if part.role != "normal":
        return values
    signs = np.array([1, -1 if layout.directx else 1, 1], np.float32)
    return np.asarray((values * signs + 1) / 2, np.float32)


def write_layout(
    image: Image,
    folder: Path,
    name: str,
    delivery: Delivery,
    provenance: Mapping[str, Any],
    fed: Mapping[str, int] | None = None,
) -> dict[str, str]:
    """Write a material set in the delivery's layout into a folder, with the document that binds it, if any.

    Parameters
    ----------
    name : of the material, see `material_name`; file names begin with it.
    fed : role to the bits of what the map is made from; PNGs have 16 for more than 8, else those of the layout.

    Returns
    -------
    file name to SHA-256 of the file, 64 hexadecimal digits.

    Raises
    ------
    ArtifactError
        The picture cannot be cut into the tiles that are wanted.
    """
    layout = LAYOUTS[delivery.layout or ""]
    held = {role_of(plane)[0] for part in layout.written for plane in part.planes}
    if left := [role for role in ROLES if role not in held and channels_of(role, image.channels)]:
        count = "1 map is" if len(left) == 1 else f"{len(left)} maps are"
        _LOG.warning("%s not part of layout %s: %s", count, delivery.layout, ", ".join(left))
    tell_of_grey(image)
    image = with_unit_normals(image, 16)
    files, written = write_maps_of(image, folder, name, layout, delivery, provenance, fed or {})
    if layout.document:
        from texloom.pipelines.media.writers import glb, usda

        maps = bound_maps(image, layout, files)
        if layout.document == "mtlx":
            size = delivery.size(image.height, image.width)
            wraps = image.wraps if delivery.udim in (None, (1, 1)) else TORUS  # tiles are continued by others
            content = document(name, maps, size, layout.shader, delivery.color_space, wraps=wraps).encode()
        elif layout.document == "usda":
            content = usda.stage(name, maps, image, delivery, "").encode()
        else:
            content = glb.binary(name, image, delivery, fed=fed)
        file = f"{name}.{layout.document}"
        write_atomically(folder / file, content)
        written[file] = hashlib.sha256(content).hexdigest()
    return written
