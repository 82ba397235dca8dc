"""Colour spaces of PNGs by code points: the chunk cICP (PNG, third edition) with the values of ITU-T H.273."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import BinaryIO

import numpy as np

from texloom.pipelines.media.color_spaces import PRIMARIES, REC709, conversion
from texloom.pipelines.media.icc import Decoding
from texloom.stages.kernels.core.elementary_functions import exp, power
from texloom.stages.vocabulary.color import linear_from_srgb

_P3 = PRIMARIES["lin_p3d65_scene"]
_PRIMARIES: Mapping[int, tuple[float, ...]] = {
    1: PRIMARIES[REC709],
    9: PRIMARIES["lin_rec2020_scene"],
    11: (*_P3[:6], 0.314, 0.351),
    12: _P3,
}
_PQ_WHITE = 203.0  # cd/m2, diffuse white of ITU-R BT.2408
_PQ_PEAK = 10000.0  # cd/m2
_HLG_WHITE = 0.75  # its signal there
_SRGB, _PQ, _HLG = 13, 16, 18
_ASSUMED = {
    _PQ: "cICP says PQ, so 1.0 is taken as diffuse white of 203 cd/m2 (ITU-R BT.2408)",
    _HLG: "cICP says HLG, so 1.0 is taken as the scene's light at signal 0.75, diffuse white of ITU-R BT.2408",
}
_REMEDY = "save the picture as sRGB without that chunk"


def chunk_of(file: BinaryIO) -> bytes | None:
    """The content of a PNG's chunk cICP, which stands before the pixels; None without one. Moves in the file."""
    file.seek(8)
    while len(head := file.read(8)) == 8 and head[4:] not in (b"IDAT", b"IEND"):
        length = int.from_bytes(head[:4], "big")
        if head[4:] == b"cICP":
            return file.read(min(length, 5))
        file.seek(length + 4, 1)
    return None


def decoding_of(chunk: bytes) -> tuple[Decoding | None, str]:
    """The decoding that a chunk asks for, None where that is sRGB; and what was assumed, for the user.

    Raises
    ------
    ValueError
        It is broken, or asks for what is not read; in words.
    """
    if len(chunk) != 4:
        raise ValueError(f"has a broken cICP chunk, not of 4 bytes; {_REMEDY}")
    primaries, transfer, matrix, full_range = chunk
    for name, value, known in (
        ("colour primaries", primaries, tuple(_PRIMARIES)),
        ("transfer function", transfer, tuple(sorted(_TRANSFERS))),
        ("matrix coefficients", matrix, (0,)),
        ("full range flag", full_range, (1,)),
    ):
        if value not in known:
            readable = ", ".join(map(str, known))
            raise ValueError(f"has a cICP chunk with {name} {value}, which is not read ({readable}); {_REMEDY}")
    if (primaries, transfer) == (1, _SRGB):
        return None, ""
    to_rec709 = None if primaries == 1 else conversion(_PRIMARIES[primaries], PRIMARIES[REC709])
    return Decoding((_TRANSFERS[transfer],), to_rec709), _ASSUMED.get(transfer, "")


def _of_bt709(codes: np.ndarray) -> np.ndarray:
    """Light of the scene by BT.709 and, with more digits, BT.2020."""
    alpha, beta = 1.09929682680944, 0.018053968510807
    bright = power((np.maximum(codes, 4.5 * beta) + alpha - 1) / alpha, 1 / 0.45)
    return np.where(codes < 4.5 * beta, codes / 4.5, bright)


def _of_pq(codes: np.ndarray) -> np.ndarray:
    """Light of the display by SMPTE ST 2084 (ITU-R BT.2100), relative to diffuse white."""
    m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128
    root = power(codes, 1 / m2)
    return np.asarray(power(np.maximum(root - c1, 0) / (c2 - c3 * root), 1 / m1) * (_PQ_PEAK / _PQ_WHITE))


def _of_hlg(codes: np.ndarray) -> np.ndarray:
    """Light of the scene by the inverse OETF of ITU-R BT.2100, relative to diffuse white."""
    return np.asarray(_hlg_light(codes) / _hlg_light(np.array([_HLG_WHITE])))


def _hlg_light(codes: np.ndarray) -> np.ndarray:
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    return np.asarray(np.where(codes <= 0.5, codes * codes / 3, (exp((codes - c) / a) + b) / 12))


_TRANSFERS: Mapping[int, Callable[[np.ndarray], np.ndarray]] = {
    **dict.fromkeys((1, 6, 14, 15), _of_bt709),
    4: lambda codes: np.asarray(power(codes, 2.2)),
    5: lambda codes: np.asarray(power(codes, 2.8)),
    8: lambda codes: codes,
    _SRGB: linear_from_srgb,
    _PQ: _of_pq,
    _HLG: _of_hlg,
}
