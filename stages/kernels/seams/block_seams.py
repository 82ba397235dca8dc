"""Costs of seams between patches of one exemplar, and the graph along whose minimum cut one is laid over others."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled

_ABSENT, _FREE, _FILLED = 0, 2, 3  # as in `texloom.stages.synthesis.stitching.seams`


@compiled
def seam_cost(pixels, slopes, offset, unit, most, squared, axis, y, x, v, u):
    """Of two neighbours along ``axis`` with sources (y, x) and (v, u), see `SeamCosts`.

    Parameters
    ----------
    pixels : (h, w, c) float32, features of the exemplar
    slopes : (2, h, w) float32, its gradients down and across, or (0, 0, 0) where they do not count
    offset : float32, added to gradients
    unit, most : float32, fixed-point steps of a cost of 1, and the greatest cost in steps
    squared : whether squares are summed
    """
    down, across = 1 - axis, axis
    if y + down == v and x + across == u:
        return np.int64(0)
    last, end = pixels.shape[0] - 1, pixels.shape[1] - 1
    y1, x1 = min(max(y + down, 0), last), min(max(x + across, 0), end)
    v0, u0 = min(max(v - down, 0), last), min(max(u - across, 0), end)
    y, x, v, u = min(max(y, 0), last), min(max(x, 0), end), min(max(v, 0), last), min(max(u, 0), end)
    here, there = np.float32(0), np.float32(0)
    for channel in range(pixels.shape[2]):
        one = pixels[y, x, channel] - pixels[v0, u0, channel]
        other = pixels[y1, x1, channel] - pixels[v, u, channel]
        here += one * one
        there += other * other
    value = here + there if squared else np.sqrt(here) + np.sqrt(there)
    if slopes.size:
        slope = slopes[axis, y, x] + slopes[axis, y1, x1] + slopes[axis, v0, u0] + slopes[axis, v, u]
        value = value / (slope + offset)
    return np.int64(min(np.rint(value * unit), most))


@compiled
def seam_costs(costs, axis, one, other, found):
    """Fill ``found``, (n,) int64, with those of pairs of sources, (n, 2) int32; ``costs``: see `seam_cost`."""
    pixels, slopes, offset, unit, most, squared = costs
    for index in range(len(found)):
        found[index] = seam_cost(
            pixels, slopes, offset, unit, most, squared, axis,
            one[index, 0], one[index, 1], other[index, 0], other[index, 1],
        )  # fmt: skip


@compiled
def seams_between(costs, match, state):
    """Sum of the costs of all seams between pixels that are not absent.

    Parameters
    ----------
    costs : see `seam_cost`
    match : (m, n, 2) int32, sources
    state : (m, n) int8
    """
    pixels, slopes, offset, unit, most, squared = costs
    total = np.int64(0)
    for axis in range(2):
        for y in range(state.shape[0] - (axis == 0)):
            for x in range(state.shape[1] - (axis == 1)):
                v, u = y + (axis == 0), x + (axis == 1)
                if state[y, x] != _ABSENT and state[v, u] != _ABSENT:
                    total += seam_cost(
                        pixels, slopes, offset, unit, most, squared, axis,
                        match[y, x, 0], match[y, x, 1], match[v, u, 0], match[v, u, 1],
                    )  # fmt: skip
    return total


@compiled
def seam_graph(costs, old, new, state, node, keep, take, beside, capacity):
    """Fill a graph in which a minimum cut parts the pixels that take their new sources from others.

    Parameters
    ----------
    costs : see `seam_cost`
    old, new : (m, n, 2) int32, sources
    state : (m, n) int8
    node : (m, n) int32, number of each free pixel
    keep, take : (k,) int64, costs of keeping and of replacing each of these beside others
    beside, capacity : (k, 4) int32 and int64, see `push_flow`
    """
    pixels, slopes, offset, unit, most, squared = costs
    given = pixels, slopes, offset, unit, most, squared
    for axis in range(2):
        for y in range(state.shape[0] - (axis == 0)):
            for x in range(state.shape[1] - (axis == 1)):
                v, u = y + (axis == 0), x + (axis == 1)
                one, other = state[y, x], state[v, u]
                if _ABSENT in (one, other) or _FREE not in (one, other):
                    continue
                a, b, c, d = old[y, x, 0], old[y, x, 1], old[v, u, 0], old[v, u, 1]
                e, f, g, h = new[y, x, 0], new[y, x, 1], new[v, u, 0], new[v, u, 1]
                first, second = node[y, x], node[v, u]
                if one == _FREE and other == _FREE:
                    stay = seam_cost(*given, axis, a, b, c, d)
                    right = seam_cost(*given, axis, a, b, g, h)
                    left = seam_cost(*given, axis, e, f, c, d)
                    stay = min(stay, left + right)
                    share = min(max(stay // 2, stay - left), right)
                    keep[first] += share
                    keep[second] += stay - share
                    beside[first, axis], beside[second, axis + 2] = second, first
                    capacity[first, axis] = right - share
                    capacity[second, axis + 2] = left - (stay - share)
                elif one == _FREE:
                    if other == _FILLED:
                        c, d = g, h
                    keep[first] += seam_cost(*given, axis, a, b, c, d)
                    take[first] += seam_cost(*given, axis, e, f, c, d)
                else:
                    if one == _FILLED:
                        a, b = e, f
                    keep[second] += seam_cost(*given, axis, a, b, c, d)
                    take[second] += seam_cost(*given, axis, a, b, g, h)
