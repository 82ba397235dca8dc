"""Slow readable twins of the kernels of texture optimisation: one pixel at a time, exact integers.

Patches are held as in `texloom.stages.synthesis.optimisation.correspondence`; features lie in rows of ``width *
channels`` values.
"""

import math
from fractions import Fraction

import numpy as np

from tests.wraps import sides
from texloom.stages.kernels.patchmatch.search import PatchShape, Scan, SearchedExemplar, Target
from texloom.stages.vocabulary.facts import Wraps

_WORD = 2**64


def random_bits(key: int, position: int, counter: int) -> int:
    """SplitMix64's finaliser in whole numbers modulo 2**64."""
    bits = (key + position * 0x9E3779B97F4A7C15 + counter * 0xD1B54A32D192ED03) % _WORD
    bits = (bits ^ bits >> 30) * 0xBF58476D1CE4E5B9 % _WORD
    bits = (bits ^ bits >> 27) * 0x94D049BB133111EB % _WORD
    return bits ^ bits >> 31


def patch(features: np.ndarray, channels: int, size: int, row: int, column: int) -> np.ndarray:
    """The patch whose top-left pixel is (row, column), as int64."""
    pixels = features.reshape(features.shape[0], -1, channels)
    return pixels[row : row + size, column : column + size].astype(np.int64)


def patch_distance(
    target: np.ndarray, exemplar: np.ndarray, channels: int, size: int, at: tuple[int, int], to: tuple[int, int]
) -> int:
    """Sum of squared differences of the target patch ``at`` and the exemplar patch ``to``."""
    difference = patch(target, channels, size, *at) - patch(exemplar, channels, size, *to)
    return int((difference**2).sum())


def distances(target: np.ndarray, exemplar: np.ndarray, match: np.ndarray, channels: int, size: int) -> np.ndarray:
    """Distance of every target patch to its match."""
    result = np.empty(match.shape[1:], np.int64)
    for at in np.ndindex(result.shape):
        result[at] = patch_distance(target, exemplar, channels, size, at, tuple(match[:, *at]))
    return result


def occurrence_map(match: np.ndarray, size: int, places: tuple[int, int]) -> np.ndarray:
    """For each exemplar pixel the number of target patches whose matches cover it."""
    covered = np.zeros((places[0] + size - 1, places[1] + size - 1), np.int64)
    for y, x in np.ndindex(match.shape[1:]):
        row, column = match[:, y, x]
        covered[row : row + size, column : column + size] += 1
    return covered


def occurrence_penalty(match: np.ndarray, size: int, places: tuple[int, int], penalty_per_use: float) -> np.ndarray:
    """The occurrence map's mean over each exemplar patch, times ``penalty_per_use``, rounded."""
    covered = occurrence_map(match, size, places)
    penalty = np.empty(places, np.int64)
    for row, column in np.ndindex(places):
        uses = int(covered[row : row + size, column : column + size].sum())
        penalty[row, column] = round(uses * (penalty_per_use / size**2))
    return penalty


