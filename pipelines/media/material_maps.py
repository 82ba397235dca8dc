"""The maps of a material whose files are known, and the image of many channels that they make.

Albedo and emission are colours; the others are data, integers divided by the highest value of their type. Normals
are unpacked to vectors, x right, y up, z towards the viewer, and normalised unless their length is 1 within the
rounding of their bits, so that they are written to a file unchanged. Maps of one value may be stored in colour if
that is grey. A mask is black where the exemplar is excluded.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from texloom.pipelines.media import locate as picture_files
from texloom.pipelines.media.conventions import COLORS
from texloom.pipelines.media.curves import CURVES
from texloom.pipelines.media.headers import Refusal
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import Facts, MapFacts
from texloom.stages.vocabulary.masks import HALF
from texloom.stages.vocabulary.normals import rebuilt, rounding, unit

_VERSION = 4  # raised when the same files are read to other values
_FLAT = 2 / 255  # largest difference in a plane that holds nothing
GREY = 16 / 255
"""largest difference of channels in a grey picture of a lossy format"""


@dataclasses.dataclass(frozen=True)
class Map:
    """One file of a map set."""

    role: str
    """one of `texloom.pipelines.media.conventions.ROLES`, or ``frame`` of a frame stack's files"""
    reference: str
    stem: str
    """the file's name without its suffix, and without the mark of UDIM tiles"""
    height: int
    width: int
    channels: tuple[str, ...]
    """its channels in the image"""
    bits: int
    """8 or 16 of an integer, 32 where the values are floats"""
    facts: MapFacts
    """what is said of it: by its name, the YAML file, or texloom in its header"""
    digest: str
    """SHA-256 of its content"""
    memory: int
    """bytes that decoding takes at most"""
    note: str = ""
    """what was assumed of its colour, for the user"""
    plane: str = ""
    """the channel of the file that holds it: ``R``, ``G``, ``B`` or ``A``; empty: it is the file's only map"""
    inverted: bool = False
    """whether the file holds 1 minus it, as gloss is of roughness"""
    curve: str = ""
    """that the file's values went through, one of `texloom.pipelines.media.curves.CURVES`; reading undoes it"""
    file_channels: tuple[str, ...] = ()
    """channels of the file"""
    twins: tuple[Map, ...] = ()
    """other files that hold the same map and are not read, as normals of DirectX beside those of OpenGL"""
    implied: str | None = None
    """the programs whose names imply where green points, where nothing else says so; empty if none do, and green is
    assumed to point up; None where it is said, and of other maps than normals"""

    @property
    def is_plain(self) -> bool:
        """Whether its file holds it alone and as it is."""
        return not self.plane and not self.inverted

    @property
    def directx(self) -> bool:
        """Whether green points down in a normal map; up, where nobody says so."""
        return self.facts.green == "down"


def read(maps: tuple[Map, ...], height: int, width: int) -> Image:
    """Decode the maps; `Refusal` names the file that is broken, or not the one that was opened."""
    parts: list[Image] = []
    for one in maps:
        try:
            parts.append(_planes(one, height, width))
        except Refusal as error:
            raise Refusal(f"{Path(one.reference).name} {error}") from None
        except FileNotFoundError:
            raise Refusal(f"{Path(one.reference).name}: no such file") from None
        if one.role == "mask" and parts[-1].pixels.max() < HALF:
            raise Refusal(f"{Path(one.reference).name} is black: it excludes every pixel")
    # A mask may be drawn by hand.
    told = [part.facts for one, part in zip(maps, parts, strict=True) if one.role != "mask"]
    pixels = np.concatenate([part.pixels for part in parts], axis=2)
    return Image(pixels, channels_of(maps), Facts.joined(told))


def normal_codes(one: Map, height: int, width: int) -> tuple[np.ndarray, np.ndarray] | None:
    """The vectors that `read` makes of a normal map, and the file's integers, (h, w, 3), or 4 with x in alpha.

    None where the size is another one, the file holds floats, or is not there any more.
    """
    if (one.height, one.width) != (height, width) or one.bits not in (8, 16) or not one.is_plain or one.curve:
        return None
    try:
        pixels = _decoded(one).pixels
    except (Refusal, OSError):
        return None
    kept = pixels if has_x_in_alpha(pixels) else pixels[..., :3]
    codes = np.rint(kept.astype(np.float64) * (2**one.bits - 1))
    return unit(_vectors(one, pixels), rounding(one.bits)), codes.astype(np.uint8 if one.bits == 8 else np.uint16)


