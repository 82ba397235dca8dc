"""Integers of decoded pictures, and how they become linear light."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Float32

from texloom.pipelines.media import cicp, color_management, icc
from texloom.pipelines.media.cie_lab import Lab
from texloom.pipelines.media.headers import Refusal
from texloom.pipelines.media.icc import Decoding
from texloom.stages.vocabulary.color import linear_from_codes


def decoding_of(
    info: Mapping[str, Any], planes: int, chunk: bytes | None = None
) -> tuple[Decoding | color_management.ColorTransform | None, str]:
    """How a picture that is not sRGB is decoded, and what was assumed; ``chunk``: the content of cICP."""
    profile = info.get("icc_profile")
    try:
        if chunk is not None:
            return cicp.decoding_of(chunk)
        if planes == len("CMYK") or (profile and icc.needs_tables(profile, planes)):
            return color_management.of_tables(profile)
        return (icc.of_profile(profile, planes) if profile else icc.of_png(info)), ""
    except ValueError as error:
        raise Refusal(str(error)) from None


def decoded_by_opencv(file: BinaryIO, channels: tuple[str, ...]) -> np.ndarray:
    """The values of a PNG or TIFF with all their bits, (h, w, c)."""
    import cv2

    file.seek(0)
    log = cv2.utils.logging
    level = log.getLogLevel()
    log.setLogLevel(log.LOG_LEVEL_SILENT)
    try:
        values: np.ndarray | None = cv2.imdecode(np.frombuffer(file.read(), np.uint8), cv2.IMREAD_UNCHANGED)
    finally:
        log.setLogLevel(level)
    if values is None:
        raise ValueError("cannot be decoded")
    if values.ndim == 2:
        return np.repeat(values[..., None], 1 if channels[0] == "Y" else len(channels), axis=2)
    if channels[0] == "Y":  # OpenCV gives grey with alpha as colour
        return values[..., [0, -1]]
    values[..., [0, 2]] = values[..., [2, 0]]  # from B G R
    return values


def floats(
    values: np.ndarray,
    straight_planes: int,
    decoding: Decoding | color_management.ColorTransform | Lab | None = None,
) -> Float32[np.ndarray, "h w c"]:
    """Linear light of sRGB integers of 8 or 16 bits, or of floats, which are linear already.

    The last ``straight_planes`` are not sRGB: they are divided by the highest value of their type. ``decoding``
    replaces sRGB.
    """
    if values.dtype == np.float32:
        return np.ascontiguousarray(values)
    if decoding is None:
        return linear_from_codes(values, straight_planes)
    colors = values.shape[2] - straight_planes
    light = decoding.linear(values[..., :colors])
    if not straight_planes:
        return light
    return np.concatenate([light, linear_from_codes(values[..., colors:], straight_planes)], axis=2)
