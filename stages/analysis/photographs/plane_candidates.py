"""Candidates for the planes of a photograph: where line segments of two vanishing points meet."""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.analysis.photographs import bezier
from texloom.stages.analysis.photographs.vanishing import pointing_to
from texloom.stages.common.features.line_segments import Frame, Segments
from texloom.stages.common.grids.growing import convex_hull
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import determinant, inverse_of, matrix_product
from texloom.stages.vocabulary.arrays import Mask

_GRID = 24  # cells along the longer side, in which segments of two families meet
_SPREAD = 2.0  # cells by which segments reach beyond themselves
_MIN_DENSITY = 0.15  # segment length in a cell, as a share of the cell's side
_SAMPLES = 16  # points of a segment that are counted in cells
_GAP = 5  # cells, about; narrower gaps of a plane are closed
_MIN_CELLS = 9  # of a plane
_MIN_SINE = 0.25  # of the angle between both directions in the middle of a plane
_MAX_DEPTH = 4.0  # of a point on a plane, relative to its middle; what is farther is left out
_BORDER = 0.02  # share of the length of the segments along a border that is beyond it
_SLACK = 0.04  # of a plane beyond its lines of one direction, as a share of their extent
_STEPS = 24  # along each side of a rectangle, at which is asked what the photograph shows of it
_LEAST_SHOWN = 0.5  # share of a rectangle that it shows, else a part is taken
_COST = 1.5  # of a place of the part that is not shown, in those that are


@dataclass(frozen=True)
class PlaneCandidate:
    """A rectangle on a plane, around its line segments."""

    corners: Float64[np.ndarray, "4 2"]
    """clockwise from the texture's origin, half diagonals from the middle of the photograph"""
    area: Mask
    """its cells"""
    support: float
    """length of the segments that meet in its cells, sides of a cell"""
    families: tuple[Segments, Segments]
    """down and across"""


