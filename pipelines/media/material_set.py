"""Map sets: the pictures of one material as one image of many channels.

A folder holds pictures whose names say which maps they are, see `texloom.pipelines.media.map_names`:
``albedo.png``, ``Bricks_1K_Roughness.jpg``, ``moss_nor_gl_2k.png``, ``T_Moss_ORM.png``. A YAML file names the
roles, with paths relative to its own folder:

    albedo: moss/color.png
    roughness: {file: moss/arm.jpg, channel: G}
    metallic: {file: moss/arm.jpg, channel: B, invert: false}
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
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float32

from texloom.pipelines.errors import hint, shown
from texloom.pipelines.media import locate as picture_files
from texloom.pipelines.media.conventions import COLORS, CONVENTION_OF, CONVENTIONS, LAYOUTS, ROLES
from texloom.pipelines.media.formats import SUFFIXES, is_unread, told_of_unread
from texloom.pipelines.media.headers import Refusal
from texloom.pipelines.media.known_files import Inspected
from texloom.pipelines.media.map_names import (
    Claim,
    Named,
    read_names,
    recognised_plane,
    several_materials,
    shared_words,
    stem_of,
    whole_files,
    words_of,
)
from texloom.pipelines.media.udim import is_tiled, tiles_of
from texloom.pipelines.yaml import read_document
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import UNITS, Facts, MapFacts
from texloom.stages.vocabulary.masks import HALF, USABLE
from texloom.stages.vocabulary.normals import NORMAL, rebuilt, rounding, unit
from texloom.stages.vocabulary.sizes import format_size

_VERSION = 4  # raised when the same files are read to other values
_IN_COLOR = (*COLORS, "specular")
HEIGHT_UNIT = "height_unit"
"""the key of a YAML file that says the unit of heights"""
_KEYS = ("normal_convention", HEIGHT_UNIT, "resample")
_YAML = (".yaml", ".yml")
_LISTED = 4  # files in a note
_FLAT = 2 / 255  # largest difference in a plane that holds nothing
_GREY = 16 / 255  # largest difference of channels in a grey picture of a lossy format


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


def is_map_set(reference: str) -> bool:
    """Whether a reference is a folder or a YAML file."""
    if not picture_files.is_path(reference) or "\0" in reference:
        return False
    # As text, as this is asked of each item of a set, twice.
    return os.path.splitext(reference)[1].lower() in _YAML or os.path.isdir(reference)  # noqa: PTH112, PTH122


def holds_maps(folder: Path) -> bool:
    """Whether a folder can be a map set: one of its pictures is named as an albedo."""
    return "albedo" in names_in(folder).claims


def holds_one_material(folder: Path) -> bool:
    """Whether a folder's pictures are the maps of one material: several roles, and not several albedos."""
    named = names_in(folder)
    return "albedo" not in named.several and len(named.claims) > 1


def looks_like_one(folder: Path) -> bool:
    """Whether a folder's pictures have words of their names and a size in common, and are not numbered."""
    pictures = pictures_in(folder)
    shared = len(shared_words(pictures))
    if len(pictures) < 2 or not shared or all("".join(words_of(one.stem)[shared:]).isdecimal() for one in pictures):
        return False
    try:
        sizes = {(seen.height, seen.width) for one in pictures if (seen := picture_files.inspect(str(one)))}
    except (Refusal, OSError):
        return False
    return len(sizes) == 1


def same_material(references: Sequence[str]) -> Path | None:
    """The folder of which all files are maps of one material; nothing if they are not."""
    paths = list(map(Path, references))
    if len(paths) < 2 or len({path.parent for path in paths}) > 1 or not all(map(is_picture, paths)):
        return None
    named = read_names(sorted(paths), _is_grey)
    is_one = "albedo" in named.claims and "albedo" not in named.several and len(named.claims) > 1
    return paths[0].parent if is_one and not named.unknown else None


def names_in(folder: Path) -> Named:
    """What the names of a folder's pictures say."""
    return read_names(pictures_in(folder), _is_grey)


def _is_grey(path: Path) -> bool | None:
    try:
        pixels = picture_files.decode(
            str(path), picture_files.inspect(str(path), data=True).digest, data=True
        ).pixels
    except (Refusal, OSError):
        return None
    colors = pixels[..., :3]
    return pixels.shape[2] < 3 or bool((colors.max(axis=2) - colors.min(axis=2)).max() <= _GREY)


