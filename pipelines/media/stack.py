"""Frame stacks: the pictures of a texture at several times as one image, see `stages.vocabulary.frame_stacks`.

The frames are the pictures of a folder or those that match a pattern, in the order of the numbers in their names;
or the parts of an EXR. A single picture is a stack of one frame.
"""

from __future__ import annotations

import glob
import re
from pathlib import Path

import numpy as np

from texloom.pipelines.media import locate
from texloom.pipelines.media.exr_pictures import MAX_FRAMES
from texloom.pipelines.media.headers import Refusal
from texloom.pipelines.media.known_files import Inspected
from texloom.pipelines.media.material_maps import Map
from texloom.pipelines.media.material_set import is_picture, pictures_in
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import Facts, MapFacts
from texloom.stages.vocabulary.frame_stacks import stack_channels
from texloom.stages.vocabulary.sizes import format_size

SCHEME = "stack:"
"""begins the reference of a source that is a frame stack"""
ROLE = "frame"
"""of its files"""
_COPIES = 3  # of all values in memory at a time: the stack, its planes in CIELAB, and the copy that a step takes


def is_stack(reference: str) -> bool:
    """Whether a reference is that of a frame stack."""
    return reference.startswith(SCHEME)


def path_of(reference: str) -> str:
    """The file, folder or pattern of a frame stack; other references are returned as they are."""
    return reference.removeprefix(SCHEME)


def files_of(reference: str) -> list[str]:
    """The files of a frame stack in the order of the numbers in their names; `Refusal` where there is none."""
    name = path_of(reference)
    if not locate.is_path(name):
        return [name]
    path = locate.locate(name)
    if path.is_dir():
        found = pictures_in(path)
    elif path.exists() or not glob.has_magic(name):
        return [name]
    else:
        found = [one for one in map(Path, glob.glob(name)) if is_picture(one) and one.is_file()]  # noqa: PTH207
    if not found:
        raise Refusal("holds no picture; a stack is a folder or a quoted pattern of numbered pictures, or an EXR")
    return [str(one) for one in sorted(found, key=_by_numbers)]


def open_stack(reference: str) -> tuple[Map, ...]:
    """Read the headers of a frame stack's files; nothing is decoded.

    Raises
    ------
    Refusal : there is no picture, there are too many frames, a file cannot be read, sizes or channels differ.
    """
    files = files_of(reference)
    if len(files) > MAX_FRAMES:
        raise Refusal(f"has {len(files)} frames, at most {MAX_FRAMES}")
    frames: list[Map] = []
    for file in files:
        try:
            seen = locate.inspect(file, layered=len(files) == 1)
        except Refusal as error:
            raise Refusal(str(error) if len(files) == 1 else f"{Path(file).name} {error}") from None
        frames.append(_frame(file, seen))
    first = frames[0]
    for one in frames:
        of_one, of_first = " ".join(one.channels), " ".join(first.channels)
        for is_alike, ours, theirs in (
            ((one.height, one.width) == (first.height, first.width), format_size(one), format_size(first)),
            (of_one == of_first, f"{of_one} as channels", of_first),
        ):
            if not is_alike:
                names = Path(one.reference).name, Path(first.reference).name
                raise Refusal(f"all frames must be alike: {names[0]} has {ours}, {names[1]} {theirs}")
    return tuple(frames)


def channels_of(frames: tuple[Map, ...]) -> tuple[str, ...]:
    """The channels of the stack."""
    return frames[0].channels if len(frames) == 1 else stack_channels(frames[0].channels, len(frames))


def memory_of(frames: tuple[Map, ...]) -> int:
    """Bytes that the stack takes at most, decoded and with the planes by which it is compared."""
    planes = 4 * frames[0].height * frames[0].width * len(channels_of(frames))
    return _COPIES * planes + max(one.memory for one in frames)


def read(frames: tuple[Map, ...]) -> Image:
    """Decode the frames; `Refusal` names the file that is broken, or not the one that was opened."""
    parts = []
    for one in frames:
        try:
            parts.append(locate.decode(one.reference, one.digest, layered=len(frames) == 1))
        except Refusal as error:
            raise Refusal(str(error) if len(frames) == 1 else f"{Path(one.reference).name} {error}") from None
    pixels = np.concatenate([part.pixels for part in parts], axis=2)
    return Image(pixels, channels_of(frames), Facts.joined(part.facts for part in parts))


def _frame(file: str, seen: Inspected) -> Map:
    return Map(
        ROLE,
        file,
        Path(file).stem,
        seen.height,
        seen.width,
        seen.channels,
        seen.bits,
        MapFacts(),
        seen.digest,
        seen.memory,
        seen.note,
    )


def _by_numbers(path: Path) -> list[tuple[int, int, str]]:
    parts = re.split(r"(\d+)", path.name)
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts]
