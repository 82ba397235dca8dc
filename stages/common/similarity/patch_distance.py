"""Distances of patches of pictures to the nearest patches of an exemplar."""

import functools
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int64

from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import eigenvectors, row_product, square_sums

SIDE = 7
"""samples along a patch's side"""

_COMPONENTS = 16
_MAX_TARGETS = 1 << 14
_SELF = 256  # exemplar patches whose distance to the others is the reference
_CHUNK = 256  # patches that are searched for at a time
_ROWS = 480  # in which they are searched for at a time; the distances fit into the processor's cache

Whole: TypeAlias = Bool[np.ndarray, "p q"]
"""true for patches that count, by their top-left pixel"""

Places: TypeAlias = Int64[np.ndarray, "n 2"]
"""rows and columns, px"""


def blurred(tone: Float32[np.ndarray, "h w *c"], deviation: float) -> Float32[np.ndarray, "h w *c"]:
    """Gaussian blur; ``deviation`` in px."""
    return gaussian_blur(tone, deviation)


class Patches:
    """All patches of a picture, samples ``step`` px apart, by the pixel of their upper left sample.

    The samples of a line are kept side by side, as runs of values are gathered faster than single ones.

    Parameters
    ----------
    mean : if given, it is subtracted, and the picture is smoothed for the step.
    """

    def __init__(self, lab: Float32[np.ndarray, "h w c"], step: int, mean: np.ndarray | None = None):
        height, width, channels = lab.shape
        reach = (SIDE - 1) * step + 1
        self.step = step
        self.shape = (height - reach + 1, width - reach + 1)
        lines = np.zeros((channels, step, height, -(-width // step)), np.float32)
        for number, of_channel in enumerate(lines):  # one after the other, as each needs copies
            plane = lab[..., number]
            if mean is not None:
                plane = smoothed(np.ascontiguousarray(plane - mean[number]), step)
            for of_phase, phase in zip(of_channel, range(step), strict=True):
                part = plane[:, phase::step]
                of_phase[:, : part.shape[1]] = part
        self._lines, self._width = lines, width
        channel, phase, line, sample = lines.strides
        self._runs: np.ndarray = np.ndarray(
            (step, self.shape[0], lines.shape[3] - SIDE + 1, channels, SIDE),
            f"V{SIDE * sample}",
            lines,
            strides=(phase, line, sample, channel, step * line),
        )

    def plane(self, channel: int) -> Float32[np.ndarray, "h w"]:
        """The samples of a channel at their pixels."""
        lines = self._lines[channel].transpose(1, 2, 0)
        return np.ascontiguousarray(lines.reshape(len(lines), -1)[:, : self._width])

    def at(self, rows: np.ndarray, columns: np.ndarray) -> Float32[np.ndarray, "n e"]:
        """Patches at some pixels as rows: every channel's SIDE x SIDE samples."""
        runs = self._runs[columns % self.step, rows, columns // self.step]
        return runs.view(np.float32).reshape(len(runs), runs.shape[1] * SIDE**2)


def random_corners(
    shape: tuple[int, int], count: int, seed: int, whole: Whole | None
) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of ``count`` random patches of a picture that has ``shape`` of them.

    Of those that are ``whole``; None allows all.
    """
    rng = np.random.default_rng(seed)
    if whole is None:
        return rng.integers(0, shape[0], count), rng.integers(0, shape[1], count)
    places = np.flatnonzero(whole)
    rows, columns = np.divmod(places[rng.integers(0, places.size, count)], whole.shape[1])
    return rows, columns


def few_patches(
    lab: Float32[np.ndarray, "h w c"], rows: np.ndarray, columns: np.ndarray
) -> Float32[np.ndarray, "n e"]:
    """As `Patches.at` of neighbouring samples, without a copy of the picture."""
    patches = np.lib.stride_tricks.sliding_window_view(lab, (SIDE, SIDE), axis=(0, 1))
    return patches[rows, columns].reshape(len(rows), -1)


def smoothed(lab: Float32[np.ndarray, "h w *c"], step: int) -> Float32[np.ndarray, "h w *c"]:
    """Low-pass filtered for samples ``step`` px apart."""
    return lab if step == 1 else blurred(lab, step / 2)


def principal_directions(patches: Patches, whole: Whole | None = None) -> Float32[np.ndarray, "e d"]:
    """Directions in which the patches of a picture vary most."""
    sample = patches.at(*random_corners(patches.shape, 2048, 2, whole))
    sample -= sample.mean(axis=0)
    _, vectors = eigenvectors(square_sums(sample))
    return np.ascontiguousarray(vectors[:, : -_COMPONENTS - 1 : -1].astype(np.float32))


def with_squares(rows: Float32[np.ndarray, "n d"]) -> Float32[np.ndarray, "n e"]:
    """Rows as `nearest_rows` searches them: with their squared length as a last value."""
    return np.column_stack([rows, (rows * rows).sum(axis=1)])


def nearest_rows(
    searched: Float32[np.ndarray, "n e"],
    wanted: Float32[np.ndarray, "m d"],
    leave_out: Callable[[int, np.ndarray], None] | None = None,
) -> Int64[np.ndarray, "*m"]:
    """The row of ``searched``, see `with_squares`, that is nearest to each of ``wanted``; of equals the first.

    ``leave_out`` is called with the number of the first of some rows and their distances to all of ``wanted``,
    (row, wanted), and sets to infinity those that do not count.
    """
    factors = np.ascontiguousarray(np.column_stack([-2 * wanted, np.ones(len(wanted), np.float32)]).T)
    best = np.full(len(wanted), np.inf, np.float32)
    nearest = np.zeros(len(wanted), np.int64)
    for start in range(0, len(searched), _ROWS):
        # |a - b|^2 less |b|^2, which is the same for all
        distances = row_product(searched[start : start + _ROWS], factors)
        if leave_out is not None:
            leave_out(start, distances)
        least = distances.min(axis=0)
        better = np.flatnonzero(least < best)
        best[better], nearest[better] = least[better], distances[:, better].argmin(axis=0) + start
    return nearest


class NearestPatches:
    """Finds the patches of an exemplar that are nearest to others, at one scale.

    Of at most 16384 patches the nearest by principal components is found, then others about it are tried, down to
    steps of one pixel.

    Parameters
    ----------
    lab : CIELAB of the exemplar, or L alone.
    step : px between samples.
    whole : the patches that count; None for all.
    mean : see `Patches`.
    """

    def __init__(
        self,
        lab: Float32[np.ndarray, "h w c"],
        step: int,
        whole: Whole | None,
        mean: np.ndarray | None = None,
    ):
        self.step = step
        self.patches = Patches(lab, step, mean)
        self.directions = principal_directions(self.patches, whole)
        height, width = self.patches.shape
        self.stride = int(np.ceil(np.sqrt(height * width / _MAX_TARGETS)))
        chosen = np.zeros((height, width), bool)
        chosen[:: self.stride, :: self.stride] = True
        if whole is not None:
            chosen = chosen & whole if (chosen & whole).any() else whole
        self.corners: Places = np.argwhere(chosen)
        parts = [self.corners[start : start + 4096] for start in range(0, len(self.corners), 4096)]
        components = [row_product(self.patches.at(*part.T), self.directions) for part in parts]
        self.searched = with_squares(np.concatenate(components))

    def distances(self, wanted: np.ndarray) -> Float32[np.ndarray, "n"]:  # type: ignore[name-defined]
        """Squared distance of each row of ``wanted``, a patch, to its nearest; mean of samples, CIELAB units."""
        return self._refined(wanted, self._nearest(wanted))

    def own_distances(self) -> tuple[Float32[np.ndarray, "n"], Float32[np.ndarray, "n"]]:  # type: ignore[name-defined]
        """Contrast of random patches of the exemplar, and squared distance to those that do not overlap them."""
        height, width = self.patches.shape
        reach = SIDE * self.step
        chosen = np.random.default_rng(5).permutation(len(self.corners))[:_SELF]
        offset = np.random.default_rng(6).integers(0, self.stride, (len(chosen), 2))
        own = np.minimum(self.corners[chosen] + offset, (height - 1, width - 1))
        patches = self.patches.at(*own.T)
        return patch_contrast(patches), self._refined(patches, self._nearest(patches, own, reach), own, reach)

    def _nearest(self, wanted: np.ndarray, apart: Places | None = None, reach: int = 0) -> Places:
        """Corners of the target nearest to each patch by principal components.

        ``apart``: corners of the patches; targets nearer than ``reach`` px are left out.
        """
        components = row_product(wanted, self.directions)
        leave_out = None if apart is None else functools.partial(self._leave_out, apart, reach)
        nearest = np.empty(len(wanted), np.int64)
        for first in range(0, len(wanted), _CHUNK):
            part = components[first : first + _CHUNK]
            nearest[first : first + _CHUNK] = nearest_rows(self.searched, part, leave_out)
        return np.asarray(self.corners[nearest])

    def _leave_out(self, apart: Places, reach: int, start: int, distances: np.ndarray) -> None:
        """See `nearest_rows`."""
        here = self.corners[start : start + len(distances)]  # by rows, so that most of `apart` are far away
        close = np.flatnonzero((apart[:, 0] > here[0, 0] - reach) & (apart[:, 0] < here[-1, 0] + reach))
        near = np.abs(here[:, None, 0] - apart[close, 0]) < reach
        near &= np.abs(here[:, None, 1] - apart[close, 1]) < reach
        rows, columns = np.nonzero(near)
        distances[rows, close[columns]] = np.inf

    def _refined(
        self, wanted: np.ndarray, corners: Places, apart: Places | None = None, reach: int = 0
    ) -> np.ndarray:
        """Exact squared distance to the best patch about ``corners``, down to steps of one pixel."""
        last = np.array(self.patches.shape) - 1
        offsets = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column]
        best = _squared(wanted, self.patches.at(*corners.T))
        hop = self.stride
        while hop > 1:
            hop = (hop + 1) // 2
            centre = corners.copy()
            for offset in offsets:
                tried = np.clip(centre + hop * np.array(offset), 0, last)
                distance = _squared(wanted, self.patches.at(*tried.T))
                if apart is not None:
                    distance[np.abs(tried - apart).max(axis=1) < reach] = np.inf
                better = distance < best
                best[better], corners[better] = distance[better], tried[better]
        return best


def patch_contrast(patches: Float32[np.ndarray, "n e"]) -> Float32[np.ndarray, "*n"]:
    """Mean squared deviation of the samples of each patch from their mean, summed over channels."""
    samples = patches.reshape(len(patches), -1, SIDE**2)
    return np.asarray(samples.var(axis=2).sum(axis=1))


def _squared(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    difference = one - other
    return np.asarray(np.einsum("ne,ne->n", difference, difference)) / SIDE**2
