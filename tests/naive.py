"""Slow readable twins of the kernels: one pixel at a time, exact integers, no tricks.

Patches are held as in `texloom.stages.synthesis._patchmatch.correspondence`; features lie in rows of ``width *
channels`` values.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

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
    found = np.empty(match.shape[1:], np.int64)
    for y, x in np.ndindex(found.shape):
        to = (int(match[0, y, x]), int(match[1, y, x]))
        found[y, x] = patch_distance(target, exemplar, channels, size, (y, x), to)
    return found


def occurrence_map(match: np.ndarray, size: int, places: tuple[int, int]) -> np.ndarray:
    """For each exemplar pixel the number of target patches whose matches cover it."""
    covered = np.zeros((places[0] + size - 1, places[1] + size - 1), np.int64)
    for y, x in np.ndindex(match.shape[1:]):
        row, column = match[:, y, x]
        covered[row : row + size, column : column + size] += 1
    return covered


def occurrence_price(match: np.ndarray, size: int, places: tuple[int, int], price_per_use: float) -> np.ndarray:
    """The occurrence map's mean over each exemplar patch, times ``price_per_use``, rounded."""
    covered = occurrence_map(match, size, places)
    price = np.empty(places, np.int64)
    for row, column in np.ndindex(places):
        uses = int(covered[row : row + size, column : column + size].sum())
        price[row, column] = round(uses * (price_per_use / size**2))
    return price


class Sweep:
    """One scan of PatchMatch; holds what stays the same and changes ``match`` and ``distance`` in place."""

    def __init__(
        self,
        target: np.ndarray,
        exemplar: np.ndarray,
        channels: int,
        size: int,
        match: np.ndarray,
        distance: np.ndarray,
        price: np.ndarray,
        own_price: int,
        overused: int,
        wrap: bool,
    ) -> None:
        self.target, self.exemplar, self.channels, self.size = target, exemplar, channels, size
        self.match, self.distance, self.price = match, distance, price
        self.own_price, self.overused, self.wrap = own_price, overused, wrap
        self.shape = match.shape[1:]

    def neighbour(self, y: int, x: int) -> tuple[int, int] | None:
        """The target patch at (y, x), around the torus where there is one."""
        if self.wrap:
            return y % self.shape[0], x % self.shape[1]
        return (y, x) if 0 <= y < self.shape[0] and 0 <= x < self.shape[1] else None

    def proposal(self, y: int, x: int, dy: int, dx: int) -> tuple[int, int] | None:
        """What the patch at (y + dy, x + dx) proposes for the one at (y, x)."""
        near = self.neighbour(y + dy, x + dx)
        if near is None:
            return None
        return int(self.match[0][near]) - dy, int(self.match[1][near]) - dx

    def coherent(self, y: int, x: int) -> bool:
        """All neighbours propose what the patch has."""
        proposals = [self.proposal(y, x, *d) for d in ((-1, 0), (1, 0), (0, -1), (0, 1))]
        return all(p is None or p == (self.match[0, y, x], self.match[1, y, x]) for p in proposals)

    def cost(self, y: int, x: int, place: tuple[int, int]) -> int:
        """Distance to a place and its price without the own use."""
        found = patch_distance(self.target, self.exemplar, self.channels, self.size, (y, x), place)
        return found + int(self.price[place])

    def run(
        self,
        first: int,
        last: int,
        forward: bool,
        radius: int,
        tries: int,
        unused: np.ndarray,
        fill_tries: int,
        key: int,
    ) -> int:
        """Scan rows ``first`` to ``last``; the number of matches that changed."""
        order = [(y, x) for y in range(first, last) for x in range(self.shape[1])]
        behind = -1 if forward else 1
        changed = 0
        for y, x in order if forward else reversed(order):
            if self.coherent(y, x):
                continue
            old = best = (int(self.match[0, y, x]), int(self.match[1, y, x]))
            cost = self.cost(y, x, best)
            for number in range(2 + tries + fill_tries):
                if number < 2:
                    place = self.proposal(y, x, *((behind, 0), (0, behind))[number])
                elif number < 2 + tries:
                    place = self.near_place(y, x, number - 2, best, old, radius, key)
                else:
                    place = self.unused_place(y, x, number - 2, unused, key)
                if place is None or place == best or not self.whole(place):
                    continue
                offer = self.cost(y, x, place) + self.own_price
                if offer < cost:
                    best, cost = place, offer
            if best != old:
                self.match[:, y, x] = best
                self.distance[y, x] = patch_distance(
                    self.target, self.exemplar, self.channels, self.size, (y, x), best
                )
                changed += 1
        return changed

    def whole(self, place: tuple[int, int]) -> bool:
        """The exemplar has the patch."""
        return 0 <= place[0] < self.price.shape[0] and 0 <= place[1] < self.price.shape[1]

    def near_place(
        self, y: int, x: int, attempt: int, best: tuple[int, int], old: tuple[int, int], radius: int, key: int
    ) -> tuple[int, int] | None:
        """A random place around the match that is not overused, or not more than the old match; at most 5 draws."""
        for draw in range(5):
            bits = random_bits(key, y * self.shape[1] + x, 5 * attempt + draw)
            place = []
            for middle, count, part in zip(best, self.price.shape, (bits >> 32, bits % 2**32), strict=True):
                low, high = max(0, middle - radius), min(count - 1, middle + radius)
                place.append(low + part % (high - low + 1))
            price = self.price[place[0], place[1]]
            if price <= self.overused or price < self.price[old]:
                return place[0], place[1]
        return None

    def unused_place(self, y: int, x: int, attempt: int, unused: np.ndarray, key: int) -> tuple[int, int]:
        """One of the little used places."""
        index = random_bits(key, y * self.shape[1] + x, 5 * attempt) % unused.shape[1]
        return int(unused[0, index]), int(unused[1, index])


