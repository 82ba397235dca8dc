"""The flattened picture of PSD files of more than 8 bits and of large documents (PSB), by psd-tools."""

from __future__ import annotations

from typing import Any, BinaryIO

import numpy as np

_MODES = {1: ("Y",), 3: ("R", "G", "B")}
PROFILE = 1039  # the image resource


def header_of(file: BinaryIO) -> Any:
    """The header, with ``height``, ``width``, ``channels``, ``depth``, ``color_mode``. Moves in the file."""
    from psd_tools.psd.header import FileHeader

    file.seek(0)
    return FileHeader.read(file)


def channels_of(header: Any) -> tuple[str, ...]:
    """Names of the channels that are read, in order: grey or colour, and alpha where a channel more is there.

    Raises
    ------
    ValueError
        It is neither grey nor RGB; in words.
    """
    color = _MODES.get(int(header.color_mode))
    if color is None or header.depth not in (8, 16, 32):
        raise ValueError("is neither grey nor RGB of 8, 16 or 32 bits; convert it")
    return (*color, "A") if header.channels == len(color) + 1 else color


def profile_of(file: BinaryIO) -> bytes | None:
    """The ICC profile. Moves behind the header."""
    from psd_tools.psd.color_mode_data import ColorModeData
    from psd_tools.psd.image_resources import ImageResources

    file.seek(26)
    ColorModeData.read(file)
    found = ImageResources.read(file).get(PROFILE)
    return None if found is None else bytes(found.data)


def values_of(file: BinaryIO, header: Any, count: int) -> np.ndarray:
    """The first ``count`` channels, (h, w, count): uint8, uint16 or float32 (linear light). Layers are not read."""
    from psd_tools.psd.image_data import ImageData

    file.seek(26)
    for size in (4, 4, 8 if header.version == 2 else 4):  # colour mode, resources, layers
        file.seek(int.from_bytes(file.read(size)), 1)
    expected = header.height * header.width * header.channels * header.depth // 8
    planes = ImageData.read(file).get_data(header, max_output_bytes=expected)
    kind = {8: ">u1", 16: ">u2", 32: ">f4"}[header.depth]
    shape = header.height, header.width
    arrays = [np.frombuffer(plane, kind).reshape(shape) for plane in planes[:count]]
    return np.stack(arrays, axis=2).astype(arrays[0].dtype.newbyteorder("="))
