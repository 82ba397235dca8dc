"""Distances to features measured in a texture that is distorted."""

import math

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner

_MAX_ROUNDS = 6


@compiled
def _square(inverse, row, column, source):
    """Squared length in texture of the straight line from a pixel to another, by Simpson's rule."""
    width = inverse.shape[1]
    to_row, to_column = source // width, source % width
    here, there = inverse[row, column], inverse[to_row, to_column]
    middle = inverse[(row + to_row) // 2, (column + to_column) // 2]
    rows, columns = (row - to_row) / 6, (column - to_column) / 6
    down = (here[0] + 4 * middle[0] + there[0]) * rows + (here[1] + 4 * middle[1] + there[1]) * columns
    across = (here[2] + 4 * middle[2] + there[2]) * rows + (here[3] + 4 * middle[3] + there[3]) * columns
    return down * down + across * across


@inner
def _closer(nearest, square, inverse, row, column, side_row, side_column):
    """Let a pixel take the feature of a neighbour, if that is nearer than its own; whether it is."""
    at_row, at_column = row + side_row, column + side_column
    if at_row < 0 or at_row >= nearest.shape[0] or at_column < 0 or at_column >= nearest.shape[1]:
        return False
    source = nearest[at_row, at_column]
    if source < 0 or source == nearest[row, column]:
        return False
    offered = _square(inverse, row, column, source)
    if offered < square[row, column]:
        nearest[row, column], square[row, column] = source, offered
        return True
    return False


@compiled
def spread(nearest, square, inverse):
    """Propagate the nearest feature to all pixels, by sweeps down and up until none changes, at most six times.

    Parameters
    ----------
    nearest : (h, w) int64, changed: the nearest feature pixel, row * w + column; itself at features, else -1
    square : (h, w) float64, changed: its squared distance in texture; 0 at features, else inf
    inverse : (h, w, 4) float64, from px to texture
    """
    height, width = nearest.shape
    for _ in range(_MAX_ROUNDS):
        changed = False
        for direction in range(2):
            before = -1 if direction == 0 else 1
            for y in range(height):
                row = y if direction == 0 else height - 1 - y
                for x in range(width):
                    for side in range(-1, 2):
                        changed |= _closer(nearest, square, inverse, row, x, before, side)
                    changed |= _closer(nearest, square, inverse, row, x, 0, -1)
                for x in range(width - 1, -1, -1):
                    changed |= _closer(nearest, square, inverse, row, x, 0, 1)
        if not changed:
            break


@compiled
def walk(features, jacobian, axis, farthest, out, first, last):
    """Fill rows ``first`` to ``last`` of ``out`` with the distance to features' border along an axis of texture.

    The nearer of both ways; the line through a pixel follows the nearest pixels' Jacobians in steps of a pixel.

    Parameters
    ----------
    features : (h, w) bool
    jacobian : (h, w, 4) float32, from texture to px
    axis : 0 down the texture, 1 across
    farthest : in texture, where the line ends
    out : (h, w) float32, output; positive outside features, negative inside
    """
    height, width = features.shape
    for y in range(first, last):
        for x in range(width):
            nearest = farthest
            for side in (-1.0, 1.0):
                row, column, length = np.float64(y), np.float64(x), 0.0
                at_row, at_column = y, x
                while length < nearest:
                    down = np.float64(jacobian[at_row, at_column, axis])
                    across = np.float64(jacobian[at_row, at_column, 2 + axis])
                    rate = math.sqrt(down * down + across * across)
                    row += side * down / rate
                    column += side * across / rate
                    length += 1 / rate
                    at_row, at_column = round(row), round(column)
                    if at_row < 0 or at_row >= height or at_column < 0 or at_column >= width:
                        break
                    if features[at_row, at_column] != features[y, x]:
                        nearest = min(nearest, length)
                        break
            out[y, x] = -nearest if features[y, x] else nearest
