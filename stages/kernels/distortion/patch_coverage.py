"""The pixels of a photograph that a rational Bézier patch covers, and how texture lies in them."""

from __future__ import annotations

import math

import numba
import numpy as np

_ITERATIONS = 8


@numba.njit(cache=True, nogil=True)
def _weights(t, value, slope):
    """Cubic Bernstein polynomials and their derivatives."""
    s = 1.0 - t
    value[0], value[1], value[2], value[3] = s * s * s, 3 * t * s * s, 3 * t * t * s, t * t * t
    slope[0], slope[1] = -3 * s * s, 3 * s * s - 6 * t * s
    slope[2], slope[3] = 6 * t * s - 3 * t * t, 3 * t * t


@numba.njit(cache=True, nogil=True)
def cover(controls, space, unit, cells, total, count, place, first, last):
    """Add a patch's Jacobian to the pixels that it covers, in rows ``first`` to ``last``.

    The patch is cut into ``cells`` x ``cells`` parts; in the box around each, pixels are carried back to the patch
    by Newton's method, and those that come to lie in the part belong to it.

    Parameters
    ----------
    controls : (4, 4, 3) float64, see `texloom.stages.analysis._distortion.bezier`
    space : (4, 4, 3) float64, the same surface in space, whose derivatives tell how fast texture is passed
    unit : (2,) float64, of ``space`` a unit of texture, down and across
    total : (h, w, 4) float64, sums of Jacobians: row by down, row by across, column by down, column by across
    count : (h, w) int32, patches at a pixel
    place : (h, w, 2) float64, (u, v) of the last patch
    """
    width = count.shape[1]
    bu, du, bv, dv = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    point, by_u, by_v = np.empty(3), np.empty(3), np.empty(3)
    edge = 1e-9
    for i in range(cells):
        for j in range(cells):
            top, bottom, left, right = 1e18, -1e18, 1e18, -1e18
            for corner in range(9):
                _weights((i + (corner // 3) / 2) / cells, bu, du)
                _weights((j + (corner % 3) / 2) / cells, bv, dv)
                x = y = w = 0.0
                for a in range(4):
                    for b in range(4):
                        share = bu[a] * bv[b]
                        y += share * controls[a, b, 0]
                        x += share * controls[a, b, 1]
                        w += share * controls[a, b, 2]
                top, bottom = min(top, y / w), max(bottom, y / w)
                left, right = min(left, x / w), max(right, x / w)
            slack = 1.0 + 0.1 * max(bottom - top, right - left)
            for row in range(max(first, math.ceil(top - slack)), min(last, math.floor(bottom + slack) + 1)):
                for column in range(max(0, math.ceil(left - slack)), min(width, math.floor(right + slack) + 1)):
                    u, v = (i + 0.5) / cells, (j + 0.5) / cells
                    found = False
                    for _ in range(_ITERATIONS):
                        _weights(u, bu, du)
                        _weights(v, bv, dv)
                        for k in range(3):
                            point[k] = by_u[k] = by_v[k] = 0.0
                            for a in range(4):
                                for b in range(4):
                                    point[k] += bu[a] * bv[b] * controls[a, b, k]
                                    by_u[k] += du[a] * bv[b] * controls[a, b, k]
                                    by_v[k] += bu[a] * dv[b] * controls[a, b, k]
                        w = point[2]
                        y, x = point[0] / w, point[1] / w
                        yu, xu = (by_u[0] - y * by_u[2]) / w, (by_u[1] - x * by_u[2]) / w
                        yv, xv = (by_v[0] - y * by_v[2]) / w, (by_v[1] - x * by_v[2]) / w
                        determinant = yu * xv - yv * xu
                        if abs(determinant) < 1e-12 or w <= 0:
                            break
                        away, aside = row - y, column - x
                        if abs(away) + abs(aside) < 1e-9:
                            found = True
                            break
                        u += (away * xv - aside * yv) / determinant
                        v += (aside * yu - away * xu) / determinant
                        if abs(u - 0.5) > 1.5 or abs(v - 0.5) > 1.5:
                            break
                    if not found:
                        continue
                    # a part has its first border, the last one both
                    fine = i / cells - edge * (i == 0) <= u and (
                        u < (i + 1) / cells or (i == cells - 1 and u <= 1 + edge)
                    )
                    fine = fine and j / cells - edge * (j == 0) <= v
                    fine = fine and (v < (j + 1) / cells or (j == cells - 1 and v <= 1 + edge))
                    if not fine:
                        continue
                    speed_u = speed_v = 0.0
                    for k in range(3):
                        fast_u = fast_v = 0.0
                        for a in range(4):
                            for b in range(4):
                                fast_u += du[a] * bv[b] * space[a, b, k]
                                fast_v += bu[a] * dv[b] * space[a, b, k]
                        speed_u += fast_u * fast_u
                        speed_v += fast_v * fast_v
                    down, across = unit[0] / math.sqrt(speed_u), unit[1] / math.sqrt(speed_v)
                    total[row, column, 0] += yu * down
                    total[row, column, 1] += yv * across
                    total[row, column, 2] += xu * down
                    total[row, column, 3] += xv * across
                    count[row, column] += 1
                    place[row, column, 0], place[row, column, 1] = u, v
