"""Basins of a picture: what the watersheds between its valleys surround."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner


@compiled
def flood(values, order, depth, basin):
    """Fill ``basin`` with the number of one pixel of the basin that each pixel belongs to.

    Pixels are taken from the lowest on. One without flooded neighbours begins a basin; any other joins the basin of
    its lowest neighbour, and where it meets another, the two become one unless both are ``depth`` deep there.

    Parameters
    ----------
    values : (h, w) float32
    order : (h * w,) int64, pixels by rising value
    depth : float32
    basin : (h * w,) int64
    """
    height, width = values.shape
    lowest = np.empty(height * width, np.float32)  # of a basin's first pixel
    found = np.empty(4, np.int64)
    basin[:] = -1
    for place in order:
        row, column = place // width, place % width
        value = values[row, column]
        count, least = 0, np.int64(-1)
        for side in range(4):
            down, across = row + (side == 3) - (side == 0), column + (side == 2) - (side == 1)
            if down < 0 or across < 0 or down >= height or across >= width:
                continue
            other = down * width + across
            if basin[other] < 0:
                continue
            if least < 0 or values[down, across] < values[least // width, least % width]:
                least = other
            found[count] = other
            count += 1
        if count == 0:
            basin[place] = place
            lowest[place] = value
            continue
        own = _root(basin, least)
        basin[place] = own
        for index in range(count):
            other = _root(basin, found[index])
            if other != own and value - max(lowest[own], lowest[other]) < depth:
                if lowest[other] < lowest[own] or (lowest[other] == lowest[own] and other < own):
                    own, other = other, own
                basin[other] = own
    for place in order:
        basin[place] = _root(basin, place)


@inner
def _root(basin, place):
    while basin[place] != place:
        basin[place] = basin[basin[place]]
        place = basin[place]
    return place
