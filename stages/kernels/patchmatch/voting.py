"""Voting: every target pixel becomes an average of the exemplar pixels that the patches over it propose."""

from typing import Any, NamedTuple

import numba
import numpy as np

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
    """Fill ``sums[first:last]`` with the weighted sum of all votes for each target pixel.

    Parameters
    ----------
    votes : Votes
    window : (patch_size,) int32 or float32, weights along one side of a patch; the weight of a pixel is the product
    line_window : (patch_size * channels,) of the same type, each weight repeated for all channels
    sums : (H, (q + patch_size - 1) * channels), of the window's type; the right margin is work space on a torus
    """
    row, column, exemplar, channels, patch_size, wrap = votes
    down, across = row.shape
    run = line_window.size
    weights = line_window.copy()
    for y in range(first, last):
        line = sums[y]
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
def round_votes(sums, weights_across, weights_down, channels, target, first, last):
    """Set rows ``first`` to ``last`` of the int16 ``target`` to the votes' mean, rounded to nearest.

    The weight of all votes for a pixel is the product of its entries in ``weights_down`` and ``weights_across``,
    int64.
    """
    for y in range(first, last):
        for x in range(weights_across.size):
            weight = weights_across[x] * weights_down[y]
            for k in range(channels):
                # floor division rounds half up, for negative sums too
                target[y, x * channels + k] = (2 * sums[y, x * channels + k] + weight) // (2 * weight)


@numba.njit(cache=True, nogil=True)
def histogram_vote(votes, bins, excess, pixels, width, target):
    """Set the target pixels in ``pixels`` to a weighted mean that avoids colours which the target has too often.

    A vote for a colour in bins b_c weighs 1 / (1 + sum over channels of ``excess[c, b_c]``) [Kopf2007]_.

    Parameters
    ----------
    votes : Votes
    bins : (h, w * channels) uint8, histogram bin of every exemplar value
    excess : (channels, bins) float32, pixels of the target beyond the exemplar's share, 0 where there are too few
    pixels : (n,) int64, flat indices of target pixels in rows of ``width``
    target : (H, W * channels) int16, changed in place
    """
    row, column, exemplar, channels, patch_size, wrap = votes
    down, across = row.shape
    mean = np.empty(channels, np.float32)
    for index in range(pixels.size):
        y, x = pixels[index] // width, pixels[index] % width
        mean[:] = 0
        total = np.float32(0)
        for i in range(patch_size):
            qy = wrap_index(y - i, down, wrap)
            if qy < 0:
                continue
            for j in range(patch_size):
                qx = wrap_index(x - j, across, wrap)
                if qx < 0:
                    continue
                source_row, source = row[qy, qx] + i, (column[qy, qx] + j) * channels
                surplus = np.float32(1)
                for c in range(channels):
                    surplus += excess[c, bins[source_row, source + c]]
                weight = np.float32(1) / surplus
                total += weight
                for c in range(channels):
                    mean[c] += weight * exemplar[source_row, source + c]
        for c in range(channels):
            target[y, x * channels + c] = np.int16(np.rint(mean[c] / total))