def channels_of(maps: Sequence[Map]) -> tuple[str, ...]:
    """The channels of the image that the maps make."""
    return tuple(channel for one in maps for channel in one.channels)


def memory_of(maps: Sequence[Map]) -> int:
    """Bytes that `read` takes at most: all planes, their copy in one image, and a file that is being decoded."""
    planes = maps[0].height * maps[0].width * 4 * len(channels_of(maps))
    return 2 * planes + max(one.memory for one in maps)


def digest_of(maps: Sequence[Map]) -> str:
    """SHA-256 of the roles and contents of the maps, without their files' names."""
    parts = [
        [one.role, one.channels, one.facts.record(), one.digest, one.plane, one.inverted, one.curve] for one in maps
    ]
    return hashlib.sha256(json.dumps([_VERSION, parts]).encode()).hexdigest()


def _decoded(one: Map) -> Image:
    return picture_files.decode(one.reference, one.digest, one.role not in COLORS)


def _planes(one: Map, height: int, width: int) -> Image:
    """The channels of a map, resampled to the image's size."""
    image = _decoded(one)
    pixels = image.pixels
    if one.plane:
        pixels = np.ascontiguousarray(pixels[..., [image.channels.index(one.plane)]])
    elif one.role == "albedo":
        pixels = pixels[..., [image.channels.index(name) for name in one.channels]]
    elif one.role == "normal":
        pixels = unit(_vectors(one, pixels), rounding(min(one.bits, 16)))
    elif len(one.channels) == 1:
        pixels = _grey(pixels[..., : 1 if image.channels[0] == "Y" else 3], one.role)
        if one.bits != 32 and one.facts.range is not None:  # heights that texloom has normalised
            pixels = one.facts.range[0] + np.float32(one.facts.range[1] - one.facts.range[0]) * pixels
    else:
        pixels = pixels[..., :3]
    if one.role != "normal":
        pixels = _undone(one, pixels)
    if one.inverted:
        pixels = 1 - pixels
    facts = Facts(image.wraps, _known(one, pixels))
    if (one.height, one.width) != (height, width):
        pixels = _resampled(pixels, height, width)
        if one.role == "normal":
            pixels = unit(pixels)
    return Image(pixels, one.channels, facts)


def _known(one: Map, pixels: Float32[np.ndarray, "h w c"]) -> dict[str, MapFacts]:
    """The facts of a map by its role, with the range of floats that are neither colours nor vectors."""
    if one.role in ("albedo", "mask"):
        return {}
    if one.bits != 32 or one.role in (*COLORS, "normal"):
        return {one.role: one.facts}
    return {one.role: dataclasses.replace(one.facts, range=(float(pixels.min()), float(pixels.max())))}


def has_x_in_alpha(pixels: Float32[np.ndarray, "h w c"]) -> bool:
    """Whether normals have x in alpha and y in green, as DXT5nm; red is then black, white or as green."""
    if pixels.shape[2] != len("RGBA"):
        return False
    red, green, _, alpha = np.moveaxis(pixels, 2, 0)
    if min(float(np.ptp(plane)) for plane in (green, alpha)) <= _FLAT:
        return False
    is_empty = float(red.max()) <= _FLAT or float(red.min()) >= 1 - _FLAT
    return is_empty or float(np.abs(red - green).max()) <= _FLAT


def with_x_in_alpha(one: Map, levels: np.ndarray) -> np.ndarray:
    """Integers of normals, (h, w, 3), as the file of a normal map has them: (h, w, 4) if with x in alpha."""
    try:
        pixels = _decoded(one).pixels
    except (Refusal, OSError):
        return levels
    if not has_x_in_alpha(pixels):
        return levels
    first = np.rint(pixels[0, 0] * (2**one.bits - 1))
    red, blue = (
        np.full_like(levels[..., 1], first[place]) if np.ptp(pixels[..., place]) <= _FLAT else levels[..., 1]
        for place in (0, 2)
    )
    return np.dstack([red, levels[..., 1], blue, levels[..., 0]])


