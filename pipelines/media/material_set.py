"""Map sets: the pictures of one material as one image of many channels.

A folder holds one picture a map, whose name ends in its role: ``albedo.png``, ``Bricks_1K_Roughness.jpg``,
``moss_nor_gl_2k.png``. A YAML file names the roles, with paths relative to its own folder:

    albedo: moss/color.png
    normal: moss/n.png
    height: moss/bump16.tif
    normal_convention: directx   # green points down; else the file name says it, or texloom's header
    height_unit: cm              # of heights in floats: um, mm, cm, m or in
    resample: true               # to the albedo's size; otherwise all maps must have the same size

Albedo and emission are colours; the others are data, integers divided by the highest value of their type. Normals
are unpacked to vectors, x right, y up, z towards the viewer, and normalised unless their length is 1 within the
rounding of their bits, so that they are written to a file unchanged. Maps of one value may be stored in colour if
that is grey. A mask is black where the exemplar is excluded.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

from texloom.pipelines.errors import hint, shown
from texloom.pipelines.media import locate as picture_files
from texloom.pipelines.media.decode import Refusal
from texloom.pipelines.media.formats import SUFFIXES
from texloom.pipelines.yaml import read_document
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import GREENS, UNITS, Facts, MapFacts
from texloom.stages.vocabulary.masks import HALF, USABLE
from texloom.stages.vocabulary.normals import NORMAL, rebuilt, rounding, unit
from texloom.stages.vocabulary.sizes import format_size

_VERSION = 3  # raised when the same files are read to other values
ROLES: Mapping[str, tuple[str, ...]] = {
    "albedo": ("albedo", "basecolor", "basecolour", "diffuse", "diff", "color", "colour", "col"),
    "normal": ("normal", "normals", "nor", "nrm", "norm"),
    "roughness": ("roughness", "rough"),
    "metallic": ("metallic", "metalness", "metal"),
    "ao": ("ao", "ambientocclusion", "occlusion"),
    "height": ("height", "displacement", "disp", "bump"),
    "specular": ("specular", "spec"),
    "opacity": ("opacity",),
    "emissive": ("emissive", "emission"),
    "mask": ("mask", "usable"),
}
"""role to the words that name it at the end of a file's name, without separators"""
COLORS = ("albedo", "emissive")
"""roles of maps in sRGB"""
_IN_COLOR = (*COLORS, "specular")
_CONVENTIONS = {"gl": "opengl", "opengl": "opengl", "ogl": "opengl", "dx": "directx", "directx": "directx"}
_GREENS = dict(zip(("opengl", "directx"), GREENS, strict=True))
_PREFERENCE = ("opengl", None, "directx")
HEIGHT_UNIT = "height_unit"
"""the key of a YAML file that says the unit of heights"""
_KEYS = ("normal_convention", HEIGHT_UNIT, "resample")
_NOT_A_ROLE = re.compile(r"\d+k?|map|maps|tex|texture|png|jpg|jpeg|tif|tiff|exr")
_YAML = (".yaml", ".yml")
_GREY = 16 / 255  # largest difference of channels in a grey picture of a lossy format


@dataclasses.dataclass(frozen=True)
class Map:
    """One file of a map set."""

    role: str
    """one of `ROLES`, or ``frame`` of a frame stack's files"""
    reference: str
    stem: str
    """the file's name without its suffix"""
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

    @property
    def directx(self) -> bool:
        """Whether green points down in a normal map; up, where nobody says so."""
        return self.facts.green == "down"


def is_map_set(reference: str) -> bool:
    """Whether a reference is a folder or a YAML file."""
    if not picture_files.is_path(reference) or "\0" in reference:
        return False
    # As text, as this is asked of each item of a set, twice.
    return os.path.splitext(reference)[1].lower() in _YAML or os.path.isdir(reference)  # noqa: PTH112, PTH122


