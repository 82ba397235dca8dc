"""A threshold between two classes of values."""

import numpy as np

_BINS = 256


def otsu_threshold(values: np.ndarray) -> float:
    """The threshold that maximises the variance between the classes below and above it [Otsu1979]_."""
    low, high = float(values.min()), float(values.max())
    if high <= low:
        return high
    counts, edges = np.histogram(values, bins=_BINS, range=(low, high))
    middles = (edges[:-1] + edges[1:]) / 2
    below = np.cumsum(counts)[:-1]
    above = counts.sum() - below
    sums = np.cumsum(counts * middles)
    mean_below = sums[:-1] / np.maximum(below, 1)
    mean_above = (sums[-1] - sums[:-1]) / np.maximum(above, 1)
    return float(middles[:-1][np.argmax(below * above * (mean_below - mean_above) ** 2)])
