"""The loops of training, compiled."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def principal_sign(labels, rows, sample, rounds, classes):
    """Divide ``rows`` into two classes by the side of the mean on which their labels lie.

    The direction is the first principal one of the rows in ``sample``, by power iteration. ``classes``
    is filled with 0 and 1 in the order of ``rows``; returns how many are 1.
    """
    width = labels.shape[1]
    mean = np.zeros(width, np.float64)
    for row in sample:
        for k in range(width):
            mean[k] += labels[row, k]
    mean /= sample.size
    direction = np.zeros(width, np.float64)
    farthest = -1.0
    for row in sample:  # start at the label farthest from the mean
        distance = 0.0
        for k in range(width):
            distance += (labels[row, k] - mean[k]) ** 2
        if distance > farthest:
            farthest = distance
            for k in range(width):
                direction[k] = labels[row, k] - mean[k]
    if farthest <= 1e-12:
        classes[:] = 0
        return 0
    for _ in range(rounds):
        following = np.zeros(width, np.float64)
        for row in sample:
            along = 0.0
            for k in range(width):
                along += (labels[row, k] - mean[k]) * direction[k]
            for k in range(width):
                following[k] += along * (labels[row, k] - mean[k])
        direction = following / np.sqrt((following**2).sum())
    ones = 0
    for i in range(rows.size):
        along = 0.0
        for k in range(width):
            along += (labels[rows[i], k] - mean[k]) * direction[k]
        classes[i] = 1 if along > 0 else 0
        ones += classes[i]
    return ones


@numba.njit(cache=True, nogil=True)
def best_split(levels, rows, classes, candidates, levels_count, smallest):
    """The candidate feature and level below which the classes of ``rows`` are least mixed (Gini impurity).

    ``levels`` is (features, samples), uint8. Returns (feature, level), or (-1, 0) where nothing is gained with at
    least ``smallest`` rows on both sides; rows go left where their level is below.
    """
    count = rows.size
    total = 0
    for i in range(count):
        total += classes[i]
    best = total * total / count + (count - total) * (count - total) / count + 1e-6
    feature, level = -1, 0
    number = np.zeros(levels_count, np.int64)
    ones = np.zeros(levels_count, np.int64)
    for candidate in candidates:
        number[:] = 0
        ones[:] = 0
        column = levels[candidate]
        for i in range(count):
            value = column[rows[i]]
            number[value] += 1
            ones[value] += classes[i]
        left = left_ones = 0
        for cut in range(1, levels_count):
            left += number[cut - 1]
            left_ones += ones[cut - 1]
            right = count - left
            if left < smallest or number[cut - 1] == 0:
                continue
            if right < smallest:
                break
            right_ones = total - left_ones
            purity = (left_ones * left_ones + (left - left_ones) * (left - left_ones)) / left
            purity += (right_ones * right_ones + (right - right_ones) * (right - right_ones)) / right
            if purity > best:
                best, feature, level = purity, candidate, cut
    return feature, level
