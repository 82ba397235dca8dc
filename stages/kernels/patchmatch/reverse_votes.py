"""Votes of exemplar patches for the target pixels over which they lie best."""

from typing import Any, NamedTuple

from texloom.stages.kernels.core.compiled import compiled
from texloom.stages.kernels.patchmatch.search import wrap_index


class ReverseVotes(NamedTuple):
    """Exemplar patches in the order of the target rows that they are matched with."""

    row: Any
    """(n,) int32, top row of each exemplar patch"""
    column: Any
    """(n,) int32, its left column"""
    target_column: Any
    """(n,) int32, left column of its match"""
    starts: Any
    """(p + 1,) int64: the patches matched with target row y are ``starts[y]`` to ``starts[y + 1]``"""
    exemplar: Any
    """(h, w * channels), of any type"""
    channels: int
    wrap: Any
    """texloom.stages.vocabulary.facts.Wraps; a target that wraps down has p rows, else p + patch_size - 1"""


@compiled
def reverse_vote_sums(votes, window, line_window, top, sums, weights, first, last):
    """Fill rows ``first`` to ``last`` of ``sums`` with the weighted sum of the votes, and ``weights`` with theirs.

    Parameters
    ----------
    votes : ReverseVotes
    window : (patch_size,) float64, weights along one side of a patch
    line_window : (patch_size * channels,) float64, each weight repeated for all channels
    top : target row of the first row of ``sums``
    sums : (rows, (q + patch_size - 1) * channels) float64; the right margin is work space where it wraps
    weights : (rows, q + patch_size - 1) float64
    """
    row, column, target_column, starts, exemplar, channels, wrap = votes
    size, run = window.size, line_window.size
    down, across = starts.size - 1, weights.shape[1] - size + 1
    for index in range(first, last):
        line, weight = sums[index], weights[index]
        line[:] = 0
        weight[:] = 0
        for i in range(size):
            y = wrap_index(top + index - i, down, wrap.down)
            if y < 0:
                continue
            for patch in range(starts[y], starts[y + 1]):
                left = column[patch] * channels
                source = exemplar[row[patch] + i, left : left + run]
                x = target_column[patch]
                into = line[x * channels : x * channels + run]
                for k in range(run):
                    into[k] += window[i] * line_window[k] * source[k]
                for j in range(size):
                    weight[x + j] += window[i] * window[j]
        if wrap.across:
            for k in range((size - 1) * channels):
                line[k] += line[across * channels + k]
            for j in range(size - 1):
                weight[j] += weight[across + j]
