"""Voting: every target pixel becomes an average of the exemplar pixels that the patches over it propose."""

from typing import Any, NamedTuple

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.patchmatch.search import wrap_index


class Votes(NamedTuple):
    """Target patches and the exemplar patches that they are matched with."""

    row: Any
    """(p, q) int32"""
    column: Any
    """(p, q) int32"""
    exemplar: Any
    """(h, w * channels) float32 or int16; int16 for `copy_votes`"""
    channels: int
    patch_size: int
    wrap: Any
    """texloom.stages.vocabulary.facts.Wraps; along an axis that wraps the target has as many pixels as patches, at
    least patch_size - 1, else patch_size - 1 more"""


@compiled
def find_runs(row, column, patch_size, wrap, longest, first, last):
    """Find runs of patches side by side whose matches are side by side, of those over rows ``first`` to ``last``.

    No run crosses a multiple of ``longest``, so that more of them are like the one above. For ``row``, ``column``,
    ``patch_size`` and ``wrap`` see `Votes`, which is a type for each type of exemplar.

    Returns
    -------
    (last - first + patch_size - 1, q, 6) int32, by row, from that of the patches which end in row ``first``: of
    each run its first patch and length, the row and column of that one's match, in how many rows above the run is
    the same, and whether it is in the row below; and the number of runs of each row.
    """
    down, across = row.shape
    before = patch_size - 1
    runs = np.empty((last - first + before, across, 6), np.int32)
    count = np.zeros(runs.shape[0], np.int64)
    for k in range(runs.shape[0]):
        y = wrap_index(first - before + k, down, wrap.down)
        if y < 0:
            continue
        x, beside = 0, 0
        while x < across:
            r, c = row[y, x], column[y, x]
            end = min(across, x - x % longest + longest)
            n = 1
            while x + n < end and column[y, x + n] == c + n and row[y, x + n] == r:
                n += 1
            above = 0
            if k > 0:
                while beside < count[k - 1] and runs[k - 1, beside, 0] < x:
                    beside += 1
                if beside < count[k - 1]:
                    other = runs[k - 1, beside]
                    if other[0] == x and other[1] == n and other[2] == r - 1 and other[3] == c:
                        above = other[4] + 1
                        other[5] = 1
            run = runs[k, count[k]]
            run[0], run[1], run[2], run[3], run[4], run[5] = x, n, r, c, above, 0
            count[k] += 1
            x += n
    return runs, count


@compiled
def vote_sums(votes, shares, down, runs, count, sums):
    """Fill ``sums`` with the weighted sum of all votes for each target pixel of some rows, by runs of patches.

    Patches of a run vote for the same pixels, so their weights are added first, and those of the same runs one
    above the other. All rows of such a block follow one another: run by run for each row took three times as long.

    Parameters
    ----------
    votes : Votes, of float32, or of int16, which is added in single precision too
    shares : (n, (n + patch_size - 1) * channels) float32, for runs of up to n patches: the sum of their weights
        along rows for each of the values that they cover
    down : (patch_size + 1,) float32, sums of the weights of a patch's first rows, from none to all
    runs, count : of these rows, see `find_runs`; whole numbers are added exactly, others are to have no runs above
        one another, lest their rounding depends on which rows these are
    sums : (rows, (q + patch_size - 1) * channels) float32; the right margin is work space where it wraps
    """
    exemplar, channels, before = votes.exemplar, votes.channels, votes.patch_size - 1
    sums[:] = 0
    for k in range(runs.shape[0]):
        for j in range(count[k]):
            run = runs[k, j]
            if run[5]:
                continue  # counted with the run below
            x, n, r, c, above = run[0], run[1], run[2] - run[4], run[3], run[4]
            values = (n + before) * channels
            share = shares[n - 1, :values]
            top = k - before - above
            for i in range(max(0, -top), min(above + before + 1, sums.shape[0] - top)):
                weight = down[min(i, before) + 1] - down[max(i - above, 0)]
                source = exemplar[r + i, c * channels : c * channels + values]
                into = sums[top + i, x * channels : x * channels + values]
                for m in range(values):
                    into[m] += weight * share[m] * source[m]
    if votes.wrap.across:
        across = votes.row.shape[1]
        for y in range(sums.shape[0]):
            for m in range(before * channels):
                sums[y, m] += sums[y, across * channels + m]


@compiled(error_model="numpy")  # a test for zero would prevent vectors
def round_votes(sums, weights_across, weights_down, target, first, last):
    """Set rows ``first`` to ``last`` of the int16 ``target`` to the votes' mean; halves are rounded up.

    ``sums`` are those of these rows, float32, whole numbers.
    The weight of all votes for a value is the product of its entries in ``weights_down`` and ``weights_across``,
    float64. The quotients of such small numbers are never rounded to a whole number that they do not reach, and
    vectors of them are divided faster than integers.
    """
    for y in range(first, last):
        line = sums[y - first, : weights_across.size]
        for k in range(weights_across.size):
            weight = weights_across[k] * weights_down[y]
            target[y, k] = np.int16(np.floor((2.0 * line[k] + weight) / (2.0 * weight)))


