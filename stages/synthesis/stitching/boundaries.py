"""Boundary zones of patches, and an index of the places of an exemplar by their boundary zones."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int64

from texloom.stages.kernels.core.loading import loaded
from texloom.stages.numerics.matrices import eigenvectors, matrix_product, row_product, square_sums

_MAX_PLACES = 1 << 14  # in an index; larger exemplars are sampled at every second or third row and column
_SAMPLE = 192  # patches that the components are fitted to
_BLOCK = 2048  # patches whose vectors are computed at a time


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
    """Means over all whole squares of ``side`` px, indexed by their top-left pixel."""
    height, width = planes.shape[0] - side + 1, planes.shape[1] - side + 1
    down = sum((planes[i : i + height] for i in range(1, side)), planes[:height])
    both = sum((down[:, i : i + width] for i in range(1, side)), down[:, :width])
    return np.asarray(both / np.float32(side * side), np.float32)


@dataclass(frozen=True)
class Boundaries:
    """A k-d tree of the places of an exemplar, by the boundary zones of patches there.

    A zone is described by the principal components of its means over small squares. `distances` compares all
    pixels of the zones.
    """

    features: Float32[np.ndarray, "h w c"]
    mask: Bool[np.ndarray, "p q"]
    """the zones within a patch"""
    square: int
    """side of the squares, px"""
    corners: Int64[np.ndarray, "squares 2"]
    """top-left pixels of the squares, within a patch"""
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
        """Index the patches of an exemplar whose top-left pixel is ``free``.

        Parameters
        ----------
        free : true somewhere.
        mask : boundary zones of a patch, ``zone`` px wide.
        variance : share of the zones' variance that the components keep.
        """
        spatial = loaded("scipy.spatial")
        stride = max(1, int(np.ceil(np.sqrt(free.size / _MAX_PLACES))))
        strided = np.argwhere(free[::stride, ::stride]) * stride
        places = strided if len(strided) else np.argwhere(free)[:_MAX_PLACES]
        square = max(1, zone // 3)
        grid = np.stack(np.meshgrid(*(np.arange(0, n - square + 1, square) for n in mask.shape), indexing="ij"), -1)
        corners = np.array([at for at in grid.reshape(-1, 2) if mask[at[0] :, at[1] :][:square, :square].all()])

        means = square_means(features, square)
        pixels = means.reshape(-1, means.shape[2])

        def zone_values(corner: np.ndarray) -> np.ndarray:
            at = matrix_product(corner, [means.shape[1], 1])
            squares = pixels.take(at[:, None] + matrix_product(corners, [means.shape[1], 1]), axis=0)
            return np.asarray(squares.reshape(len(corner), -1))

        mean, basis = _components(zone_values(places[:: max(1, -(-len(places) // _SAMPLE))]), variance)
        blocks = [places[first : first + _BLOCK] for first in range(0, len(places), _BLOCK)]
        vectors = np.concatenate([row_product(zone_values(block) - mean, basis) for block in blocks])
        tree = spatial.cKDTree(vectors, balanced_tree=False)
        return cls(features, mask, square, corners, places, stride, mean, basis, tree)

    def nearest(self, window: Float32[np.ndarray, "p q c"], count: int, slack: float) -> Int64[np.ndarray, "k 2"]:
        """Up to ``count`` places whose zones are nearest to those of ``window``, nearest first.

        ``slack`` is the relative error that the approximate search may make.
        """
        means = square_means(window, self.square)
        vector = matrix_product(means[self.corners[:, 0], self.corners[:, 1]].ravel() - self.mean, self.basis)
        _, numbers = self.tree.query(vector, k=min(count, len(self.places)), eps=slack)
        return self.places[np.atleast_1d(numbers)]

    def distances(
        self, window: Float32[np.ndarray, "p q c"], places: Int64[np.ndarray, "k 2"]
    ) -> Float32[np.ndarray, "k"]:  # type: ignore[name-defined]
        """Root of the mean squared difference in the zones, for each of ``places``."""
        inside = np.argwhere(self.mask)
        width = self.features.shape[1]
        pixels = self.features.reshape(-1, self.features.shape[2])
        source = matrix_product(places, [width, 1])[:, None] + matrix_product(inside, [width, 1])
        difference = (pixels.take(source, axis=0) - window[self.mask]).reshape(len(places), -1)
        return np.sqrt(np.einsum("kv,kv->k", difference, difference) / np.float32(len(inside)))


def _components(sample: Float32[np.ndarray, "n values"], share: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean of a sample and the principal components that hold ``share`` of its variance, as columns."""
    mean = sample.mean(axis=0, dtype=np.float64)
    centred = sample - mean
    wide = sample.shape[1] > len(sample)
    variance, vectors = eigenvectors(square_sums(centred.T if wide else centred))
    variance, vectors = np.maximum(variance[::-1], 0), vectors[:, ::-1]
    kept = int(np.searchsorted(np.cumsum(variance), share * variance.sum())) + 1
    basis = row_product(centred.T, vectors[:, :kept]) if wide else vectors[:, :kept]
    basis /= np.maximum(np.linalg.norm(basis, axis=0), 1e-12)
    return mean.astype(np.float32), basis.astype(np.float32)
