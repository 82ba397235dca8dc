"""The pixels of a photograph that a rational Bézier patch covers, and the texture's Jacobian at them."""

import math

import numba
import numpy as np

_ITERATIONS = 8
_RESIDUAL = 1e-9  # px at which Newton's method has converged
_EDGE = 1e-9  # of u and v beyond the patch
_CELL_EDGE = 1e-8  # of a cell: more than u and v differ by when they are found from two cells


@numba.njit(cache=True, nogil=True)
def _weights(t, value, slope):
    """Cubic Bernstein polynomials and their derivatives."""
    s = 1.0 - t
    value[0], value[1], value[2], value[3] = s * s * s, 3 * t * s * s, 3 * t * t * s, t * t * t
    slope[0], slope[1] = -3 * s * s, 3 * s * s - 6 * t * s
    slope[2], slope[3] = 6 * t * s - 3 * t * t, 3 * t * t


@numba.njit(cache=True, nogil=True)
def _combine(controls, along_u, along_v, out):
    """Fill ``out``, (3,), with the control points' sum under products of weights."""
    for k in range(3):
        total = 0.0
        for a in range(4):
            for b in range(4):
                total += along_u[a] * along_v[b] * controls[a, b, k]
        out[k] = total


@numba.njit(cache=True, nogil=True)
def _bounding_box(controls, i, j, cells, weights, point):
    """Top, bottom, left and right of a cell's corners, edge midpoints and centre, px, with some slack."""
    top, bottom, left, right = 1e18, -1e18, 1e18, -1e18
    for corner in range(9):
        _weights((i + (corner // 3) / 2) / cells, weights[0], weights[1])
        _weights((j + (corner % 3) / 2) / cells, weights[2], weights[3])
        _combine(controls, weights[0], weights[2], point)
        y, x = point[0] / point[2], point[1] / point[2]
        top, bottom = min(top, y), max(bottom, y)
        left, right = min(left, x), max(right, x)
    slack = 1.0 + 0.1 * max(bottom - top, right - left)
    return top - slack, bottom + slack, left - slack, right + slack


@numba.njit(cache=True, nogil=True)
def _invert(controls, row, column, u, v, weights, points, slopes):
    """Find (u, v) of a pixel by Newton's method; returns them and whether it has converged.

    Then ``weights`` are those of u, their derivatives, those of v and theirs, and ``slopes`` the derivatives of row
    by u, row by v, column by u and column by v.

    The equations are those of the homogeneous point, (row * w, column * w), which are linear for a plane.
    """
    point, by_u, by_v = points[0], points[1], points[2]
    for _ in range(_ITERATIONS):
        _weights(u, weights[0], weights[1])
        _weights(v, weights[2], weights[3])
        _combine(controls, weights[0], weights[2], point)
        _combine(controls, weights[1], weights[2], by_u)
        _combine(controls, weights[0], weights[3], by_v)
        yu, xu = by_u[0] - row * by_u[2], by_u[1] - column * by_u[2]
        yv, xv = by_v[0] - row * by_v[2], by_v[1] - column * by_v[2]
        down, across = row * point[2] - point[0], column * point[2] - point[1]
        w = point[2]
        if w > 0 and abs(down) + abs(across) < _RESIDUAL * w:
            slopes[0], slopes[1], slopes[2], slopes[3] = yu / w, yv / w, xu / w, xv / w
            return u, v, True
        determinant = yu * xv - yv * xu
        if abs(determinant) < 1e-12:
            break
        u += (down * xv - across * yv) / determinant
        v += (across * yu - down * xu) / determinant
        if abs(u - 0.5) > 1.5 or abs(v - 0.5) > 1.5:
            break
    return u, v, False


@numba.njit(cache=True, nogil=True)
def _cell_of(t, cells):
    """The cell of a coordinate, -1 beyond the patch; near a border between two always the second."""
    if t < -_EDGE or t > 1 + _EDGE:
        return -1
    return min(max(math.floor(t * cells + _CELL_EDGE), 0), cells - 1)


@numba.njit(cache=True, nogil=True)
def cover(controls, space, unit, cells, total, count, place, first, last):
    """Add a patch's Jacobian to the pixels that it covers, in rows ``first`` to ``last``.

    The patch is cut into ``cells`` x ``cells`` cells. Newton's method finds (u, v) of the pixels in the box around
    each cell from the cell's centre; a pixel counts in the one cell that (u, v) lie in.

    Parameters
    ----------
    controls : (4, 4, 3) float64, see `texloom.stages.analysis._distortion.bezier`
    space : (4, 4, 3) float64, the same surface in space, whose derivatives are the speed of texture along u and v
    unit : (2,) float64, of ``space`` a unit of texture, down and across
    total : (h, w, 4) float64, sums of Jacobians: row by down, row by across, column by down, column by across
    count : (h, w) int32, patches at a pixel
    place : (h, w, 2) float64, (u, v) of the last patch
    """
    width = count.shape[1]
    weights, points, slopes = np.empty((4, 4)), np.empty((3, 3)), np.empty(4)
    for i in range(cells):
        for j in range(cells):
            top, bottom, left, right = _bounding_box(controls, i, j, cells, weights, points[0])
            for row in range(max(first, math.ceil(top)), min(last, math.floor(bottom) + 1)):
                for column in range(max(0, math.ceil(left)), min(width, math.floor(right) + 1)):
                    u, v, converged = _invert(
                        controls, row, column, (i + 0.5) / cells, (j + 0.5) / cells, weights, points, slopes
                    )
                    if not converged or _cell_of(u, cells) != i or _cell_of(v, cells) != j:
                        continue
                    _combine(space, weights[1], weights[2], points[1])
                    _combine(space, weights[0], weights[3], points[2])
                    speed_u = speed_v = 0.0
                    for k in range(3):
                        speed_u += points[1, k] * points[1, k]
                        speed_v += points[2, k] * points[2, k]
                    down, across = unit[0] / math.sqrt(speed_u), unit[1] / math.sqrt(speed_v)
                    total[row, column, 0] += slopes[0] * down
                    total[row, column, 1] += slopes[1] * across
                    total[row, column, 2] += slopes[2] * down
                    total[row, column, 3] += slopes[3] * across
                    count[row, column] += 1
                    place[row, column, 0], place[row, column, 1] = u, v
