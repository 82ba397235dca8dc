"""The cells of a lattice: templates of a cell, and their detection in an image."""

import dataclasses
import heapq
import math
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from texloom.stages.numerics.matrices import inverse_of, least_squares, matrix_product, rank

REACH = 0.2
"""search radius around a point's predicted position, as a share of the shorter generator"""

_INVALID = -2.0  # correlation where a cell is not whole
_STEPS = ((1, 0), (-1, 0), (0, 1), (0, -1))
_SEEDS = 3  # a side: the best peak in each of 3x3 parts of the image is tried as the first point


def reduced(generators: np.ndarray) -> np.ndarray:
    """The two shortest independent vectors of a lattice (Gauss' reduction), the shorter first.

    Each points down, or to the right where it is horizontal, so that equal lattices have equal generators.
    """
    a, b = np.asarray(generators, np.float64)
    if matrix_product(a, a) > matrix_product(b, b):
        a, b = b, a
    while True:
        b = b - np.rint(matrix_product(a, b) / matrix_product(a, a)) * a
        if matrix_product(b, b) >= matrix_product(a, a) - 1e-9:
            break
        a, b = b, a
    return np.array([vector if tuple(np.rint(vector * 1e6)) > (0, 0) else -vector for vector in (a, b)])


def steps_along(generators: np.ndarray) -> np.ndarray:
    """Matrix (2, k) from positions to steps along the k generators."""
    if len(generators) == 2:
        return inverse_of(generators)
    return np.asarray(generators.T / (generators**2).sum())


def cell_offsets(generators: np.ndarray) -> Int64[np.ndarray, "m 2"]:
    """The pixels that are nearer to a lattice point than to any other, as offsets from it."""
    a, b = reduced(generators)
    reach = int(np.ceil(max(np.hypot(*a), np.hypot(*b))))
    around = np.arange(-reach, reach + 1)
    offsets = np.stack(np.meshgrid(around, around, indexing="ij"), axis=2).reshape(-1, 2)
    inside = [
        np.abs(matrix_product(offsets, vector)) <= 0.5 * matrix_product(vector, vector)
        for vector in (a, b, a + b, a - b)
    ]
    return np.asarray(offsets[np.logical_and.reduce(inside)], np.int64)


def regular_points(
    shape: tuple[int, int], generators: np.ndarray, origin: np.ndarray, offsets: Int64[np.ndarray, "m 2"]
) -> Float64[np.ndarray, "n 2"]:
    """All lattice points whose cells lie inside an image of ``shape``; ``origin`` is a lattice point."""
    inverse = inverse_of(generators)
    corners = np.array([(0, 0), (0, shape[1]), (shape[0], 0), shape]) - origin
    low, high = (
        np.floor(matrix_product(corners, inverse).min(axis=0)),
        np.ceil(matrix_product(corners, inverse).max(axis=0)),
    )
    steps = np.stack(np.meshgrid(*(np.arange(*ends) for ends in zip(low, high + 1, strict=True)), indexing="ij"), 2)
    places = matrix_product(steps.reshape(-1, 2), generators) + origin
    nearest = np.rint(places)
    whole = (nearest + offsets.min(axis=0) >= 0) & (nearest + offsets.max(axis=0) < np.array(shape))
    return np.asarray(places[whole.all(axis=1)])


def cut(plane: Float32[np.ndarray, "h w *c"], places: np.ndarray, offsets: Int64[np.ndarray, "m 2"]) -> np.ndarray:
    """The pixels of the cells at ``places``, (n, m) or (n, m, c)."""
    index = np.rint(places).astype(np.int64)[:, None] + offsets[None]
    return np.asarray(plane[index[..., 0], index[..., 1]])


def normalised(cells: np.ndarray) -> Float64[np.ndarray, "n m"]:
    """Each row with mean 0 and length 1; constant rows are 0."""
    centred = cells - cells.mean(axis=1, dtype=np.float64, keepdims=True)
    length = np.sqrt((centred**2).sum(axis=1, keepdims=True))
    return np.asarray(
        np.divide(centred, length, out=np.zeros_like(centred), where=length > 1e-3 * cells.shape[1] ** 0.5)
    )


