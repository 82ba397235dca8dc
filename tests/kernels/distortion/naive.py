"""Slow readable twins of the kernels of distorted textures."""

from __future__ import annotations

import numpy as np


def blur_along(
    planes: np.ndarray, jacobian: np.ndarray, usable: np.ndarray, sigma: np.ndarray, axis: int
) -> np.ndarray:
    """See `texloom.stages.kernels.distortion.blur`."""
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


def landed(jacobian: np.ndarray, place: tuple[int, int], down: int, across: int, step: float) -> np.ndarray:
    """Where so many steps down and across the texture lead, see `texloom.stages.kernels.distortion.windows`."""
    last = np.array(jacobian.shape[:2]) - 1
    times = max(abs(down), abs(across))
    at = np.array(place, float)
    for _ in range(times):
        probe = at
        for share in (0.5, 1.0):
            near = np.clip(np.floor(probe + 0.5).astype(int), 0, last)
            move = jacobian[tuple(near)].reshape(2, 2) @ (np.array([down, across]) * step / times)
            probe = at + share * move
        at = probe
    return at


def sampled(planes: np.ndarray, place: np.ndarray) -> np.ndarray:
    """The picture's values between pixels; beyond its border those at it."""
    height, width = planes.shape[:2]
    row, column = np.clip(place, 0, [height - 1, width - 1])
    top, left = min(int(row), height - 2), min(int(column), width - 2)
    p, q = row - top, column - left
    upper = (1 - q) * planes[top, left] + q * planes[top, left + 1]
    return np.asarray((1 - p) * upper + p * ((1 - q) * planes[top + 1, left] + q * planes[top + 1, left + 1]))


def stands_on(mask: np.ndarray, place: np.ndarray) -> bool:
    """Whether a place lies on a pixel of the mask."""
    row, column = np.floor(place + 0.5).astype(int)
    return bool(0 <= row < mask.shape[0] and 0 <= column < mask.shape[1] and mask[row, column])


def window(
    planes: np.ndarray, jacobian: np.ndarray, known: np.ndarray, place: tuple[int, int], step: float
) -> tuple[np.ndarray, np.ndarray]:
    """The 25 samples around a pixel, by way of the middle of their row, and which of them are known."""
    values, found = [], []
    for down in range(-2, 3):
        for across in range(-2, 3):
            at = landed(jacobian, place, down, 0, step)
            for _ in range(abs(across)):
                at = landed(jacobian, tuple(at), 0, int(np.sign(across)), step)
            values.append(sampled(planes, at))
            found.append(stands_on(known, at))
    return np.array(values), np.array(found)


def described(
    values: np.ndarray, found: np.ndarray, mean: np.ndarray, basis: np.ndarray, doubt: np.ndarray
) -> np.ndarray:
    """Components of a window; the most likely ones, given what is known of it."""
    used = np.repeat(found, values.shape[1])
    part = (values.ravel() - mean)[used]
    if found.all():
        return np.asarray(part @ basis)
    return np.linalg.solve(basis[used].T @ basis[used] + np.diag(doubt), basis[used].T @ part)
