"""Slow readable twins of the kernels of inverse texture synthesis."""

import numpy as np

from tests.kernels.core.naive import bilinear
from tests.kernels.patchmatch.naive import patch_distance


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
            far = patch_distance(texture, compaction, channels, size, (y * step, x * step), place)
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


def oriented_window(texture: np.ndarray, row: int, column: int, angle: float, size: int) -> np.ndarray:
    """The neighbourhood around a pixel of (h, w, c) in the frame of an angle, (size, size, c), bilinear."""
    along = np.array([np.sin(angle), np.cos(angle)])
    beside = np.array([np.cos(angle), -np.sin(angle)])
    window = np.empty((size, size, texture.shape[2]))
    for i, j in np.ndindex(size, size):
        place = np.array([row, column]) + (i - size // 2) * beside + (j - size // 2) * along
        window[i, j] = bilinear(texture, *place)
    return np.floor(window + 0.5).astype(np.int64)


def oriented_neighbour(angles: np.ndarray, place: np.ndarray, dy: int, dx: int) -> np.ndarray:
    """The place (dy, dx) from another in the frame of the pixel nearest to that one."""
    angle = angles[tuple(np.floor(np.asarray(place) + 0.5).astype(int))]
    beside, along = np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])
    return np.asarray(place + dy * beside + dx * along)


def oriented_seam(
    texture: np.ndarray, angles: np.ndarray, one: np.ndarray, other: np.ndarray, dy: int, dx: int
) -> float:
    """What is visible where a pixel from ``other`` lies (dy, dx) from one from ``one``; (h, w, c)."""
    total = 0.0
    for own, beside, sign in ((one, other, 1), (other, one, -1)):
        place = oriented_neighbour(angles, own, sign * dy, sign * dx)
        if (place >= 0).all() and (place <= np.array(texture.shape[:2]) - 1).all():
            values = [np.floor(bilinear(texture, *where) + 0.5) for where in (place, beside)]
            total += float(((values[0] - values[1]) ** 2).sum())
    return total
