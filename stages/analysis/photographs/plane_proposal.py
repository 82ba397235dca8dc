"""Plane proposal: the corners of rectangles on the planes of a photograph, from its vanishing points."""

import dataclasses
import itertools
import logging
import math

import numpy as np
from jaxtyping import Float32, Float64
from pydantic import Field

from texloom.stages.analysis.photographs.vanishing import Segments, pointing_to, vanishing_points
from texloom.stages.common.grids.pyramid import scaled
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import determinant, inverse_of, matrix_product
from texloom.stages.vocabulary.arrays import Image, Mask, Quads
from texloom.stages.vocabulary.color import srgb_from_linear
from texloom.stages.vocabulary.declare import Document, Params, stage

_LOG = logging.getLogger(__name__)

_MAX_SIDE = 1024  # px of the longer side at which segments are detected
_MIN_LENGTH = 0.02  # of a segment, half diagonals
_FAMILIES = 4  # vanishing points
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
_COLORS = ((1.0, 0.1, 0.1), (0.1, 1.0, 0.1))  # of segments down and across


class PlaneProposalParams(Params):
    """When planes are proposed, and how many."""

    most: int = Field(1, ge=1, le=8)
    """maximum number of planes, the best supported first"""
    support: float = Field(0.08, gt=0, le=1)
    """minimum share of the length of all line segments that has to run in each direction of a plane"""
    geometry: Document | None = None
    """a file that says where the surfaces lie, see `jacobian_field`: no planes are proposed"""


@dataclasses.dataclass(frozen=True)
class PlaneProposal:
    """The proposed planes."""

    corners: Quads
    """a rectangle on each plane, around its line segments; none where no two directions are evident"""
    picture: Image
    """the photograph with the rectangles and their segments, red down and green across"""


@stage(version=1)
def plane_proposal(image: Image, params: PlaneProposalParams) -> PlaneProposal:
    """Propose rectangles on the planes of a photograph: walls of bricks, tiles, windows.

    Line segments that point to the same vanishing point are parallel in space. Where segments of two such families
    meet, they lie on a plane, and the homography of the plane follows from both vanishing points but for the
    aspect ratio. The rectangle encloses the segments of both; it may reach beyond the photograph.

    Parameters
    ----------
    image : the photograph.

    References
    ----------
    [Gioi2010]_ the segments. [LiebowitzZisserman1998]_ rectification by vanishing points. Where planes lie is ours.
    """
    cells = _PhotographCells((image.height, image.width))
    if params.geometry is not None:
        return PlaneProposal(np.empty((0, 4, 2), np.float32), _drawn(image, [], cells))
    segments = _segments(image, cells)
    points = vanishing_points(segments, _FAMILIES, params.support)
    agree = np.array([pointing_to(point, segments) for point in points])
    # On the line through two vanishing points, segments agree with both.
    families = [segments[own & (agree.sum(axis=0) == 1)] for own in agree]
    densities = [cells.density(family) for family in families]
    proposals = []
    for first, second in itertools.combinations(range(len(points)), 2):
        others = [density for number, density in enumerate(densities) if number not in (first, second)]
        shared = np.minimum(densities[first], densities[second])
        # Where another family is denser, single segments agree with this one by chance.
        shared[shared <= np.max(others, axis=0, initial=_MIN_DENSITY)] = 0
        pair = (points[first], points[second]), (families[first], families[second])
        proposals += _planes(*pair, shared, cells)
    kept: list[_Plane] = []
    for plane in sorted(proposals, key=lambda plane: -plane.support):
        if len(kept) < params.most and not any((plane.area & other.area).any() for other in kept):
            kept.append(plane)
    if not kept:
        _LOG.warning(
            "no plane is evident from the photograph's lines; without a geometry file it counts as frontal"
        )
    corners = np.array([cells.pixels(plane.corners) for plane in kept]).reshape(-1, 4, 2)
    return PlaneProposal(corners.astype(np.float32), _drawn(image, kept, cells))


