"""Slow readable twins of per-pixel synthesis' kernels: one pixel at a time."""

from __future__ import annotations

import numpy as np

from stages.synthesis._tables import Tables
from tests.naive import random_bits

_WORD = 2**64
SIDES = [(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)]


class PerPixel:
    """An exemplar and what decides a pixel's place in it."""

    def __init__(self, tables: Tables, support: int, tolerance: int):
        self.t = tables
        self.support, self.tolerance = support, tolerance

    def moved(self, place: int, down: float, across: float) -> int:
        """A place so many texture px away from another in the exemplar, kept inside the margin."""
        row, column = divmod(int(place), self.t.pitch)
        if self.t.jacobian is not None:
            j = self.t.jacobian[place]
            u, v = np.float32(down), np.float32(across)
            down, across = j[0] * u + j[1] * v, j[2] * u + j[3] * v
        row = min(max(row + round(float(down)), 0), self.t.places // self.t.pitch - 1)
        return row * self.t.pitch + min(max(column + round(float(across)), 0), self.t.pitch - 1)

    def child(
        self, parent: int, row: int, column: int, level: int, amplitude: int, key: int, frame: tuple | None = None
    ) -> int:
        """What a pixel of a level takes over from the coarser one."""
        step = 2**level
        bits = random_bits(key, (row % _WORD << 32) % _WORD ^ column % 2**32, 0)
        jitter = [((part - 2**31) * amplitude + 2**46) >> 47 for part in (bits >> 32, bits % 2**32)]
        down, across = (side % 2 - (0.5 if level else 1.0) for side in (row, column))
        own, inverse = frame or (level, np.eye(2, dtype=np.float32).ravel())
        step = 2**own
        u = (inverse[0] * np.float32(down) + inverse[1] * np.float32(across)) * np.float32(step)
        v = (inverse[2] * np.float32(down) + inverse[3] * np.float32(across)) * np.float32(step)
        home = self.t.home[own * self.t.places :]
        return int(home[self.moved(home[self.moved(parent, u, v)], *jitter)])

    def corrected(
        self, around: list[int], own: int, level: int, given: np.ndarray, inverse: np.ndarray | None = None
    ) -> int:
        """The place that suits a pixel best; ``around`` are its neighbours', in the order of `SIDES`."""
        t, step, base = self.t, 2**level, level * self.t.places
        inverse = np.array([1, 0, 0, 1], np.float32) if inverse is None else inverse
        a, b, c, d = inverse
        offsets, ring = [], []
        for e, f in (np.float32(side) for side in SIDES):
            offsets.append(((a * e + b * f) * step, (c * e + d * f) * step))
            sign = 1 if a * d > b * c else -1
            direction = np.array([d * e - b * f, a * f - c * e]) * sign
            ring.append(SIDES.index(tuple(int(part) for part in np.rint(direction / np.abs(direction).max()))))
        says = [self.moved(place, -u, -v) for place, (u, v) in zip(around, offsets, strict=True)]
        wanted = np.zeros(t.values.shape[1], np.int64)
        for side, (row, column) in enumerate(SIDES):
            near = ring[side]
            u, v = offsets[near]
            at = self.moved(around[near], np.float32(row * step) - u, np.float32(column * step) - v)
            wanted[:8] += t.table[side * t.levels * t.places + base + at]
        wanted[8:] = given

        def distance(place: int) -> int:
            return int(((wanted - t.values[base + place]) ** 2).sum())

        control = int(((t.values[base + own, 8:].astype(np.int64) - given) ** 2).sum())
        if all(place == own for place in says) and control <= self.tolerance:
            return own
        tried = [(distance(own) * (256 - self.support * says.count(own)) >> 8, own)]
        tried += [(distance(place) * (256 - self.support * says.count(place)) >> 8, place) for place in says]
        for which in range(t.similar.shape[1]):
            alike = [int(t.similar[base + own, which])]
            for place, (u, v) in zip(around, offsets, strict=True):
                alike.append(self.moved(int(t.similar[base + place, which]), -u, -v))
            tried += [(distance(place), place) for place in alike]
        least = min(far for far, _ in tried)
        return int(t.home[base + next(place for far, place in tried if far == least)])
