"""Slow readable twins of per-pixel synthesis' kernels: one pixel at a time."""

import numpy as np

from tests.kernels.distortion.naive import landed
from tests.kernels.patchmatch.naive import random_bits
from texloom.stages.common.per_pixel.tables import Tables

_WORD = 2**64
SIDES = [(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)]


class Repeats:
    """Phases of places, those wanted of pixels, both as shares of two displacements, and these, 1/256 px."""

    def __init__(self, places: np.ndarray, wanted: np.ndarray, origin: tuple[int, int], generators: np.ndarray):
        self.places, self.wanted, self.origin, self.generators = places, wanted, origin, generators.reshape(2, 2)

    def way(self, row: int, column: int, place: int) -> tuple[int, int]:
        """From a place to one of the phase that a pixel wants, 1/256 px."""
        wanted = self.wanted[row - self.origin[0], column - self.origin[1]]
        ahead = [(int(a) - int(b) + 2**31) % 2**32 - 2**31 for a, b in zip(wanted, self.places[place], strict=True)]
        down, across = (sum(a * int(g) for a, g in zip(ahead, line, strict=True)) for line in self.generators.T)
        return down // 2**32, across // 2**32


class PerPixel:
    """An exemplar and what decides a pixel's place in it."""

    def __init__(self, tables: Tables, coherence_bonus: int, tolerance: int, control_bonus: int = 0):
        self.t = tables
        self.coherence_bonus, self.tolerance, self.control_bonus = coherence_bonus, tolerance, control_bonus

    def moved(self, at: tuple[int, int], down: float, across: float) -> tuple[int, int]:
        """A position so many texture px away from another in the exemplar, kept inside the margin."""
        if self.t.jacobian is None:
            return self.by(at, down, across)
        u, v = np.float32(down), np.float32(across)
        for share in (np.float32(0.5), np.float32(1)):  # the Jacobian there, then that half the way
            j = self.t.jacobian[self.place(at if share < 1 else half)]
            half = self.by(at, share * (j[0] * u + j[1] * v), share * (j[2] * u + j[3] * v))
        return half

    def place(self, at: tuple[int, int]) -> int:
        """The place nearest to a position."""
        return (at[0] + 128) // 256 * self.t.pitch + (at[1] + 128) // 256

    def position(self, place: int) -> tuple[int, int]:
        """Row and column of a place, in 1/256 px."""
        return int(place) // self.t.pitch * 256, int(place) % self.t.pitch * 256

    def snapped(self, at: tuple[int, int], level: int) -> tuple[int, int]:
        """The position, or that of the nearest valid neighbourhood where that is another place."""
        valid = int(self.t.candidates[level * self.t.places + self.place(at), 0])
        return at if valid == self.place(at) else self.position(valid)

    def contribution(self, side: int, row: int, level: int) -> np.ndarray:
        """What a row of ``appearance`` adds to the sum that describes the pixel of which it is a side."""
        pairs = self.t.sides.reshape(self.t.levels, 8, 4, 8, 2)[level, side].astype(int)
        products = (self.t.appearance[row].astype(int).reshape(4, 1, 2) * pairs).sum(axis=(0, 2))
        return np.rint(products / 2048).astype(int)

    def sum_at(self, row: int, column: int, level: int) -> np.ndarray:
        """What describes a pixel of the exemplar."""
        total = np.zeros(8, int)
        for side, (down, across) in enumerate(SIDES):
            at = np.array([row + down * 2**level, column + across * 2**level])
            if self.t.jacobian is not None:
                field = self.t.jacobian.reshape(*self.t.shape, 4)
                at = np.floor(landed(field, (row, column), down, across, 2.0**level) + 0.5).astype(int)
                at = np.clip(at, 0, np.array(self.t.shape) - 1)
            place = (at[0] + self.t.margin) * self.t.pitch + at[1] + self.t.margin
            total += self.contribution(side, level * self.t.places + place, level)
        return total

    def child(
        self, parent: tuple[int, int], row: int, column: int, level: int, amplitude: int, key: int,
        frame: tuple[int, np.ndarray] | None = None,
    ) -> tuple[int, int]:  # fmt: skip
        """What a pixel of a level takes over from the coarser one; ``frame``: table level, ``inverse``."""
        bits = random_bits(key, (row % _WORD << 32) % _WORD ^ column % 2**32, 0)
        jitter = [((part - 2**31) * amplitude + 2**46) >> 47 for part in (bits >> 32, bits % 2**32)]
        own, inverse = frame or (level, np.eye(2, dtype=np.float32).ravel())
        down, across = (np.float32(side % 2 - (0.5 if level else 1.0)) for side in (row, column))
        u = (inverse[0] * down + inverse[1] * across) * np.float32(2**own)
        v = (inverse[2] * down + inverse[3] * across) * np.float32(2**own)
        return self.snapped(self.moved(self.snapped(self.moved(parent, u, v), own), *jitter), own)

    def begun(
        self, row: int, column: int, block: int, key: int, attempt: int, repeats: Repeats | None,
        frame: tuple[int, np.ndarray] | None = None, begins: np.ndarray | None = None,
    ) -> tuple[int, int]:  # fmt: skip
        """The position in a piece at which a pixel of the coarsest level begins."""
        level = self.t.levels - 1
        bits = random_bits(key, (row // block % _WORD << 32) % _WORD ^ column // block % 2**32, attempt)
        last = self.t.places // self.t.pitch - 1, self.t.pitch - 1
        if begins is None:
            top, bottom, left, right = self.t.core
            sides, reach = (bottom - top, right - left), (block - 1) * 2**level
            room = sides if self.t.endless else [max(1, side - reach) for side in sides]
            r, c = (
                (bits >> 32) % room[0] + row % block * 2**level,
                bits % 2**32 % room[1] + column % block * 2**level,
            )
            if self.t.endless:
                r, c = r % sides[0], c % sides[1]
            r, c = min(r, sides[0] - 1) + top, min(c, sides[1] - 1) + left
            if repeats is not None:
                down, across = repeats.way(row, column, r * self.t.pitch + c)
                r += int(np.floor(down / 256 + 0.5))
                c += int(np.floor(across / 256 + 0.5))
            place = min(max(r, 0), last[0]) * self.t.pitch + min(max(c, 0), last[1])
            return self.position(self.t.candidates[level * self.t.places + place, 0])
        assert frame is not None
        own, inverse = frame
        at = self.snapped(self.position(begins[(bits >> 32) % len(begins)]), own)
        for axis, part in enumerate((row, column)):
            way = part % block - block // 2
            u, v = (np.sign(way) * inverse[side + axis] * np.float32(2**own) for side in (0, 2))
            for _ in range(abs(way)):
                at = self.snapped(self.moved(at, np.float32(u), np.float32(v)), own)
        if repeats is not None:
            down, across = repeats.way(row, column, self.place(at))
            at = self.snapped(self.moved(at, down / 256, across / 256), own)
        return at

    def corrected(
        self, around: list[tuple[int, int]], own: tuple[int, int], level: int, given: np.ndarray,
        inverse: np.ndarray | None = None,
    ) -> tuple[int, int]:  # fmt: skip
        """The position that suits a pixel best; ``around`` are its neighbours', in the order of `SIDES`."""
        t, step, base = self.t, 2**level, level * self.t.places
        inverse = np.array([1, 0, 0, 1], np.float32) if inverse is None else inverse
        a, b, c, d = inverse
        offsets, ring = [], []
        for e, f in (np.float32(side) for side in SIDES):
            offsets.append(((a * e + b * f) * step, (c * e + d * f) * step))
            sign = 1 if a * d > b * c else -1
            direction = np.array([d * e - b * f, a * f - c * e]) * sign
            ring.append(SIDES.index(tuple(int(part) for part in np.rint(direction / np.abs(direction).max()))))
        predicted = [self.moved(at, -u, -v) for at, (u, v) in zip(around, offsets, strict=True)]
        wanted = np.zeros(t.values.shape[1], np.int64)
        for side, (row, column) in enumerate(SIDES):
            near = ring[side]
            u, v = offsets[near]
            at = self.moved(around[near], np.float32(row * step) - u, np.float32(column * step) - v)
            wanted[:8] += self.contribution(side, base + self.place(at), level)
        wanted[8:] = given

        def distance(at: tuple[int, int], agree: int = 0) -> int:
            squares = (wanted - t.values[base + self.place(at)]) ** 2
            factors = 256 - self.coherence_bonus * agree, 256 - self.control_bonus * agree
            return int(squares[:8].sum() * factors[0] + squares[8:].sum() * factors[1]) >> 8

        def preferred(at: tuple[int, int]) -> int:
            agree = sum(max(abs(at[0] - other[0]), abs(at[1] - other[1])) <= 192 for other in predicted)
            return distance(at, agree)

        control = int(((t.values[base + self.place(own), 8:].astype(np.int64) - given) ** 2).sum())
        if all(at == own for at in predicted) and control <= self.tolerance:
            return own
        tried = [(preferred(at), at) for at in [own, *predicted]]
        for which in range(1, t.candidates.shape[1]):
            for at, (u, v) in zip([own, *around], [(0, 0), *offsets], strict=True):
                place = self.place(at)
                to = self.position(t.candidates[base + place, which])
                from_ = self.position(place)
                alike = (at[0] + to[0] - from_[0], at[1] + to[1] - from_[1])
                if (u, v) != (0, 0):
                    alike = self.moved(alike, -u, -v)
                tried.append((distance(alike), alike))
        least = min(far for far, _ in tried)
        return self.snapped(next(at for far, at in tried if far == least), level)

    def by(self, at: tuple[int, int], down: float, across: float) -> tuple[int, int]:
        """A position so many px further, inside the margin."""
        row = at[0] + round(float(np.float32(down) * 256))
        column = at[1] + round(float(np.float32(across) * 256))
        last = self.t.places // self.t.pitch - 1, self.t.pitch - 1
        return min(max(row, 0), last[0] * 256), min(max(column, 0), last[1] * 256)