@compiled
def weighted_values(exemplar, bins, excess, runs, count, places, patch_size, filled, number, table, first, last):
    """Fill in rows ``first`` to ``last`` of ``table`` what votes for the pixels add that some rows are made of.

    A vote for a colour in bins b_c weighs 1 / (1 + sum over channels of ``excess[c, b_c]``) [Kopf2007]_. Only few
    of the pixels of a large exemplar vote in some rows, so that the runs of these are followed.

    Parameters
    ----------
    exemplar : (h, w * channels) int16
    bins : (h, w * channels) uint8, histogram bin of every exemplar value
    excess : (channels, bins) float32, pixels of the target beyond the exemplar's share, 0 where there are too few
    runs, count : see `find_runs`, for all rows
    places : (n,) int64, the rows
    filled : (h, w) uint8, set to ``number`` where the table is filled; other numbers are of earlier rows
    table : (h, w * (channels + 1)) float32, output: the weighted values of each pixel, and its weight
    """
    channels, before = excess.shape[0], patch_size - 1
    for place in places:
        for i in range(before + 1):
            k = place + before - i
            for j in range(count[k]):
                run = runs[k, j]
                y = run[2] + i
                if y < first or y >= last or (run[5] and i > 0):
                    continue
                for x in range(run[3], run[3] + run[1] + before):
                    if filled[y, x] == number:
                        continue
                    filled[y, x] = number
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


@compiled
def count_bins(values, lows, widths, counts):
    """Add the histograms of ``values``, (h, w * channels) int16, to ``counts``; see `histogram_votes`."""
    channels = lows.size
    for y in range(values.shape[0]):
        for x in range(values.shape[1] // channels):
            for c in range(channels):
                counts[c, _bin(values[y, x * channels + c], lows[c], widths[c], counts.shape[1])] += 1


@compiled
def surplus(counts, wanted):
    """How far ``counts`` exceed ``wanted``, both (channels, bins), float32; 0 where they do not."""
    excess = np.empty(counts.shape, np.float32)
    for c in range(counts.shape[0]):
        for b in range(counts.shape[1]):
            excess[c, b] = max(0.0, counts[c, b] - wanted[c, b])
    return excess


@inner
def _add_runs(votes, shares, runs, count, place, line):
    """Fill ``line`` with the votes for a row, of the runs from ``place`` on."""
    exemplar, channels, before = votes.exemplar, votes.channels, votes.patch_size - 1
    line[:] = 0
    for i in range(before + 1):
        k = place + before - i
        for j in range(count[k]):
            run = runs[k, j]
            if run[5] and i > 0:
                continue  # counted with the run below
            x, n, r, c = run[0], run[1], run[2], run[3]
            rows = np.float32(min(run[4], before - i) + 1)
            values = (n + before) * channels
            share = shares[n - 1, :values]
            source = exemplar[r + i, c * channels : c * channels + values]
            into = line[x * channels : x * channels + values]
            for m in range(values):
                into[m] += rows * share[m] * source[m]
    if votes.wrap.across:
        across = votes.row.shape[1]
        for m in range(before * channels):
            line[m] += line[across * channels + m]


@compiled
def histogram_votes(
    votes, shares, runs, count, lows, widths, rows, stops, target, counts, wanted, exemplar, bins, filled, is_filled
):
    """Set rows of the target to a weighted mean that avoids colours which the target has too often.

    Parameters
    ----------
    votes : Votes, of the table that `weighted_values` fills
    shares : see `vote_sums`; of votes of equal weight
    runs, count : see `find_runs`, for all rows
    lows, widths : (channels,) float32, lower end and width of the histograms' bins
    rows : (n,) int64
    stops : (m,) int64, where each chunk of ``rows`` ends
    target : (H, W * channels) int16, changed in place
    counts : (channels, bins) int64, histograms of the target, or anything to which their change is added
    wanted : (channels, bins) float64, what they should be
    exemplar, bins, filled : see `weighted_values`
    is_filled : the table is; else it is filled by ``counts`` before each chunk, at most 255, as none of it is yet
    """
    channels = lows.size
    sums = np.empty((votes.row.shape[1] + votes.patch_size - 1) * votes.channels, np.float32)
    start, number = 0, np.uint8(0)
    for stop in stops:
        if not is_filled:
            number += np.uint8(1)
            weighted_values(
                exemplar, bins, surplus(counts, wanted), runs, count, rows[start:stop], votes.patch_size, filled,
                number, votes.exemplar, np.int64(0), exemplar.shape[0],
            )  # fmt: skip
        for y in rows[start:stop]:
            _add_runs(votes, shares, runs, count, y, sums)
            for x in range(target.shape[1] // channels):
                total = sums[x * votes.channels : (x + 1) * votes.channels]
                for c in range(channels):
                    value = np.int16(np.rint(total[c] / total[channels]))
                    counts[c, _bin(target[y, x * channels + c], lows[c], widths[c], counts.shape[1])] -= 1
                    counts[c, _bin(value, lows[c], widths[c], counts.shape[1])] += 1
                    target[y, x * channels + c] = value
        start = stop
