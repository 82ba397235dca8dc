"""Voting: every target pixel becomes an average of the exemplar pixels that the patches over it propose."""

from typing import Any, NamedTuple

import numba
import numpy as np

from texloom.stages.kernels.core.row_sum import sum_of_rows
from texloom.stages.kernels.patchmatch.search import wrap_index


class Votes(NamedTuple):
    """Target patches and the exemplar patches that they are matched with."""

    row: Any
    """(p, q) int32"""
    column: Any
    """(p, q) int32"""
    exemplar: Any
    """(h, w * channels) int16, or float32 for `vote_sums`"""
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
    """Fill ``sums`` with what `vote_sums` does, for integer weights, a run of patches at a time.

    Patches side by side whose matches are side by side vote for the same pixels, so their weights are added first.

    Parameters
    ----------
    votes : Votes, of int16
    steps : ((2 * n + patch_size) * channels,) int32 for runs of at most n patches: n zeros, then the sums of the
        first 0, 1, ... weights along a side of a patch, each repeated for all channels
    sums : (last - first, (q + patch_size - 1) * channels) int32
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
def weighted_values(votes, bins, excess, table, first, last):
    """Fill rows ``first`` to ``last`` of the exemplar in ``table`` with what a vote for each pixel adds.

    A vote for a colour in bins b_c weighs 1 / (1 + sum over channels of ``excess[c, b_c]``) [Kopf2007]_.

    Parameters
    ----------
    votes : Votes
    bins : (h, w * channels) uint8, histogram bin of every exemplar value
    excess : (channels, bins) float32, pixels of the target beyond the exemplar's share, 0 where there are too few
    table : (h * w, n) float32, n > channels, output: the weighted values of each pixel, and its weight
    """
    exemplar, channels = votes.exemplar, votes.channels
    width = exemplar.shape[1] // channels
    for y in range(first, last):
        for x in range(width):
            surplus = np.float32(1)
            for c in range(channels):
                surplus += excess[c, bins[y, x * channels + c]]
            weight = np.float32(1) / surplus
            entry = table[y * width + x]
            for c in range(channels):
                entry[c] = weight * exemplar[y, x * channels + c]
            entry[channels] = weight


@numba.njit(cache=True, nogil=True, forceinline=True)
def _bin(value, low, step, count):
    """Histogram bin of a value; the first and the last hold what lies beyond."""
    return np.int64(min(max((np.float32(value) - low) / step, np.float32(0)), np.float32(count - 1)))


@numba.njit(cache=True, nogil=True)
def histogram_vote(votes, table, run, lows, steps, pixels, width, target, change):
    """Set the target pixels in ``pixels`` to a weighted mean that avoids colours which the target has too often.

    Parameters
    ----------
    votes : Votes
    table : (h * w, n) float32, see `weighted_values`
    run : as many integers as ``table`` has columns; its type tells the compiler their number
    lows, steps : (channels,) float32, lower end and width of the histograms' bins
    pixels : (n,) int64, flat indices of target pixels in rows of ``width``
    target : (H, W * channels) int16, changed in place
    change : (channels, bins) int64, to which the change of the target's histograms is added
    """
    row, column, exemplar, channels, patch_size, wrap = votes
    down, across = row.shape
    exemplar_width = exemplar.shape[1] // channels
    voted = np.empty(patch_size * patch_size, np.int64)
    total = np.empty(len(run), np.float32)
    for index in range(pixels.size):
        y, x = pixels[index] // width, pixels[index] % width
        count = 0
        for i in range(patch_size):
            qy = wrap_index(y - i, down, wrap)
            if qy < 0:
                continue
            for j in range(patch_size):
                qx = wrap_index(x - j, across, wrap)
                if qx < 0:
                    continue
                voted[count] = (row[qy, qx] + i) * exemplar_width + column[qy, qx] + j
                count += 1
        sum_of_rows(table, voted, np.int64(count), total, run)
        for c in range(channels):
            value = np.int16(np.rint(total[c] / total[channels]))
            change[c, _bin(target[y, x * channels + c], lows[c], steps[c], change.shape[1])] -= 1
            change[c, _bin(value, lows[c], steps[c], change.shape[1])] += 1
            target[y, x * channels + c] = value
