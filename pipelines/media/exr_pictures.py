"""EXR files as pictures: the part that holds the colour or the map, or all parts as a frame stack."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Float32

from texloom.pipelines.media import color_spaces, exr_channels
from texloom.pipelines.media.headers import OpenedPicture, Refusal, check_size
from texloom.pipelines.store import codec, exr
from texloom.stages.vocabulary.frame_stacks import stack_channels

_VALUES = 2**30  # of all channels of an EXR
_CHANNELS = 64
MAX_FRAMES = 128
"""frames of a stack"""


def _exr_parts(file: BinaryIO) -> tuple[list[Any], int]:
    """The headers of all parts, which can be read, and the number of values in all of them."""
    headers = exr.read_headers(file)
    values = 0
    for header in headers:
        if not exr.is_flat(header):
            raise Refusal("has deep pixels, which are not read")
        height, width = exr.data_size(header)
        check_size(height, width)
        if len(header["channels"]) > _CHANNELS:
            raise Refusal(f"has {len(header['channels'])} channels, at most {_CHANNELS}")
        if any((channel.xSampling, channel.ySampling) != (1, 1) for channel in header["channels"]):
            raise Refusal("has subsampled channels, which are not read")
        values += height * width * len(header["channels"])
    if values > _VALUES:
        raise Refusal(f"is too large: {values} values in all channels, at most {_VALUES}")
    return headers, values


def header_of(file: BinaryIO, data: bool) -> OpenedPicture:
    """The colour, or the map if it is ``data``, of the first part that has one; `Refusal` if none has."""
    headers, values = _exr_parts(file)
    index, names, note = _exr_channels([_channel_names(header) for header in headers], data)
    height, width = exr.data_size(headers[index])
    matrix = None if data else _exr_matrix(headers, index)

    def decode() -> Float32[np.ndarray, "h w c"]:
        return _exr_pixels(exr.read_parts(file, len(headers))[index], (height, width), names, matrix)

    memory = 4 * (values + height * width * len(names))  # OpenEXR reads all parts
    part = headers[index].get("name", "")
    facts = codec.facts_in(headers[0], part, height, width)
    bits = codec.original_bits(headers[0])
    texel_size = codec.texel_size_in(headers[0], part, height, width)
    known = facts, note, bits, texel_size, codec.names_of_maps(headers[0])
    return OpenedPicture(height, width, tuple(names.values()), 32, memory, decode, *known)


def stack_header_of(file: BinaryIO) -> OpenedPicture:
    """The colour and alpha of all parts as a frame stack."""
    headers, values = _exr_parts(file)
    if len(headers) > MAX_FRAMES:
        raise Refusal(f"has {len(headers)} parts, at most {MAX_FRAMES}")
    height, width = exr.data_size(headers[0])
    names: list[dict[str, str]] = []
    for number, header in enumerate(headers, 1):
        known = _exr_channels([_channel_names(header)])[1]
        names.append({own: name for own, name in known.items() if name in ("R", "G", "B", "Y", "A")})
        if exr.data_size(header) != (height, width) or {*names[-1].values()} != {*names[0].values()}:
            raise Refusal(f"all parts must have the size and channels of the first, but part {number} has not")
    matrices = [_exr_matrix(headers, index) for index in range(len(headers))]

    def decode() -> Float32[np.ndarray, "h w c"]:
        parts = zip(exr.read_parts(file, len(headers)), names, matrices, strict=True)
        return np.concatenate([_exr_pixels(part, (height, width), *more) for part, *more in parts], axis=2)

    channels = stack_channels(tuple(names[0].values()), len(headers))
    memory = 4 * (values + height * width * len(channels))
    return OpenedPicture(height, width, channels, 32, memory, decode)


def _exr_channels(parts: list[list[str]], data: bool = False) -> tuple[int, dict[str, str], str]:
    try:
        return exr_channels.chosen(parts, data)
    except ValueError as error:
        raise Refusal(str(error)) from None


def _channel_names(header: Any) -> list[str]:
    return [channel.name for channel in header["channels"]]


def _exr_matrix(headers: list[Any], index: int) -> Any:
    """What converts the colour of a part to Rec.709; none where it is that."""
    try:
        return color_spaces.of_exr({**headers[0], **headers[index]})
    except ValueError as error:
        raise Refusal(str(error)) from None


def _exr_pixels(part: Any, size: tuple[int, int], names: Mapping[str, str], matrix: Any) -> np.ndarray:
    """The channels of a part, converted by ``matrix`` if they are colour."""
    planes = part.channels
    pixels = np.empty((*size, len(names)), np.float32)
    for place, name in enumerate(names):
        pixels[..., place] = planes.pop(name).pixels
    if matrix is not None and next(iter(names.values())) == "R":
        pixels[..., :3] = color_spaces.converted(pixels[..., :3], matrix)
    return pixels
