"""Cells of courses whose elements are equally long, from joint to joint, with a phase of their own in each."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64

from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import inverse_of, matrix_product
from texloom.stages.synthesis.near_regular.cell_outline import CellOutline

_INSIDE = np.linspace(0.2, 0.8, 13)  # shares of a course's height that are compared: its own joints lie outside
_MIN_SEEN = 0.8  # of these, at a place along a course
_MIN_LENGTH = 0.6  # of an element, in heights of the courses
_MIN_SHOWN = 2.0  # elements of a course
_MIN_LIKENESS = 0.35  # mean correlation of joints along courses with those one element on
_TOLERANCE = 0.8  # of that of the best length, that a shorter one has to reach: twice an element repeats too
_MIN_COURSES = 3
_ROUNDS = 3
_JOINT = 0.08  # of a course's height, within which changes of colour are one joint's


@dataclass(frozen=True)
class CourseCells:
    """The elements of an exemplar's courses."""

    outline: CellOutline
    """of one element, between its joints"""
    vertices: Float64[np.ndarray, "cells 2"]
    """where each begins, px"""
    shifts: Float64[np.ndarray, " pairs"]
    """of each course against the one before, as a share of an element's length"""

    def offsets(self, rows: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Where elements of numbered courses begin, as shares of their length, by shifts drawn from ``shifts``."""
        number = rows - rows.min()
        drawn = rng.choice(self.shifts, int(number.max()) + 1) if len(self.shifts) else np.zeros(number.max() + 1)
        return np.asarray(np.cumsum(drawn)[number] % 1.0)


@dataclass(frozen=True)
class CourseEdges:
    """Changes of the mean colour of courses along them, which joints have."""

    rows: list[int]
    """steps of the courses that are seen"""
    first: list[float]
    """where along them they begin, px"""
    changes: list[Float64[np.ndarray, " length"]]
    """at each px from there"""


def course_cells(
    features: Float32[np.ndarray, "h w c"],
    valid: Bool[np.ndarray, "h w"],
    vertex: Float64[np.ndarray, "2"],
    outline: CellOutline,
) -> CourseCells | None:
    """The elements of courses, if all are equally long.

    Joints across courses are changes of their mean colour along them. Where these repeat at one distance in all
    courses, whatever their phase, elements are that long. None where they do not, as in a wall of rubble.

    Parameters
    ----------
    features : of the straightened exemplar.
    valid : which of its pixels may be used.
    vertex : of its courses, px.
    outline : a rectangle along courses, see `course_outline`.
    """
    upright, along = outline.side, outline.base
    unit = along / np.hypot(*along)
    height = float(np.hypot(*upright))
    edges = course_edges(features, valid, vertex, outline)
    rows = edges.rows
    if len(rows) < _MIN_COURSES:
        return None
    length = _common_length(edges.changes, _MIN_LENGTH * height)
    if length is None:
        return None
    begins, shares = [], []
    frame = np.array([upright, length * unit])
    phase = outline.phase or (0.0, 0.0)
    for row, start, line, joint in zip(
        rows, edges.first, edges.changes, _phases(edges.changes, length, height), strict=True
    ):
        count = int((len(line) - joint) // length) + 1
        along_course = start + joint + length * np.arange(-1, count + 1)
        begins.append(vertex + row * upright + along_course[:, None] * unit)
        shares.append((start + joint) / length)
    shifts = np.diff(shares)[np.diff(rows) == 1] % 1.0
    return CourseCells(CellOutline.rectangle(frame, (phase[0], 0.0)), np.concatenate(begins), shifts)


def course_edges(
    features: Float32[np.ndarray, "h w c"],
    valid: Bool[np.ndarray, "h w"],
    vertex: Float64[np.ndarray, "2"],
    outline: CellOutline,
) -> CourseEdges:
    """The changes of colour along the courses that are seen.

    Parameters
    ----------
    features : of the straightened exemplar.
    valid : which of its pixels may be used.
    vertex : of its courses, px.
    outline : a rectangle along courses, see `course_outline`.
    """
    unit = outline.base / np.hypot(*outline.base)
    upright, phase = outline.side, (outline.phase or (0.0, 0.0))[0]
    corners = (np.array([(0, 0), (0, 1), (1, 0), (1, 1)]) * valid.shape) - vertex
    ends = matrix_product(corners, inverse_of(np.array([upright, unit])))
    low, high = np.floor(ends.min(axis=0)).astype(int), np.ceil(ends.max(axis=0)).astype(int)
    rows, first, edges = [], [], []
    for row in range(low[0] - 1, high[0] + 1):
        across = (row + phase + _INSIDE)[:, None, None] * upright
        places = np.rint(vertex + across + np.arange(low[1], high[1] + 1)[None, :, None] * unit).astype(np.int64)
        inside = ((places >= 0) & (places < valid.shape)).all(axis=2)
        places = np.where(inside[..., None], places, 0)
        inside &= valid[places[..., 0], places[..., 1]]
        seen = np.flatnonzero(inside.mean(axis=0) >= _MIN_SEEN)
        if len(seen) < 2 * _MIN_LENGTH * np.hypot(*upright):
            continue
        span = np.s_[seen[0] : seen[-1] + 1]
        values = np.where(inside[..., None], features[places[..., 0], places[..., 1]], 0)[:, span]
        mean = values.sum(axis=0, dtype=np.float64) / np.maximum(inside[:, span].sum(axis=0), 1)[:, None]
        change = np.zeros(len(mean))
        change[1:-1] = np.sqrt(((mean[2:] - mean[:-2]) ** 2).sum(axis=1))
        rows.append(row)
        first.append(float(low[1] + seen[0]))
        edges.append(change)
    return CourseEdges(rows, first, edges)


def _phases(edges: list[np.ndarray], length: float, height: float) -> list[float]:
    """Where the first joint of each course is, px from its begin."""
    size = round(length)
    folded = np.array(
        [np.bincount((np.arange(len(line)) % length).astype(int), line, size)[:size] for line in edges]
    )
    folded = _around(folded / np.maximum(folded.sum(axis=1, keepdims=True), 1e-12), 1.0)
    phases = _around(folded, _JOINT * height).argmax(axis=1)
    # What is seen as a joint's middle depends on the colours beside it, so that courses are brought in step.
    for _ in range(_ROUNDS):
        mean = np.mean([np.roll(line, -phase) for line, phase in zip(folded, phases, strict=True)], axis=0)
        near = np.arange(-int(height / 4), int(height / 4) + 1)
        fits = [
            [float((np.roll(line, -phase - move) * mean).sum()) for move in near]
            for line, phase in zip(folded, phases, strict=True)
        ]
        phases = phases + near[np.argmax(fits, axis=1)]
    mean = np.mean([np.roll(line, -phase) for line, phase in zip(folded, phases, strict=True)], axis=0)
    near = np.arange(-int(3 * _JOINT * height), int(3 * _JOINT * height) + 1)
    weights = mean[near] - mean[near].min()
    middle = float((weights * near).sum() / max(float(weights.sum()), 1e-12))
    return [float(phase + middle) % length for phase in phases]


def _around(lines: np.ndarray, sigma: float) -> np.ndarray:
    """Rows that continue at their ends, blurred along."""
    size = lines.shape[1]
    return np.array([gaussian_blur(np.tile(line, 3)[None], sigma)[0, size : 2 * size] for line in lines])


def _common_length(edges: list[np.ndarray], least: float) -> float | None:
    """The distance after which joints return in all courses, px; none where there is none."""
    size = max(len(line) for line in edges)
    most = int(size / _MIN_SHOWN)
    total, number = np.zeros(most + 1), np.zeros(most + 1)
    for line in edges:
        smooth = gaussian_blur(line[None], 1.5)[0]
        smooth = smooth - smooth.mean()
        for lag in range(int(least), min(most, len(line) // 2) + 1):
            one, other = smooth[lag:], smooth[:-lag]
            norm = np.sqrt((one**2).sum() * (other**2).sum())
            total[lag] += float((one * other).sum() / norm) if norm > 0 else 0.0
            number[lag] += 1
    likeness = np.where(number >= _MIN_COURSES, total / np.maximum(number, 1), -1.0)
    best = float(likeness.max())
    if best < _MIN_LIKENESS:
        return None
    peaks = [
        lag
        for lag in range(1, most)
        if likeness[lag] >= _TOLERANCE * best
        and likeness[lag] >= likeness[lag - 1]
        and likeness[lag] >= likeness[lag + 1]
    ]
    return float(peaks[0]) if peaks else None