def holds_maps(folder: Path) -> bool:
    """Whether a folder can be a map set: one of its pictures is named as an albedo."""
    roles = (recognised(path.stem) for path in pictures_in(folder))
    return any(role is not None and role[0] == "albedo" for role in roles)


def holds_one_material(folder: Path) -> bool:
    """Whether a folder's pictures are the maps of one material: several roles, and not several albedos."""
    roles = [role[0] for path in pictures_in(folder) if (role := recognised(path.stem)) is not None]
    return roles.count("albedo") < 2 and len(set(roles)) > 1


def recognised(name: str) -> tuple[str, str | None] | None:
    """The role in a name, and the convention of a normal map if it is there; None without a role."""
    parted = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name)
    words = [word.lower() for word in re.split(r"[^A-Za-z0-9]+", parted) if word]
    while words and _NOT_A_ROLE.fullmatch(words[-1]):
        words.pop()
    convention = _CONVENTIONS.get(words[-1]) if words else None
    if convention:
        words.pop()
    elif words:
        # As in normalgl, without a separator.
        last = re.fullmatch(r"(normal|nor|nrm)_?(opengl|ogl|gl|directx|dx)", words[-1])
        if last:
            words[-1], convention = last[1], _CONVENTIONS[last[2]]
    while words and words[-1] in ("map", "maps"):
        words.pop()
    for count in (2, 1):
        word = "".join(words[-count:]) if len(words) >= count else ""
        role = next((role for role, known in ROLES.items() if word in known), None)
        if role is not None:
            return (role, convention) if role == "normal" or convention is None else None
    return None


def open_set(reference: str) -> tuple[tuple[Map, ...], tuple[str, ...]]:
    """Find the maps of a folder or YAML file and read their headers.

    Returns
    -------
    the maps, the albedo first, whose size is the image's; and notes on files that are not used, and on what was
    assumed of colours.

    Raises
    ------
    Refusal : there is no albedo, a role has several files, a file cannot be read, sizes differ.
    """
    path = Path(reference)
    named, settings, notes = _of_folder(path) if path.is_dir() else _of_yaml(path)
    if "albedo" not in named:
        listed = f", which are {', '.join(named)}" if named else ""
        raise Refusal(
            f"has no albedo among its maps{listed}; its name has to end in one of {', '.join(ROLES['albedo'])}"
        )
    maps = tuple(_opened(role, named[role], settings) for role in ROLES if role in named)
    first = maps[0]
    for one in maps:
        if (one.height, one.width) == (first.height, first.width):
            continue
        sizes = f"{_file_name(one)} has {format_size(one)}, {_file_name(first)} {format_size(first)}"
        if not settings.get("resample"):
            raise Refusal(f"{sizes}; bring them to one size, or list them in a YAML file with 'resample: true'")
        sides = (first.height, first.width, one.height, one.width)
        if abs(one.height * first.width - one.width * first.height) > max(sides):
            raise Refusal(f"{sizes}; they cannot be resampled, as their sides are in other proportions")
    notes += [f"{_file_name(one)}: {one.note}" for one in maps if one.note]
    return maps, tuple(notes)


def files_of(reference: str) -> list[Path]:
    """The files whose names make them maps of a folder, or that a YAML file names; no picture is opened.

    Raises
    ------
    Refusal : the YAML file is wrong.
    """
    path = Path(reference)
    if path.is_dir():
        return [picture for picture in pictures_in(path) if recognised(picture.stem) is not None]
    named, _, _ = _of_yaml(path)
    return [picture_files.locate(picture) for picture in named.values()]


def read(maps: tuple[Map, ...], height: int, width: int) -> Image:
    """Decode the maps; `Refusal` names the file that is broken, or not the one that was opened."""
    parts: list[Image] = []
    for one in maps:
        try:
            parts.append(_planes(one, height, width))
        except Refusal as error:
            raise Refusal(f"{_file_name(one)} {error}") from None
        except FileNotFoundError:
            raise Refusal(f"{_file_name(one)}: no such file") from None
        if one.role == "mask" and parts[-1].pixels.max() < HALF:
            raise Refusal(f"{_file_name(one)} is black: it excludes every pixel")
    told = [
        part.facts for one, part in zip(maps, parts, strict=True) if one.role != "mask"
    ]  # it may be drawn by hand
    pixels = np.concatenate([part.pixels for part in parts], axis=2)
    return Image(pixels, channels_of(maps), Facts.joined(told))


