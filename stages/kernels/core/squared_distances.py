"""Squared distances between all rows of a table."""

from texloom.stages.kernels.core.compiled import compiled


@compiled
def squared_distances(columns, out, first, last):
    """Set rows ``first`` to ``last`` of ``out`` to the squared distances of these places to all.

    Parameters
    ----------
    columns : (k, n) float64, the values of all places
    out : (n, n) float64, output; values are added in their order
    """
    for i in range(first, last):
        line = out[i]
        for j in range(line.size):
            line[j] = 0.0
        for column in columns:
            own = column[i]
            for j in range(line.size):
                difference = own - column[j]
                line[j] += difference * difference
