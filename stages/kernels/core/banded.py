"""Elimination in systems whose entries are near the diagonal."""

from texloom.stages.kernels.core.compiled import compiled


@compiled
def solve_band(band, right):
    """Replace ``right``, (n, m) float64, by the solution of a symmetric, positive definite system.

    ``band``, (n, width) float64, has each row of it from the diagonal on, and is overwritten.
    """
    count, width = band.shape
    for i in range(count):
        row = band[i]
        for k in range(1, min(width, count - i)):
            if row[k] != 0.0:
                factor, below = row[k] / row[0], band[i + k]
                for j in range(width - k):
                    below[j] -= factor * row[k + j]
                for j in range(right.shape[1]):
                    right[i + k, j] -= factor * right[i, j]
    for i in range(count - 1, -1, -1):
        row = band[i]
        for k in range(1, min(width, count - i)):
            if row[k] != 0.0:
                for j in range(right.shape[1]):
                    right[i, j] -= row[k] * right[i + k, j]
        for j in range(right.shape[1]):
            right[i, j] /= row[0]
