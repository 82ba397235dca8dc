"""Products and eigenvectors of matrices, whose last bits are the same on every processor.

BLAS and LAPACK add in an order that depends on the processor. Here sums have one order, and LLVM may not change it.
"""

import math

import numpy as np

from texloom.stages.kernels.core.block_product import ROWS, block_product
from texloom.stages.kernels.core.compiled import compiled, inner

_STRIP = 96  # rows that stay in the processor's cache while all panels pass


@compiled
def multiply_rows(rows, panels, out, first, last):
    """Set rows ``first`` to ``last`` of ``out``, (n, m), to those of ``rows``, (n, k), times a matrix.

    Parameters
    ----------
    panels : (p, k, c), the matrix' columns, c for each of p panels, see `block_product`; the last one's may be more
    """
    columns, width = panels.shape[2], out.shape[1]
    block = np.empty((ROWS, columns), out.dtype)
    for top in range(first, last, _STRIP):
        bottom = min(top + _STRIP, last)
        for panel in range(panels.shape[0]):
            left = panel * columns
            right = min(left + columns, width)
            for i in range(top, bottom, ROWS):
                if i + ROWS <= bottom and left + columns <= width:
                    block_product(rows, i, bottom, panels, panel, out, i, left)
                    continue
                block_product(rows, i, bottom, panels, panel, block, 0, 0)
                for r in range(min(ROWS, bottom - i)):
                    line, made = out[i + r, left:right], block[r]
                    for j in range(line.size):
                        line[j] = made[j]


@inner
def _tridiagonal(vectors, diagonal, beside):
    """Reduce ``vectors``, a symmetric matrix, by Householder to a transformation, a column each."""
    n = diagonal.size
    for i in range(n - 1, 0, -1):
        scale = 0.0
        for k in range(i):
            scale += abs(vectors[i, k])
        if scale == 0.0:
            beside[i] = vectors[i, i - 1]
            diagonal[i] = 0.0
            continue
        square = 0.0
        for k in range(i):
            vectors[i, k] /= scale
            square += vectors[i, k] * vectors[i, k]
        lead = vectors[i, i - 1]
        root = -math.sqrt(square) if lead > 0 else math.sqrt(square)
        beside[i] = scale * root
        square -= lead * root
        vectors[i, i - 1] = lead - root
        for j in range(i):
            beside[j] = 0.0
        for j in range(i):  # the lower half stands for the upper one
            own, line = vectors[i, j], vectors[j]
            total = beside[j] + line[j] * own
            for k in range(j):
                beside[k] += line[k] * own
                total += line[k] * vectors[i, k]
            beside[j] = total
        along = 0.0
        for j in range(i):
            vectors[j, i] = vectors[i, j] / square
            beside[j] /= square
            along += beside[j] * vectors[i, j]
        along /= 2 * square
        for j in range(i):
            beside[j] -= along * vectors[i, j]
        for j in range(i):
            own, moved, line, step = vectors[i, j], beside[j], vectors[j], vectors[i]
            for k in range(j + 1):
                line[k] -= own * beside[k] + moved * step[k]
        diagonal[i] = square
    diagonal[0] = 0.0
    beside[0] = 0.0
    line = np.empty(n)
    for i in range(n):
        if diagonal[i] != 0.0:
            for k in range(i):
                line[k] = 0.0
            for j in range(i):
                factor, row = vectors[i, j], vectors[j]
                for k in range(i):
                    line[k] += factor * row[k]
            for j in range(i):
                factor, row = vectors[j, i], vectors[j]
                for k in range(i):
                    row[k] -= factor * line[k]
        diagonal[i] = vectors[i, i]
        vectors[i, i] = 1.0
        for j in range(i):
            vectors[i, j] = 0.0
            vectors[j, i] = 0.0


@inner
def _diagonal(vectors, diagonal, beside):
    """Implicit QL steps: ``diagonal`` becomes the eigenvalues, ``vectors`` their vectors, a row each."""
    n = diagonal.size
    for i in range(1, n):
        beside[i - 1] = beside[i]
    beside[n - 1] = 0.0
    for first in range(n):
        for _ in range(60):
            last = first
            while last < n - 1:
                size = abs(diagonal[last]) + abs(diagonal[last + 1])
                if size + abs(beside[last]) == size:
                    break
                last += 1
            if last == first:
                break
            g = (diagonal[first + 1] - diagonal[first]) / (2.0 * beside[first])
            r = math.sqrt(g * g + 1.0)
            g = diagonal[last] - diagonal[first] + beside[first] / (g + (r if g >= 0 else -r))
            sine, cosine, moved = 1.0, 1.0, 0.0
            stopped = False
            for i in range(last - 1, first - 1, -1):
                f, b = sine * beside[i], cosine * beside[i]
                r = math.sqrt(f * f + g * g)
                beside[i + 1] = r
                if r == 0.0:
                    diagonal[i + 1] -= moved
                    beside[last] = 0.0
                    stopped = True
                    break
                sine, cosine = f / r, g / r
                g = diagonal[i + 1] - moved
                r = (diagonal[i] - g) * sine + 2.0 * cosine * b
                moved = sine * r
                diagonal[i + 1] = g + moved
                g = cosine * r - b
                one, other = vectors[i], vectors[i + 1]
                for k in range(n):
                    f = other[k]
                    other[k] = sine * one[k] + cosine * f
                    one[k] = cosine * one[k] - sine * f
            if not stopped:
                diagonal[first] -= moved
                beside[first] = g
                beside[last] = 0.0


@compiled
def find_eigenvectors(matrices):
    """Eigenvalues of symmetric matrices, (m, n, n) float64, in no order, and their vectors, a row each."""
    count, size, _ = matrices.shape
    values, beside, found = np.empty((count, size)), np.empty(size), np.empty(matrices.shape)
    for number in range(count):
        vectors = matrices[number].copy()
        _tridiagonal(vectors, values[number], beside)
        for row in range(size):  # assigned as a whole, Numba compiles messages about shapes for seconds
            for column in range(size):
                found[number, row, column] = vectors[column, row]
        _diagonal(found[number], values[number], beside)
    return values, found
