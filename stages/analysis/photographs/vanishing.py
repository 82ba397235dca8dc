"""Vanishing points of line segments.

Points and lines are homogeneous, (row, column, w), in coordinates whose origin is the middle of the photograph and
whose unit is half its diagonal, so that points at infinity are well conditioned.
"""

import numpy as np
from jaxtyping import Bool, Float64

from texloom.stages.common.features.line_segments import Segments
from texloom.stages.kernels.core.elementary_functions import arctan2, cos, sin
from texloom.stages.numerics.matrices import least_squares, length_of, matrix_product

_CANDIDATES = 90  # longest segments whose intersections are tried
_VOTERS = 500  # longest segments that choose among these
_PARTS = 64  # of the intersections, few enough for a processor's cache
_TOLERANCE = np.radians(1.5)  # between a segment and the line from its middle to its vanishing point
_TANGENT = float(sin(_TOLERANCE) / cos(_TOLERANCE))
_WIDE_TOLERANCE = np.radians(3.0)  # of segments that no further family may have

_HALF_PX = 1e-3  # half diagonals, about half a px
_PASSES = 20
_CHANGE = 1e-7  # by which slopes are measured


def vanishing_points(segments: Segments, most: int, min_share: float) -> list[Float64[np.ndarray, "3"]]:
    """The vanishing points that most of the length of the segments agrees with, best first.

    Each is that intersection of two long segments to which most others point, refined by least squares; its
    segments are then left out.

    Parameters
    ----------
    most : maximum number.
    min_share : of the total length that has to agree.
    """
    total = float(segments.lengths.sum())
    chosen: list[Float64[np.ndarray, "3"]] = []
    while len(chosen) < most and len(segments.ends) > 2:
        point = _best_intersection(segments)
        for _ in range(2):
            point = _refined(point, segments[deviations(point, segments) < _TOLERANCE])
        if float(segments.lengths[deviations(point, segments) < _TOLERANCE].sum()) < min_share * total:
            break
        chosen.append(point)
        segments = segments[deviations(point, segments) >= _WIDE_TOLERANCE]
    return chosen


def pointing_to(point: Float64[np.ndarray, "3"], segments: Segments) -> Bool[np.ndarray, "n"]:  # type: ignore[name-defined]
    """The segments that agree with a vanishing point."""
    return _agree(point, segments)


def deviations(points: Float64[np.ndarray, "*m 3"], segments: Segments) -> Float64[np.ndarray, "*m n"]:
    """Angles between segments and the lines from their middles to vanishing points, 0..pi/2."""
    cross, dot = _products(points, segments)
    return np.asarray(arctan2(np.abs(cross), np.abs(dot)))


def _agree(points: Float64[np.ndarray, "*m 3"], segments: Segments) -> Bool[np.ndarray, "*m n"]:
    """Whether `deviations` are below the tolerance, without an arctangent for each."""
    cross, dot = _products(points, segments)
    return np.asarray(np.abs(cross) < _TANGENT * np.abs(dot))


def _products(points: Float64[np.ndarray, "*m 3"], segments: Segments) -> tuple[np.ndarray, np.ndarray]:
    """Cross and dot products of segments and the ways from their middles to vanishing points."""
    along = segments.ends[:, 1] - segments.ends[:, 0]
    down, across = (points[..., None, axis] - points[..., None, 2] * segments.middles[:, axis] for axis in (0, 1))
    cross = down * along[:, 1] - across * along[:, 0]
    return cross, down * along[:, 0] + across * along[:, 1]


def _best_intersection(segments: Segments) -> Float64[np.ndarray, "3"]:
    order = np.argsort(-segments.lengths, kind="stable")[:_CANDIDATES]
    ends = np.concatenate([segments.ends[order], np.ones((len(order), 2, 1))], axis=2)
    voters = segments[np.argsort(-segments.lengths, kind="stable")[:_VOTERS]]
    lines = np.cross(ends[:, 0], ends[:, 1])
    first, second = np.triu_indices(len(order), 1)
    points = np.cross(lines[first], lines[second])
    size = np.linalg.norm(points, axis=1)
    points = points[size > 1e-9] / size[size > 1e-9, None]
    parts = np.array_split(points, _PARTS)
    agreeing = matrix_product(np.concatenate([_agree(part, voters) for part in parts]), voters.lengths)
    return np.asarray(points[int(agreeing.argmax())])


def _refined(point: Float64[np.ndarray, "3"], segments: Segments) -> Float64[np.ndarray, "3"]:
    """The point for which lines from the middles of its segments pass their ends most closely."""
    first = np.cross(point, np.eye(3)[np.abs(point).argmin()])
    first /= length_of(first)
    basis = np.stack([point, first, np.cross(point, first)])  # the last two are at right angles to the point

    def moved(step: np.ndarray) -> np.ndarray:
        turned = basis[0] + matrix_product(step, basis[1:])
        return np.asarray(turned / length_of(turned))

    def distances(step: np.ndarray) -> np.ndarray:
        """In half px, about."""
        return np.asarray(sin(deviations(moved(step), segments)) * segments.lengths / 2 / _HALF_PX)

    step = np.zeros(2)
    for _ in range(_PASSES):  # Gauss and Newton's, with weights that count far segments by their distance alone
        off = distances(step)
        slopes = np.stack([(distances(step + change) - off) / _CHANGE for change in _CHANGE * np.eye(2)], axis=1)
        weight = 1 / np.sqrt(np.sqrt(1 + off**2))
        step = step - least_squares(weight[:, None] * slopes, weight * off)
    return moved(step)