@dataclass(frozen=True)
class Cells(Frame):
    """Cells of a coarse grid over a photograph."""

    @property
    def side(self) -> float:
        """Of a cell, px."""
        return max(self.size) / _GRID

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of cells."""
        height, width = self.size
        return math.ceil(height / self.side), math.ceil(width / self.side)

    def of(self, places: np.ndarray) -> tuple[np.ndarray, ...]:
        """Rows and columns of the cells that places are in."""
        return tuple(np.clip(((self.pixels(places) + 0.5) / self.side).astype(int), 0, np.array(self.shape) - 1).T)

    def centres(self) -> np.ndarray:
        """Places of the middles of all cells."""
        return self.places((np.moveaxis(np.indices(self.shape), 0, 2) + 0.5) * self.side - 0.5)

    def density(self, family: Segments) -> Float32[np.ndarray, "m n"]:
        """Length of the segments in and near each cell, in sides of the cell."""

        density = np.zeros(self.shape, np.float32)
        shares = (np.arange(_SAMPLES) + 0.5)[:, None, None] / _SAMPLES
        places = (family.ends[:, 0] * (1 - shares) + family.ends[:, 1] * shares).reshape(-1, 2)
        np.add.at(density, self.of(places), np.tile(family.lengths * self.unit / self.side / _SAMPLES, _SAMPLES))
        return np.asarray(gaussian_blur(density, _SPREAD), np.float32)


def plane_candidates(
    segments: Segments, points: list[Float64[np.ndarray, "3"]], cells: Cells
) -> list[PlaneCandidate]:
    """The planes on which segments of two vanishing points meet, the best supported first."""
    agree = np.array([pointing_to(point, segments) for point in points])
    # On the line through two vanishing points, segments agree with both.
    families = [segments[own & (agree.sum(axis=0) == 1)] for own in agree]
    densities = [cells.density(family) for family in families]
    candidates = []
    for first, second in itertools.combinations(range(len(points)), 2):
        others = [density for number, density in enumerate(densities) if number not in (first, second)]
        shared = np.minimum(densities[first], densities[second])
        # Where another family is denser, single segments agree with this one by chance.
        shared[shared <= np.max(others, axis=0, initial=_MIN_DENSITY)] = 0
        pair = (points[first], points[second]), (families[first], families[second])
        candidates += _planes(*pair, shared, cells)
    return sorted(candidates, key=lambda candidate: -candidate.support)


def _planes(
    points: tuple[np.ndarray, np.ndarray],
    families: tuple[Segments, Segments],
    shared: Float32[np.ndarray, "m n"],
    cells: Cells,
) -> list[PlaneCandidate]:
    """The planes on which segments of two families meet: where their ``shared`` density is not 0."""
    import cv2

    # Planes that are parallel, as both sides of a street, are on different sides of the line through both points.
    line = np.cross(*points)
    side = matrix_product(cells.centres(), line[:2]) + line[2] > 0
    planes = []
    for half in (side, ~side):
        covered = ((shared > 0) & half).astype(np.uint8)
        closed = cv2.morphologyEx(covered, cv2.MORPH_CLOSE, np.ones((_GAP, _GAP), np.uint8)) * half
        count, labels = cv2.connectedComponents(closed.astype(np.uint8), connectivity=4)
        parts = [labels == label for label in range(1, count)]
        found = [_around(points, families, area, half, (shared, cells)) for area in parts]
        # Lines at one place, such as a joint between large tiles, lie on a plane with the next ones.
        if len(parts) > 1 and any(plane is not None and _is_thin(plane, cells) for plane in found):
            found.append(_around(points, families, convex_hull(closed > 0) & half, half, (shared, cells)))
        planes += found
    return [plane for plane in planes if plane is not None]


def _around(
    points: tuple[np.ndarray, np.ndarray],
    families: tuple[Segments, Segments],
    area: Mask,
    half: Mask,
    density: tuple[Float32[np.ndarray, "m n"], Cells],
) -> PlaneCandidate | None:
    """The plane of the segments in and beside an area; none where that is small."""
    import cv2

    shared, cells = density
    # Segments at the borders have few neighbours.
    near = cv2.dilate(area.astype(np.uint8), np.ones((3, 3), np.uint8)) * half > 0
    first, second = (family[near[cells.of(family.middles)]] for family in families)
    if np.count_nonzero(area) < _MIN_CELLS or not (len(first.ends) and len(second.ends)):
        return None
    plane = _plane(points, (first, second), area, float(shared[area].sum()))
    return None if plane is None else replace(plane, corners=_shown_part(plane.corners, cells))


def _is_thin(plane: PlaneCandidate, cells: Cells) -> bool:
    """Whether the rectangle is narrower than a cell."""
    corners = cells.pixels(plane.corners)
    sides = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    return bool(min(sides[::2].max(), sides[1::2].max()) < cells.side)


def _plane(
    points: tuple[np.ndarray, np.ndarray], families: tuple[Segments, Segments], area: Mask, support: float
) -> PlaneCandidate | None:
    """The rectangle around segments whose directions have these vanishing points; none where it is degenerate."""
    middles = np.concatenate([family.middles for family in families])
    lengths = np.concatenate([family.lengths for family in families])
    origin = np.average(middles, axis=0, weights=lengths)
    towards = np.array([point[:2] - point[2] * origin for point in points])
    towards /= np.maximum(np.hypot(*towards.T), 1e-12)[:, None]
    if abs(float(determinant(towards))) < _MIN_SINE:
        return None
    down = int(abs(towards[1, 0]) > abs(towards[0, 0]))
    across = 1 - down
    # Down and to the right in the photograph.
    axes = points[down] * np.copysign(1, towards[down, 0]), points[across] * np.copysign(1, towards[across, 1])
    matrix = np.stack([*axes, np.append(origin, 1)], axis=1)
    back, ordered = inverse_of(matrix), (families[down], families[across])
    borders = [_borders(ordered[1 - axis], ordered[axis], back, axis) for axis in (0, 1)]
    low, high = np.array(borders).T
    square = np.array([low, (low[0], high[1]), high, (high[0], low[1])])
    corners = matrix_product(np.concatenate([square, np.ones((4, 1))], axis=1), matrix.T)
    if not ((high > low).all() and (corners[:, 2] > 0).all()):
        return None
    return PlaneCandidate(corners[:, :2] / corners[:, 2:], area, support, ordered)


def _shown_part(corners: Float64[np.ndarray, "4 2"], cells: Cells) -> Float64[np.ndarray, "4 2"]:
    """The rectangle, or the part of it that shows most where the photograph shows less than half.

    Of a wall in steep perspective the photograph shows a wedge.
    """
    steps = (np.arange(_STEPS) + 0.5) / _STEPS
    matrix = bezier.homography(corners)
    places = cells.pixels(_on_plane(steps, steps, matrix))
    shown = ((places >= 0) & (places <= np.array(cells.size) - 1)).all(axis=2)
    if shown.mean() >= _LEAST_SHOWN or not shown.any():
        return corners
    sums = np.cumsum(np.pad(np.where(shown, 1, -_COST), ((1, 0), (0, 0))), axis=0)
    best, part = 0.0, (0, _STEPS, 0, _STEPS)
    for first, last in itertools.combinations(range(_STEPS + 1), 2):
        along = np.append(0, np.cumsum(sums[last] - sums[first]))
        gain = along - np.minimum.accumulate(along)
        end = int(gain.argmax())
        if gain[end] > best:
            best, part = float(gain[end]), (first, last, int(along[: end + 1].argmin()), end)
    top, bottom, left, right = (edge / _STEPS for edge in part)
    ends = _on_plane(np.array([top, bottom]), np.array([left, right]), matrix)
    return np.array([ends[0, 0], ends[0, 1], ends[1, 1], ends[1, 0]])


def _on_plane(
    down: Float64[np.ndarray, "m"],  # type: ignore[name-defined]
    across: Float64[np.ndarray, "n"],  # type: ignore[name-defined]
    matrix: Float64[np.ndarray, "3 3"],
) -> Float64[np.ndarray, "m n 2"]:
    """Places at shares of the sides of a rectangle."""
    square = np.stack([*np.meshgrid(down, across, indexing="ij"), np.ones((len(down), len(across)))], axis=2)
    flat = matrix_product(square, matrix.T)
    return flat[..., :2] / flat[..., 2:]


def _borders(lines: Segments, others: Segments, back: np.ndarray, axis: int) -> tuple[float, float]:
    """The first and last of the lines that run across an axis of a plane, as far as the others reach along it.

    Parameters
    ----------
    back : from the photograph to the plane, whose w is 1 in its middle.
    """
    reach, weights = _along(others.ends.reshape(-1, 2), np.repeat(others.lengths, 2), back, axis)
    low, high = _quantiles(reach, weights)
    slack = _SLACK * (high - low)
    values, weights = _along(lines.middles, lines.lengths, back, axis)
    return _quantiles(values, np.where((values > low - slack) & (values < high + slack), weights, 0))


def _along(places: np.ndarray, lengths: np.ndarray, back: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates on a plane, and lengths, which are 0 where the plane is too far away."""
    flat = matrix_product(np.concatenate([places, np.ones((len(places), 1))], axis=1), back.T)
    return flat[:, axis] / flat[:, 2], np.where(flat[:, 2] > 1 / _MAX_DEPTH, lengths, 0)


def _quantiles(values: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    """The values that a small share of the weights is below, and above."""
    order = np.argsort(values, kind="stable")
    sums = np.cumsum(weights[order])
    low, high = (values[order][np.searchsorted(sums, share * sums[-1])] for share in (_BORDER, 1 - _BORDER))
    return float(low), float(high)