def unread(one: Map, used: Collection[str]) -> dict[str, float | str]:
    """Channels of a map's file that are not ``used`` and hold nothing: their value, or the one they repeat."""
    found: dict[str, float | str] = {}
    try:
        planes = dict(zip(one.file_channels, np.moveaxis(_decoded(one).pixels, 2, 0), strict=True))
    except (Refusal, OSError):
        return found
    for name in set(planes) - set(used):
        plane = planes[name]
        if np.ptp(plane) <= _FLAT:
            found[name] = float(plane[0, 0])
        elif alike := [other for other in used if np.abs(planes[other] - plane).max() <= _FLAT]:
            found[name] = alike[0]
    return found


def stored_vectors(one: Map, pixels: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "h w 3"]:
    """Vectors as the file of a normal map has them; floats with negative values are vectors already.

    Where x is in alpha, z is -1, to be rebuilt.
    """
    colors = _undone(one, pixels[..., :3])
    if has_x_in_alpha(pixels):
        colors = np.dstack([pixels[..., 3], pixels[..., 1], np.zeros_like(pixels[..., 0])])
    return colors.copy() if one.bits == 32 and colors.min() < 0 else colors * 2 - 1


def _undone(one: Map, pixels: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "h w c"]:
    """Values of a file, alpha last, without the curve that they went through."""
    if not one.curve:
        return pixels
    colors = pixels[..., :3]
    if colors.min() < 0 or colors.max() > 1:
        raise Refusal(f"has values outside 0..1, of which no curve can be undone; leave out 'curve: {one.curve}'")
    undone = np.asarray(CURVES[one.curve][1](colors), np.float32)
    return np.concatenate([undone, pixels[..., 3:]], axis=2)


def with_curve(image: Image, one: Map) -> Image:
    """The image with the curve of a map's file on that map, so that it is written as the file has it."""
    if not one.curve:
        return image
    places = [place for place, name in enumerate(image.channels) if name in one.channels and name != "A"]
    pixels = image.pixels.copy()
    values = pixels[..., places]
    signs = np.array([1, -1, 1] if one.role == "normal" and one.directx else [1] * len(places), np.float32)
    values = (values * signs + 1) / 2 if one.role == "normal" else 1 - values if one.inverted else values
    values = np.asarray(CURVES[one.curve][0](np.clip(values, 0, 1)), np.float32)
    values = (values * 2 - 1) * signs if one.role == "normal" else 1 - values if one.inverted else values
    pixels[..., places] = values
    return image.with_pixels(pixels)


def holds_vectors(one: Map) -> bool:
    """Whether the file of a normal map in floats holds vectors, not 0..1 as integers do; so where it is gone."""
    try:
        return bool(_decoded(one).pixels[..., :3].min() < 0)
    except (Refusal, OSError):
        return True


def _vectors(one: Map, pixels: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "h w 3"]:
    """Vectors of a normal map, with a third channel and green up."""
    vectors, _ = rebuilt(stored_vectors(one, pixels))
    if one.directx:
        vectors[..., 1] *= -1
    return vectors


def _grey(pixels: Float32[np.ndarray, "h w c"], role: str) -> Float32[np.ndarray, "h w 1"]:
    """One value a pixel: the median of three that hardly differ."""
    if pixels.shape[2] == 1:
        return pixels
    ordered = np.sort(pixels, axis=2)
    if (ordered[..., 2] - ordered[..., 0]).max() > GREY:
        raise Refusal(
            f"is in colour, but {role} has one value a pixel; save it in grey, or where it holds several maps, "
            f"name them in a YAML file of maps, as '{role}: {{file: NAME, channel: R}}'"
        )
    return np.ascontiguousarray(ordered[..., 1:2])


def _resampled(pixels: Float32[np.ndarray, "h w c"], height: int, width: int) -> Float32[np.ndarray, "h w c"]:
    import cv2

    smaller = height < pixels.shape[0]
    resized = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
    return np.asarray(resized, np.float32).reshape(height, width, pixels.shape[2])
