"""Slow readable twin of the kernel of cells."""

import numpy as np


def search_cell(
    lab: np.ndarray,
    forbidden: np.ndarray,
    points: np.ndarray,
    weights: np.ndarray,
    wanted: np.ndarray,
    box: np.ndarray,
    base: np.ndarray,
    offsets: np.ndarray,
    taken: np.ndarray,
) -> tuple[np.ndarray, float]:
    """The displacement of least cost and that cost; ``forbidden`` tells pixels."""
    best, cost = base, np.inf
    size = box[2:] - box[:2]
    for shift in base + offsets:
        first, last = box[:2] + shift, box[2:] + shift
        if (
            (first < 0).any()
            or (last > lab.shape[:2]).any()
            or forbidden[first[0] : last[0], first[1] : last[1]].any()
        ):
            continue
        shown = lab[tuple((points + shift).T)].astype(np.float64)
        value = float((weights * ((shown - wanted) ** 2).sum(axis=1)).sum())
        if (np.abs(shift - taken) * 2 < size).all(axis=1).any():
            value *= 2
        if value < cost:
            best, cost = shift, value
    return best, cost
