"""Products of a picture with itself, shifted."""

from texloom.stages.kernels.core.compiled import compiled


@compiled
def shifted_products(plane, rows, row_shifts, column_shifts, sums):
    """Fill ``sums`` with the products of the pixels of some rows with those at each shift from them.

    Parameters
    ----------
    plane : (h, w) float32
    rows : (n,) int64, in order
    row_shifts : (p,) int64, px; pixels that lie outside count for nothing
    column_shifts : (q,) int64, px, each one more than the one before
    sums : (p, q, 3) float64, output: of the products, and of the squares of both factors
    """
    height, width = plane.shape
    sums[:] = 0.0
    # The same pixels at all shifts, or sums would jump from shift to shift.
    first = max(0, -column_shifts[0])
    last = min(width, width - column_shifts[-1])
    for row in rows:
        if row + row_shifts[0] < 0 or row + row_shifts[-1] >= height:
            continue
        own = plane[row]
        for p in range(row_shifts.size):
            other = plane[row + row_shifts[p]]
            for q in range(column_shifts.size):
                shift = column_shifts[q]
                product, square, shifted = 0.0, 0.0, 0.0
                for x in range(first, last):
                    a, b = own[x], other[x + shift]
                    product += a * b
                    square += a * a
                    shifted += b * b
                sums[p, q, 0] += product
                sums[p, q, 1] += square
                sums[p, q, 2] += shifted
