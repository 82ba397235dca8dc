"""Separable filters."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled
def filter_rows(pixels, down, across, rows, columns, out, first, last):
    """Fill rows ``first`` to ``last`` of ``out``, (h, w * c), with sums of shares of neighbours.

    Parameters
    ----------
    pixels : (h, w * c), of the type of all that is not an index
    down, across : shares of the neighbours, of odd length
    rows : (h + down.size - 1,) int64, the row that stands at each place, from before the first one; -1 for zeros
    columns : the same of the w * c values of a row
    """
    reach = (columns.size - out.shape[1]) // (across.size - 1) if across.size > 1 else 0
    line = np.empty(out.shape[1], pixels.dtype)
    wide = np.empty(columns.size, pixels.dtype)
    for y in range(first, last):
        for x in range(line.size):
            line[x] = 0
        for k in range(down.size):
            if rows[y + k] >= 0:
                share, above = down[k], pixels[rows[y + k]]
                for x in range(line.size):
                    line[x] += share * above[x]
        for x in range(wide.size):
            wide[x] = line[columns[x]] if columns[x] >= 0 else 0
        total = out[y]
        for x in range(total.size):
            total[x] = 0
        for k in range(across.size):
            share, beside = across[k], wide[k * reach :]
            for x in range(total.size):
                total[x] += share * beside[x]
