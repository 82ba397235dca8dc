"""The header of Radiance HDR pictures, whose pixels OpenCV reads."""

from __future__ import annotations

import dataclasses
import re
from typing import BinaryIO

import numpy as np

from texloom.pipelines.media.color_spaces import PRIMARIES, REC709, conversion, same_primaries

_LONGEST = 2**16  # bytes of a header


@dataclasses.dataclass(frozen=True)
class RadianceHeader:
    """What a header says."""

    height: int
    width: int
    matrix: np.ndarray | None
    """from its primaries to Rec.709; None where they are that"""
    exposure: float
    """by which the light was multiplied, 1 where nothing is said"""


def header_of(file: BinaryIO) -> RadianceHeader:
    """Read a header; moves in the file.

    Raises
    ------
    ValueError
        It is broken, or asks for what is not read; in words.
    """
    file.seek(0)
    head, end, rest = file.read(_LONGEST).partition(b"\n\n")
    line = rest.partition(b"\n")[0]
    sides = re.fullmatch(rb"([-+][XY]) (\d{1,9}) ([-+][XY]) (\d{1,9})", line)
    if not end or sides is None:
        raise EOFError
    if (sides[1], sides[3]) != (b"-Y", b"+X"):
        raise ValueError("has rows in an order that is not read; save it with rows from the top, left to right")
    matrix, exposure = None, 1.0
    for key, value in re.findall(r"^([A-Z]+)\s*=\s*(.*)$", head.decode("latin-1"), re.MULTILINE):
        if key == "FORMAT" and value.strip() != "32-bit_rle_rgbe":
            raise ValueError("holds XYZ and not RGB, which is not read; save it as RGB")
        if key == "EXPOSURE":
            exposure *= float(value)
        if key == "PRIMARIES":
            primaries = [float(number) for number in value.split()]
            if len(primaries) != 8:
                raise EOFError
            if not same_primaries(primaries, PRIMARIES[REC709]):
                matrix = conversion(primaries, PRIMARIES[REC709])
    if not (np.isfinite(exposure) and exposure > 0):
        raise ValueError("has an exposure that is no positive number")
    return RadianceHeader(int(sides[2]), int(sides[4]), matrix, exposure)
