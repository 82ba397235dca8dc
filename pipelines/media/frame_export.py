"""The frames of a stack as a folder: a picture each."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.material_export import channels_of, codes_of
from texloom.pipelines.media.material_maps import Map
from texloom.pipelines.store import codec
from texloom.pipelines.store.atomic import write_atomically
from texloom.pipelines.store.png_file import png, with_facts
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.frame_stacks import frames_of


def write_frames(
    image: Image, folder: Path, like: Sequence[Map], provenance: Mapping[str, Any], delivery: Delivery
) -> dict[str, str]:
    """Write every frame into a folder, made if need be.

    They have the names and bits of the files of ``like`` if there is one for each frame: PNG of 8 or 16 bits, EXR
    of floats. Otherwise they are numbered.

    Returns
    -------
    file name to SHA-256 of the file, 64 hexadecimal digits.
    """
    folder.mkdir(parents=True, exist_ok=True)
    frames = frames_of(image)
    stems = [one.stem for one in like] if len(like) == len(frames) else []
    if len(set(stems)) != len(frames):
        digits = len(str(len(frames)))
        stems = [f"frame_{number:0{digits}}" for number in range(1, len(frames) + 1)]
    bits = like[0].bits if like else 8
    written = {}
    for stem, frame in zip(stems, frames, strict=True):
        if bits == 32:
            file = f"{stem}.exr"
            shown, attributes = delivery.encoded(frame), delivery.exr_attributes(is_color=True)
            written[file] = codec.export(shown, Image, folder / file, provenance, attributes)
            continue
        file, grey = f"{stem}.png", frame.channels == ("Y",)
        names = ["Y"] if grey else channels_of("albedo", frame.channels)
        explained = with_facts(provenance, frame.facts, frame.height, frame.width)
        content = png(codes_of(frame, names, "albedo", bits, directx=False), explained)
        write_atomically(folder / file, content)
        written[file] = hashlib.sha256(content).hexdigest()
    return written
