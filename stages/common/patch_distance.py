"""Distances of patches of pictures to the nearest patches of an exemplar."""

from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int64

SIDE = 7
"""samples along a patch's side"""

_COMPONENTS = 16
_SERIAL = 1 << 18  # multiplications that OpenBLAS runs on one thread
_MAX_TARGETS = 1 << 14
_SELF = 256  # exemplar patches whose distance to the others is the reference
_CHUNK = 256

Whole: TypeAlias = Bool[np.ndarray, "p q"]
"""true for patches that count, by their top-left pixel"""

Places: TypeAlias = Int64[np.ndarray, "n 2"]
"""rows and columns, px"""


def blurred(tone: Float32[np.ndarray, "h w *c"], deviation: float) -> Float32[np.ndarray, "h w *c"]:
    """Gaussian blur; ``deviation`` in px."""
    import cv2

    return np.asarray(cv2.GaussianBlur(tone, (0, 0), deviation))


def product(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """``rows @ matrix`` in pieces too small for BLAS to use threads: (n, k) and (k, m) float32 to (n, m).

    OpenBLAS threads wait actively: where others use the cores too, a product takes ten times longer.
    """
    piece = max(1, _SERIAL // matrix.size)
    whole = len(rows) // piece * piece
    products = np.empty((len(rows), matrix.shape[1]), np.float32)
    pieces = rows[:whole].reshape(-1, piece, rows.shape[1])
    np.matmul(pieces, matrix, out=products[:whole].reshape(-1, piece, matrix.shape[1]))
    np.matmul(rows[whole:], matrix, out=products[whole:])
    return products


def patch_windows(lab: np.ndarray, step: int) -> np.ndarray:
    """View of all patches, samples ``step`` px apart: (rows, columns, channel, SIDE, SIDE)."""
    reach = (SIDE - 1) * step + 1
    view = np.lib.stride_tricks.sliding_window_view(lab, (reach, reach), axis=(0, 1))
    return np.asarray(view[..., ::step, ::step])


def sample_patches(windows: np.ndarray, count: int, seed: int, whole: Whole | None) -> np.ndarray:
    """``count`` random patches as rows, of those that are ``whole``; None allows all."""
    rng = np.random.default_rng(seed)
    if whole is None:
        rows, columns = rng.integers(0, windows.shape[0], count), rng.integers(0, windows.shape[1], count)
    else:
        places = np.flatnonzero(whole)
        rows, columns = np.divmod(places[rng.integers(0, places.size, count)], whole.shape[1])
    return windows[rows, columns].reshape(count, -1)


def smoothed(lab: Float32[np.ndarray, "h w 3"], step: int) -> Float32[np.ndarray, "h w 3"]:
    """Low-pass filtered for samples ``step`` px apart."""
    return lab if step == 1 else blurred(lab, step / 2)


def principal_directions(
    lab: Float32[np.ndarray, "h w 3"], step: int, whole: Whole | None = None
) -> Float32[np.ndarray, "e d"]:
    """Directions in which the patches of a smoothed picture vary most, samples ``step`` px apart."""
    patches = sample_patches(patch_windows(lab, step), 2048, 2, whole)
    patches -= patches.mean(axis=0)
    _, vectors = np.linalg.eigh(np.einsum("ne,nf->ef", patches, patches))
    return np.ascontiguousarray(vectors[:, : -_COMPONENTS - 1 : -1].astype(np.float32))


class NearestPatches:
    """Finds the patches of an exemplar that are nearest to others, at one scale.

    Of at most 16384 patches the nearest by principal components is found, then others about it are tried, down to
    steps of one pixel.

    Parameters
    ----------
    lab : CIELAB of the exemplar, smoothed for the scale.
    step : px between samples.
    whole : the patches that count; None for all.
    """

    def __init__(self, lab: Float32[np.ndarray, "h w 3"], step: int, whole: Whole | None):
        self.step = step
        self.directions = principal_directions(lab, step, whole)
        self.windows = patch_windows(lab, step)
        height, width = self.windows.shape[:2]
        self.stride = int(np.ceil(np.sqrt(height * width / _MAX_TARGETS)))
        chosen = np.zeros((height, width), bool)
        chosen[:: self.stride, :: self.stride] = True
        if whole is not None:
            chosen = chosen & whole if (chosen & whole).any() else whole
        self.corners: Places = np.argwhere(chosen)
        self.components = np.empty((len(self.corners), self.directions.shape[1]), np.float32)
        for start in range(0, len(self.corners), 4096):
            part = self.corners[start : start + 4096]
            self.components[start : start + 4096] = product(gathered(self.windows, part), self.directions)

    def distances(self, wanted: np.ndarray) -> Float32[np.ndarray, "n"]:  # type: ignore[name-defined]
        """Squared distance of each row of ``wanted``, a patch, to its nearest; mean of samples, CIELAB units."""
        return self._refined(wanted, self._nearest(wanted))

    def own_distance(self) -> float:
        """Mean squared distance of random patches of the exemplar to those that do not overlap them."""
        height, width = self.windows.shape[:2]
        reach = SIDE * self.step
        chosen = np.random.default_rng(5).permutation(len(self.corners))[:_SELF]
        offset = np.random.default_rng(6).integers(0, self.stride, (len(chosen), 2))
        own = np.minimum(self.corners[chosen] + offset, (height - 1, width - 1))
        patches = gathered(self.windows, own)
        found = self._refined(patches, self._nearest(patches, own, reach), own, reach)
        return float(found.mean(dtype=np.float64))

    def _nearest(self, wanted: np.ndarray, apart: Places | None = None, reach: int = 0) -> Places:
        """Corners of the target nearest to each patch by principal components.

        ``apart``: corners of the patches; targets nearer than ``reach`` px are left out.
        """
        components = product(wanted, self.directions)
        squares = (self.components**2).sum(axis=1)
        known = np.column_stack([self.components, squares])
        nearest = np.zeros(len(wanted), np.int64)
        for first in range(0, len(wanted), _CHUNK):
            part = components[first : first + _CHUNK]
            factors = np.ascontiguousarray(np.column_stack([-2 * part, np.ones(len(part), np.float32)]).T)
            best = np.full(len(part), np.inf, np.float32)
            number = np.zeros(len(part), np.int64)
            for start in range(0, len(known), 1024):
                distances = product(known[start : start + 1024], factors)
                if apart is not None:
                    here, there = self.corners[start : start + 1024].T, apart[first : first + _CHUNK].T
                    near = np.abs(here[0][:, None] - there[0]) < reach
                    near &= np.abs(here[1][:, None] - there[1]) < reach
                    distances[near] = np.inf
                least = distances.min(axis=0)
                better = np.flatnonzero(least < best)
                best[better], number[better] = least[better], distances[:, better].argmin(axis=0) + start
            nearest[first : first + _CHUNK] = number
        return np.asarray(self.corners[nearest])

    def _refined(
        self, wanted: np.ndarray, corners: Places, apart: Places | None = None, reach: int = 0
    ) -> np.ndarray:
        """Exact squared distance to the best patch about ``corners``, down to steps of one pixel."""
        last = np.array(self.windows.shape[:2]) - 1
        offsets = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column]
        best = _squared(wanted, gathered(self.windows, corners))
        hop = self.stride
        while hop > 1:
            hop = (hop + 1) // 2
            centre = corners.copy()
            for offset in offsets:
                tried = np.clip(centre + hop * np.array(offset), 0, last)
                distance = _squared(wanted, gathered(self.windows, tried))
                if apart is not None:
                    distance[np.abs(tried - apart).max(axis=1) < reach] = np.inf
                better = distance < best
                best[better], corners[better] = distance[better], tried[better]
        return best


def gathered(patches: np.ndarray, corners: Places) -> np.ndarray:
    """The patches at ``corners`` as rows."""
    return np.asarray(patches[corners[:, 0], corners[:, 1]].reshape(len(corners), -1))


def _squared(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    difference = one - other
    return np.asarray(np.einsum("ne,ne->n", difference, difference)) / SIDE**2