def votes(match: np.ndarray, size: int, wrap: bool, y: int, x: int) -> list[tuple[int, int, int, int]]:
    """All votes for the target pixel (y, x): its place (i, j) in a patch, and the exemplar pixel proposed."""
    down, across = match.shape[1:]
    found = []
    for i, j in np.ndindex(size, size):
        q, p = y - i, x - j
        if wrap:
            q, p = q % down, p % across
        if 0 <= q < down and 0 <= p < across:
            found.append((i, j, int(match[0, q, p]) + i, int(match[1, q, p]) + j))
    return found


def mean_vote(match: np.ndarray, exemplar: np.ndarray, window: np.ndarray, wrap: bool) -> np.ndarray:
    """Weighted mean of all votes, as exact fractions; ``exemplar`` is (h, w, c) and whole, the result (H, W, c)."""
    extra = 0 if wrap else window.size - 1
    result = np.empty((match.shape[1] + extra, match.shape[2] + extra, exemplar.shape[2]), object)
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
    wrap: bool,
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


def lattice_sums(
    density: np.ndarray, mass: np.ndarray, penalty: float, first: np.ndarray, second: np.ndarray
) -> tuple[float, int, float]:
    """Score, number of points and mass that one lattice collects, one point of each pair of opposites."""
    if abs(np.linalg.det([first, second])) < 1:
        return 0.0, 0, 0.0
    reach = np.array(density.shape) // 2
    score, number, total = 0.0, 0, 0.0
    steps = range(-sum(density.shape), sum(density.shape) + 1)
    for a, b in ((a, b) for a in steps if a >= 0 for b in steps if a > 0 or b > 0):
        offset = a * first + b * second
        if (np.abs(offset) > reach).any():
            continue
        row, column = np.rint(offset).astype(int) + reach
        value = float(density[row, column])
        score += value if value > 0 else -penalty
        number += 1
        total += float(mass[row, column])
    return score, number, total


def cheapest_cut(errors: np.ndarray) -> float:
    """Least sum over all paths from the first row to the last that move a column a row at most: tries all."""

    def from_here(row: int, column: int) -> float:
        if not 0 <= column < errors.shape[1]:
            return math.inf
        own = float(errors[row, column])
        if row == errors.shape[0] - 1:
            return own
        return own + min(from_here(row + 1, column + step) for step in (-1, 0, 1))

    return min(from_here(0, column) for column in range(errors.shape[1]))


