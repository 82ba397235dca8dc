"""Voting: every target pixel becomes an average of the exemplar pixels that the patches over it propose."""

from typing import Any, NamedTuple

import numba
import numpy as np

from texloom.stages.kernels.core.inner import inner
from texloom.stages.kernels.patchmatch.search import wrap_index


class Votes(NamedTuple):
    """Target patches and the exemplar patches that they are matched with."""

    row: Any
    """(p, q) int32"""
    column: Any
    """(p, q) int32"""
    exemplar: Any
    """(h, w * channels) int16, or float32 for `vote_sums` and `histogram_vote`"""
    channels: int
    patch_size: int
    wrap: bool
    """the target is a torus of (p, q) >= patch_size - 1 pixels; else it has (p, q) + patch_size - 1 pixels"""


@numba.njit(cache=True, nogil=True)
def vote_sums(votes, window, line_window, sums, first, last):
    """Fill ``sums`` with the weighted sum of all votes for each target pixel of rows ``first`` to ``last``.

    Parameters
    ----------
    votes : Votes
    window : (patch_size,) int32 or float32, weights along one side of a patch; the weight of a pixel is the product
    line_window : (patch_size * channels,) of the same type, each weight repeated for all channels
    sums : (last - first, (q + patch_size - 1) * channels), of the window's type; the right margin is work space
        on a torus
    """
    row, column, exemplar, channels, patch_size, wrap = votes
    down, across = row.shape
    run = line_window.size
    weights = line_window.copy()
    for y in range(first, last):
        line = sums[y - first]
        line[:] = 0
        for i in range(patch_size):
            q = wrap_index(y - i, down, wrap)
            if q < 0:
                continue
            for k in range(run):
                weights[k] = line_window[k] * window[i]
            for x in range(across):
                source = exemplar[row[q, x] + i, column[q, x] * channels : column[q, x] * channels + run]
                into = line[x * channels : x * channels + run]
                for k in range(run):
                    into[k] += weights[k] * source[k]
        if wrap:
            for k in range((patch_size - 1) * channels):
                line[k] += line[across * channels + k]


