"""ICC profiles of integer pictures: those of a matrix and three curves, or of one curve in grey (ICC.1:2022)."""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32

from texloom.pipelines.media.color_spaces import PRIMARIES, REC709, conversion, converted, from_d50, same_primaries
from texloom.stages.vocabulary.color import linear_from_srgb

_SAMPLES = np.linspace(0, 1, 256)
_CURVE = 0.003  # largest difference of linear light from sRGB's that counts as rounding
_MATRIX = 0.004  # of the matrix to Rec.709 from the identity
_GAMMA = 0.02  # of a PNG's gamma from 1 / 2.2, which stands for sRGB
_MAX_TAGS = 200
_PARAMETERS = (1, 3, 4, 5, 7)  # of each type of a parametric curve


@dataclasses.dataclass(frozen=True)
class Decoding:
    """How codes of a picture become linear Rec.709 light, if not as sRGB."""

    curves: tuple[Any, ...]
    """a function from 0..1 to linear light for each channel: one of grey, three of colour"""
    matrix: np.ndarray | None
    """from linear colour of the device to Rec.709"""

    def linear(self, codes: np.ndarray) -> Float32[np.ndarray, "h w c"]:
        """Linear light of the colour's codes, uint8 or uint16, (h, w, 1 or 3)."""
        levels = np.arange(np.iinfo(codes.dtype).max + 1) / np.iinfo(codes.dtype).max
        pixels = np.empty(codes.shape, np.float32)
        for index in range(codes.shape[2]):
            table = self.curves[index % len(self.curves)](levels).astype(np.float32)
            pixels[..., index] = table[codes[..., index]]
        return pixels if self.matrix is None or codes.shape[2] != 3 else converted(pixels, self.matrix)


def of_profile(profile: bytes, planes: int) -> Decoding | None:
    """The decoding of a picture of 1 or 3 ``planes`` with a profile; None where that is sRGB.

    Raises
    ------
    ValueError
        The profile is broken or of a kind that is not read; in words.
    """
    try:
        space, tags = _tags(profile)
        if space == b"GRAY" and planes == 1 and b"kTRC" in tags:
            decoding = Decoding((_curve(tags[b"kTRC"]),), None)
        elif space == b"RGB " and all(
            name in tags for name in (b"rXYZ", b"gXYZ", b"bXYZ", b"rTRC", b"gTRC", b"bTRC")
        ):
            columns = [_xyz(tags[name]) for name in (b"rXYZ", b"gXYZ", b"bXYZ")]
            curves = tuple(_curve(tags[name]) for name in (b"rTRC", b"gTRC", b"bTRC"))
            decoding = Decoding(curves, from_d50(np.stack(columns, axis=1)))
        else:
            kind = space.decode("ascii", "replace").strip()
            raise ValueError(f"has an ICC profile ({kind}) that is no matrix with curves; convert it to sRGB")
    except (struct.error, IndexError, np.linalg.LinAlgError):
        raise ValueError("has a broken ICC profile; convert it to sRGB, or remove the profile") from None
    return None if _is_srgb(decoding) else decoding


def needs_tables(profile: bytes, planes: int) -> bool:
    """Whether a profile has no matrix with curves, or no curve in grey, but tables; False where it is broken."""
    try:
        space, tags = _tags(profile)
    except (struct.error, IndexError):
        return False
    wanted = (b"kTRC",) if planes == 1 else (b"rXYZ", b"gXYZ", b"bXYZ", b"rTRC", b"gTRC", b"bTRC")
    return b"A2B0" in tags and space == (b"GRAY" if planes == 1 else b"RGB ") and not all(n in tags for n in wanted)


def of_png(info: Mapping[str, Any]) -> Decoding | None:
    """The decoding by a PNG's gamma and chromaticities, where it has no profile and does not say sRGB.

    Raises
    ------
    ValueError
        They are not those of a colour space.
    """
    if "srgb" in info:
        return None
    gamma, chromaticities = info.get("gamma"), info.get("chromaticity")
    matrix = None
    if chromaticities is not None:
        white, primaries = chromaticities[:2], chromaticities[2:]
        if not same_primaries((*primaries, *white), PRIMARIES[REC709]):
            matrix = conversion((*primaries, *white), PRIMARIES[REC709])
    if not gamma or abs(gamma - 1 / 2.2) <= _GAMMA:
        return None if matrix is None else Decoding((linear_from_srgb,), matrix)
    return Decoding((lambda codes: codes ** (1 / gamma),), matrix)


def _is_srgb(decoding: Decoding) -> bool:
    curves = [np.abs(curve(_SAMPLES) - linear_from_srgb(_SAMPLES)).max() for curve in decoding.curves]
    matrix = 0.0 if decoding.matrix is None else np.abs(decoding.matrix - np.eye(3)).max()
    return bool(max(curves) <= _CURVE and matrix <= _MATRIX)


def _tags(profile: bytes) -> tuple[bytes, dict[bytes, bytes]]:
    """The colour space of the device, and the content of each tag."""
    if profile[36:40] != b"acsp":
        raise IndexError
    (count,) = struct.unpack_from(">I", profile, 128)
    tags = {}
    for index in range(min(count, _MAX_TAGS)):
        name, offset, size = struct.unpack_from(">4sII", profile, 132 + 12 * index)
        tags[name] = profile[offset : offset + size]
    return profile[16:20], tags


def _xyz(tag: bytes) -> list[float]:
    return [value / 65536 for value in struct.unpack_from(">3i", tag, 8)]


def _curve(tag: bytes) -> Any:
    """A function from 0..1 to 0..1."""
    kind = tag[:4]
    if kind == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        values = struct.unpack_from(f">{count}H", tag, 12) if count * 2 <= len(tag) else ()
        if len(values) != count:
            raise IndexError
        if count < 2:
            gamma = values[0] / 256 if count else 1.0
            return lambda codes: codes**gamma
        table = np.array(values) / 65535
        return lambda codes: np.interp(codes, np.linspace(0, 1, count), table)
    if kind != b"para":
        raise IndexError
    (form,) = struct.unpack_from(">H", tag, 8)
    numbers = [value / 65536 for value in struct.unpack_from(f">{_PARAMETERS[form]}i", tag, 12)]
    g, a, b, c, d, e, f = numbers + [0.0] * (7 - len(numbers))
    if form == 0:
        return lambda codes: codes**g
    if form in (1, 2):  # c is an offset there
        start, offset = (-b / a if a else 0.0), c if form == 2 else 0.0
        return lambda codes: np.where(codes >= start, np.maximum(a * codes + b, 0) ** g, 0) + offset
    return lambda codes: np.where(codes >= d, np.maximum(a * codes + b, 0) ** g + e, c * codes + f)