def overlap_errors(features: np.ndarray, template: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Mean squared difference of ``template`` where ``mask`` is true, at every place of ``features``."""
    height, width = mask.shape
    found = np.empty((features.shape[0] - height + 1, features.shape[1] - width + 1))
    for y, x in np.ndindex(found.shape):
        difference = features[y : y + height, x : x + width].astype(np.float64) - template
        found[y, x] = (difference[mask] ** 2).sum() / mask.sum()
    return found


def neighbourhood_distance(
    first: np.ndarray, at: tuple[int, int], second: np.ndarray, to: tuple[int, int], channels: int, size: int
) -> int:
    """Sum of squared differences of a neighbourhood of ``first`` and one of ``second``."""
    return int(((patch(first, channels, size, *at) - patch(second, channels, size, *to)) ** 2).sum())


def inverse_match(
    texture: np.ndarray, compaction: np.ndarray, channels: int, size: int, step: int, proposals: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """For every neighbourhood of the grid the best of its proposals, the first of equals, and its distance."""
    match = proposals[0].copy()
    distance = np.empty(match.shape[1:], np.int64)
    for y, x in np.ndindex(distance.shape):
        tried = []
        for proposal in proposals:
            place = (int(proposal[0, y, x]), int(proposal[1, y, x]))
            far = neighbourhood_distance(texture, (y * step, x * step), compaction, place, channels, size)
            tried.append((far, len(tried), place))
        distance[y, x], _, match[:, y, x] = min(tried)
    return match, distance


def nearest_vector(wanted: np.ndarray, given: np.ndarray) -> int:
    """Number of the nearest vector, the first of equals."""
    return int(((given.astype(np.int64) - wanted) ** 2).sum(axis=1).argmin())


def weighted_difference(planes: np.ndarray, piece: np.ndarray, stands: np.ndarray, weights: np.ndarray) -> float:
    """Sum over a piece's pixels of the squared difference from what stands, by the pixel's weight."""
    total = 0.0
    for y, x in np.ndindex(weights.shape):
        differences = planes[piece[0, y, x], piece[1, y, x]].astype(float) - stands[y, x]
        total += float(weights[y, x] * (differences**2).sum())
    return total


def beside(candidates: np.ndarray, size: int, row: int, column: int) -> list[tuple[int, int]]:
    """The pixel (row, column) and those in the middle of neighbourhoods that look like the one around it."""
    middle = size // 2
    found = [(row, column)]
    if 0 <= row - middle < candidates.shape[0] and 0 <= column - middle < candidates.shape[1]:
        alike = [int(place) for place in candidates[row - middle, column - middle, 1:] if place >= 0]
        found += [(place // candidates.shape[1] + middle, place % candidates.shape[1] + middle) for place in alike]
    return found


def coherent_pixels(
    source: np.ndarray, candidates: np.ndarray, size: int, y: int, x: int, wrap: bool = False
) -> set[tuple[int, int]]:
    """Candidates for the compaction's pixel (y, x): what its nine sources resemble, shifted; not clipped."""
    found = set()
    for dy, dx in np.ndindex(3, 3):
        v, u = y + dy - 1, x + dx - 1
        if wrap:
            v, u = v % source.shape[1], u % source.shape[2]
        if 0 <= v < source.shape[1] and 0 <= u < source.shape[2]:
            for row, column in beside(candidates, size, int(source[0, v, u]), int(source[1, v, u])):
                found.add((row - dy + 1, column - dx + 1))
    return found


def folding(parent: list[int], child: list[int], distortion: list[float]) -> list[int]:
    """Leaves of the tree before each inner node is folded; 0 for leaves. Looks at every node every time."""
    fold, folded = [0] * len(parent), set()

    def leaves(node: int) -> list[int]:
        if child[node] < 0 or node in folded:
            return [node]
        return leaves(child[node]) + leaves(child[node] + 1)

    def inner(node: int) -> list[int]:
        if child[node] < 0 or node in folded:
            return []
        return [node, *inner(child[node]), *inner(child[node] + 1)]

    while inner(0):

        def cost(node: int) -> float:
            below = leaves(node)
            return (distortion[node] - sum(distortion[leaf] for leaf in below)) / (len(below) - 1)

        cheapest = min(inner(0), key=cost)
        total = len(leaves(0))
        gone = inner(cheapest)
        for node in gone:
            fold[node] = total
            folded.add(node)
    return fold


def resynthesise_pixel(
    at: tuple[int, int],
    radius: int,
    wrap: bool,
    exemplar: np.ndarray,
    candidates: np.ndarray,
    home: np.ndarray,
    canvas: np.ndarray,
    match: np.ndarray,
    valid: np.ndarray,
) -> tuple[int, int]:
    """The exemplar pixel that continues the valid pixels around ``at`` best, of the homes of what they propose."""
    steps = [(down, across) for down in range(-radius, radius + 1) for across in range(-radius, radius + 1)]
    around = []
    for step in steps:
        row, column = at[0] + step[0], at[1] + step[1]
        if wrap:
            row, column = row % canvas.shape[0], column % canvas.shape[1]
        if 0 <= row < canvas.shape[0] and 0 <= column < canvas.shape[1] and valid[row, column]:
            around.append((step, (row, column)))
    proposed = []
    for step, neighbour in around:
        source = tuple(match[neighbour])
        for place in [source, *(tuple(other) for other in candidates[source] if other[0] >= 0)]:
            inside = [min(max(int(place[axis]) - step[axis], 0), exemplar.shape[axis] - 1) for axis in (0, 1)]
            proposed.append(tuple(home[tuple(inside)].tolist()))

    def difference(place: tuple[int, int]) -> float:
        total = 0.0
        for step, neighbour in around:
            other = exemplar[place[0] + step[0], place[1] + step[1]].astype(np.float64)
            total += float(((other - canvas[neighbour]) ** 2).sum())
        return total

    return min(proposed, key=difference)  # the first of equal ones


def copy_vote(
    match: np.ndarray, target: np.ndarray, exemplar: np.ndarray, size: int, reach: int, wrap: bool, y: int, x: int
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
            if wrap:
                at = at % shape
            elif (at < 0).any() or (at >= shape).any():
                continue
            to = np.clip([row + dy, column + dx], 0, np.array(exemplar.shape[:2]) - 1)
            total += int(((target[tuple(at)].astype(np.int64) - exemplar[tuple(to)]) ** 2).sum())
        found.append(total)
    return min(found)


def seams_around(
    planes: np.ndarray, source: np.ndarray, y: int, x: int, place: tuple[int, int], wrap: bool = False
) -> float:
    """What is visible around the pixel (y, x) if it is copied from ``place``; ``planes`` is (h, w, c)."""

    def far(one: np.ndarray, other: np.ndarray) -> float:
        ends = [(int(row), int(column)) for row, column in (one, other)]
        if all(0 <= row < planes.shape[0] and 0 <= column < planes.shape[1] for row, column in ends):
            return float(((planes[ends[0]] - planes[ends[1]]) ** 2).sum())
        return 0.0

    total = 0.0
    for step in np.array([(-1, 0), (0, -1), (1, 0), (0, 1)]):
        v, u = np.array((y, x)) + step
        if wrap:
            v, u = v % source.shape[1], u % source.shape[2]
        if 0 <= v < source.shape[1] and 0 <= u < source.shape[2]:
            other = source[:, v, u]
            total += far(np.array(place) + step, other) + far(np.array(place), other - step)
    return total


def moved_pixel(
    source: np.ndarray,
    texture: np.ndarray,
    given: np.ndarray,
    vectors: np.ndarray,
    basis: np.ndarray,
    candidates: np.ndarray,
    price: np.ndarray,
    radius: int,
    broken: int,
    wrap: bool,
    y: int,
    x: int,
) -> dict[tuple[int, int], int]:
    """What each proposal for a pixel costs: squared distance, price, and ``broken`` a neighbour not continued."""
    shape = np.array(source.shape[:2])

    def inside(row: int, column: int) -> bool:
        return wrap or bool(0 <= row < shape[0] and 0 <= column < shape[1])

    def at(row: int, column: int) -> tuple[int, int]:
        place = np.array([row, column]) % shape if wrap else np.clip([row, column], 0, shape - 1)
        return int(place[0]), int(place[1])

    near = [at(y + i, x + j) for i in range(-radius, radius + 1) for j in range(-radius, radius + 1)]
    around = [np.concatenate([texture[tuple(source[place])], given[place]]) for place in near]
    wanted = np.rint(np.concatenate(around) @ basis).astype(int)
    steps = [np.array([i - 1, j - 1]) for i, j in np.ndindex(3, 3)]
    known = [tuple(source[at(y + i, x + j)] - (i, j)) for i, j in steps if (i or j) and inside(y + i, x + j)]
    own = {
        place
        for place in [tuple(source[y, x]), *known]
        if 0 <= place[0] < texture.shape[0] and 0 <= place[1] < texture.shape[1]
    }
    proposed = own | {tuple(other) for place in own for other in candidates[place]}
    return {
        place: int(((wanted - vectors[place].astype(int)) ** 2).sum())
        + int(price[place])
        + broken * sum(place != other for other in known)
        for place in proposed
    }


def steepness(pixels: np.ndarray) -> np.ndarray:
    """Absolute differences between a pixel's neighbours, across and down, summed over channels."""
    padded = np.pad(pixels.astype(np.int64), ((1, 1), (1, 1), (0, 0)), mode="edge")
    across = np.abs(padded[1:-1, 2:] - padded[1:-1, :-2])
    down = np.abs(padded[2:, 1:-1] - padded[:-2, 1:-1])
    return np.asarray((across + down).sum(axis=2))


def cubic_b_spline(x: float) -> float:
    """The cubic B-spline with knots at whole numbers, symmetric around 0."""
    x = abs(x)
    if x < 1:
        return (4 - 6 * x**2 + 3 * x**3) / 6
    return (2 - x) ** 3 / 6 if x < 2 else 0.0


def control_weights(
    position: np.ndarray, low: np.ndarray, spacing: np.ndarray, wrap: bool, shape: tuple[int, int]
) -> dict[tuple[int, int], list[float]]:
    """For every control point near a position its weights; on a small torus one point may have several."""
    at = (position - low) / spacing
    if not wrap:
        at = np.clip(at, 0, np.array(shape) - 3)
    found: dict[tuple[int, int], list[float]] = {}
    for i in range(math.floor(at[0]) - 2, math.floor(at[0]) + 4):
        for j in range(math.floor(at[1]) - 2, math.floor(at[1]) + 4):
            weight = cubic_b_spline(at[0] - i) * cubic_b_spline(at[1] - j)
            if weight > 0:
                # without wrap-around the control point of cell 0 is the second: one stands before the box
                point = (i % shape[0], j % shape[1]) if wrap else (i + 1, j + 1)
                found.setdefault(point, []).append(weight)
    return found


def approximate(
    positions: np.ndarray,
    values: np.ndarray,
    low: np.ndarray,
    spacing: np.ndarray,
    wrap: bool,
    shape: tuple[int, int],
) -> np.ndarray:
    """Lee, Wolberg and Shin's control lattice: equations 3 to 5."""
    above, below = np.zeros((*shape, 2)), np.zeros(shape)
    for position, value in zip(positions, values, strict=True):
        near = control_weights(position, low, spacing, wrap, shape)
        squares = sum(weight**2 for weights in near.values() for weight in weights)
        for point, weights in near.items():
            for weight in weights:
                above[point] += weight**2 * (weight * value / squares)
                below[point] += weight**2
    return np.divide(above, below[..., None], out=np.zeros_like(above), where=below[..., None] > 0)


def deform(
    control: np.ndarray, low: np.ndarray, spacing: np.ndarray, wrap: bool, positions: np.ndarray
) -> np.ndarray:
    """Positions plus the spline's values there."""
    moved = positions.copy()
    for index, position in enumerate(positions):
        for point, weights in control_weights(position, low, spacing, wrap, control.shape[:2]).items():
            moved[index] += sum(weights) * control[point]
    return moved


def catmull_rom(x: float) -> float:
    """Keys' cubic convolution kernel with a = -1/2."""
    x = abs(x)
    if x < 1:
        return 1.5 * x**3 - 2.5 * x**2 + 1
    return -0.5 * x**3 + 2.5 * x**2 - 4 * x + 2 if x < 2 else 0.0


def sampled(pixels: np.ndarray, row: float, column: float) -> np.ndarray:
    """A picture's value between pixels, kept within those of the four nearest; its border goes on for ever."""
    height, width, _ = pixels.shape
    row, column = min(max(row, 0), height - 1), min(max(column, 0), width - 1)
    top, left = math.floor(row), math.floor(column)

    def at(y: int, x: int) -> np.ndarray:
        return pixels[min(max(y, 0), height - 1), min(max(x, 0), width - 1)].astype(np.float64)

    value = sum(
        catmull_rom(row - y) * catmull_rom(column - x) * at(y, x)
        for y in range(top - 1, top + 3)
        for x in range(left - 1, left + 3)
    )
    near = np.stack([at(top + i, left + j) for i in (0, 1) for j in (0, 1)])
    return np.clip(value, near.min(axis=0), near.max(axis=0))


def bilinear(plane: np.ndarray, row: float, column: float) -> np.ndarray:
    """A plane's value between its entries; beyond it that at its border."""
    row, column = min(max(row, 0), plane.shape[0] - 1), min(max(column, 0), plane.shape[1] - 1)
    value = 0.0
    for y in range(plane.shape[0]):
        for x in range(plane.shape[1]):
            value = value + max(0, 1 - abs(row - y)) * max(0, 1 - abs(column - x)) * plane[y, x]
    return np.asarray(value)


def laid_texton(
    pixels: np.ndarray,
    source: np.ndarray,
    place: np.ndarray,
    origin: np.ndarray,
    lattice: np.ndarray,
    textons: dict[tuple[int, int], np.ndarray],
    generators: np.ndarray,
    start: np.ndarray,
    zone: np.ndarray,
) -> np.ndarray:
    """What textons, by the steps of their cells, show at a place: all weighed by how far into their cells it is."""
    at = (place - origin) @ np.linalg.inv(lattice)
    total, value = 0.0, np.zeros(pixels.shape[2])
    for step, texton in textons.items():
        share = at - step
        inside = np.minimum(share, 1 - share) / zone + 0.5  # 0.5 at the border, 0 and 1 half a zone away from it
        weight = float(np.prod(np.clip(inside, 0, 1)))
        if weight > 0:
            straight = (texton + share) @ generators + start
            value += weight * sampled(pixels, *bilinear(source, *straight))
            total += weight
    return value / total


def draw_displacements(
    tables: np.ndarray,
    step: float,
    neighbours: np.ndarray,
    grid: np.ndarray,
    most: float,
    rounds: int,
    key: int,
    moves: np.ndarray,
) -> np.ndarray:
    """Gibbs sampling of the vertices, in turn."""

    def uniform(node: int, counter: int) -> float:
        return (random_bits(key, node, counter) >> 11) / 2**53

    moves = moves.copy()
    middle = (tables.shape[1] - 1) / 2
    pitch = grid[1, 1] - grid[0, 1]
    for number in range(rounds):
        for node in range(len(moves)):
            shift = (np.array([uniform(node, 4 * number), uniform(node, 4 * number + 1)]) - 0.5) * pitch
            places = moves[node] + grid + shift
            likely = []
            for place in places:
                logarithm = 0.0 if (np.abs(place) <= most).all() else -np.inf
                for side, other in enumerate(neighbours[node]):
                    if other >= 0:
                        away = (moves[other] - place) * (1 if side < 4 else -1)
                        logarithm += float(bilinear(tables[side % 4], *(middle + away / step)))
                likely.append(logarithm)
            if max(likely) == -np.inf:
                continue
            weights = np.cumsum([math.exp(value - max(likely)) for value in likely])
            chosen = int(np.searchsorted(weights, uniform(node, 4 * number + 2) * weights[-1], side="right"))
            moves[node] = places[chosen]
    return moves


def line_mean(noise: np.ndarray, angle: np.ndarray, length: int, y: int, x: int) -> float:
    """Mean of ``noise`` along the field line through a pixel, ``length`` steps to both sides or to the border."""
    met = [noise[y, x]]
    for sign in (1, -1):
        place = np.array([y, x], np.float64)
        step = sign * np.array([np.sin(angle[y, x]), np.cos(angle[y, x])], np.float64)
        for _ in range(length):
            place = place + step
            row, column = np.rint(place).astype(int)
            if not (0 <= row < noise.shape[0] and 0 <= column < noise.shape[1]):
                break
            met.append(noise[row, column])
            there = np.array([np.sin(angle[row, column]), np.cos(angle[row, column])], np.float64)
            step = there if there @ step >= 0 else -there
    return float(np.mean(met))


def best_around(vectors: np.ndarray, own: tuple[int, int], place: tuple[int, int], reach: int) -> tuple[int, int]:
    """The vector within ``reach`` of ``place`` that differs least from the one at ``own``, but not that one."""
    near = [
        (y, x)
        for y in range(max(0, place[0] - reach), min(vectors.shape[0], place[0] + reach + 1))
        for x in range(max(0, place[1] - reach), min(vectors.shape[1], place[1] + reach + 1))
        if (y, x) != own
    ]
    return min(near, key=lambda at: float(((vectors[at] - vectors[own]) ** 2).sum()))


def turned_window(texture: np.ndarray, row: int, column: int, angle: float, size: int) -> np.ndarray:
    """The neighbourhood around a pixel of (h, w, c) in the frame of an angle, (size, size, c), bilinear."""
    height, width = texture.shape[:2]
    along = np.array([np.sin(angle), np.cos(angle)])
    beside = np.array([np.cos(angle), -np.sin(angle)])
    window = np.empty((size, size, texture.shape[2]))
    for i, j in np.ndindex(size, size):
        place = np.array([row, column]) + (i - size // 2) * beside + (j - size // 2) * along
        y, x = np.clip(place, 0, [height - 1, width - 1])
        top, left = min(int(y), height - 2), min(int(x), width - 2)
        square = texture[top : top + 2, left : left + 2].astype(np.float64)
        rows = square[0] * (1 - (y - top)) + square[1] * (y - top)
        window[i, j] = rows[0] * (1 - (x - left)) + rows[1] * (x - left)
    return np.floor(window + 0.5).astype(np.int64)


def turned_neighbour(turn: np.ndarray, place: np.ndarray, dy: int, dx: int) -> np.ndarray:
    """The texture pixel (dy, dx) from another in the frame of that one's angle."""
    angle = turn[tuple(place)]
    beside, along = np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])
    return np.asarray(np.floor(place + dy * beside + dx * along + 0.5).astype(int))


def turned_proposals(
    source: np.ndarray, inverse: np.ndarray, candidates: np.ndarray, together: float, wrap: bool, y: int, x: int
) -> list[tuple[np.ndarray, int]]:
    """Places that a turned pixel may come from, each with the number of neighbours that it does not continue."""
    size, limit = np.array(source.shape[:2]), np.array(candidates.shape[:2]) - 1
    groups: list[list[np.ndarray]] = []
    around = 0
    # the pixel itself is the middle one and comes first
    for i, j in sorted(np.ndindex(3, 3), key=lambda at: (3 * at[0] + at[1] - 4) % 9):
        step = np.array([i - 1, j - 1])
        there = np.array([y, x]) + step
        if not wrap and ((there < 0) | (there >= size)).any():
            continue
        around += bool(step.any())
        place = source[tuple(there % size)] - inverse[y, x].reshape(2, 2) @ step
        if (place < 0).any() or (place > limit).any():
            continue
        for group in groups:
            if (np.abs(group[0] - place) < together).all():
                group.append(place)
                break
        else:
            groups.append([place])
    found = []
    own = (source[y, x] >= 0).all() and (source[y, x] <= limit).all()
    for number, group in enumerate(groups):
        neighbours = group[1:] if number == 0 and own else group
        mean = np.mean(neighbours or group, axis=0)
        found.append((mean, around - len(neighbours)))
        pixel = np.rint(mean).astype(int)
        found += [(np.clip(other + mean - pixel, 0, limit), around) for other in candidates[tuple(pixel)]]
    return found


def turned_vector(
    source: np.ndarray,
    texture: np.ndarray,
    given: np.ndarray,
    basis: np.ndarray,
    jacobian: np.ndarray,
    inverse: np.ndarray,
    radius: int,
    wrap: bool,
    y: int,
    x: int,
) -> np.ndarray:
    """The neighbourhood around a turned pixel, each value from where the nearest pixel's source goes on to."""
    size = np.array(source.shape[:2])
    values = []
    for i, j in np.ndindex(2 * radius + 1, 2 * radius + 1):
        place = np.array([y, x]) + jacobian[y, x].reshape(2, 2) @ (i - radius, j - radius)
        near = np.floor(place + 0.5).astype(int)
        beside = place - near
        if wrap:
            near %= size
        elif ((near < 0) | (near >= size)).any():
            near, beside = np.clip(near, 0, size - 1), np.zeros(2)
        at = source[tuple(near)] + inverse[tuple(near)].reshape(2, 2) @ beside
        values += [*np.floor(bilinear(texture, *at) + 0.5), *given[tuple(near)]]
    return np.rint(np.array(values) @ basis)


def turned_seam(
    texture: np.ndarray, turn: np.ndarray, one: np.ndarray, other: np.ndarray, dy: int, dx: int
) -> float:
    """What is visible where a pixel from ``other`` lies (dy, dx) from one from ``one``; (h, w, c)."""
    total = 0.0
    for own, beside, sign in ((one, other, 1), (other, one, -1)):
        place = turned_neighbour(turn, own, sign * dy, sign * dx)
        if (place == beside).all():
            return 0.0
        if (place >= 0).all() and (place < texture.shape[:2]).all():
            total += float(((texture[tuple(place)].astype(float) - texture[tuple(beside)]) ** 2).sum())
    return total


def feature_distances(mask: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Distances in texture to the features that neighbours have passed on; six sweeps down and up at most.

    A sweep takes each row from left to right, with the three pixels before it and the one to the left, and then
    back, with the one to the right.
    """
    height, width = mask.shape
    found = {(int(y), int(x)): (int(y), int(x)) for y, x in np.argwhere(mask)}

    def length(pixel: tuple[int, int], feature: tuple[int, int]) -> float:
        middle = (pixel[0] + feature[0]) // 2, (pixel[1] + feature[1]) // 2
        mean = (inverse[pixel] + 4 * inverse[middle] + inverse[feature]).reshape(2, 2) / 6
        return float(np.linalg.norm(mean @ np.subtract(pixel, feature)))

    def visit(y: int, x: int, sides: list[tuple[int, int]]) -> None:
        for dy, dx in sides:
            offered = found.get((y + dy, x + dx))
            if offered and ((y, x) not in found or length((y, x), offered) < length((y, x), found[y, x])):
                found[y, x] = offered

    for _ in range(6):
        for before, rows in ((-1, range(height)), (1, range(height - 1, -1, -1))):
            for y in rows:
                for x in range(width):
                    visit(y, x, [(before, -1), (before, 0), (before, 1), (0, -1)])
                for x in range(width - 1, -1, -1):
                    visit(y, x, [(0, 1)])
    return np.array([[length((y, x), found[y, x]) for x in range(width)] for y in range(height)])


def way_to_border(mask: np.ndarray, jacobian: np.ndarray, axis: int, farthest: float, y: int, x: int) -> float:
    """Length in texture of the nearer way along a direction to where ``mask`` changes; negative inside it."""
    nearest = farthest
    for side in (-1, 1):
        place, length = np.array([y, x], float), 0.0
        at = (y, x)
        while length < nearest:
            step = jacobian[at].astype(float)[[axis, 2 + axis]]
            place += side * step / np.hypot(*step)
            length += 1 / np.hypot(*step)
            at = (round(place[0]), round(place[1]))
            if not (0 <= at[0] < mask.shape[0] and 0 <= at[1] < mask.shape[1]):
                break
            if mask[at] != mask[y, x]:
                nearest = min(nearest, length)
                break
    return -nearest if mask[y, x] else nearest


def loop_cost(errors: np.ndarray, inside: np.ndarray) -> float:
    """What it costs to part ``inside`` from the rest: both errors of each pair, nothing beside a negative."""
    total = 0.0
    for y, x in np.ndindex(*errors.shape):
        for other in ((y + 1, x), (y, x + 1)):
            if other[0] < errors.shape[0] and other[1] < errors.shape[1] and inside[y, x] != inside[other]:
                total += (
                    float(errors[y, x]) + float(errors[other]) if min(errors[y, x], errors[other]) >= 0 else 0.0
                )
    return total


def seam_total(features: np.ndarray, slopes: np.ndarray, match: np.ndarray, wrap: bool) -> float:
    """What all seams of a result cost: at each pair of neighbours from apart, what both pixels would differ by."""
    height, width = match.shape[:2]
    total = 0.0

    def differ(one: np.ndarray, other: np.ndarray) -> float:
        a, b = (tuple(np.clip(place, 0, np.array(slopes.shape) - 1)) for place in (one, other))
        return float(np.linalg.norm(features[a] - features[b]) ** 3 / (1 + slopes[a] + slopes[b]))

    for y, x in np.ndindex(height, width):
        for step in np.array([(1, 0), (0, 1)]):
            beside = (y + step[0], x + step[1])
            if not wrap and (beside[0] == height or beside[1] == width):
                continue
            one, other = match[y, x].astype(int), match[beside[0] % height, beside[1] % width].astype(int)
            if (one + step != other).any():
                total += differ(one, other - step) + differ(one + step, other)
    return total
