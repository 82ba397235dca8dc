"""Matrix products in pieces too small for BLAS to spread over threads.

The threads of OpenBLAS wait for each other actively: where the cores are shared, with other programs or with the
measures that run side by side, a product takes ten times as long. In pieces it also rounds the same everywhere.
"""

import numpy as np

_SMALL = 1 << 18  # multiplications that OpenBLAS leaves on one thread


def row_product(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """``rows @ matrix`` for many rows: (n, k) and (k, m) to (n, m)."""
    piece = max(1, _SMALL // matrix.size)
    whole = len(rows) // piece * piece
    product = np.empty((len(rows), matrix.shape[1]), np.result_type(rows, matrix))
    pieces = rows[:whole].reshape(-1, piece, rows.shape[1])
    np.matmul(pieces, matrix, out=product[:whole].reshape(-1, piece, matrix.shape[1]))
    np.matmul(rows[whole:], matrix, out=product[whole:])
    return product


def inner_products(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """``one @ other.T`` of few long vectors: (n, k) and (m, k) to (n, m)."""
    piece = max(1, _SMALL // (len(one) * len(other)))
    whole = one.shape[1] // piece * piece
    first, second = (values[:, :whole].reshape(len(values), -1, piece).swapaxes(0, 1) for values in (one, other))
    total = np.matmul(first, second.swapaxes(1, 2)).sum(axis=0)
    return np.asarray(total + one[:, whole:] @ other[:, whole:].T)


def column_product(matrix: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """``matrix @ columns.T`` for many columns: (n, k) and (m, k) to (n, m), each row contiguous."""
    piece = max(1, _SMALL // matrix.size)
    whole = len(columns) // piece * piece
    product = np.empty((len(matrix), len(columns)), np.result_type(matrix, columns))
    pieces = columns[:whole].reshape(-1, piece, columns.shape[1]).swapaxes(1, 2)
    for index, part in enumerate(pieces):
        np.matmul(matrix, part, out=product[:, index * piece : (index + 1) * piece])
    np.matmul(matrix, columns[whole:].T, out=product[:, whole:])
    return product