def open_set(reference: str) -> tuple[tuple[Map, ...], tuple[str, ...]]:
    """Find the maps of a folder or YAML file and read their headers.

    Returns
    -------
    the maps, the albedo first, whose size is the image's; and notes on files that are not used, and on what was
    assumed of colours.

    Raises
    ------
    Refusal : there is no albedo, a role has several files, names leave doubt, a file cannot be read, sizes differ.
    """
    path = Path(reference)
    named, settings, notes = _of_folder(path) if path.is_dir() else _of_yaml(path)
    if "albedo" not in named:
        listed = f", which are {', '.join(named)}" if named else ""
        raise Refusal(f"has no albedo among its maps{listed}; {_proposal(path, named)}")
    opened = []
    for role in ROLES:
        files = [_opened(role, one, settings) for one in named.get(role, ())]
        lacking = [one for one in files if one.plane and one.plane not in one.file_channels]
        if lacking and not path.is_dir():
            there = ", ".join(lacking[0].file_channels)
            raise Refusal(f"{role}: {_file_name(lacking[0])} has no channel {lacking[0].plane}, but {there}")
        notes += [f"{_file_name(one)} has no channel {one.plane}, which would be {role}" for one in lacking]
        if used := [one for one in files if one not in lacking]:
            opened.append(dataclasses.replace(used[0], twins=tuple(used[1:])))
    first = opened[0]
    for one in opened:
        if (one.height, one.width) == (first.height, first.width):
            continue
        sizes = f"{_file_name(one)} has {format_size(one)}, {_file_name(first)} {format_size(first)}"
        if not settings.get("resample"):
            raise Refusal(f"{sizes}; bring them to one size, or list them in a YAML file with 'resample: true'")
        sides = (first.height, first.width, one.height, one.width)
        if abs(one.height * first.width - one.width * first.height) > max(sides):
            raise Refusal(f"{sizes}; they cannot be resampled, as their sides are in other proportions")
    notes += [f"{_file_name(one)}: {one.note}" for one in opened if one.note]
    return tuple(opened), tuple(notes)


def files_of(reference: str) -> list[Path]:
    """The files whose names make them maps of a folder, or that a YAML file names; no picture is opened.

    Raises
    ------
    Refusal : the YAML file is wrong.
    """
    path = Path(reference)
    if path.is_dir():
        names = read_names(pictures_in(path), lambda _: None)
        of_maps = [one for one in whole_files(pictures_in(path)) if one not in {*names.unknown, *names.previews}]
        return [file for one in of_maps for file in (tiles_of(one).files if is_tiled(str(one)) else (one,))]
    named, _, _ = _of_yaml(path)
    return [picture_files.locate(given.reference) for files in named.values() for given in files]


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
    # A mask may be drawn by hand.
    told = [part.facts for one, part in zip(maps, parts, strict=True) if one.role != "mask"]
    pixels = np.concatenate([part.pixels for part in parts], axis=2)
    return Image(pixels, channels_of(maps), Facts.joined(told))


def normal_codes(one: Map, height: int, width: int) -> tuple[np.ndarray, np.ndarray] | None:
    """The vectors that `read` makes of a normal map, and the file's integers, (h, w, 3), or 4 with x in alpha.

    None where the size is another one, the file holds floats, or is not there any more.
    """
    if (one.height, one.width) != (height, width) or one.bits not in (8, 16) or not one.is_plain:
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
    parts = [[one.role, one.channels, one.facts.record(), one.digest, one.plane, one.inverted] for one in maps]
    return hashlib.sha256(json.dumps([_VERSION, parts]).encode()).hexdigest()


def pictures_in(folder: Path) -> list[Path]:
    """The pictures of a folder by name, without those of its folders and hidden ones, such as ``._a.png``."""
    return sorted(
        path for path in folder.iterdir() if is_picture(path) and path.is_file() and not path.name.startswith(".")
    )


def is_picture(path: Path) -> bool:
    """Whether a file's name is that of a picture."""
    return path.suffix.lower() in SUFFIXES


_Roles: TypeAlias = Mapping[str, Sequence[Claim]]


