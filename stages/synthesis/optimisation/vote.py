"""The voting step of texture optimisation: each pixel becomes an average over the patches that cover it."""

from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float32, Int16, Int32, UInt8

from texloom.stages.common.similarity.neighbourhoods import UNIT
from texloom.stages.kernels.core.elementary_functions import exp
from texloom.stages.kernels.core.threads import run_all, run_spans, spans
from texloom.stages.synthesis.optimisation.correspondence import Patches, target_sides
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.normals import NORMAL, rounding, unit
from texloom.stages.vocabulary.scratch import bands, empty, run_bands

_BINS = 100
_RUN = 32  # patches that are added at once
_PIECE = 8192  # pixels; the call for fewer takes longer than what a thread saves
_TABLE_PIECE = 65536  # the same for values of a table
_CHUNKS = 32  # after each the histogram is updated; more would be more exact and less parallel

Window: TypeAlias = Int32[np.ndarray, "n"]  # type: ignore[name-defined]


def window(patch_size: int, sigma: float | None = None) -> Window:
    """Weights of a patch's votes along one side: all equal, or a Gaussian of ``sigma`` px about the middle.

    A narrow window averages fewer patches, which preserves detail where they differ.
    """
    if sigma is None:
        return np.ones(patch_size, np.int32)
    offset = np.arange(patch_size) - (patch_size - 1) / 2
    weights = exp(-(offset**2) / (2 * sigma**2))
    peak = min(64, 600 / weights.sum())  # the sum of all weights for a pixel is exact in single precision
    return np.maximum(1, np.rint(peak * weights)).astype(np.int32)


def weights_along(patches: int, window: Window, wraps: bool) -> np.ndarray:
    """Sum of the weights of all votes for each line of pixels along an axis of so many patches."""
    if wraps:
        return np.full(patches, window.sum(), np.int64)
    return np.convolve(np.ones(patches, np.int64), window.astype(np.int64))


def run_shares(window: Window, channels: int) -> Float32[np.ndarray, "lengths values"]:
    """Weight of the votes of a run of patches for each value that they cover, as `vote_sums` reads it."""
    shares = np.zeros((_RUN, _RUN + window.size - 1), np.float32)
    for length in range(1, _RUN + 1):
        shares[length - 1, : length + window.size - 1] = np.convolve(np.ones(length), window)
    return np.repeat(shares, channels, axis=1)


def _sums_down(window: Window) -> Float32[np.ndarray, "rows"]:  # type: ignore[name-defined]
    """Sums of the weights of a patch's first rows, from none to all."""
    return np.concatenate([[0], window.cumsum()]).astype(np.float32)


def mean_vote(
    match: Patches,
    exemplar: Int16[np.ndarray, "h wc"],
    channels: int,
    patch_size: int,
    wrap: Wraps,
    target: Int16[np.ndarray, "H Wc"] | None = None,
) -> Int16[np.ndarray, "H Wc"]:
    """Average of all votes, padded by a patch less one pixel where it wraps. It replaces a given ``target``.

    Sums are whole numbers below 2**24, which single precision adds exactly.
    """
    from texloom.stages.kernels.patchmatch.voting import Votes, find_runs, round_votes, vote_sums

    votes = Votes(match[0], match[1], exemplar, channels, patch_size, wrap)
    even = window(patch_size)
    down, across = map(weights_along, match.shape[1:], (even, even), wrap)
    shares = run_shares(even, channels), _sums_down(even)
    weights = np.repeat(across, channels).astype(np.float64), down.astype(np.float64)
    padded = (match.shape[1] + patch_size - 1, (match.shape[2] + patch_size - 1) * channels)
    if target is None:
        target = empty(padded, np.int16)

    def vote(first: int, last: int) -> None:
        sums = np.empty((last - first, (match.shape[2] + patch_size - 1) * channels), np.float32)
        runs = find_runs(*match, patch_size, wrap, _RUN, first, last)
        vote_sums(votes, *shares, *runs, sums)
        round_votes(sums, *weights, target, first, last)

    run_bands(vote, (), down.size, (match, target))
    if wrap:
        _close_torus(target, (down.size, across.size * channels))
    return target


def _close_torus(target: Int16[np.ndarray, "H Wc"], shape: tuple[int, int]) -> None:
    """Repeat the first rows and columns of what has ``shape`` behind the last, as far as there is room."""
    down, across = shape
    for band in bands(down, target):
        target[band, across:] = target[band, : target.shape[1] - across]
    target[down:] = target[: target.shape[0] - down]


