"""Wang tiles: which border meets which, where a tile lies in the atlas, and which tile covers a cell."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Int64

from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.vocabulary.declare import InputError

Kind: TypeAlias = Literal["edges", "corners"]
Cells: TypeAlias = Int64[np.ndarray, "*cells"]

HASH_FACTORS = (0x8DA6B343, 0xD8163841, 0xCB1AB31F, 0x7FEB352D, 0x846CA68B)
"""of row, column and layer, and of the two rounds that mix their sum"""

SIDES = ("north", "east", "south", "west")
CORNERS = ("northwest", "northeast", "southeast", "southwest")

_SEQUENCES = {
    1: (0,),
    2: (0, 0, 1, 1),
    3: (0, 0, 1, 0, 2, 1, 1, 2, 2),
}  # every ordered pair follows once, around the end too
_CORNERS_OF_TWO = ((0, 1, 0, 0), (0, 1, 1, 1), (1, 1, 1, 0), (0, 0, 1, 0))


@dataclasses.dataclass(frozen=True)
class WangSet:
    """A complete set of tiles in an atlas that is a legal tiling of the torus and has every tile equally often.

    Parameters
    ----------
    colors : 1 to 3, of the borders in each direction, or of the corners; with 1 any tile fits any other.
    variants : rows and columns in which the set is repeated in the atlas, by tiles with other interiors.

    References
    ----------
    [Cohen2003]_ for edges; [Lagae2006]_ for corners; [Wei2004]_ for the arrangement of edges in the atlas, that of
    corners is a de Bruijn torus.
    """

    colors: int
    kind: Kind
    variants: tuple[int, int] = (1, 1)

    def __post_init__(self) -> None:
        if self.colors not in _SEQUENCES or self.kind not in ("edges", "corners"):
            raise InputError(f"Wang tiles have edges or corners of 1 to 3 colours, not {self.colors} {self.kind}")

    @staticmethod
    def of(layout: Mapping[str, Any]) -> "WangSet":
        """The set that a table tells of, see `texloom.stages.synthesis.tiles.wang_tiles`."""
        rows, columns = layout.get("variants", (1, 1))
        return WangSet(layout["colors"], layout["kind"], (rows, columns))

    @property
    def sequence(self) -> Int64[np.ndarray, "n"]:  # type: ignore[name-defined]
        """Colours in which every ordered pair follows once, the last being followed by the first."""
        return np.array(_SEQUENCES[self.colors])

    @property
    def side(self) -> int:
        """Tiles along a side of the complete set."""
        return self.colors**2

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of tiles in the atlas."""
        rows, columns = self.variants
        return self.side * rows, self.side * columns

    @property
    def corners(self) -> Int64[np.ndarray, "m n"]:
        """Colour of the upper left corner of each tile of the atlas; all 0 where edges are coloured."""
        if self.kind == "edges":
            return np.zeros(self.shape, np.int64)
        if self.colors == 2:
            return np.tile(np.array(_CORNERS_OF_TWO), self.variants)
        # Each column is the sequence, displaced against the next one by another number of places.
        first = np.cumsum(np.arange(self.side)) - np.arange(self.side)
        return np.tile(self.sequence[(np.arange(self.side)[:, None] + first) % self.side], self.variants)

    @property
    def borders(self) -> Int64[np.ndarray, "2 m n"]:
        """Number of the upper, and of the left border of each tile of the atlas."""
        if self.kind == "edges":
            rows, columns = np.meshgrid(self.sequence, self.sequence, indexing="ij")
            return np.tile(np.stack([rows, columns]), (1, *self.variants))
        corners = self.corners
        return np.stack([corners * self.colors + np.roll(corners, -1, axis=axis) for axis in (1, 0)])

    @property
    def band(self) -> tuple[Int64[np.ndarray, "n"], Int64[np.ndarray, "n"]]:  # type: ignore[name-defined]
        """Colours of the corners along a closed band that has every border once, and the border after each."""
        if self.kind == "edges":
            return np.zeros(self.colors, np.int64), np.arange(self.colors)
        return self.sequence, self.sequence * self.colors + np.roll(self.sequence, -1)

    @property
    def tiles(self) -> Int64[np.ndarray, "m n 4"]:
        """Borders of each tile of the atlas: north, east, south, west."""
        upper, left = self.borders
        return np.stack([upper, np.roll(left, -1, axis=1), np.roll(upper, -1, axis=0), left], axis=2)

    @property
    def tile_corners(self) -> Int64[np.ndarray, "m n 4"]:
        """Colours of the corners of each tile of the atlas: northwest, northeast, southeast, southwest."""
        corners = self.corners
        below = np.roll(corners, -1, axis=0)
        return np.stack([corners, np.roll(corners, -1, axis=1), np.roll(below, -1, axis=1), below], axis=2)

    @property
    def places(self) -> Int64[np.ndarray, "tiles 2"]:
        """Row and column in the atlas of each tile, by the number that `number` gives its colours, and variant."""
        numbers = self.number(self.tiles if self.kind == "edges" else self.tile_corners)
        order = np.argsort(numbers, axis=None, kind="stable")
        return np.stack(np.unravel_index(order, numbers.shape), axis=1)

    def number(self, colors: Int64[np.ndarray, "*cells 4"]) -> Cells:
        """Number of a tile from its four colours, the digits of a number."""
        return np.asarray(matrix_product(colors, self.colors ** np.arange(3, -1, -1)))

    @property
    def digits(self) -> tuple[tuple[int, int, int], ...]:
        """Where each of a tile's four colours comes from: rows down, columns across, and the layer of the hash."""
        if self.kind == "edges":
            return (0, 0, 0), (0, 1, 1), (1, 0, 0), (0, 0, 1)
        return (0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0)

    def covering(self, rows: Cells, columns: Cells, seed: int) -> Int64[np.ndarray, "*cells 2"]:
        """Row and column in the atlas of the tile that covers each cell of the plane."""
        colors = [
            hashed(rows + down, columns + across, layer + 2 * seed) % self.colors
            for down, across, layer in self.digits
        ]
        count = math.prod(self.variants)
        variant = hashed(rows, columns, -1 - seed) % count
        return np.asarray(self.places[self.number(np.stack(colors, axis=-1)) * count + variant])


def laid(atlas: np.ndarray, places: np.ndarray, size: int) -> np.ndarray:
    """The tiles at ``places``, rows and columns of an atlas with tiles of ``size`` px, side by side."""
    pixels = tiles_of(atlas, size)[places[..., 0], places[..., 1]]
    return np.asarray(np.moveaxis(pixels, 2, 1).reshape(len(places) * size, -1, *atlas.shape[2:]))


def tiles_of(atlas: np.ndarray, size: int) -> np.ndarray:
    """A view of an atlas with tiles of ``size`` px: by their row and column, then their own rows and columns."""
    rows, columns = (side // size for side in atlas.shape[:2])
    return np.asarray(atlas.reshape(rows, size, columns, size, *atlas.shape[2:]).swapaxes(1, 2))


def hashed(rows: Cells, columns: Cells, layer: int) -> Cells:
    """32 random bits of each cell; negative rows and columns are allowed."""
    down, across, deep, first, second = HASH_FACTORS
    bits = (rows * down + columns * across + layer * deep) & 0xFFFFFFFF
    bits ^= bits >> 16
    bits = bits * first & 0xFFFFFFFF
    bits ^= bits >> 15
    bits = bits * second & 0xFFFFFFFF
    return np.asarray(bits ^ bits >> 16)