def normal_codes(one: Map, height: int, width: int) -> tuple[np.ndarray, np.ndarray] | None:
    """The vectors that `read` makes of a normal map, and the file's integers, (h, w, 3).

    None where the size is another one, the file holds floats, or is not there any more.
    """
    if (one.height, one.width) != (height, width) or one.bits not in (8, 16):
        return None
    try:
        pixels = picture_files.decode(one.reference, one.digest, one.role not in COLORS).pixels[..., :3]
    except (Refusal, OSError):
        return None
    codes = np.rint(pixels.astype(np.float64) * (2**one.bits - 1))
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
    parts = [[one.role, one.channels, one.facts.record(), one.digest] for one in maps]
    return hashlib.sha256(json.dumps([_VERSION, parts]).encode()).hexdigest()


def pictures_in(folder: Path) -> list[Path]:
    """The pictures of a folder by name; those of its folders are not among them."""
    return sorted(path for path in folder.iterdir() if is_picture(path) and path.is_file())


def is_picture(path: Path) -> bool:
    """Whether a file's name is that of a picture."""
    return path.suffix.lower() in SUFFIXES


def _of_folder(folder: Path) -> tuple[dict[str, str], dict[str, Any], list[str]]:
    """Role to file, settings, notes; of normals in both conventions, those of OpenGL."""
    by_role: dict[str, list[tuple[Path, str | None]]] = {}
    unknown = []
    pictures = pictures_in(folder)
    if not pictures:
        raise Refusal("is a folder without pictures; a folder has to hold a map set")
    for path in pictures:
        recognition = recognised(path.stem)
        if recognition is None:
            unknown.append(path.name)
        else:
            by_role.setdefault(recognition[0], []).append((path, recognition[1]))
    for role, files in by_role.items():
        if role == "normal" and len({convention for _, convention in files}) == len(files):
            files.sort(key=lambda file: _PREFERENCE.index(file[1]))
        elif len(files) > 1:
            names = " and ".join(path.name for path, _ in files)
            raise Refusal(f"has several files for {role}: {names}; remove one, or list those that count in YAML")
    notes = [f"{', '.join(unknown)} ignored: the name is that of no map"] if unknown else []
    return {role: str(files[0][0]) for role, files in by_role.items()}, {}, notes


def _of_yaml(path: Path) -> tuple[dict[str, str], dict[str, Any], list[str]]:
    try:
        document = read_document(path)
    except InputError as error:
        raise Refusal(str(error).removeprefix(f"{path}: ")) from None
    if not isinstance(document, dict):
        raise Refusal(f"must map the names of maps to files, got {shown(document)}")
    named: dict[str, str] = {}
    settings: dict[str, Any] = {}
    for key, value in document.items():
        if key in _KEYS:
            settings[key] = value
            continue
        role = recognised(key) if isinstance(key, str) else None
        if role is None:
            known = [*ROLES, *_KEYS]
            raise Refusal(f"{shown(key)} is no map{hint(str(key), known)}")
        if not isinstance(value, str) or not value:
            raise Refusal(f"{key}: must be a file, got {shown(value)}")
        if role[0] in named:
            raise Refusal(f"{key}: there is a file for {role[0]} already")
        named[role[0]] = str(path.parent / value) if picture_files.is_path(value) else value
        if role[1] is not None:
            settings.setdefault("normal_convention", role[1])
    convention, resample = settings.get("normal_convention"), settings.get("resample", False)
    if convention not in (None, "opengl", "directx"):
        raise Refusal(f"normal_convention: must be opengl or directx, got {shown(convention)}")
    if (unit_of_height := settings.get(HEIGHT_UNIT)) not in (None, *UNITS):
        raise Refusal(f"{HEIGHT_UNIT}: must be one of {', '.join(UNITS)}, got {shown(unit_of_height)}")
    if not isinstance(resample, bool):
        raise Refusal(f"resample: must be true or false, got {shown(resample)}")
    return named, settings, []


