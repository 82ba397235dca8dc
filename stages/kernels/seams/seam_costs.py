"""Costs of seams between patches of one exemplar."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner


@compiled
def seam_cost(costs, axis, y, x, v, u):
    """Of two neighbours along ``axis`` with sources (y, x) and (v, u), see `SeamCosts`.

    Parameters
    ----------
    costs : features of the exemplar, (h, w, c) float32; its gradients down and across, (2, h, w) float32, or
        (0, 0, 0) where they do not count; what is added to gradients, fixed-point steps of a cost of 1, and the
        greatest cost in steps, float32; whether squares are summed
    """
    pixels, slopes, offset, unit, most, squared = costs
    down, across = 1 - axis, axis
    if y + down == v and x + across == u:
        return np.int64(0)
    last, end = pixels.shape[0] - 1, pixels.shape[1] - 1
    y1, x1 = min(max(y + down, 0), last), min(max(x + across, 0), end)
    v0, u0 = min(max(v - down, 0), last), min(max(u - across, 0), end)
    y, x, v, u = min(max(y, 0), last), min(max(x, 0), end), min(max(v, 0), last), min(max(u, 0), end)
    value = _difference(pixels, squared, y, x, y1, x1, v0, u0, v, u)
    if slopes.size:
        slope = slopes[axis, y, x] + slopes[axis, y1, x1] + slopes[axis, v0, u0] + slopes[axis, v, u]
        value = value / (slope + offset)
    return np.int64(min(np.rint(value * unit), most))


@inner
def seam_costs_both_ways(costs, axis, y, x, v, u):
    """Of two neighbours along ``axis``, with sources in one piece or the other, of which the first one's are given.

    The cost where the first has (y, x) and the second is of the other piece, and where the first has (v, u): the
    same as `seam_cost` twice, in less time.
    """
    pixels, slopes, offset, unit, most, squared = costs
    if y == v and x == u:
        return np.int64(0), np.int64(0)
    down, across = 1 - axis, axis
    last, end = pixels.shape[0] - 1, pixels.shape[1] - 1
    y1, x1 = min(max(y + down, 0), last), min(max(x + across, 0), end)
    v1, u1 = min(max(v + down, 0), last), min(max(u + across, 0), end)
    y, x, v, u = min(max(y, 0), last), min(max(x, 0), end), min(max(v, 0), last), min(max(u, 0), end)
    value = _difference(pixels, squared, y, x, y1, x1, v, u, v1, u1)
    one = other = value
    if slopes.size:
        along = slopes[axis]
        first, second = along[y, x], along[y1, x1]
        third, fourth = along[v, u], along[v1, u1]
        one = value / (first + second + third + fourth + offset)
        other = value / (third + fourth + first + second + offset)
    return np.int64(min(np.rint(one * unit), most)), np.int64(min(np.rint(other * unit), most))


@inner
def _difference(pixels, squared, y, x, y1, x1, v, u, v1, u1):
    """Between two pieces at both pixels of a seam: (y, x) and (y1, x1) of one, (v, u) and (v1, u1) of the other."""
    here, there = np.float32(0), np.float32(0)
    for channel in range(pixels.shape[2]):
        one = pixels[y, x, channel] - pixels[v, u, channel]
        other = pixels[y1, x1, channel] - pixels[v1, u1, channel]
        here += one * one
        there += other * other
    return here + there if squared else np.sqrt(here) + np.sqrt(there)


@compiled
def seam_costs(costs, axis, one, other, found):
    """Fill ``found``, (n,) int64, with those of pairs of sources, (n, 2) int32; ``costs``: see `seam_cost`."""
    for index in range(len(found)):
        found[index] = seam_cost(costs, axis, one[index, 0], one[index, 1], other[index, 0], other[index, 1])