class Sweep:
    """One scan of PatchMatch, which changes the target's matches and distances in place."""

    def __init__(self, shape: PatchShape, target: Target, exemplar: SearchedExemplar, scan: Scan) -> None:
        self.patch, self.target, self.exemplar, self.scan = shape, target, exemplar, scan
        self.penalty, self.key = exemplar.penalty.astype(np.int64), int(scan.key)

    def neighbour(self, y: int, x: int) -> tuple[int, int] | None:
        """The target patch at (y, x), around the target where it wraps."""
        down, across = self.target.row.shape
        y, x = y % down if self.scan.wrap.down else y, x % across if self.scan.wrap.across else x
        return (y, x) if 0 <= y < down and 0 <= x < across else None

    def match(self, y: int, x: int) -> tuple[int, int]:
        """The exemplar patch that the target patch (y, x) is matched with."""
        return int(self.target.row[y, x]), int(self.target.column[y, x])

    def proposal(self, y: int, x: int, dy: int, dx: int) -> tuple[int, int] | None:
        """What the patch at (y + dy, x + dx) proposes for the one at (y, x)."""
        near = self.neighbour(y + dy, x + dx)
        if near is None:
            return None
        row, column = self.match(*near)
        return row - dy, column - dx

    def coherent(self, y: int, x: int) -> bool:
        """All neighbours propose what the patch has."""
        proposals = [self.proposal(y, x, *d) for d in ((-1, 0), (1, 0), (0, -1), (0, 1))]
        return all(place is None or place == self.match(y, x) for place in proposals)

    def distance(self, y: int, x: int, place: tuple[int, int]) -> int:
        """Distance of the target patch (y, x) to a place."""
        features, shape = (self.target.features, self.exemplar.features), self.patch
        return patch_distance(*features, shape.channels, shape.size, (y, x), place)

    def run(self, first: int, last: int) -> int:
        """Scan rows ``first`` to ``last``; the number of matches that changed."""
        forward, tries = self.scan.forward, self.scan.radii.size
        order = [(y, x) for y in range(first, last) for x in range(self.target.row.shape[1])]
        behind = -1 if forward else 1
        changed = 0
        for y, x in order if forward else reversed(order):
            if self.coherent(y, x):
                continue
            old = best = self.match(y, x)
            cost = self.distance(y, x, best) + self.penalty[best]
            omitted = 0
            if self.scan.distance_per_try:
                omitted = max(0, tries - self.distance(y, x, best) // int(self.scan.distance_per_try))
            for number in range(2 + tries + self.scan.fill_tries):
                if number < 2:
                    place = self.proposal(y, x, *((behind, 0), (0, behind))[number])
                elif number - 2 < omitted:
                    continue
                elif number < 2 + tries:
                    place = self.near_place(y, x, number - 2, best, old)
                else:
                    place = self.unused_place(y, x, number - 2)
                if place is None or place == best or not self.whole(place):
                    continue
                offer = self.distance(y, x, place) + self.penalty[place] + self.exemplar.own_penalty
                if offer < cost:
                    best, cost = place, offer
            if best != old:
                self.target.row[y, x], self.target.column[y, x] = best
                self.target.distance[y, x] = self.distance(y, x, best)
                changed += 1
        return changed

    def whole(self, place: tuple[int, int]) -> bool:
        """The exemplar has the patch."""
        return 0 <= place[0] < self.penalty.shape[0] and 0 <= place[1] < self.penalty.shape[1]

    def near_place(
        self, y: int, x: int, attempt: int, best: tuple[int, int], old: tuple[int, int]
    ) -> tuple[int, int] | None:
        """A random place around the match within the limit, or cheaper than the old match; at most 5 draws."""
        for draw in range(5):
            bits = random_bits(self.key, y * self.target.row.shape[1] + x, 5 * attempt + draw)
            place = []
            for middle, count, part in zip(best, self.penalty.shape, (bits >> 32, bits % 2**32), strict=True):
                radius = int(self.scan.radii[attempt])
                low, high = max(0, middle - radius), min(count - 1, middle + radius)
                place.append(low + (part * (high - low + 1) >> 32))
            penalty = self.penalty[place[0], place[1]]
            if penalty <= self.exemplar.penalty_limit or penalty < self.penalty[old]:
                return place[0], place[1]
        return None

    def unused_place(self, y: int, x: int, attempt: int) -> tuple[int, int]:
        """One of the little used places."""
        rows, columns = self.exemplar.unused_row, self.exemplar.unused_column
        bits = random_bits(self.key, y * self.target.row.shape[1] + x, 5 * attempt)
        index = bits % 2**32 * rows.size >> 32
        return int(rows[index]), int(columns[index])


def votes(match: np.ndarray, size: int, wrap: Wraps, y: int, x: int) -> list[tuple[int, int, int, int]]:
    """All votes for the target pixel (y, x): its place (i, j) in a patch, and the exemplar pixel proposed."""
    down, across = match.shape[1:]
    found = []
    for i, j in np.ndindex(size, size):
        q, p = y - i, x - j
        q, p = q % down if wrap.down else q, p % across if wrap.across else p
        if 0 <= q < down and 0 <= p < across:
            found.append((i, j, int(match[0, q, p]) + i, int(match[1, q, p]) + j))
    return found


def mean_vote(match: np.ndarray, exemplar: np.ndarray, window: np.ndarray, wrap: Wraps) -> np.ndarray:
    """Weighted mean of all votes, as exact fractions; ``exemplar`` is (h, w, c) and whole, the result (H, W, c)."""
    result = np.empty((*sides(match.shape[1:], window.size - 1, wrap), exemplar.shape[2]), object)
    for y, x in np.ndindex(result.shape[:2]):
        ballot = votes(match, window.size, wrap, y, x)
        weights = [int(window[i]) * int(window[j]) for i, j, _, _ in ballot]
        for c in range(exemplar.shape[2]):
            total = sum(w * int(exemplar[r, s, c]) for w, (_, _, r, s) in zip(weights, ballot, strict=True))
            result[y, x, c] = Fraction(total, sum(weights))
    return result


def rounded(fractions: np.ndarray) -> np.ndarray:
    """Nearest whole numbers, halves upwards."""
    return np.vectorize(lambda value: math.floor(value + Fraction(1, 2)), otypes=[np.int64])(fractions)


def histogram_vote(
    match: np.ndarray,
    exemplar: np.ndarray,
    bins: np.ndarray,
    excess: np.ndarray,
    size: int,
    wrap: Wraps,
    y: int,
    x: int,
) -> np.ndarray:
    """Mean vote where a vote weighs 1 / (1 + excess of its bins); ``exemplar`` and ``bins`` are (h, w, c)."""
    total, mean = 0.0, np.zeros(exemplar.shape[2])
    for _, _, row, column in votes(match, size, wrap, y, x):
        weight = 1 / (1 + sum(float(excess[c, b]) for c, b in enumerate(bins[row, column])))
        total += weight
        mean += weight * exemplar[row, column]
    return mean / total


def copy_vote(
    match: np.ndarray, target: np.ndarray, exemplar: np.ndarray, size: int, reach: int, wrap: Wraps, y: int, x: int
) -> int:
    """Least sum of squared differences between what is around a target pixel and around one that is voted for.

    ``target`` and ``exemplar`` are (H, W, c) and (h, w, c) and whole; beyond the exemplar its border repeats,
    beyond a target that does not wrap nothing counts.
    """
    shape = target.shape[:2]
    near = [(dy, dx) for dy in range(-reach, reach + 1) for dx in range(-reach, reach + 1)]
    found = []
    for _, _, row, column in votes(match, size, wrap, y, x):
        total = 0
        for dy, dx in near:
            at = np.array([y + dy, x + dx])
            at = np.where(wrap, at % shape, at)
            if (at < 0).any() or (at >= shape).any():
                continue
            to = np.clip([row + dy, column + dx], 0, np.array(exemplar.shape[:2]) - 1)
            total += int(((target[tuple(at)].astype(np.int64) - exemplar[tuple(to)]) ** 2).sum())
        found.append(total)
    return min(found)