def _opened(role: str, reference: str, settings: Mapping[str, Any]) -> Map:
    path = Path(reference)
    try:
        seen = picture_files.inspect(reference, role not in COLORS)
    except Refusal as error:
        raise Refusal(f"{path.name}: {error}") from None
    except FileNotFoundError:
        raise Refusal(f"{path.name}: no such file") from None
    color = seen.channels[0] == "R"
    if role == "normal" and not color:
        raise Refusal(f"{path.name}: is grey, but a normal map has three channels")
    channels: tuple[str, ...] = (role,)
    if role == "albedo":
        channels = tuple(name for name in seen.channels if name in ("R", "G", "B", "Y", "A"))
    elif role == "normal":
        channels = NORMAL
    elif role == "mask":
        channels = (USABLE,)
    elif role in _IN_COLOR and color:
        channels = (f"{role}.R", f"{role}.G", f"{role}.B")
    stem = path.stem if picture_files.is_path(reference) else role
    named = recognised(stem)
    convention = settings.get("normal_convention") or (named[1] if named and named[0] == "normal" else None)
    facts = Facts.of(seen.facts).of_map(role)
    if role == "normal" and convention is not None:
        facts = dataclasses.replace(facts, green=_GREENS[convention])
    if role == "height" and (height_unit := settings.get(HEIGHT_UNIT)) is not None:
        facts = dataclasses.replace(facts, unit=height_unit)
    size = seen.height, seen.width
    return Map(role, reference, stem, *size, channels, seen.bits, facts, seen.digest, seen.memory, seen.note)


def _planes(one: Map, height: int, width: int) -> Image:
    """The channels of a map, resampled to the image's size."""
    image = picture_files.decode(one.reference, one.digest, one.role not in COLORS)
    pixels = image.pixels
    if one.role == "albedo":
        pixels = pixels[..., [image.channels.index(name) for name in one.channels]]
    elif one.role == "normal":
        pixels = unit(_vectors(one, pixels), rounding(min(one.bits, 16)))
    elif len(one.channels) == 1:
        pixels = _grey(pixels[..., : 1 if image.channels[0] == "Y" else 3])
        if one.bits != 32 and one.facts.range is not None:  # heights that texloom has normalised
            pixels = one.facts.range[0] + np.float32(one.facts.range[1] - one.facts.range[0]) * pixels
    else:
        pixels = pixels[..., :3]
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


def _vectors(one: Map, pixels: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "h w 3"]:
    """Vectors of a normal map; floats with negative values are vectors already."""
    colors = pixels[..., :3]
    vectors = colors.copy() if one.bits == 32 and colors.min() < 0 else colors * 2 - 1
    vectors, _ = rebuilt(vectors)
    if one.directx:
        vectors[..., 1] *= -1
    return vectors


def _grey(pixels: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "h w 1"]:
    """One value a pixel: the median of three that hardly differ."""
    if pixels.shape[2] == 1:
        return pixels
    ordered = np.sort(pixels, axis=2)
    if (ordered[..., 2] - ordered[..., 0]).max() > _GREY:
        raise Refusal("is in colour, but such a map has one value a pixel; save it in grey")
    return np.ascontiguousarray(ordered[..., 1:2])


def _resampled(pixels: Float32[np.ndarray, "h w c"], height: int, width: int) -> Float32[np.ndarray, "h w c"]:
    import cv2

    smaller = height < pixels.shape[0]
    resized = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
    return np.asarray(resized, np.float32).reshape(height, width, pixels.shape[2])


def _file_name(one: Map) -> str:
    return Path(one.reference).name