def correlation(
    tone: Float32[np.ndarray, "h w"], offsets: Int64[np.ndarray, "m 2"], cell: np.ndarray
) -> Float32[np.ndarray, "h w"]:
    """Normalised correlation of ``cell`` (m,), of mean 0 and length 1, at every pixel; -2 where not whole."""
    import cv2

    low, high = offsets.min(axis=0), offsets.max(axis=0)
    likeness = np.full(tone.shape, _INVALID, np.float32)
    if tone.shape[0] <= high[0] - low[0] or tone.shape[1] <= high[1] - low[1]:
        return likeness
    window, weights = np.zeros((2, *(high - low + 1)))
    rows, columns = (offsets - low).T
    window[rows, columns], weights[rows, columns] = 1.0, cell
    values = tone.astype(np.float64)
    anchor = (int(-low[1]), int(-low[0]))
    product, total, squares = (
        cv2.filter2D(plane, cv2.CV_64F, kernel, anchor=anchor)
        for plane, kernel in ((values, weights), (values, window), (values**2, window))
    )
    length = np.sqrt(np.maximum(squares - total**2 / len(offsets), 0))
    flat = length <= 1e-3 * len(offsets) ** 0.5
    inside = np.s_[-low[0] : tone.shape[0] - high[0], -low[1] : tone.shape[1] - high[1]]
    likeness[inside] = np.where(flat, 0, product / np.where(flat, 1, length))[inside]
    return likeness


def _disc(reach: float) -> np.ndarray:
    around = np.arange(-int(reach), int(reach) + 1)
    return (np.hypot(around[:, None], around[None, :]) <= reach).astype(np.uint8)


def _subpixel_peak(likeness: Float32[np.ndarray, "h w"], row: int, column: int) -> Float64[np.ndarray, "2"]:
    """The sub-pixel position of a peak, by parabolas through its neighbours."""
    place = [float(row), float(column)]
    middle = likeness.item(row, column)
    for axis, (before, after) in enumerate(
        (((row - 1, column), (row + 1, column)), ((row, column - 1), (row, column + 1)))
    ):
        if min(before) < 0 or after[axis] >= likeness.shape[axis]:
            continue
        left, right = likeness.item(before), likeness.item(after)
        curvature = left - 2 * middle + right
        if left > _INVALID and right > _INVALID and curvature < 0:
            place[axis] += max(-0.5, min(0.5 * (left - right) / curvature, 0.5))
    return np.array(place)


@dataclasses.dataclass(frozen=True)
class Peaks:
    """Peaks of the correlation with a cell."""

    likeness: Float32[np.ndarray, "h w"]
    """correlation with the cell; -2 where the cell would not be whole"""
    heights: Float32[np.ndarray, "h w"]
    """correlation at peaks, else -2"""
    reach: float
    """search radius, px"""

    def chance(self) -> float:
        """Probability that a random position has a peak within reach."""
        import cv2

        within = cv2.dilate((self.heights > _INVALID).astype(np.uint8), _disc(self.reach)) > 0
        whole = self.likeness > _INVALID
        return float(within[whole].mean()) if whole.any() else 0.0

    def near(self, place: np.ndarray) -> tuple[int, int] | None:
        """The highest peak within reach of ``place``."""
        down, right = place.tolist()
        top, left = max(math.ceil(down - self.reach), 0), max(math.ceil(right - self.reach), 0)
        bottom, end = math.floor(down + self.reach) + 1, math.floor(right + self.reach) + 1
        window = self.heights[top:bottom, left:end]
        best: tuple[int, int] | None = None
        height = _INVALID
        for number in (window > _INVALID).ravel().nonzero()[0].tolist():
            row, column = divmod(number, window.shape[1])
            value = window.item(row, column)
            at = (row + top, column + left)
            if value > height and np.hypot(at[0] - down, at[1] - right) <= self.reach:
                best, height = at, value
        return best

    def elsewhere(self, places: Float64[np.ndarray, "n 2"]) -> np.ndarray:
        """Heights (k,) of the peaks that are farther than ``reach`` from all ``places``."""
        positions = np.argwhere(self.heights > _INVALID)
        away = (
            np.hypot(*np.moveaxis(positions[:, None] - places[None], 2, 0)).min(axis=1, initial=np.inf) > self.reach
        )
        return np.asarray(self.heights[tuple(positions[away].T)])


