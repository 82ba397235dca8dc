"""The pixels of a photograph that a rational Bézier patch covers, and the texture's Jacobian at them."""

import math

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner

_ITERATIONS = 8
_RESIDUAL = 1e-9  # px at which Newton's method has converged
_EDGE = 1e-9  # of u and v beyond the patch
_NEAR = 0.75  # cells from a cell's centre within which pixels are searched
_CELL_EDGE = 1e-8  # of a cell: more than u and v differ by when they are found from two cells


@compiled
def _weights(t, value, slope):
    """Cubic Bernstein polynomials and their derivatives."""
    s = 1.0 - t
    value[0], value[1], value[2], value[3] = s * s * s, 3 * t * s * s, 3 * t * t * s, t * t * t
    slope[0], slope[1] = -3 * s * s, 3 * s * s - 6 * t * s
    slope[2], slope[3] = 6 * t * s - 3 * t * t, 3 * t * t


@inner
def _evaluate(controls, weights, points):
    """Fill ``points``, (3, 3), with the surface's point and its derivatives by u and by v."""
    for k in range(3):
        point = by_u = by_v = 0.0
        for b in range(4):
            value = slope = 0.0
            for a in range(4):
                value += weights[0, a] * controls[a, b, k]
                slope += weights[1, a] * controls[a, b, k]
            point += weights[2, b] * value
            by_u += weights[2, b] * slope
            by_v += weights[3, b] * value
        points[0, k], points[1, k], points[2, k] = point, by_u, by_v


@inner
def _sample_cell(controls, i, j, cells, weights, points, corners):
    """Top, bottom, left and right of a cell's corners, edge midpoints and centre, px, with some slack.

    ``corners``, (4, 2), is filled with its corners (0, 0), (0, 1), (1, 0) and (1, 1), row and column.
    """
    top, bottom, left, right = 1e18, -1e18, 1e18, -1e18
    for number in range(9):
        down, across = number // 3, number % 3
        _weights((i + down / 2) / cells, weights[0], weights[1])
        _weights((j + across / 2) / cells, weights[2], weights[3])
        _evaluate(controls, weights, points)
        y, x = points[0, 0] / points[0, 2], points[0, 1] / points[0, 2]
        top, bottom = min(top, y), max(bottom, y)
        left, right = min(left, x), max(right, x)
        if down != 1 and across != 1:
            corners[down + across // 2, 0], corners[down + across // 2, 1] = y, x
    slack = 1.0 + 0.1 * max(bottom - top, right - left)
    return top - slack, bottom + slack, left - slack, right + slack


@inner
def _plane_through(corners, back):
    """Fill ``back``, (3, 3): the homography from (row, column, 1) to (down * w, across * w, w), 0..1 in a cell.

    It is exact where the cell is a plane. The middle of the cell belongs to all pixels if there is no homography.
    """
    y0, x0 = corners[0]
    y2, x2 = corners[1]  # one across
    y1, x1 = corners[2]  # one down
    y3, x3 = corners[3]
    sum_y, sum_x = y0 - y1 + y3 - y2, x0 - x1 + x3 - x2
    determinant = (y1 - y3) * (x2 - x3) - (x1 - x3) * (y2 - y3)
    back[:] = 0
    if abs(determinant) < 1e-9:
        back[0, 2] = back[1, 2] = 0.5
        back[2, 2] = 1
        return
    g = (sum_y * (x2 - x3) - sum_x * (y2 - y3)) / determinant
    h = ((y1 - y3) * sum_x - (x1 - x3) * sum_y) / determinant
    a, b, c = y1 - y0 + g * y1, y2 - y0 + h * y2, y0
    d, e, f = x1 - x0 + g * x1, x2 - x0 + h * x2, x0
    back[0, 0], back[0, 1], back[0, 2] = e - f * h, c * h - b, b * f - c * e
    back[1, 0], back[1, 1], back[1, 2] = f * g - d, a - c * g, c * d - a * f
    back[2, 0], back[2, 1], back[2, 2] = d * h - e * g, b * g - a * h, a * e - b * d


@inner
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
        _evaluate(controls, weights, points)
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


@inner
def _cell_of(t, cells):
    """The cell of a coordinate, -1 beyond the patch; near a border between two always the second."""
    if t < -_EDGE or t > 1 + _EDGE:
        return -1
    return min(max(math.floor(t * cells + _CELL_EDGE), 0), cells - 1)


@compiled
def cover(controls, space, unit, cells, total, count, place, first, last):
    """Add a patch's Jacobian to the pixels that it covers, in rows ``first`` to ``last``.

    The patch is cut into ``cells`` x ``cells`` cells. Newton's method finds (u, v) of the pixels in and near each
    cell from where they would be if the cell were a plane; a pixel counts in the one cell that (u, v) lie in.

    Parameters
    ----------
    controls : (4, 4, 3) float64, see `texloom.stages.analysis.photographs.bezier`
    space : (4, 4, 3) float64, the same surface in space, whose derivatives are the speed of texture along u and v
    unit : (2,) float64, of ``space`` a unit of texture, down and across
    total : (h, w, 4) float64, sums of Jacobians: row by down, row by across, column by down, column by across
    count : (h, w) int32, patches at a pixel
    place : (h, w, 2) float64, (u, v) of the last patch
    """
    width = count.shape[1]
    weights, points, slopes = np.empty((4, 4)), np.empty((3, 3)), np.empty(4)
    corners, back = np.empty((4, 2)), np.empty((3, 3))
    for i in range(cells):
        for j in range(cells):
            top, bottom, left, right = _sample_cell(controls, i, j, cells, weights, points, corners)
            _plane_through(corners, back)
            for row in range(max(first, math.ceil(top)), min(last, math.floor(bottom) + 1)):
                for column in range(max(0, math.ceil(left)), min(width, math.floor(right) + 1)):
                    w = back[2, 0] * row + back[2, 1] * column + back[2, 2]
                    if w == 0:
                        continue
                    down = (back[0, 0] * row + back[0, 1] * column + back[0, 2]) / w
                    across = (back[1, 0] * row + back[1, 1] * column + back[1, 2]) / w
                    if not (abs(down - 0.5) <= _NEAR and abs(across - 0.5) <= _NEAR):
                        continue
                    u, v, converged = _invert(
                        controls, row, column, (i + down) / cells, (j + across) / cells, weights, points, slopes
                    )
                    if not converged or _cell_of(u, cells) != i or _cell_of(v, cells) != j:
                        continue
                    _evaluate(space, weights, points)
                    speed_u = speed_v = 0.0
                    for k in range(3):
                        speed_u += points[1, k] * points[1, k]
                        speed_v += points[2, k] * points[2, k]
                    by_down, by_across = unit[0] / math.sqrt(speed_u), unit[1] / math.sqrt(speed_v)
                    total[row, column, 0] += slopes[0] * by_down
                    total[row, column, 1] += slopes[1] * by_across
                    total[row, column, 2] += slopes[2] * by_down
                    total[row, column, 3] += slopes[3] * by_across
                    count[row, column] += 1
                    place[row, column, 0], place[row, column, 1] = u, v
