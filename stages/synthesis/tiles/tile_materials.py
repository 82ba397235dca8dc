"""Materials at the corners or edges of tiles, as guides for the textures between them."""

import dataclasses

import numpy as np
from jaxtyping import Float32, Int64

from texloom.stages.analysis.control.guide import LABEL_STRENGTH, contrast
from texloom.stages.common.grids.wang import WangSet
from texloom.stages.common.similarity.neighbourhoods import Rectangles, numbers_in
from texloom.stages.synthesis.tiles.border_waves import Displacement
from texloom.stages.vocabulary.arrays import Image

_STRENGTH = 1.0  # of that of labels, which would cut elements in two


@dataclasses.dataclass(frozen=True)
class TileMaterials:
    """Which of several exemplars in one picture is wanted where."""

    exemplar: Float32[np.ndarray, "h w k"]
    """a plane for each exemplar, CIELAB units"""
    strength: np.float32
    """of a plane where its exemplar is"""

    @classmethod
    def of(cls, image: Image, rectangles: Rectangles) -> "TileMaterials":
        """Of the exemplars in ``rectangles`` of a picture."""
        strength = np.float32(_STRENGTH * LABEL_STRENGTH * contrast(image) / np.sqrt(2))
        numbers = numbers_in(rectangles, image.height, image.width)
        return cls(np.eye(len(rectangles) + 1, dtype=np.float32)[numbers][..., 1:] * strength, strength)

    def between(
        self, points: Int64[np.ndarray, "m n"], rows: int, columns: int, displacement: Displacement | None = None
    ) -> Float32[np.ndarray, "H W k"]:
        """The same of a torus, from the materials at equally spaced points of it, the first at its origin.

        With a ``displacement`` each pixel has the material from there.
        """
        places: tuple[np.ndarray, ...] = np.arange(rows)[:, None] + 0.5, np.arange(columns)[None] + 0.5
        if displacement is not None:
            places = tuple(place + away for place, away in zip(places, displacement, strict=True))
        places = tuple(
            place * (count / side) for place, count, side in zip(places, points.shape, (rows, columns), strict=True)
        )
        (top, left), (down, across) = zip(
            *((np.floor(place).astype(np.int64), (place % 1).astype(np.float32)[..., None]) for place in places),
            strict=True,
        )
        materials = np.eye(self.exemplar.shape[2], dtype=np.float32)[points]
        before, after = (
            materials[top % points.shape[0], column] * (1 - down)
            + materials[(top + 1) % points.shape[0], column] * down
            for column in (left % points.shape[1], (left + 1) % points.shape[1])
        )
        at = before * (1 - across) + after * across
        shares = np.square(np.square(at))  # so that little lies between two materials
        return np.asarray(self.strength * shares / shares.sum(axis=2, keepdims=True), np.float32)


def material_points(tiles: WangSet) -> Int64[np.ndarray, "m n"]:
    """Materials at points of the atlas of a set: at corners, or also at the middles of edges and of tiles.

    Where edges have materials, corners have the first one. The middle of a tile has the one of the others that most
    of its edges have, the last of these where several have it equally often, and the first only where all have.
    """
    if tiles.kind == "corners" or tiles.colors == 1:
        return tiles.corners
    upper, left = tiles.borders
    own = tiles.tiles
    counts = np.stack([(own == color).sum(axis=2) for color in range(1, tiles.colors)], axis=2)
    last_most = counts.shape[2] - np.argmax(counts[..., ::-1], axis=2)
    points = np.zeros((2 * upper.shape[0], 2 * upper.shape[1]), np.int64)
    points[::2, 1::2], points[1::2, ::2] = upper, left
    points[1::2, 1::2] = np.where(own.any(axis=2), last_most, 0)
    return points


def band_points(tiles: WangSet) -> Int64[np.ndarray, "m n"]:
    """The same of the closed band along a row that has every border of a set once, see `WangSet.band`."""
    corners, numbers = tiles.band
    if tiles.kind == "corners":
        return corners[None]
    return np.tile(np.stack([corners, numbers], axis=1).reshape(1, -1), (2, 1))


def edges_shown(shown: Int64[np.ndarray, "H W"], tiles: WangSet, size: int) -> Float32[np.ndarray, "2 colors"]:
    """How far edges show their material in their middle, in the tile where each does so least, 0..1.

    Parameters
    ----------
    shown : number of the material at each pixel of the atlas of a set of edges.
    size : side of a tile, px; a quarter of it is looked at, along each side of an edge to a sixteenth.

    Returns
    -------
    of each material, those of the edges across, then those down.

    Examples
    --------
    >>> tiles = WangSet(2, "edges")
    >>> edges_shown(np.zeros((4 * 32, 4 * 32), np.int64), tiles, 32).tolist()
    [[1.0, 0.0], [1.0, 0.0]]
    """
    near, middle = max(1, size // 16), slice(size // 2 - size // 8, size // 2 + size // 8)
    places = np.s_[:near, middle], np.s_[middle, -near:], np.s_[-near:, middle], np.s_[middle, :near]
    least = np.ones((2, tiles.colors), np.float32)
    for row, column in np.ndindex(*tiles.shape):
        own = shown[row * size : (row + 1) * size, column * size : (column + 1) * size]
        for side, at in enumerate(places):
            color = int(tiles.tiles[row, column, side])
            least[side % 2, color] = min(least[side % 2, color], np.float32((own[at] == color).mean()))
    return least
