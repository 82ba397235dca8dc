"""Where borders between materials wander off straight lines, alike in all tiles that share one."""

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float32, Int64

from texloom.stages.common.grids.wang import WangSet, hashed

Displacement: TypeAlias = Float32[np.ndarray, "2 H W"]
"""px down and across from each pixel to where its material is looked up"""

_OCTAVES = ((2, 1.0), (5, 0.4))
"""values of the noise along a tile, and how much these count; two of them move both sides of a path alike"""

_CHANGE = 0.25  # of a tile's side: beyond what tiles share the noise of a border becomes that of an interior


@dataclasses.dataclass(frozen=True)
class BorderWaves:
    """Displacements of the materials of a set of tiles.

    On the line between two tiles they are along this line, and depend on the number of the border alone.

    Parameters
    ----------
    size, border : side of a tile, and what it shares on each side of its borders, px.
    most : greatest displacement, px.
    seed : of the noise.
    """

    tiles: WangSet
    size: int
    border: int
    most: float
    seed: int

    @staticmethod
    def of(layout: Mapping[str, Any]) -> "BorderWaves | None":
        """Those that a table tells of, see `texloom.stages.synthesis.tiles.wang_borders`."""
        if "waves" not in layout:
            return None
        tiles, size = WangSet.of(layout), int(layout["size"])
        apart = size if tiles.kind == "corners" else size / 2
        return BorderWaves(tiles, size, int(layout["border"]), float(layout["waves"]) * apart, int(layout["noise"]))

    def atlas(self) -> Displacement:
        """Of the atlas."""
        upper, left = self.tiles.borders
        return np.stack([self._of_atlas(0, left), self._of_atlas(1, upper.T).T])

    def band(self, axis: int, height: int) -> Displacement:
        """Of the closed band, ``height`` px, along a row, axis 0, or along a column, axis 1, see `WangSet.band`."""
        numbers = self.tiles.band[1]
        along = np.concatenate([self._of_border(1 - axis, int(number)) for number in numbers])
        found = np.zeros((2, height, len(along)), np.float32)
        found[1] = along
        return found if axis == 0 else np.ascontiguousarray(found[::-1].swapaxes(1, 2))

    def _of_atlas(self, axis: int, numbers: Int64[np.ndarray, "m n"]) -> Float32[np.ndarray, "H W"]:
        """Displacements along the rows of a grid of tiles whose left borders have these numbers."""
        size, (rows, columns) = self.size, numbers.shape
        known = {number: self._of_border(axis, number) for number in np.unique(numbers).tolist()}
        lines = np.stack(
            [np.concatenate([known[number] for number in column]) for column in numbers.T.tolist()], axis=1
        )
        nearest = (np.arange(columns * size) + size // 2) // size % columns
        inside = np.tile(self._inside(), columns)
        own = self._noise((rows, columns), axis)
        own *= np.tile(self._inside(), rows)[:, None]
        return lines[:, nearest] * (1 - inside) + own * inside

    def _of_border(self, axis: int, number: int) -> Float32[np.ndarray, "side"]:  # type: ignore[name-defined]
        """Displacements along a border."""
        return self._noise((1, 1), 2 + 2 * number + axis)[:, 0] * self._inside()

    def _inside(self) -> Float32[np.ndarray, "side"]:  # type: ignore[name-defined]
        """How far each line of a tile is inside, from 0 at what tiles share to 1."""
        place = np.arange(self.size) + 0.5
        part = (np.minimum(place, self.size - place) - self.border) / (_CHANGE * self.size)
        return np.asarray(_smooth(np.clip(part, 0, 1)), np.float32)

    def _noise(self, tiles: tuple[int, int], layer: int) -> Float32[np.ndarray, "H W"]:
        """Noise of a torus of ``tiles``, px: random values at points of a grid, and smooth steps between them."""
        total = np.zeros([count * self.size for count in tiles])
        for number, (values, weight) in enumerate(_OCTAVES):
            sides = [count * values for count in tiles]
            rows, columns = np.indices(sides)
            grid = hashed(rows, columns, len(_OCTAVES) * (layer + self.seed) + number)
            places = [np.arange(count * self.size) * (values / self.size) for count in tiles]
            (top, left), (down, across) = zip(
                *((np.floor(place).astype(np.int64), _smooth(place % 1)) for place in places), strict=True
            )
            above, below = (
                grid[row][:, left] * (1 - across) + grid[row][:, (left + 1) % sides[1]] * across
                for row in (top, (top + 1) % sides[0])
            )
            total += weight * ((above * (1 - down[:, None]) + below * down[:, None]) / 2**31 - 1)
        return np.asarray(total * (self.most / sum(weight for _, weight in _OCTAVES)), np.float32)


def _smooth(part: np.ndarray) -> np.ndarray:
    return np.asarray(part * part * (3 - 2 * part))