def peaks(likeness: Float32[np.ndarray, "h w"], level: float, reach: float) -> Peaks:
    """Local maxima within ``reach`` px that are at least ``level``."""
    import cv2

    is_peak = (likeness >= cv2.dilate(likeness, _disc(reach))) & (likeness >= level) & (likeness > _INVALID)
    return Peaks(likeness, np.where(is_peak, likeness, np.float32(_INVALID)), reach)


@dataclasses.dataclass(frozen=True)
class Tracked:
    """A lattice tracked through an image from point to point."""

    steps: Int64[np.ndarray, "n 2"]
    """of each predicted point, in generators from the first"""
    places: Float64[np.ndarray, "n 2"]
    """detected position, else predicted position, px"""
    detected: Bool[np.ndarray, "n"]

    @property
    def recall(self) -> float:
        """Share of the predicted points that are detected."""
        return float(self.detected.mean()) if len(self.detected) else 0.0

    def edges(self) -> list[Float64[np.ndarray, "k 2"]]:
        """Displacements between detected neighbours, for each generator."""
        at = {
            tuple(step): place
            for step, place in zip(self.steps[self.detected].tolist(), self.places[self.detected], strict=True)
        }
        return [
            np.array(
                [at[i + di, j + dj] - place for (i, j), place in at.items() if (i + di, j + dj) in at]
            ).reshape(-1, 2)
            for di, dj in ((1, 0), (0, 1))
        ]

    def fitted(self) -> Float64[np.ndarray, "3 2"] | None:
        """Least squares fit of the generators and the first point; None where the detected points are collinear."""
        system = np.column_stack([self.steps[self.detected], np.ones(int(self.detected.sum()))])
        if len(system) < 3 or rank(system) < 3:
            return None
        return np.asarray(least_squares(system, self.places[self.detected]))


def _grow(seed: tuple[int, int], generators: np.ndarray, peaks: Peaks) -> Tracked:
    """Track the lattice from one peak, the best neighbours first, then across gaps."""
    likeness = peaks.likeness
    places = {(0, 0): _subpixel_peak(likeness, *seed)}
    taken = {seed}
    detected = {(0, 0)} if peaks.heights[seed] > _INVALID else set()
    queue = [(-float(likeness[seed]), 0, 0)]
    height, width = likeness.shape
    moves = [(di, dj, matrix_product(np.array((di, dj)), generators)) for di, dj in _STEPS]
    while queue:
        _, i, j = heapq.heappop(queue)
        for di, dj, move in moves:
            step = (i + di, j + dj)
            if step in detected or (step in places and (i, j) not in detected):
                continue
            predicted = places[i, j] + move
            row, column = map(round, predicted.tolist())
            if not (0 <= row < height and 0 <= column < width) or likeness.item(row, column) <= _INVALID:
                continue
            peak = peaks.near(predicted)
            if peak is not None and peak not in taken:
                taken.add(peak)
                detected.add(step)
                places[step] = _subpixel_peak(likeness, *peak)
                heapq.heappush(queue, (-float(likeness[peak]), *step))
            elif step not in places:
                places[step] = predicted
                heapq.heappush(queue, (2.0, *step))  # after all detected points
    steps = sorted(places)
    return Tracked(
        np.array(steps, np.int64).reshape(-1, 2),
        np.array([places[step] for step in steps]).reshape(-1, 2),
        np.array([step in detected for step in steps], bool),
    )


def track(generators: np.ndarray, peaks: Peaks) -> Tracked:
    """Detect the lattice's points in an image.

    Each point is predicted one generator from a neighbour, so that the lattice may bend. A part of the image that
    is out of step with the rest is not detected.
    """
    heights = peaks.heights
    rows, columns = (np.linspace(0, side, _SEEDS + 1).astype(int) for side in heights.shape)
    seeds = []
    for top, bottom in pairwise(rows):
        for left, right in pairwise(columns):
            part = heights[top:bottom, left:right]
            if part.size and part.max() > _INVALID:
                row, column = divmod(int(part.argmax()), part.shape[1])
                seeds.append((int(top) + row, int(left) + column))
    middle = (heights.shape[0] // 2, heights.shape[1] // 2)
    grown = [_grow(seed, generators, peaks) for seed in seeds or [middle]]
    return max(grown, key=lambda tracked: int(tracked.detected.sum()))
