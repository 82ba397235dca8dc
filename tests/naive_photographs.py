"""Slow readable references of the kernels for photographs."""

from __future__ import annotations

import numpy as np


def blur_along(
    planes: np.ndarray, jacobian: np.ndarray, usable: np.ndarray, sigma: np.ndarray, axis: int
) -> np.ndarray:
    """See `stages.kernels.distorted_blur`."""
    height, width, _ = planes.shape
    out = planes.astype(np.float64)

    def pixel(place: np.ndarray) -> tuple[int, int] | None:
        row, column = round(place[0]), round(place[1])
        return (row, column) if 0 <= row < height and 0 <= column < width else None

    def between(place: np.ndarray) -> np.ndarray:
        row, column = np.clip(place, 0, [height - 1, width - 1])
        top, left = min(int(row), height - 2), min(int(column), width - 2)
        p, q = row - top, column - left
        upper = (1 - q) * planes[top, left] + q * planes[top, left + 1]
        lower = (1 - q) * planes[top + 1, left] + q * planes[top + 1, left + 1]
        return np.asarray((1 - p) * upper + p * lower)

    for y, x in np.argwhere(usable & (sigma > 0)):
        total, weight = planes[y, x].astype(np.float64), 1.0
        for side in (-1, 1):
            place = np.array([y, x], float)
            for number in range(1, 7):
                here = pixel(place)
                assert here is not None
                step = side * 0.5 * sigma[y, x]
                half = pixel(place + step / 2 * jacobian[here][[axis, 2 + axis]])
                if half is None:
                    break
                place = place + step * jacobian[half][[axis, 2 + axis]]
                there = pixel(place)
                if there is None or not usable[there]:
                    break
                share = np.exp(-((number / 2) ** 2) / 2)
                total += share * between(place)
                weight += share
        out[y, x] = total / weight
    return out


def cover(controls: np.ndarray, shape: tuple[int, int], dense: int) -> tuple[np.ndarray, np.ndarray]:
    """Which pixels a patch covers, and (u, v) of the nearest of ``dense`` x ``dense`` points of it."""
    at = np.linspace(0, 1, dense)
    basis = np.stack([(1 - at) ** 3, 3 * at * (1 - at) ** 2, 3 * at**2 * (1 - at), at**3], axis=1)
    points = np.einsum("ui,vj,ijk->uvk", basis, basis, controls)
    points = points[..., :2] / points[..., 2:]
    near, place = np.zeros(shape, bool), np.zeros((*shape, 2))
    for row in range(shape[0]):
        for column in range(shape[1]):
            away = np.abs(points - [row, column]).max(axis=2)
            i, j = np.unravel_index(away.argmin(), away.shape)
            near[row, column] = away[i, j] < 0.5
            place[row, column] = at[i], at[j]
    return near, place