def pad_torus(
    target: Int16[np.ndarray, "H Wc"], channels: int, patch_size: int, wrap: Wraps
) -> Int16[np.ndarray, "padded_H padded_Wc"]:
    """Repeat the first rows and columns behind the last along axes that wrap, so that every patch is whole."""
    down, across = wrap.where_closed(patch_size - 1)
    return np.ascontiguousarray(np.pad(target, ((0, down), (0, across * channels)), mode="wrap"))


def vote_pixels(
    match: Patches,
    pixels: Float32[np.ndarray, "h w c"],
    window: Window,
    wrap: Wraps,
    margin: tuple[int, int] = (0, 0),
) -> Float32[np.ndarray, "H W c"]:
    """Average of all votes in any number of planes, in floating point.

    Without ``margin`` px above and below, left and right.
    """
    from texloom.stages.kernels.patchmatch.voting import Votes, find_runs, vote_sums

    height, width, channels = pixels.shape
    flat = np.ascontiguousarray(pixels.reshape(height, width * channels))
    votes = Votes(match[0], match[1], flat, channels, window.size, wrap)
    shares = run_shares(window, channels), _sums_down(window)
    down, across = map(weights_along, match.shape[1:], (window, window), wrap)
    above, left = margin
    inner = slice(left, across.size - left)
    result = empty((down.size - 2 * above, across.size - 2 * left, channels), np.float32)

    def vote(first: int, last: int) -> None:
        first, last = first + above, last + above
        sums = np.empty((last - first, (match.shape[2] + window.size - 1) * channels), np.float32)
        runs, count = find_runs(*match, window.size, wrap, _RUN, first, last)
        runs[..., 4:] = 0  # no blocks, which end where these rows end: sums are rounded
        vote_sums(votes, *shares, runs, count, sums)
        sums = sums[:, : across.size * channels].reshape(last - first, across.size, channels)
        total = np.outer(down[first:last], across[inner]).astype(np.float32)
        np.divide(sums[:, inner], total[..., None], out=result[first - above : last - above])

    run_bands(vote, (), len(result), (match, result))
    return result


def result_image(pixels: Float32[np.ndarray, "H W c"], exemplar: Image) -> Image:
    """Pixels voted from an exemplar as an image whose normals have unit length."""
    channels = exemplar.channels
    if set(NORMAL) <= set(channels):
        normal = [channels.index(name) for name in NORMAL]
        for band in bands(len(pixels), pixels):
            # Normals within the rounding of 8 bits are copied unchanged.
            pixels[band][..., normal] = unit(pixels[band][..., normal], rounding(8))
    return exemplar.elsewhere(pixels)


def copy_vote(
    match: Patches,
    target: Int16[np.ndarray, "H Wc"],
    exemplar: Int16[np.ndarray, "h wc"],
    channels: int,
    patch_size: int,
    reach: int,
    wrap: Wraps,
) -> Int32[np.ndarray, "rows columns 2"]:
    """For each pixel the vote whose neighbourhood, ``reach`` px around, is most similar to that in ``target``."""
    from texloom.stages.kernels.patchmatch.copy_votes import copy_votes
    from texloom.stages.kernels.patchmatch.voting import Votes

    height, width = target_sides(match, patch_size, wrap)
    source = np.empty((height, width, 2), np.int32)
    votes = Votes(match[0], match[1], exemplar, channels, patch_size, wrap)
    run_spans(copy_votes, (votes, target, reach, source), height, 16)
    return source