def _of_folder(folder: Path) -> tuple[_Roles, dict[str, Any], list[str]]:
    """Role to files, of which the first is the one to use; settings, notes."""
    pictures = pictures_in(folder)
    if not pictures:
        raise Refusal("is a folder without pictures; a folder has to hold a map set")
    named = read_names(pictures, _is_grey)
    found = named.claims
    if (named.doubts or named.several) and (listed := told_of_several(folder)):
        raise Refusal(listed)
    if named.doubts:
        doubts = ", ".join(f"{path.name} ({' or '.join(some)})" for path, some in named.doubts.items())
        raise Refusal(f"has names that leave doubt: {doubts}; {_proposal(folder, found)}")
    for role, alike in named.several.items():
        names = " and ".join(path.name for path in alike)
        raise Refusal(f"has several files for {role}: {names}; remove one, or list those that count in YAML")
    notes = []
    if named.unknown:
        notes.append(f"{', '.join(path.name for path in named.unknown)} ignored: the name is that of no map")
    companions = [path.name for path in named.previews]
    others = sorted(path.name for path in folder.iterdir() if not path.is_dir() and path not in pictures)
    if unread := told_of_unread(name for name in others if not name.startswith(".")):
        notes.append(unread)
    companions += [name for name in others if not is_unread(name)]
    if companions:
        listed = ", ".join(companions[:_LISTED]) + (", ..." if len(companions) > _LISTED else "")
        count = "1 file" if len(companions) == 1 else f"{len(companions)} files"
        notes.append(f"{count} beside the maps ignored: {listed}")
    for role, given in found.items():
        for other in given[1:]:
            place = f" in {other.plane}" if other.plane else ""
            held = f"{other.path.name} not read{place}"
            notes.append(f"{held}: {role} is that of {given[0].path.name}")
    for path, planes in named.packed.items():
        notes.append(f"{path.name} read as {', '.join(planes)}")
    green = named.green
    if green and "normal" in found and not found["normal"][0].green:
        names = ", ".join(LAYOUTS[name].title for name in named.layouts)
        return found, {"green": green, "implied": names}, notes
    return found, {}, notes


def told_of_several(folder: Path) -> str:
    """What the user is told of a folder with the maps of several materials; empty where it has not."""
    found = several_materials(pictures_in(folder), _is_grey)
    documents = [
        f"{name}.yaml {{{', '.join(f'{role}: {_yaml_of(claims[0])}' for role, claims in one.claims.items())}}}"
        for name, one in list(found.items())[:_LISTED]
    ]
    return (
        f"holds maps of {len(found)} materials; move those of each into a folder of its own, or write "
        f"{' and '.join(documents)}{' ...' if len(found) > _LISTED else ''}; if each is a texture of its own, give "
        f"'{folder.name}/*{pictures_in(folder)[0].suffix}'"
        if found
        else ""
    )


def _proposal(path: Path, named: _Roles) -> str:
    """What a YAML file would say, for the user to correct."""
    if not path.is_dir():
        return "the YAML file has to name one, as albedo: color.png"
    files = {role: _yaml_of(named[role][0]) for role in ROLES if role in named}
    taken = {some[0].path.name for some in named.values()}
    pictures = whole_files(pictures_in(path))
    for role, one in zip((role for role in ROLES if role not in files), pictures, strict=False):
        if role == "albedo" and one.name not in taken:
            files = {role: one.name, **files}
    left = [one.name for one in pictures if one.name not in {*taken, *map(str, files.values())}]
    listed = ", ".join(f"{role}: {file}" for role, file in files.items())
    others = f", and what {', '.join(left)} are" if left else ""
    return (
        f"if these are one material, write {path.name}/{path.name}.yaml with its maps, as {{{listed}}}{others}; "
        f"if each is a texture of its own, give '{path.name}/*{pictures_in(path)[0].suffix}'"
    )


def _yaml_of(given: Claim) -> str:
    name = given.path.name
    if not (given.plane or given.inverted):
        return name
    channel = f", channel: {given.plane}" if given.plane else ""
    return f"{{file: {name}{channel}, invert: {str(given.inverted).lower()}}}"


def _of_yaml(path: Path) -> tuple[_Roles, dict[str, Any], list[str]]:
    try:
        document = read_document(path)
    except InputError as error:
        raise Refusal(str(error).removeprefix(f"{path}: ")) from None
    if not isinstance(document, dict):
        raise Refusal(f"must map the names of maps to files, got {shown(document)}")
    named: dict[str, list[Claim]] = {}
    settings: dict[str, Any] = {}
    for key, value in document.items():
        if key in _KEYS:
            settings[key] = value
            continue
        plane = recognised_plane(key) if isinstance(key, str) else None
        if plane is None:
            known = [*ROLES, *_KEYS]
            raise Refusal(f"{shown(key)} is no map{hint(str(key), known)}")
        role, inverted, green = plane
        given = _of_entry(key, value, path.parent)
        if role in named:
            raise Refusal(f"{key}: there is a file for {role} already")
        named[role] = [dataclasses.replace(given, inverted=given.inverted != inverted)]
        if green:
            settings.setdefault("normal_convention", CONVENTION_OF[green])
    if "bump" in named and "height" not in named:
        named["height"] = named.pop("bump")
    convention, resample = settings.get("normal_convention"), settings.get("resample", False)
    if convention not in (None, *CONVENTIONS):
        raise Refusal(f"normal_convention: must be opengl or directx, got {shown(convention)}")
    if (unit_of_height := settings.get(HEIGHT_UNIT)) not in (None, *UNITS):
        raise Refusal(f"{HEIGHT_UNIT}: must be one of {', '.join(UNITS)}, got {shown(unit_of_height)}")
    if not isinstance(resample, bool):
        raise Refusal(f"resample: must be true or false, got {shown(resample)}")
    return named, settings, []


