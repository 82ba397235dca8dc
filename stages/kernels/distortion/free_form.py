"""Free-form deformation: points moved by a lattice of control points under a cubic B-spline.

A lattice of ``m - 3`` by ``n - 3`` cells has (m, n) control points, one row and column before the box and two
beyond it. One that wraps around has as many control points as cells.
"""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled
def _place(position, low, spacing, cells, wrap):
    """The cell along one axis that holds a position, and the weights of the four control points around it."""
    at = (position - low) / spacing
    if not wrap:
        at = min(max(at, 0.0), float(cells))
    cell = np.int64(np.floor(at))
    if not wrap:
        cell = min(cell, cells - 1)
    t = at - cell
    rest = 1.0 - t
    first = rest * rest * rest / 6.0
    second = (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0
    third = (-3.0 * t * t * t + 3.0 * t * t + 3.0 * t + 1.0) / 6.0
    return cell, (first, second, third, t * t * t / 6.0)


@compiled
def approximate(positions, values, low, spacing, wrap, control):
    """Fill a control lattice so that its spline comes near to scattered values.

    Each value would be met exactly by the control points around it that are least in their squares; where several
    values ask for a control point, they are averaged by the squares of its weights.

    Parameters
    ----------
    positions, values : (n, 2) float64, px
    low, spacing : (2,) float64, px: the box's first corner, and the sides of a control cell
    control : (m, n, 2) float64, output; 0 where nothing is near
    """
    rows, columns = control.shape[0], control.shape[1]
    beyond = 0 if wrap else 3
    total = np.zeros((rows, columns))
    control[:] = 0.0
    for index in range(positions.shape[0]):
        row, down = _place(positions[index, 0], low[0], spacing[0], rows - beyond, wrap)
        column, across = _place(positions[index, 1], low[1], spacing[1], columns - beyond, wrap)
        squares = 0.0
        for k in range(4):
            for m in range(4):
                squares += (down[k] * across[m]) ** 2
        for k in range(4):
            for m in range(4):
                weight = down[k] * across[m]
                i, j = row + k, column + m
                if wrap:
                    i, j = (i - 1) % rows, (j - 1) % columns
                total[i, j] += weight * weight
                for axis in range(2):
                    control[i, j, axis] += weight * weight * (weight * values[index, axis] / squares)
    for i in range(rows):
        for j in range(columns):
            if total[i, j] > 0.0:
                control[i, j] /= total[i, j]


@compiled
def deform(control, low, spacing, wrap, positions):
    """Add to each of ``positions`` the spline's value there; beyond the box that at its border.

    Parameters
    ----------
    control : (m, n, 2) float64, px
    low, spacing : (2,) float64, px
    positions : (n, 2) float64, px, changed in place
    """
    rows, columns = control.shape[0], control.shape[1]
    beyond = 0 if wrap else 3
    for index in range(positions.shape[0]):
        row, down = _place(positions[index, 0], low[0], spacing[0], rows - beyond, wrap)
        column, across = _place(positions[index, 1], low[1], spacing[1], columns - beyond, wrap)
        moved_row, moved_column = 0.0, 0.0
        for k in range(4):
            i = (row + k - 1) % rows if wrap else row + k
            for m in range(4):
                j = (column + m - 1) % columns if wrap else column + m
                weight = down[k] * across[m]
                moved_row += weight * control[i, j, 0]
                moved_column += weight * control[i, j, 1]
        positions[index, 0] += moved_row
        positions[index, 1] += moved_column
