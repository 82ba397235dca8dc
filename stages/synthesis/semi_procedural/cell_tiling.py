"""Cells of a lattice in Python: what the shaders compute, the reference that they are tested with."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float32, Int64

from texloom.stages.common.grids.wang import hashed
from texloom.stages.synthesis.endless.mip_levels import in_bands, pyramid_of, texels
from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.normals import NORMAL

GROUPS = 4
"""of cells where there are enough: by odd and even rows and columns, so that neighbours are never the same cell"""

_SHIFT, _CHOICE = 0, 1  # layers of the hash

Covering = tuple[Float32[np.ndarray, "H W"], Float32[np.ndarray, "H W"], Float32[np.ndarray, "H W"]]
"""weight of a cell at each place, and row and column of the sheet that it shows there, px"""


@dataclasses.dataclass(frozen=True)
class CellTiling:
    """Cells of a texture and how they are laid, see `texloom.stages.synthesis.semi_procedural.cell_texture`.

    References
    ----------
    [Guehl2020]_: a point process, here the lattice, with a window function around each point.
    """

    pyramid: list[Float32[np.ndarray, "_ _ n"]]
    """levels of detail of all channels of the sheet of cells"""
    channels: tuple[str, ...]
    window: ScalarMap
    layout: Mapping[str, Any]

    @staticmethod
    def of(image: Image, window: ScalarMap, layout: Mapping[str, Any]) -> CellTiling:
        """From the outputs of the stage."""
        return CellTiling(pyramid_of(image.pixels), image.channels, window, layout)

    def pixels(
        self, rows: Float32[np.ndarray, "H W"], columns: Float32[np.ndarray, "H W"], level: float = 0.0
    ) -> Float32[np.ndarray, "H W n"]:
        """All channels at places of the plane, px of the exemplar, at a level of detail."""
        return in_bands(partial(self._part, level), rows, columns)

    def _part(self, level: float, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        sums = np.zeros((*rows.shape, len(self.channels)), np.float32)
        total = np.zeros(rows.shape, np.float32)
        for weight, down, across in self.covering(rows, columns):
            at = np.nonzero(weight)
            found = texels(self.pyramid, down[at][None], across[at][None], level)[0]
            sums[at] += weight[at][:, None] * found
            total += weight
        blended = sums / total[..., None]
        if set(NORMAL) <= set(self.channels):
            own = [self.channels.index(name) for name in NORMAL]
            vectors = blended[..., own]
            lengths = np.sqrt(np.square(vectors).sum(axis=-1, keepdims=True, dtype=np.float32))
            blended[..., own] = vectors / np.maximum(lengths, np.float32(1e-6))
        return np.asarray(blended)

    def covering(self, rows: Float32[np.ndarray, "H W"], columns: Float32[np.ndarray, "H W"]) -> Iterator[Covering]:
        """The cells that may reach each place of the plane."""
        first, second = np.array(self.layout["generators"], np.float32)
        inverse = np.array(self.layout["inverse"], np.float32)  # from places to steps
        low = np.array(self.layout["low"], np.float32)
        unit = np.array(self.layout["along"], np.float32)
        down, across = self.layout["candidates"]
        last_row = np.floor(rows * inverse[0, 0] + columns * inverse[1, 0] - low[0])
        for row in (last_row - np.float32(step) for step in range(down)):
            shift = self.shifts_of(row.astype(np.int64)).astype(np.float32)
            y, x = rows - row * first[0] - shift * unit[0], columns - row * first[1] - shift * unit[1]
            last_column = np.floor(y * inverse[0, 1] + x * inverse[1, 1] - low[1])
            for column in (last_column - np.float32(step) for step in range(across)):
                v, u = y - column * second[0], x - column * second[1]
                place = self.points_of(row.astype(np.int64), column.astype(np.int64)).astype(np.float32)
                yield self._weights(v, u), place[..., 0] + v, place[..., 1] + u

    def shifts_of(self, rows: Int64[np.ndarray, "*cells"]) -> Int64[np.ndarray, "*cells"]:
        """By which rows of cells are displaced along themselves, px."""
        mean, spread, length = self.layout["shift"]
        bits = hashed(rows, np.zeros_like(rows), _SHIFT)
        return np.asarray((rows * mean + ((bits >> 16) * spread >> 16)) % length)

    def points_of(
        self, rows: Int64[np.ndarray, "*cells"], columns: Int64[np.ndarray, "*cells"]
    ) -> Int64[np.ndarray, "*cells 2"]:
        """Row and column of the sheet, px, where the points of the lattice lie in the boxes that cells show."""
        groups, across = self.layout["groups"], self.layout["columns"]
        drawn = (hashed(rows, columns, _CHOICE) >> 16) * (self.layout["cells"] // groups) >> 16
        group = 2 * (rows & 1) + (columns & 1) if groups == GROUPS else np.zeros_like(rows)
        number = groups * drawn + group
        places = np.stack([number // across, number % across], axis=-1)
        return np.asarray(places * np.array(self.layout["box"]) + np.array(self.layout["point"]))

    def _weights(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """The window at offsets from a cell's point, bilinear; 0 beyond it."""
        y, x = (one - np.float32(first) for one, first in zip((rows, columns), self.layout["corner"], strict=True))
        last = np.array(self.window.shape) - 1
        inside = (y > 0) & (x > 0) & (y < last[0]) & (x < last[1])
        y, x = np.where(inside, y, 0).astype(np.float32), np.where(inside, x, 0).astype(np.float32)
        top, left = y.astype(np.int64), x.astype(np.int64)
        t, s = y - top.astype(np.float32), x - left.astype(np.float32)
        table = self.window
        upper = table[top, left] + s * (table[top, left + 1] - table[top, left])
        lower = table[top + 1, left] + s * (table[top + 1, left + 1] - table[top + 1, left])
        return np.asarray(np.where(inside, upper + t * (lower - upper), np.float32(0)))
