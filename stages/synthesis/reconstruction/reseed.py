"""New sources for pixels that show another texture than their control asks for."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64

from texloom.stages.kernels.core.elementary_functions import log2
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.synthesis.control_maps.correlation import median_cells

_BLOCK = 8  # px; pixels of a block get one piece of the exemplar
_TRIES = 16  # pieces tried for a block
_ALIKE = 0.25  # squared difference within which a piece is accepted, and by which it must be better
_AROUND = 4  # of 3x3 pixels that must be wrong, since control is noisy
_CELL_PIXELS = 32  # of the exemplar in a cell of similar control, about so many at least
_HALVINGS = 8  # of control into cells, at most
_MIN_VARIANCE = 1.0  # of the texture in two cells together, squared CIELAB units


@dataclass(frozen=True)
class _ControlCells:
    """What texture an exemplar has at similar values of control."""

    cell: Int64[np.ndarray, "h w"]
    """of each pixel of the exemplar"""
    control: Float64[np.ndarray, "cells k"]
    """mean of each cell"""
    texture: Float64[np.ndarray, "cells c"]
    """mean of each cell"""
    variance: Float64[np.ndarray, " cells"]
    """of the texture, all channels together"""

    @classmethod
    def of(cls, texture: Float32[np.ndarray, "h w c"], own: Float32[np.ndarray, "h w k"]) -> "_ControlCells":
        """Those of an exemplar with its control."""
        values, colors = (planes.reshape(-1, planes.shape[2]).astype(np.float64) for planes in (own, texture))
        halvings = min(_HALVINGS, max(0, int(log2(len(values) / _CELL_PIXELS))))
        cell = np.unique(median_cells(own.reshape(values.shape), halvings), return_inverse=True)[1]
        counts = np.bincount(cell)

        def means(planes: np.ndarray) -> np.ndarray:
            return np.stack([np.bincount(cell, plane) for plane in planes.T], axis=1) / counts[:, None]

        mean = means(colors)
        variance = means(np.square(colors - mean[cell])).sum(axis=1)
        return cls(cell.reshape(own.shape[:2]), means(values), mean, variance)

    def nearest(self, wanted: Float32[np.ndarray, "H W k"]) -> Int64[np.ndarray, "H W"]:
        """The cells whose control is most similar."""
        spatial = loaded("scipy.spatial")
        return np.asarray(spatial.KDTree(self.control).query(wanted)[1])

    def difference(self, one: Int64[np.ndarray, "..."], other: Int64[np.ndarray, "..."]) -> np.ndarray:
        """Squared difference of the texture of two cells, relative to its variance in both."""
        squares = np.square(self.texture[one] - self.texture[other]).sum(axis=-1)
        return np.asarray(squares / np.maximum(self.variance[one] + self.variance[other], _MIN_VARIANCE))

    def drawn(self, cells: Int64[np.ndarray, "n"], random: np.random.Generator) -> Int64[np.ndarray, "n tries"]:  # type: ignore[name-defined]
        """Random pixels of the exemplar in each of ``cells``, by their numbers."""
        counts = np.bincount(self.cell.ravel())
        first = np.cumsum(counts) - counts
        pixels = np.argsort(self.cell, axis=None, kind="stable")
        numbers = (random.random((len(cells), _TRIES)) * counts[cells][:, None]).astype(np.int64)
        return np.asarray(pixels[first[cells][:, None] + numbers])


def reseeded(
    source: Int32[np.ndarray, "H W 2"],
    texture: Float32[np.ndarray, "h w c"],
    own: Float32[np.ndarray, "h w k"],
    wanted: Float32[np.ndarray, "H W k"],
    random: np.random.Generator,
) -> Int32[np.ndarray, "H W 2"]:
    """Sources with those replaced, piece by piece, that show another texture than the wanted control asks for.

    A line under control, as a river, is lost where it is thinner than a pixel of a coarse scale, or where no piece
    of the exemplar has its direction; single pixels of it are too unlike their neighbours to be chosen later. The
    texture at a value of control is its mean there, in units of its deviation: so a line counts whatever its share
    of the texture, and noise of control where it says little does not.

    Parameters
    ----------
    source : where the result's pixels come from in the exemplar.
    texture, own : the exemplar and its control.
    wanted : control of the result.
    """
    if not own.shape[2]:
        return source
    cells = _ControlCells.of(texture, own)
    asked = cells.nearest(wanted)
    before = cells.difference(cells.cell[source[..., 0], source[..., 1]], asked)
    rows, columns = np.nonzero(_not_alone(before > 1))
    if not len(rows):
        return source
    (height, width), before = own.shape[:2], before[rows, columns]
    block = rows // _BLOCK * wanted.shape[1] + columns // _BLOCK
    order = np.lexsort((-before, block))
    rows, columns, before = rows[order], columns[order], before[order]
    _, worst, block = np.unique(block[order], return_index=True, return_inverse=True)
    drawn = cells.drawn(asked[rows[worst], columns[worst]], random)
    # each piece shows at the worst pixel of its block the place that was drawn
    down, across = rows - rows[worst][block], columns - columns[worst][block]
    r, c = drawn[block] // width + down[:, None], drawn[block] % width + across[:, None]
    outside = (r < 0) | (r >= height) | (c < 0) | (c >= width)
    r, c = np.clip(r, 0, height - 1), np.clip(c, 0, width - 1)
    differences = cells.difference(cells.cell[r, c], asked[rows, columns][:, None])
    differences[outside] = np.inf
    sums = np.zeros((len(worst), _TRIES))
    np.add.at(sums, block, np.minimum(differences, 4))
    # the first that will do: the best would repeat
    is_alike = sums < _ALIKE * np.bincount(block)[:, None]
    tried = np.where(is_alike.any(axis=1), is_alike.argmax(axis=1), sums.argmin(axis=1))[block]
    every = np.arange(len(rows))
    better = differences[every, tried] < _ALIKE * before
    new = source.copy()
    new[rows[better], columns[better]] = np.stack([r[every, tried], c[every, tried]], axis=1)[better]
    return new


def _not_alone(marked: Bool[np.ndarray, "H W"]) -> Bool[np.ndarray, "H W"]:
    """The marked pixels that enough others around them are marked too."""
    ndimage = loaded("scipy.ndimage")
    return np.asarray(marked & (9 * ndimage.uniform_filter(marked.astype(np.float32), 3) > _AROUND - 0.5))
