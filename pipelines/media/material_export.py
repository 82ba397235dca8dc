"""The maps of a material as a folder: a PNG each, all in one EXR, and a MaterialX document that binds them."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.media.conventions import COLORS, ROLES
from texloom.pipelines.media.delivery import AS_IS, Delivery
from texloom.pipelines.media.material_maps import Map, normal_codes
from texloom.pipelines.media.materialx import BoundMap, document
from texloom.pipelines.media.relief import Relief, relief_of
from texloom.pipelines.store import codec
from texloom.pipelines.store.atomic import write_atomically
from texloom.pipelines.store.clipping import Clipped
from texloom.pipelines.store.png_file import LARGE, png, with_facts, write_png
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import srgb_from_linear
from texloom.stages.vocabulary.facts import GREENS, MapFacts
from texloom.stages.vocabulary.normals import NORMAL, rounding, unit
from texloom.stages.vocabulary.scratch import bands, empty, release

_LOG = logging.getLogger(__name__)

_NAME = "material"
_BITS = {"height": 16}
"""of maps made from files whose bits nobody knows, if not 8"""
_STRIP = 2**22  # values converted at once


def write_maps(
    image: Image,
    folder: Path,
    like: Sequence[Map],
    provenance: Mapping[str, Any],
    delivery: Delivery = AS_IS,
    fed: Mapping[str, int] | None = None,
) -> dict[str, str]:
    """Write all maps of an image into a folder, made if need be.

    ``material.exr`` holds all channels, normals with unit length; ``material.mtlx`` binds the PNGs. These have the
    names and direction of green of the files of ``like``; they are named by their role without such a file, and
    where it packs several maps or holds 1 minus one. In PNG
    only, heights are normalised, see `relief_of`, other values beyond 0..1 clipped, and a grey albedo is written as
    three equal channels, each with a warning. Pixels copied from files of ``like`` keep their bits.

    Parameters
    ----------
    like : maps of the exemplar.
    provenance : of the image, ready for JSON; stored in the EXR and, with the image's facts, in PNGs.
    delivery : colour space of the EXR and physical size.
    fed : role to the bits of what the map is made from, 32 of floats; those of ``like`` where none are given. PNGs
        have 16 for more than 8, also where the file that they are named like has 8.

    Returns
    -------
    file name to SHA-256 of the file, 64 hexadecimal digits.
    """
    folder.mkdir(parents=True, exist_ok=True)
    alike = {one.role: one for one in like}
    known = {**{one.role: one.bits for one in like}, **(fed or {})}
    bits = {role: 16 if known.get(role, _BITS.get(role, 8)) > 8 else 8 for role in ROLES}
    image = with_unit_normals(image, bits["normal"])
    attributes, shown = delivery.exr_attributes(is_color=True), delivery.encoded(image)
    written = {f"{_NAME}.exr": codec.export(shown, Image, folder / f"{_NAME}.exr", provenance, attributes)}
    relief = relief_of(image)
    relief.tell()
    tell_of_grey(image)
    image = relief.normalised(image)
    stems = [one.stem for one in like]
    bound = []

    def write(file: str, content: bytes) -> None:
        write_atomically(folder / file, content)
        written[file] = hashlib.sha256(content).hexdigest()

    for role in ROLES:
        channels = channels_of(role, image.channels)
        if channels:
            one = alike.get(role)
            directx = one is not None and one.directx
            said = {role: facts_of_file(role, directx, relief)}
            explained = with_facts(provenance, image.facts, image.height, image.width, said)
            # Files of the same name may be in several folders; gloss and packed maps are written as what they hold.
            is_own = one is not None and one.is_plain and stems.count(one.stem) == 1
            file = f"{one.stem if one is not None and is_own else role}.png"
            if image.height * image.width > LARGE:
                strips = _code_strips(image, channels, role, bits[role], directx)
                written[file] = write_png(folder / file, image.height, image.width, strips, explained)
                bound.append(BoundMap(role, file, min(3, len(channels)), role in COLORS, directx, relief))
                continue
            levels = codes_of(image, channels, role, bits[role], directx)
            if role == "normal" and one is not None:
                keep_codes(levels, image, one)
            write(file, png(levels, explained))
            bound.append(BoundMap(role, file, min(3, len(channels)), role in COLORS, directx, relief))
    write(
        f"{_NAME}.mtlx",
        document(_NAME, bound, delivery.size(image.height, image.width), wraps=image.wraps).encode(),
    )
    return written


def write_deep_png(image: Image, path: Path, provenance: Mapping[str, Any]) -> str:
    """Write the colour of an image as a PNG of 16 bits, in sRGB; pixels decoded from such a file keep their bits.

    Returns
    -------
    SHA-256 of the file, 64 hexadecimal digits.
    """
    has_alpha = "A" in image.channels
    grey = image.channels[0] == "Y" and not has_alpha
    channels = ["Y"] if grey else channels_of("albedo", image.channels)
    explained = with_facts(provenance, image.facts, image.height, image.width)
    strips = _code_strips(image, channels, "albedo", 16, directx=False)
    return write_png(path, image.height, image.width, strips, explained)


def channels_of(role: str, known: Sequence[str]) -> list[str]:
    """The channels that a map of this role is made of; none if the image has no such map."""
    if role == "albedo":
        # Three channels even where it is grey, as the shader expects a colour.
        return [*("RGB" if known[0] == "R" else "YYY"), *(["A"] if "A" in known else [])]
    names = NORMAL if role == "normal" else tuple(f"{role}.{letter}" for letter in "RGB")
    if set(names) <= set(known):
        return list(names)
    return [role] if role in known else []


def tell_of_grey(image: Image) -> None:
    """Warn that the albedo of a grey image is written as colour."""
    if image.channels[0] == "Y":
        _LOG.warning("albedo: is grey, and written as three equal channels, as shaders expect")


def facts_of_file(role: str, directx: bool, relief: Relief) -> MapFacts:
    """What holds for the file of integers that a map is written to."""
    if role == "height":
        return relief.facts()
    return MapFacts(GREENS[directx] if role == "normal" else "")


def keep_codes(levels: np.ndarray, image: Image, one: Map) -> None:
    """Take the integers of a normal map where the image has what was read from them.

    Vectors that are not of unit length are normalised on reading, which other integers would stand for.
    """
    read = normal_codes(one, image.height, image.width)
    if read is not None:
        vectors, codes = read
        places = [image.channels.index(name) for name in NORMAL]
        same = (image.pixels[..., places] == vectors).all(axis=2)
        levels[same] = codes[same]


def with_unit_normals(image: Image, bits: int) -> Image:
    """The image with normals of unit length, within the rounding of ``bits``."""
    if not set(NORMAL) <= set(image.channels):
        return image
    places = [image.channels.index(name) for name in NORMAL]

    def right(band: slice) -> np.ndarray:
        return np.asarray(unit(image.pixels[band][..., places], rounding(bits)))

    if all(
        np.array_equal(image.pixels[band][..., places], right(band)) for band in bands(image.height, image.pixels)
    ):
        return image
    pixels = empty(image.pixels.shape, np.float32)
    for band in bands(image.height, image.pixels, pixels):
        pixels[band] = image.pixels[band]
        pixels[band][..., places] = right(band)
    return image.with_pixels(pixels)


def codes_of(image: Image, channels: Sequence[str], role: str, bits: int, directx: bool) -> np.ndarray:
    """The integers of a map's file, (h, w, c): uint8 or uint16 for 8 or 16 ``bits``."""
    return np.concatenate(list(_code_strips(image, channels, role, bits, directx)))


def _code_strips(
    image: Image, channels: Sequence[str], role: str, bits: int, directx: bool
) -> Iterator[np.ndarray]:
    """Strips of rows of `codes_of`, from top to bottom."""
    most, clipped = 2**bits - 1, Clipped(bits)
    rows = max(1, _STRIP // image.width)
    for top in range(0, image.height, rows):
        strip = image.pixels[top : top + rows]
        levels = np.empty((*strip.shape[:2], len(channels)), np.uint8 if bits == 8 else np.uint16)
        for place, name in enumerate(channels):
            values = strip[..., image.channels.index(name)].astype(np.float64)
            if role == "normal":
                values = ((-values if directx and name == NORMAL[1] else values) + 1) / 2
            is_light = role in COLORS and name != "A"
            clipped.add(values, is_light)
            if is_light:
                values = srgb_from_linear(values)
            levels[..., place] = np.rint(np.clip(values, 0, 1) * most)
        release(image.pixels)
        yield levels
    clipped.tell(role)