def _of_entry(key: str, value: Any, folder: Path) -> Claim:
    """A file, or ``{file: x.png, channel: G, invert: true}``, of a YAML file in ``folder``."""
    entry = value if isinstance(value, dict) and "file" in value else {"file": value}
    if other := next((one for one in entry if one not in ("file", "channel", "invert")), None):
        raise Refusal(f"{key}: {shown(other)} unknown; there are file, channel and invert")
    file, channel, invert = entry.get("file"), entry.get("channel", ""), entry.get("invert", False)
    if not isinstance(file, str) or not file:
        raise Refusal(f"{key}: must be a file, got {shown(value)}")
    if not isinstance(channel, str):
        raise Refusal(f"{key}.channel: must be the name of a channel, such as R, got {shown(channel)}")
    if not isinstance(invert, bool):
        raise Refusal(f"{key}.invert: must be true or false, got {shown(invert)}")
    return Claim(str(folder / file) if picture_files.is_path(file) else file, channel, invert)


def _inspected(reference: str, role: str) -> Inspected:
    name = Path(reference).name
    try:
        return picture_files.inspect(reference, role not in COLORS)
    except Refusal as error:
        raise Refusal(f"{name}: {error}") from None
    except FileNotFoundError:
        raise Refusal(f"{name}: no such file") from None


def _opened(role: str, given: Claim, settings: Mapping[str, Any]) -> Map:
    reference, path = given.reference, given.path
    seen = _inspected(reference, role)
    color = seen.channels[:3] == ("R", "G", "B")
    if not given.plane and len(seen.channels) > 1 and not color and seen.channels[0] != "Y":
        entry = f"{role}: {{file: {path.name}, channel: {seen.channels[0]}}}"
        raise Refusal(
            f"{path.name}: has no colour, but {', '.join(seen.channels)}; name one in a YAML file, as {entry}"
        )
    if role == "normal" and not color:
        raise Refusal(f"{path.name}: is grey, but a normal map has three channels")
    channels: tuple[str, ...] = (role,)
    if given.plane and role in ("albedo", "normal"):
        raise Refusal(f"{path.name}: {role} cannot be one channel of a file")
    if role == "albedo":
        channels = tuple(name for name in seen.channels if name in ("R", "G", "B", "Y", "A"))
    elif role == "normal":
        channels = NORMAL
    elif role == "mask":
        channels = (USABLE,)
    elif role in _IN_COLOR and color and not given.plane:
        channels = (f"{role}.R", f"{role}.G", f"{role}.B")
    stem = stem_of(path) if picture_files.is_path(reference) else role
    facts = Facts.of(seen.facts).of_map(role)
    note, implied = seen.note, None
    if role == "normal":
        said = recognised_plane(stem)
        green = given.green or (said[2] if said and said[0] == "normal" else "")
        if (convention := settings.get("normal_convention")) is not None:
            green = CONVENTIONS[convention]
        if not (green or facts.green):
            green, implied = settings.get("green", ""), settings.get("implied", "")
        facts = dataclasses.replace(facts, green=green or facts.green)
    if role == "height" and (height_unit := settings.get(HEIGHT_UNIT)) is not None:
        facts = dataclasses.replace(facts, unit=height_unit)
    size = seen.height, seen.width
    return Map(
        *(role, reference, stem, *size, channels, seen.bits, facts, seen.digest, seen.memory, note),
        plane=given.plane,
        inverted=given.inverted,
        file_channels=seen.channels,
        implied=implied,
    )


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
        pixels = _grey(pixels[..., : 1 if image.channels[0] == "Y" else 3])
        if one.bits != 32 and one.facts.range is not None:  # heights that texloom has normalised
            pixels = one.facts.range[0] + np.float32(one.facts.range[1] - one.facts.range[0]) * pixels
    else:
        pixels = pixels[..., :3]
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


def stored_vectors(one: Map, pixels: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "h w 3"]:
    """Vectors as the file of a normal map has them; floats with negative values are vectors already.

    Where x is in alpha, z is -1, to be rebuilt.
    """
    colors = pixels[..., :3]
    if has_x_in_alpha(pixels):
        colors = np.dstack([pixels[..., 3], pixels[..., 1], np.zeros_like(pixels[..., 0])])
    return colors.copy() if one.bits == 32 and colors.min() < 0 else colors * 2 - 1


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
