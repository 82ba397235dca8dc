"""TIFF of kinds that OpenCV does not read, by tifffile: planes apart, signed integers, half and double floats."""

from __future__ import annotations

import contextlib
import importlib.util
import logging
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

_KINDS = {(1, 16): "u2", (2, 8): "i1", (2, 16): "i2", (3, 16): "f2", (3, 32): "f4", (3, 64): "f8"}
_COMPRESSIONS = (1, 8, 32773, 32946)  # none, Deflate, PackBits: those without imagecodecs
_OF_FLOATS = 3  # predictor


def kind_of(formats: set[int], bits: set[int], compression: int, predictor: int) -> tuple[np.dtype, str]:
    """The type of the values that a TIFF's tags say, and what is told of them.

    Raises
    ------
    ValueError
        It is not read; in words.
    """
    name = _KINDS.get((min(formats), min(bits))) if len(formats) == len(bits) == 1 else None
    if name is None:
        raise ValueError(
            "has values of a kind that is not read; TIFF may hold 8 or 16 bits, or floats of 16, 32 or 64"
        )
    is_plain = compression in _COMPRESSIONS and predictor != _OF_FLOATS
    if not is_plain and importlib.util.find_spec("imagecodecs") is None:
        raise ValueError("is compressed in a way that needs imagecodecs; pip install 'texloom[photos]'")
    kind = np.dtype(name)
    if kind.kind != "i":
        return kind, ""
    return kind, f"has signed values, which are divided by {np.iinfo(kind).max} and not taken as sRGB"


class _Kept(logging.Handler):
    """Keeps what is logged."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.told: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep one record."""
        self.told.append(record.getMessage())


@contextlib.contextmanager
def _strict(logger: logging.Logger) -> Iterator[None]:
    """Raise what tifffile only logs, as it leaves out what it cannot read."""
    kept, propagates = _Kept(), logger.propagate
    logger.addHandler(kept)
    logger.propagate = False
    try:
        yield
    finally:
        logger.removeHandler(kept)
        logger.propagate = propagates
    if kept.told:
        raise ValueError(kept.told[0])


def values_of(file: BinaryIO, planes: int) -> np.ndarray:
    """The first page, (h, w, planes): uint16, or float32; signed integers are divided by their highest value."""
    import tifffile

    file.seek(0)
    with _strict(tifffile.logger()), tifffile.TiffFile(file) as opened:
        page = opened.pages[0]
        values = np.asarray(page.asarray(maxworkers=1))
        if planes > 1 and page.planarconfig == tifffile.PLANARCONFIG.SEPARATE:
            values = np.moveaxis(values, 0, 2)
    values = values.reshape(*values.shape[:2], planes)
    if values.dtype.kind == "i":
        return values.astype(np.float32) / np.float32(np.iinfo(values.dtype).max)
    return np.ascontiguousarray(values, np.uint16 if values.dtype.kind == "u" else np.float32)
