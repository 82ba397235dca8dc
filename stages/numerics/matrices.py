"""Algebra of matrices, whose last bits are the same on every processor.

NumPy's own functions call BLAS and LAPACK, which add in an order that depends on the processor.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from texloom.stages.kernels.core.loading import loaded

_PIECES = 16  # of work that threads share


def matrix_product(one: ArrayLike, other: ArrayLike) -> Any:
    """``one @ other`` of few columns; of stacks too, and a number of two vectors."""
    first, second = np.asarray(one), np.asarray(other)
    if second.ndim == 1:
        return np.einsum("...i,i->...", first, second)[()]
    if first.ndim == 1:
        return np.einsum("i,...ij->...j", first, second)
    return np.einsum("...ij,jk->...ik" if second.ndim == 2 else "...ij,...jk->...ik", first, second)


def row_product(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """``rows @ matrix`` of many rows, (n, k) and (k, m), on all threads: (n, m) of the type of ``rows``.

    Parameters
    ----------
    rows, matrix : float32 or float64
    """
    from texloom.stages.kernels.core.block_product import BYTES
    from texloom.stages.kernels.core.matrix_products import multiply_rows
    from texloom.stages.kernels.core.threads import run_spans

    count, width = matrix.shape
    columns = BYTES // rows.itemsize
    number = -(-width // columns)
    wide = np.zeros((count, number * columns), rows.dtype)
    wide[:, :width] = matrix
    panels = np.ascontiguousarray(np.swapaxes(wide.reshape(count, number, columns), 0, 1))
    out = np.empty((len(rows), width), rows.dtype)
    pieces = min(_PIECES, max(1, rows.size * width >> 22))
    run_spans(multiply_rows, (np.ascontiguousarray(rows), panels, out), len(rows), pieces)
    return out


def square_sums(sample: np.ndarray) -> np.ndarray:
    """``sample.T @ sample`` of many rows, (n, k), on all threads: (k, k) float64."""
    values = np.asarray(sample, np.float64)
    return row_product(values.T, values)


def eigenvectors(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues of symmetric matrices, (..., n, n), and their vectors of length 1.

    Returns
    -------
    (..., n) float64, ascending, and (..., n, n) float64 with a vector in each column
    """
    from texloom.stages.kernels.core.matrix_products import find_eigenvectors

    size = matrix.shape[-1]
    values, vectors = find_eigenvectors(np.ascontiguousarray(matrix, np.float64).reshape(-1, size, size))
    order = np.argsort(values, axis=1, kind="stable")
    columns = np.moveaxis(np.take_along_axis(vectors, order[:, :, None], axis=1), 1, 2)
    return np.take_along_axis(values, order, axis=1).reshape(matrix.shape[:-1]), columns.reshape(matrix.shape)


def length_of(vector: ArrayLike) -> float:
    """Euclidean length of all values together."""
    return float(np.sqrt(np.square(np.asarray(vector, np.float64)).sum()))


def determinant(matrix: ArrayLike) -> Any:
    """Of (..., n, n), n from 1 to 3: float64 of (...)."""
    m = np.asarray(matrix, np.float64)
    if m.shape[-1] == 1:
        return m[..., 0, 0]
    if m.shape[-1] == 2:
        return m[..., 0, 0] * m[..., 1, 1] - m[..., 0, 1] * m[..., 1, 0]
    return sum(m[..., 0, k] * _cofactor(m, 0, k) for k in range(3))


def inverse_of(matrix: ArrayLike) -> np.ndarray:
    """Of (..., n, n), n from 1 to 3, float64.

    Raises
    ------
    numpy.linalg.LinAlgError : there is none.
    """
    m = np.asarray(matrix, np.float64)
    whole = np.asarray(determinant(m))
    if not whole.all():
        raise np.linalg.LinAlgError("Singular matrix")
    size = m.shape[-1]
    found = np.empty_like(m)
    for i in range(size):
        for j in range(size):
            if size == 1:
                part = np.ones_like(whole)
            elif size == 2:
                part = (-1) ** (i + j) * m[..., 1 - j, 1 - i]
            else:
                part = _cofactor(m, j, i)
            found[..., i, j] = part / whole
    return found


def _cofactor(m: np.ndarray, row: int, column: int) -> np.ndarray:
    """Of (..., 3, 3): the determinant of what other rows and columns hold, with its sign."""
    (a, b), (c, d) = ((row + 1) % 3, (row + 2) % 3), ((column + 1) % 3, (column + 2) % 3)
    return np.asarray(m[..., a, c] * m[..., b, d] - m[..., a, d] * m[..., b, c])


def pseudo_inverse(vectors: ArrayLike) -> np.ndarray:
    """(n, k) of one to three independent vectors, (k, n): rows times it are coordinates along the vectors."""
    rows = np.asarray(vectors, np.float64)
    return np.asarray(matrix_product(rows.T, inverse_of(matrix_product(rows, rows.T))))


