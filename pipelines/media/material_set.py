"""Map sets: the pictures of one material as one image of many channels.

A folder holds pictures whose names say which maps they are, see `texloom.pipelines.media.map_names`:
``albedo.png``, ``Bricks_1K_Roughness.jpg``, ``moss_nor_gl_2k.png``, ``T_Moss_ORM.png``. A YAML file names the
roles, with paths relative to its own folder:

    albedo: moss/color.png
    roughness: {file: moss/arm.jpg, channel: G}
    metallic: {file: moss/arm.jpg, channel: B, invert: false}
    ao: {file: moss/ao.png, curve: srgb}   # through which its values went, which is undone; or inverse_srgb
    normal: moss/n.png
    height: moss/bump16.tif
    normal_convention: directx   # green points down; else the file name says it, or texloom's header
    height_unit: cm              # of heights in floats: um, mm, cm, m or in
    resample: false              # refuse maps of other sizes than the albedo's, to which they are resampled else

See `texloom.pipelines.media.material_maps` for what is read of them.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from texloom.pipelines.media import locate as picture_files
from texloom.pipelines.media.conventions import COLORS, CONVENTIONS, LAYOUTS, ROLES
from texloom.pipelines.media.formats import SUFFIXES, is_unread, told_of_unread
from texloom.pipelines.media.headers import Refusal
from texloom.pipelines.media.known_files import Inspected
from texloom.pipelines.media.map_names import (
    Claim,
    Named,
    of_other_beginning,
    read_names,
    recognised_plane,
    several_materials,
    shared_words,
    whole_files,
)
from texloom.pipelines.media.material_maps import GREY, Map
from texloom.pipelines.media.material_yaml import HEIGHT_UNIT, of_yaml
from texloom.pipelines.media.name_words import stem_of, words_of
from texloom.pipelines.media.udim import is_tiled, tiles_of
from texloom.stages.vocabulary.facts import Facts
from texloom.stages.vocabulary.masks import USABLE
from texloom.stages.vocabulary.normals import NORMAL
from texloom.stages.vocabulary.sizes import format_size

_IN_COLOR = (*COLORS, "specular")
_YAML = (".yaml", ".yml")
_LISTED = 4  # files in a note


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
    unknown = [path for path in named.unknown if not _holds_maps(path)]
    return paths[0].parent if is_one and (not unknown or shared_words(paths)) else None


def _holds_maps(path: Path) -> bool:
    """Whether a file is an EXR with several maps, as texloom writes it beside their files."""
    if path.suffix.lower() != ".exr":
        return False
    try:
        channels = picture_files.inspect(str(path)).channels
    except (Refusal, OSError):
        return False
    return len({"albedo" if name in "RGBY" else name.partition(".")[0] for name in channels} & {*ROLES}) > 1


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
    return pixels.shape[2] < 3 or bool((colors.max(axis=2) - colors.min(axis=2)).max() <= GREY)


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
    named, settings, notes = _of_folder(path) if path.is_dir() else (*of_yaml(path), [])
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
    if any(one.plane == "A" and one.reference == first.reference for one in opened):  # alpha is a map of its own
        first = opened[0] = dataclasses.replace(first, channels=tuple(one for one in first.channels if one != "A"))
    notes += _told_of_sizes(opened, settings.get("resample"))
    notes += [f"{_file_name(one)}: {one.note}" for one in opened if one.note]
    return tuple(opened), tuple(notes)


def _told_of_sizes(maps: Sequence[Map], resample: bool | None) -> list[str]:
    """Which maps are resampled to the albedo's size; `Refusal` where they cannot be, or ``resample`` is false.

    A mask of another size is likelier that of another picture: it is resampled where ``resample`` is true alone.
    """
    first, told = maps[0], []
    for one in maps:
        if (one.height, one.width) == (first.height, first.width):
            continue
        sizes = f"{_file_name(one)} has {format_size(one)}, {_file_name(first)} {format_size(first)}"
        if abs(one.height * first.width - one.width * first.height) > max(
            first.height, first.width, one.height, one.width
        ):
            raise Refusal(f"{sizes}; they cannot be resampled, as their sides are in other proportions")
        if resample is False:
            raise Refusal(f"{sizes}; bring them to one size, or leave out 'resample: false'")
        if resample is None and one.role == "mask":
            raise Refusal(f"{sizes}; bring them to one size, or list them in a YAML file with 'resample: true'")
        told += (
            [] if resample else [f"{sizes}: {one.role} is resampled; 'resample: false' in a YAML file refuses it"]
        )
    return told


def files_of(reference: str) -> list[Path]:
    """The files whose names make them maps of a folder, or that a YAML file names; no picture is opened.

    Raises
    ------
    Refusal : the YAML file is wrong.
    """
    path = Path(reference)
    if path.is_dir():
        names = read_names(pictures_in(path), lambda _: None)
        of_maps = [
            one
            for one in whole_files(pictures_in(path))
            if one not in {*names.unknown, *names.previews, *names.smaller}
        ]
        return [file for one in of_maps for file in (tiles_of(one).files if is_tiled(str(one)) else (one,))]
    named, _ = of_yaml(path)
    return [picture_files.locate(given.reference) for files in named.values() for given in files]


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
        within = [one.name for one in sorted(folder.iterdir()) if one.is_dir() and holds_maps(one)]
        told = f"; give {folder.name}/{within[0]}, which holds maps" if within else ""
        raise Refusal(f"is a folder without pictures, but has to hold a map set{told}")
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
    whole = [path for path in named.unknown if _holds_maps(path)]
    if unknown := [path.name for path in named.unknown if path not in whole]:
        notes.append(f"{', '.join(unknown)} ignored: the name is that of no map")
    if named.smaller:
        notes.append(_told_of_smaller(named.smaller))
    companions = [path.name for path in (*whole, *named.previews)]
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
    if "albedo" in found:
        first, used = found["albedo"][0].path, {given[0].path for given in found.values()}
        notes += [
            f"{path.name} is taken for the same material as {first.name}, though its name begins otherwise"
            for path in of_other_beginning(first, sorted(used - {first}))
        ]
    green = named.green
    if green and "normal" in found and not found["normal"][0].green:
        names = ", ".join(LAYOUTS[name].title for name in named.layouts)
        return found, {"green": green, "implied": names}, notes
    return found, {}, notes


def _told_of_smaller(files: Sequence[Path]) -> str:
    listed = ", ".join(path.name for path in files[:_LISTED]) + (", ..." if len(files) > _LISTED else "")
    return f"{listed} not read: the same maps are there with more pixels; a YAML file of maps may list these"


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
    written = (
        f"if these are one material, write {path.name}/{path.name}.yaml with its maps, as {{{listed}}}{others}"
    )
    if same_material(list(map(str, pictures))):  # so that a pattern is refused too
        return written
    return f"{written}; if each is a texture of its own, give '{path.name}/*{pictures_in(path)[0].suffix}'"


def _yaml_of(given: Claim) -> str:
    name = given.path.name
    if not (given.plane or given.inverted):
        return name
    channel = f", channel: {given.plane}" if given.plane else ""
    return f"{{file: {name}{channel}, invert: {str(given.inverted).lower()}}}"


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
        curve=given.curve,
        file_channels=seen.channels,
        implied=implied,
    )


def _file_name(one: Map) -> str:
    return Path(one.reference).name
