"""Boundary zones of patches: which places of an exemplar continue what is there already."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int64

_MOST = 1 << 14  # places in an index; of larger exemplars it has every second or third down and across
_SAMPLE = 192  # patches that the components are found from
_BLOCK = 2048  # patches laid out at a time


def zone_mask(sides: tuple[int, int], zone: int, before: tuple[bool, bool], after: tuple[bool, bool]) -> np.ndarray:
    """True in the boundary zones of a patch.

    Parameters
    ----------
    sides : of the patch, px.
    zone : width of a boundary zone, px.
    before, after : whether there is a zone at the (top, left) and at the (bottom, right).
    """
    mask = np.zeros(sides, bool)
    for axis, (first, last) in enumerate(zip(before, after, strict=True)):
        lines = mask.swapaxes(0, axis)
        lines[:zone] |= first
        lines[sides[axis] - zone :] |= last
    return mask


def square_means(planes: Float32[np.ndarray, "h w c"], side: int) -> Float32[np.ndarray, "H W c"]:
    """Means of all whole squares of ``side`` px, by their top-left pixel."""
    height, width = planes.shape[0] - side + 1, planes.shape[1] - side + 1
    down = sum((planes[i : i + height] for i in range(1, side)), planes[:height])
    both = sum((down[:, i : i + width] for i in range(1, side)), down[:, :width])
    return np.asarray(both / np.float32(side * side), np.float32)


@dataclass(frozen=True)
class Boundaries:
    """All places of an exemplar, by what a patch has in its boundary zones there.

    Zones are described by means of small squares, these by their principal components, and they are kept in a k-d
    tree; distances that a choice rests on are taken from whole zones.
    """

    features: Float32[np.ndarray, "h w c"]
    mask: Bool[np.ndarray, "p q"]
    """the zones within a patch"""
    square: int
    """side of the squares, px"""
    corners: Int64[np.ndarray, "squares 2"]
    """of the squares, within a patch"""
    places: Int64[np.ndarray, "n 2"]
    """top-left pixels of the patches in the index"""
    stride: int
    """px between places"""
    mean: Float32[np.ndarray, "values"]
    basis: Float32[np.ndarray, "values components"]
    tree: Any
    """k-d tree of the components, in the order of ``places``"""

    @classmethod
    def of(
        cls,
        features: Float32[np.ndarray, "h w c"],
        free: Bool[np.ndarray, "H W"],
        mask: Bool[np.ndarray, "p q"],
        zone: int,
        variance: float,
    ) -> "Boundaries":
        """Index an exemplar for patches with zones ``mask``, ``zone`` px wide, at ``variance`` of what varies.

        Patches are those whose top-left pixel is ``free``; some is.
        """
        from scipy.spatial import cKDTree

        stride = max(1, int(np.ceil(np.sqrt(free.size / _MOST))))
        some = np.argwhere(free[::stride, ::stride]) * stride
        places = some if len(some) else np.argwhere(free)[:_MOST]
        square = max(1, zone // 3)
        grid = np.stack(np.meshgrid(*(np.arange(0, n - square + 1, square) for n in mask.shape), indexing="ij"), -1)
        corners = np.array([at for at in grid.reshape(-1, 2) if mask[at[0] :, at[1] :][:square, :square].all()])

        means = square_means(features, square)
        pixels = means.reshape(-1, means.shape[2])

        def laid_out(some: np.ndarray) -> np.ndarray:
            at = some @ [means.shape[1], 1]
            squares = pixels.take(at[:, None] + corners @ [means.shape[1], 1], axis=0)
            return np.asarray(squares.reshape(len(some), -1))

        mean, basis = _components(laid_out(places[:: max(1, -(-len(places) // _SAMPLE))]), variance)
        blocks = [places[first : first + _BLOCK] for first in range(0, len(places), _BLOCK)]
        vectors = np.concatenate([(laid_out(block) - mean) @ basis for block in blocks])
        tree = cKDTree(vectors, balanced_tree=False)
        return cls(features, mask, square, corners, places, stride, mean, basis, tree)

    def nearest(self, window: Float32[np.ndarray, "p q c"], count: int, slack: float) -> Int64[np.ndarray, "k 2"]:
        """The places whose zones are most like those of ``window``, nearest first.

        Parameters
        ----------
        count : places wanted; fewer if there are not as many.
        slack : a place may be farther by this share than one that is missed instead.
        """
        means = square_means(window, self.square)
        vector = (means[self.corners[:, 0], self.corners[:, 1]].ravel() - self.mean) @ self.basis
        _, found = self.tree.query(vector, k=min(count, len(self.places)), eps=slack)
        return self.places[np.atleast_1d(found)]

    def distances(
        self, window: Float32[np.ndarray, "p q c"], places: Int64[np.ndarray, "k 2"]
    ) -> Float32[np.ndarray, "k"]:  # type: ignore[name-defined]
        """Root of the mean squared difference in the zones, for each of ``places``."""
        inside = np.argwhere(self.mask)
        width = self.features.shape[1]
        pixels = self.features.reshape(-1, self.features.shape[2])
        source = (places @ [width, 1])[:, None] + inside @ [width, 1]
        difference = (pixels.take(source, axis=0) - window[self.mask]).reshape(len(places), -1)
        return np.sqrt(np.einsum("kv,kv->k", difference, difference) / np.float32(len(inside)))


def _components(sample: Float32[np.ndarray, "n values"], share: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean of a sample and the principal directions that hold ``share`` of its variance, as columns."""
    mean = sample.mean(axis=0, dtype=np.float64)
    centred = sample - mean
    wide = sample.shape[1] > len(sample)
    variance, vectors = np.linalg.eigh(centred @ centred.T if wide else centred.T @ centred)
    variance, vectors = np.maximum(variance[::-1], 0), vectors[:, ::-1]
    kept = int(np.searchsorted(np.cumsum(variance), share * variance.sum())) + 1
    basis = centred.T @ vectors[:, :kept] if wide else vectors[:, :kept]
    basis /= np.maximum(np.linalg.norm(basis, axis=0), 1e-12)
    return mean.astype(np.float32), basis.astype(np.float32)
