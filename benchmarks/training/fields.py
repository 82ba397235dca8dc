"""Smooth random fields, of which noise, light, wear and bending are made."""

from __future__ import annotations

import cv2
import numpy as np

Array = np.ndarray


def smooth_noise(shape: tuple[int, int], period: float | tuple[float, float], rng: np.random.Generator) -> Array:
    """Random field of mean about 0 and deviation about 1 that varies over ``period`` pixels (down, across)."""
    down, across = period if isinstance(period, tuple) else (period, period)
    size = max(2, int(np.ceil(shape[1] / across)) + 3), max(2, int(np.ceil(shape[0] / down)) + 3)
    coarse = rng.standard_normal((size[1], size[0]), np.float32)
    enlarged = (max(shape[1], round(size[0] * across)), max(shape[0], round(size[1] * down)))
    field = cv2.resize(coarse, enlarged, interpolation=cv2.INTER_CUBIC)
    top, left = (enlarged[1] - shape[0]) // 2, (enlarged[0] - shape[1]) // 2
    return np.ascontiguousarray(field[top : top + shape[0], left : left + shape[1]]) * np.float32(1.3)


def octaves(shape: tuple[int, int], period: float, falloff: float, rng: np.random.Generator) -> Array:
    """Sum of smooth fields from ``period`` down to 1.5 px, each ``falloff`` times as strong as the one before."""
    total, weight, power = np.zeros(shape, np.float32), 1.0, 0.0
    while period >= 1.5:
        total += np.float32(weight) * smooth_noise(shape, period, rng)
        power += weight**2
        period, weight = period / 2, weight * falloff
    return total / np.float32(max(power, 1e-6) ** 0.5)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is evenly spread between those of ``low`` and ``high``."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def bent(ids: Array, shape: tuple[int, int], turn: float, bend: float, rng: np.random.Generator) -> Array:
    """The middle of ``ids`` turned by ``turn`` radians and bent by up to about ``bend`` px, without blending."""
    rows, columns = np.indices(shape, np.float32)
    rows -= shape[0] / 2
    columns -= shape[1] / 2
    if bend > 0:
        period = log_uniform(rng, max(12.0, 3 * bend), max(200.0, 8 * bend))
        rows += np.float32(bend) * smooth_noise(shape, period, rng)
        columns += np.float32(bend) * smooth_noise(shape, period, rng)
    cosine, sine = np.float32(np.cos(turn)), np.float32(np.sin(turn))
    down = cosine * rows - sine * columns + ids.shape[0] / 2
    across = sine * rows + cosine * columns + ids.shape[1] / 2
    return np.asarray(cv2.remap(ids, across, down, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REFLECT))