@dataclasses.dataclass(frozen=True)
class _Plane:
    corners: Float64[np.ndarray, "4 2"]
    area: Mask
    """its cells"""
    support: float
    families: tuple[Segments, Segments]
    """down and across"""


@dataclasses.dataclass(frozen=True)
class _PhotographCells:
    """Positions in a photograph: px; from its middle in half diagonals; and cells of a coarse grid."""

    size: tuple[int, int]
    """of the photograph, px"""

    @property
    def unit(self) -> float:
        """Half the diagonal, px."""
        return float(np.hypot(*self.size)) / 2

    @property
    def side(self) -> float:
        """Of a cell, px."""
        return max(self.size) / _GRID

    def pixels(self, places: np.ndarray) -> np.ndarray:
        """Rows and columns, px."""
        return np.asarray(places * self.unit + (np.array(self.size) - 1) / 2)

    def places(self, pixels: np.ndarray) -> np.ndarray:
        """The same in half diagonals from the middle."""
        return np.asarray((pixels - (np.array(self.size) - 1) / 2) / self.unit)

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


def _segments(image: Image, cells: _PhotographCells) -> Segments:
    """The line segments of a photograph, in half diagonals from its middle."""
    import cv2

    factor = min(1.0, _MAX_SIDE / max(image.height, image.width))
    grey = cv2.cvtColor(srgb_from_linear(image.color).astype(np.float32), cv2.COLOR_RGB2GRAY)
    sides = (scaled(image.width, factor), scaled(image.height, factor))
    small = cv2.resize(np.rint(grey * 255).astype(np.uint8), sides, interpolation=cv2.INTER_AREA)
    lines = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(small)[0]
    ends = np.zeros((0, 2, 2)) if lines is None else lines.reshape(-1, 2, 2)[..., ::-1].astype(np.float64)
    segments = Segments(cells.places((ends + 0.5) * np.array(cells.size) / small.shape - 0.5))
    return segments[segments.lengths >= _MIN_LENGTH]


def _planes(
    points: tuple[np.ndarray, np.ndarray],
    families: tuple[Segments, Segments],
    shared: Float32[np.ndarray, "m n"],
    cells: _PhotographCells,
) -> list[_Plane]:
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
        for label in range(1, count):
            area = labels == label
            # Segments at the borders have few neighbours.
            around = cv2.dilate(area.astype(np.uint8), np.ones((3, 3), np.uint8)) * half > 0
            first, second = (family[around[cells.of(family.middles)]] for family in families)
            if np.count_nonzero(area) >= _MIN_CELLS and len(first.ends) and len(second.ends):
                planes.append(_plane(points, (first, second), area, float(shared[area].sum())))
    return [plane for plane in planes if plane is not None]


def _plane(
    points: tuple[np.ndarray, np.ndarray], families: tuple[Segments, Segments], area: Mask, support: float
) -> _Plane | None:
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
    return _Plane(corners[:, :2] / corners[:, 2:], area, support, ordered)


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


def _drawn(image: Image, planes: list[_Plane], cells: _PhotographCells) -> Image:
    import cv2

    canvas = np.ascontiguousarray(0.6 * np.clip(image.color, 0, 1), np.float32)
    thickness = max(1, round(min(canvas.shape[:2]) / 384))

    def draw(places: np.ndarray, closed: bool, color: tuple[float, float, float]) -> None:
        fixed = np.rint(np.clip(cells.pixels(places)[..., ::-1], -1e5, 1e5) * 16).astype(np.int32)
        cv2.polylines(canvas, list(fixed), closed, color, thickness, cv2.LINE_AA, 4)

    for plane in planes:
        for family, color in zip(plane.families, _COLORS, strict=True):
            draw(family.ends, False, color)
        draw(plane.corners[None], True, (1.0, 0.8, 0.0))
    return Image(canvas, ("R", "G", "B"))
