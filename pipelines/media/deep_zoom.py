"""Deep Zoom pyramids: pictures of any size as tiles, which OpenSeadragon and other viewers load as they are viewed.

``NAME.dzi`` tells size and tiles; ``NAME_files/LEVEL/COLUMN_ROW.png`` are the tiles. Each level has half the size
of the next one, rounded up; the first is one pixel, the last the picture.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from texloom.pipelines.store.atomic import write_atomically
from texloom.pipelines.store.png_file import png
from texloom.stages.vocabulary.color import srgb_codes
from texloom.stages.vocabulary.scratch import empty, release

TILE = 512  # px

Read = Callable[[slice, slice], np.ndarray]
"""linear colour inside rows and columns, float32, (h, w, 3) or (h, w, 1)"""

_DOCUMENT = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Image xmlns="http://schemas.microsoft.com/deepzoom/2008" Format="png" Overlap="0" TileSize="{tile}">'
    '<Size Height="{height}" Width="{width}"/></Image>\n'
)


def write_deep_zoom(path: str | os.PathLike[str], height: int, width: int, read: Read) -> dict[str, str]:
    """Write a pyramid of a picture of which one window after the other is read.

    Reduced levels are means of 2 x 2 pixels in linear light.

    Parameters
    ----------
    path : ends in ``.dzi``.
    height, width : of the picture, px.
    read : called once for each tile of 512 x 512 px, from left to right and from top to bottom. An endless texture
        is made so, window by window.

    Returns
    -------
    name to SHA-256: an empty name for the document, paths relative to its folder for the tiles.
    """
    path = Path(path)
    room = f"{path.stem}_files"
    document = _DOCUMENT.format(tile=TILE, height=height, width=width).encode()
    written = {"": hashlib.sha256(document).hexdigest()}
    for level in range(math.ceil(math.log2(max(height, width, 1))), -1, -1):
        folder = path.parent / room / str(level)
        folder.mkdir(parents=True, exist_ok=True)
        half: np.ndarray | None = None
        for row, top in enumerate(range(0, height, TILE)):
            for column, left in enumerate(range(0, width, TILE)):
                pixels = read(slice(top, min(top + TILE, height)), slice(left, min(left + TILE, width)))
                if half is None:
                    half = empty((-(-height // 2), -(-width // 2), pixels.shape[2]), np.float32)
                small = _halved(pixels)
                half[top // 2 : top // 2 + len(small), left // 2 : left // 2 + small.shape[1]] = small
                levels = srgb_codes(pixels)
                content = png(levels)
                write_atomically(folder / f"{column}_{row}.png", content, durable=False)
                written[f"{room}/{level}/{column}_{row}.png"] = hashlib.sha256(content).hexdigest()
            assert half is not None
            release(half)
        assert half is not None
        height, width, read = half.shape[0], half.shape[1], _reader(half)
    write_atomically(path, document)
    return written


def _halved(pixels: np.ndarray) -> np.ndarray:
    """Means of 2 x 2 pixels; the last row and column are repeated where their number is odd."""
    even = np.pad(pixels, ((0, len(pixels) % 2), (0, pixels.shape[1] % 2), (0, 0)), mode="edge")
    means = even.reshape(len(even) // 2, 2, even.shape[1] // 2, 2, -1).mean(axis=(1, 3))
    return np.asarray(means, np.float32)


def _reader(pixels: np.ndarray) -> Read:
    return lambda rows, columns: pixels[rows, columns]