@numba.njit(cache=True, nogil=True)
def coherent_vote_sums(votes, steps, sums, first, last):
    """Fill ``sums`` with what `vote_sums` does, a run of patches at a time.

    Patches side by side whose matches are side by side vote for the same pixels, so their weights are added first.

    Parameters
    ----------
    votes : Votes
    steps : ((2 * n + patch_size) * channels,) int32, or float32 as the exemplar, for runs of at most n patches:
        n zeros, then the sums of the first 0, 1, ... weights along a side of a patch, each repeated for all
        channels
    sums : (last - first, (q + patch_size - 1) * channels), of the type of ``steps``
    """
    row, column, exemplar, channels, patch_size, wrap = votes
    down, across = row.shape
    longest = (steps.size // channels - patch_size) // 2
    for y in range(first, last):
        line = sums[y - first]
        line[:] = 0
        for i in range(patch_size):
            q = wrap_index(y - i, down, wrap)
            if q < 0:
                continue
            weight = steps[(longest + i + 1) * channels] - steps[(longest + i) * channels]
            x = 0
            while x < across:
                r, c = row[q, x], column[q, x]
                n = 1
                while n < longest and x + n < across and column[q, x + n] == c + n and row[q, x + n] == r:
                    n += 1
                values = (n + patch_size - 1) * channels
                begun = steps[(longest + 1) * channels : (longest + 1) * channels + values]
                ended = steps[(longest + 1 - n) * channels : (longest + 1 - n) * channels + values]
                source = exemplar[r + i, c * channels : c * channels + values]
                into = line[x * channels : x * channels + values]
                for k in range(values):
                    into[k] += weight * (begun[k] - ended[k]) * source[k]
                x += n
        if wrap:
            for k in range((patch_size - 1) * channels):
                line[k] += line[across * channels + k]


@numba.njit(cache=True, nogil=True, error_model="numpy")  # a test for zero would prevent vectors
def round_votes(sums, weights_across, weights_down, target, first, last):
    """Set rows ``first`` to ``last`` of the int16 ``target`` to the votes' mean; halves are rounded up.

    ``sums`` are those of these rows.
    The weight of all votes for a value is the product of its entries in ``weights_down`` and ``weights_across``,
    float64. The quotients of such small numbers are never rounded to a whole number that they do not reach, and
    vectors of them are divided faster than integers.
    """
    for y in range(first, last):
        line = sums[y - first, : weights_across.size]
        for k in range(weights_across.size):
            weight = weights_across[k] * weights_down[y]
            target[y, k] = np.int16(np.floor((2.0 * line[k] + weight) / (2.0 * weight)))


@numba.njit(cache=True, nogil=True)
def weighted_values(exemplar, bins, excess, table, first, last):
    """Fill rows ``first`` to ``last`` of the exemplar in ``table`` with what a vote for each pixel adds.

    A vote for a colour in bins b_c weighs 1 / (1 + sum over channels of ``excess[c, b_c]``) [Kopf2007]_.

    Parameters
    ----------
    exemplar : (h, w * channels) int16
    bins : (h, w * channels) uint8, histogram bin of every exemplar value
    excess : (channels, bins) float32, pixels of the target beyond the exemplar's share, 0 where there are too few
    table : (h, w * (channels + 1)) float32, output: the weighted values of each pixel, and its weight
    """
    channels = excess.shape[0]
    for y in range(first, last):
        for x in range(exemplar.shape[1] // channels):
            surplus = np.float32(1)
            for c in range(channels):
                surplus += excess[c, bins[y, x * channels + c]]
            weight = np.float32(1) / surplus
            entry = table[y, x * (channels + 1) : (x + 1) * (channels + 1)]
            for c in range(channels):
                entry[c] = weight * exemplar[y, x * channels + c]
            entry[channels] = weight


@inner(forceinline=True)
def _bin(value, low, step, count):
    """Histogram bin of a value; the first and the last hold what lies beyond."""
    return np.int64(min(max((np.float32(value) - low) / step, np.float32(0)), np.float32(count - 1)))


@numba.njit(cache=True, nogil=True)
def count_bins(values, lows, widths, counts):
    """Add the histograms of ``values``, (h, w * channels) int16, to ``counts``; see `histogram_vote`."""
    channels = lows.size
    for y in range(values.shape[0]):
        for x in range(values.shape[1] // channels):
            for c in range(channels):
                counts[c, _bin(values[y, x * channels + c], lows[c], widths[c], counts.shape[1])] += 1


@numba.njit(cache=True, nogil=True)
def surplus(counts, wanted):
    """How far ``counts`` exceed ``wanted``, both (channels, bins), float32; 0 where they do not."""
    excess = np.empty(counts.shape, np.float32)
    for c in range(counts.shape[0]):
        for b in range(counts.shape[1]):
            excess[c, b] = max(0.0, counts[c, b] - wanted[c, b])
    return excess


@numba.njit(cache=True, nogil=True)
def histogram_votes(votes, steps, lows, widths, rows, stops, target, counts, wanted, exemplar, bins):
    """`histogram_vote` for chunks of ``rows``, before each of which `weighted_values` are updated.

    Parameters
    ----------
    stops : (n,) int64, where each chunk ends
    counts : (channels, bins) int64, histograms of the target, updated
    wanted : (channels, bins) float64, what they should be
    exemplar, bins : see `weighted_values`
    """
    start = 0
    for stop in stops:
        weighted_values(exemplar, bins, surplus(counts, wanted), votes.exemplar, np.int64(0), exemplar.shape[0])
        histogram_vote(votes, steps, lows, widths, rows[start:stop], target, counts)
        start = stop


@numba.njit(cache=True, nogil=True)
def histogram_vote(votes, steps, lows, widths, rows, target, change):
    """Set rows of the target to a weighted mean that avoids colours which the target has too often.

    Parameters
    ----------
    votes : Votes, of the table that `weighted_values` fills
    steps : see `coherent_vote_sums`
    lows, widths : (channels,) float32, lower end and width of the histograms' bins
    rows : (n,) int64
    target : (H, W * channels) int16, changed in place
    change : (channels, bins) int64, to which the change of the target's histograms is added
    """
    channels = lows.size
    sums = np.empty((1, (votes.row.shape[1] + votes.patch_size - 1) * votes.channels), np.float32)
    for y in rows:
        coherent_vote_sums(votes, steps, sums, y, y + 1)
        for x in range(target.shape[1] // channels):
            total = sums[0, x * votes.channels : (x + 1) * votes.channels]
            for c in range(channels):
                value = np.int16(np.rint(total[c] / total[channels]))
                change[c, _bin(target[y, x * channels + c], lows[c], widths[c], change.shape[1])] -= 1
                change[c, _bin(value, lows[c], widths[c], change.shape[1])] += 1
                target[y, x * channels + c] = value
