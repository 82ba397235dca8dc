"""Measures of small patches: sliced Wasserstein distance and nearest neighbours."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int64

from stages.evaluation._pictures import Picture
from stages.evaluation._pixels import blurred, quantiles

SIDE = 7
"""samples along a patch's side"""

_PATCHES = 8192  # of the sliced distance; their sampling noise is a fifth of the distance between two crops
_PROJECTIONS = 64
_COMPONENTS = 16
_MOST = 1 << 18  # patches that are indexed
_CHUNK = 1024
_SMALL = 1 << 18  # multiplications that OpenBLAS leaves on one thread


def product(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """``rows @ matrix`` for many rows, in pieces too small for BLAS to spread: (n, k) and (k, m) float32 to (n, m).

    The threads of OpenBLAS wait for each other actively: where the cores are shared, with other programs or with
    the measures that run side by side, a product takes ten times as long.
    """
    piece = max(1, _SMALL // matrix.size)
    whole = len(rows) // piece * piece
    found = np.empty((len(rows), matrix.shape[1]), np.float32)
    pieces = rows[:whole].reshape(-1, piece, rows.shape[1])
    np.matmul(pieces, matrix, out=found[:whole].reshape(-1, piece, matrix.shape[1]))
    np.matmul(rows[whole:], matrix, out=found[whole:])
    return found


def _windows(lab: np.ndarray, step: int) -> np.ndarray:
    """View of all patches, samples ``step`` px apart: (rows, columns, channel, SIDE, SIDE)."""
    reach = (SIDE - 1) * step + 1
    view = np.lib.stride_tricks.sliding_window_view(lab, (reach, reach), axis=(0, 1))
    return np.asarray(view[..., ::step, ::step])


def _sample(lab: np.ndarray, count: int) -> np.ndarray:
    """``count`` random patches as rows."""
    rng = np.random.default_rng(0)
    windows = _windows(lab, 1)
    rows, columns = rng.integers(0, windows.shape[0], count), rng.integers(0, windows.shape[1], count)
    return windows[rows, columns].reshape(count, -1)


def sliced_wasserstein(one: Picture, other: Picture, levels: int = 4) -> list[float]:
    """Sliced Wasserstein distance of the 7x7 patches of two pictures at full, half, quarter ... size.

    Each is the mean over random projections of the distance between the projections' distributions, CIELAB units.
    Levels at which a side is shorter than two patches are left out.

    References
    ----------
    [Elnekave2022]_ section 3.
    """
    import cv2

    directions = np.random.default_rng(1).standard_normal((SIDE * SIDE * 3, _PROJECTIONS)).astype(np.float32)
    directions /= np.linalg.norm(directions, axis=0)
    pair = [one.lab, other.lab]
    distances = []
    for _ in range(levels):
        if min(*pair[0].shape[:2], *pair[1].shape[:2]) < 2 * SIDE:
            break
        first, second = (quantiles(product(_sample(lab, _PATCHES), directions)) for lab in pair)
        distances.append(float(np.abs(first - second).mean()))
        pair = [cv2.pyrDown(lab) for lab in pair]
    return distances


class PatchIndex(NamedTuple):
    """Patches of a picture at one scale, by their leading principal components."""

    lab: Float32[np.ndarray, "h w 3"]
    """smoothed for the scale"""
    rows: Int64[np.ndarray, "p"]
    """of the upper left samples"""
    components: Float32[np.ndarray, "p q d"]
    """of the patch whose upper left sample is pixel (rows[p], q)"""
    step: int
    """pixels between samples"""

    def halves(self) -> list[tuple["PatchIndex", "PatchIndex"]]:
        """Left and right, top and bottom, without the patches that reach across."""
        reach = (SIDE - 1) * self.step
        height, width = self.lab.shape[:2]
        left = self.components[:, : width // 2 - reach]
        right = self.components[:, width // 2 :]
        top, bottom = self.rows < height // 2 - reach, self.rows >= height // 2
        return [
            (self._replace(components=left), self._replace(lab=self.lab[:, width // 2 :], components=right)),
            (
                self._replace(rows=self.rows[top], components=self.components[top]),
                self._replace(rows=self.rows[bottom], components=self.components[bottom]),
            ),
        ]


def smoothed(lab: Float32[np.ndarray, "h w 3"], step: int) -> Float32[np.ndarray, "h w 3"]:
    """Without the detail that samples ``step`` px apart cannot hold."""
    return lab if step == 1 else blurred(lab, step / 2)


def principal_directions(lab: Float32[np.ndarray, "h w 3"], step: int) -> Float32[np.ndarray, "e d"]:
    """Directions in which the patches of a smoothed picture vary most, samples ``step`` px apart."""
    windows = _windows(lab, step)
    rng = np.random.default_rng(2)
    rows, columns = rng.integers(0, windows.shape[0], 2048), rng.integers(0, windows.shape[1], 2048)
    patches = windows[rows, columns].reshape(2048, -1)
    patches -= patches.mean(axis=0)
    _, vectors = np.linalg.eigh(np.einsum("ne,nf->ef", patches, patches))
    return np.ascontiguousarray(vectors[:, : -_COMPONENTS - 1 : -1].astype(np.float32))


def index_patches(
    lab: Float32[np.ndarray, "h w 3"], step: int, directions: Float32[np.ndarray, "e d"], most: int = _MOST
) -> PatchIndex:
    """Project the patches of a smoothed picture; of one with more than ``most``, those of random rows."""
    windows = _windows(lab, step)
    height, width = windows.shape[:2]
    rows = np.sort(np.random.default_rng(3).permutation(height)[: max(1, most // width)])
    components = np.empty((len(rows), width, directions.shape[1]), np.float32)
    for index, row in enumerate(rows):
        components[index] = product(windows[row].reshape(width, -1), directions)
    return PatchIndex(lab, rows, components, step)


def nearest_distance(queries: PatchIndex, targets: PatchIndex, count: int = 256) -> float:
    """Mean squared distance of ``count`` random patches of ``queries`` to their nearest patches of ``targets``.

    The nearest patch is found by principal components among all that are indexed; its distance is exact, CIELAB
    units squared, mean over samples and sum over channels.
    """
    places = np.random.default_rng(4).permutation(queries.components.shape[0] * queries.components.shape[1])
    rows, columns = np.divmod(places[:count], queries.components.shape[1])
    wanted = queries.components[rows, columns]
    factors = np.ascontiguousarray(np.column_stack([-2 * wanted, np.ones(len(wanted), np.float32)]).T)
    searched = targets.components.reshape(-1, targets.components.shape[2])
    best = np.full(len(wanted), np.inf, np.float32)
    nearest = np.zeros(len(wanted), np.intp)
    for start in range(0, len(searched), _CHUNK):
        chunk = searched[start : start + _CHUNK]
        # |a - b|^2 less |b|^2, which is the same for all
        distances = product(np.column_stack([chunk, (chunk * chunk).sum(axis=1)]), factors)
        least = distances.min(axis=0)
        better = np.flatnonzero(least < best)
        best[better], nearest[better] = least[better], distances[:, better].argmin(axis=0) + start
    row, column = np.divmod(nearest, targets.components.shape[1])
    ours = _windows(queries.lab, queries.step)[queries.rows[rows], columns].reshape(len(wanted), -1)
    theirs = _windows(targets.lab, targets.step)[targets.rows[row], column].reshape(len(wanted), -1)
    return float(((ours - theirs) ** 2).sum(axis=1).mean(dtype=np.float64)) / SIDE**2