def solve(matrix: ArrayLike, values: ArrayLike) -> np.ndarray:
    """What ``matrix``, (n, n), times it is ``values``, (n,) or (n, m): by elimination with pivots, float64.

    Raises
    ------
    numpy.linalg.LinAlgError : there is none, or more than one.
    """
    left, right = np.array(matrix, np.float64), np.array(values, np.float64)
    for step in range(len(left)):
        pivot = step + int(np.abs(left[step:, step]).argmax())
        if left[pivot, step] == 0:
            raise np.linalg.LinAlgError("Singular matrix")
        left[[step, pivot]], right[[step, pivot]] = left[[pivot, step]], right[[pivot, step]]
        left[step], right[step] = left[step] / left[step, step], right[step] / left[step, step]
        for other in range(len(left)):
            if other != step:
                factor = left[other, step]
                left[other], right[other] = left[other] - factor * left[step], right[other] - factor * right[step]
    return right


def rank(matrix: ArrayLike) -> int:
    """Of (n, k): by elimination with pivots; what is 10^12 times smaller than the largest value counts as 0."""
    left = np.array(matrix, np.float64)
    least = 1e-12 * float(np.abs(left).max(initial=0.0))
    found = 0
    while min(left.shape) > 0:
        row, column = np.unravel_index(int(np.abs(left).argmax()), left.shape)
        if abs(left[row, column]) <= least:
            break
        found += 1
        line = left[row] / left[row, column]
        left = np.delete(left - left[:, column, None] * line, row, axis=0)
    return found


def least_squares(matrix: ArrayLike, values: ArrayLike) -> np.ndarray:
    """What ``matrix``, (n, k), times it is nearest to ``values``, (n,) or (n, m): float64.

    It is 0 for columns that depend on those before them.
    """
    wanted = np.asarray(values, np.float64)
    basis = np.array(np.asarray(matrix, np.float64).T)  # becomes orthogonal rows, as of Gram and Schmidt
    turned = np.eye(len(basis))
    for number in range(len(basis)):
        row = basis[number].copy()
        least = 1e-12 * length_of(row)
        for other in [*range(number)] * 2:  # twice, for rounding
            share = (row * basis[other]).sum()
            row -= share * basis[other]
            turned[number] -= share * turned[other]
        size = length_of(row)
        factor = 1 / size if size > least else 0.0
        basis[number] = factor * row
        turned[number] *= factor
    return np.asarray(matrix_product(turned.T, matrix_product(basis, wanted)))


def solve_symmetric(matrix: Any, right: np.ndarray) -> np.ndarray:
    """Solve a sparse symmetric, positive definite system by elimination.

    Parameters
    ----------
    matrix : of SciPy, (n, n). Time and memory grow with the distance of its entries from the diagonal after SciPy's
        reordering, which for a grid is about its shorter side.
    right : (n, m) float64

    Returns
    -------
    (n, m) float64
    """
    from texloom.stages.kernels.core.banded import solve_band

    rows = matrix.tocsr()
    order = _near_neighbours(rows)
    place = np.empty(order.size, np.int64)
    place[order] = np.arange(order.size)
    entries = rows.tocoo()
    row, column = place[entries.row], place[entries.col]
    upper = column >= row
    row, column, values = row[upper], column[upper], entries.data[upper]
    band = np.zeros((order.size, int((column - row).max()) + 1))
    np.add.at(band, (row, column - row), values)
    solution = np.array(right[order], np.float64)
    solve_band(band, solution)
    return solution[place]


def _near_neighbours(matrix: Any) -> np.ndarray:
    """The rows of a symmetric matrix in an order in which those with a common entry are near each other.

    SciPy's own order for that depends on the processor, by which NumPy sorts equal numbers.
    """
    csgraph = loaded("scipy.sparse.csgraph")
    part = csgraph.connected_components(matrix, directed=False)[1]
    starts = np.unique(part, return_index=True)[1]
    walks = [
        csgraph.breadth_first_order(matrix, start, directed=False, return_predecessors=False) for start in starts
    ]
    return np.concatenate(walks)


def cubic_spline(values: np.ndarray, every: int, count: int) -> np.ndarray:
    """Interpolate by a cubic spline whose third derivative is continuous at the knots next to the ends.

    Parameters
    ----------
    values : (knots, m) float64, at least 5 knots, at 0, ``every``, 2 ``every`` ...

    Returns
    -------
    (count, m) float64: the spline at 0, 1, 2 ...
    """
    from texloom.stages.kernels.core.banded import solve_band

    bend = values[2:] - 2 * values[1:-1] + values[:-2]
    second = np.empty_like(values)  # derivatives at the knots, times the square of their distance
    second[1], second[-2] = bend[0], bend[-1]
    inner = 6 * bend[1:-1]
    inner[0] -= second[1]
    inner[-1] -= second[-2]
    solve_band(np.tile([4.0, 1.0], (len(inner), 1)), inner)
    second[2:-2] = inner
    second[0], second[-1] = 2 * second[1] - second[2], 2 * second[-2] - second[-3]
    place = np.arange(count)
    left = np.minimum(place // every, len(values) - 2)
    after = ((place - left * every) / every)[:, None]
    before = 1 - after
    bent = (before * before - 1) * before * second[left] + (after * after - 1) * after * second[left + 1]
    return np.asarray(before * values[left] + after * values[left + 1] + bent / 6)