class HistogramVote:
    """Voting that brings each channel's histogram towards the exemplar's ([Kopf2007]_, [Kaspar2015]_ section 3.2).

    Rows are visited in random order, in chunks. The target's histogram is constant within a chunk, so that the
    result does not depend on the number of threads.

    Parameters
    ----------
    lows, highs : range of each channel's histogram, CIELAB units.
    usable : exemplar pixels that the histograms count; none counts all.
    expected : weight of each exemplar pixel in the histograms; none for equal weights.
    """

    def __init__(
        self,
        exemplar: Int16[np.ndarray, "h wc"],
        patch_size: int,
        wrap: Wraps,
        lows: np.ndarray,
        highs: np.ndarray,
        usable: Mask | None = None,
        expected: Float32[np.ndarray, "h w"] | None = None,
    ):
        self.exemplar = exemplar
        self.channels = lows.size
        self.patch_size = patch_size
        self.wrap = wrap
        self.lows = np.asarray(lows * UNIT, np.float32)
        self.widths = np.asarray((highs - lows) * UNIT / _BINS, np.float32)
        self.shares = run_shares(window(patch_size), self.channels + 1)
        self.bins = self._bins(exemplar).reshape(exemplar.shape)
        counted = self.bins.reshape(-1, self.channels)
        if usable is not None:
            counted = counted[usable.ravel()]
        self.pixels: float = len(counted)
        weights = None
        if expected is not None:
            weights = (expected if usable is None else expected[usable]).ravel().astype(np.float64)
            self.pixels = float(weights.sum())
        self.histogram = self._histogram(counted, weights)

    def _bins(self, values: np.ndarray) -> np.ndarray:
        planes = values.reshape(-1, self.channels)
        return np.asarray(np.clip((planes - self.lows) / self.widths, 0, _BINS - 1), np.uint8)

    def _histogram(self, bins: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
        return np.stack([np.bincount(bins[:, c], weights, minlength=_BINS) for c in range(self.channels)])

    def __call__(
        self, match: Patches, target: Int16[np.ndarray, "H Wc"], order: np.random.Generator
    ) -> Int16[np.ndarray, "H Wc"]:
        """The next target, given the current one."""
        from texloom.stages.kernels.patchmatch.voting import Votes, count_bins, find_runs, histogram_votes

        height, width = target_sides(match, self.patch_size, self.wrap)
        target = target[:height, : width * self.channels].copy()
        counts = np.zeros(self.histogram.shape, np.int64)
        count_bins(target, self.lows, self.widths, counts)
        wanted = height * width / self.pixels * self.histogram
        table = np.empty(
            (self.exemplar.shape[0], self.exemplar.shape[1] // self.channels * (self.channels + 1)), np.float32
        )
        filled = np.zeros((table.shape[0], self.exemplar.shape[1] // self.channels), np.uint8)
        votes = Votes(match[0], match[1], table, self.channels + 1, self.patch_size, self.wrap)
        runs = find_runs(*match, self.patch_size, self.wrap, _RUN, 0, height)
        voting = (votes, self.shares, *runs, self.lows, self.widths)
        rows = order.permutation(height)
        chunks = np.array_split(rows, min(_CHUNKS, height))
        if table.size < _TABLE_PIECE and len(chunks[0]) * width < _PIECE:
            stops = np.cumsum([len(chunk) for chunk in chunks])
            histogram_votes(*voting, rows, stops, target, counts, wanted, self.exemplar, self.bins, filled, False)
        else:
            for number, chunk in enumerate(chunks, 1):
                self._vote_for(chunk, voting, target, counts, wanted, filled, np.uint8(number))
        return pad_torus(target, self.channels, self.patch_size, self.wrap) if self.wrap else target

    def _vote_for(
        self,
        chunk: np.ndarray,
        voting: tuple[Any, ...],
        target: np.ndarray,
        counts: np.ndarray,
        wanted: np.ndarray,
        filled: UInt8[np.ndarray, "h w"],
        number: np.uint8,
    ) -> None:
        """`histogram_votes` for one chunk, on all threads; ``number`` is its own, from 1."""
        from texloom.stages.kernels.patchmatch.voting import histogram_votes, surplus, weighted_values

        votes, _, runs, count, *_ = voting
        filling = (
            self.exemplar, self.bins, surplus(counts, wanted), runs, count, chunk, self.patch_size, filled, number,
            votes.exemplar,
        )  # fmt: skip
        run_spans(weighted_values, filling, len(self.exemplar), min(4, 1 + votes.exemplar.size // _TABLE_PIECE))
        parts = spans(len(chunk), min(4, 1 + len(chunk) * target.shape[1] // self.channels // _PIECE))
        changes = np.zeros((len(parts), *counts.shape), np.int64)
        calls = [
            (
                *voting, chunk[slice(*part)], np.array([part[1] - part[0]]), target, change, wanted,
                self.exemplar, self.bins, filled, True,
            )
            for part, change in zip(parts, changes, strict=True)
        ]  # fmt: skip
        run_all(histogram_votes, calls)
        counts += changes.sum(axis=0)
