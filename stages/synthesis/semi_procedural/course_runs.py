"""Runs of blocks of courses whose blocks differ in length: from joint to joint, and about equally long."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64

from texloom.stages.analysis.regularity.straighten import Positions
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.synthesis.near_regular.cell_outline import CellOutline
from texloom.stages.synthesis.near_regular.course_cells import CourseEdges, course_edges
from texloom.stages.synthesis.near_regular.lattice_tiles import Window
from texloom.stages.synthesis.semi_procedural.cell_contents import box_of

STRETCH = 0.1
"""of a run's length, by which it is made longer or shorter at most"""

_BLUR = 0.06  # of a course's height: both edges of a joint become one peak
_CLEAR = 2.2  # times the median change of colour: joints have 2 to 4 of it, grain up to 1.8
_WIDE = 0.15  # of a course's height: joints are up to twice as wide
_APART = 0.3  # of a course's height, between joints
_SHORTEST, _LONGEST = 1.5, 8.0  # of a run, in heights of the courses
_FEWEST = 8  # runs
_FROM = 2  # courses


@dataclass(frozen=True)
class CourseRuns:
    """Runs of an exemplar's courses."""

    outline: CellOutline
    """of one run, between its joints"""
    begins: Float64[np.ndarray, "runs 2"]
    """where each begins on its course, px"""
    lengths: Float64[np.ndarray, " runs"]
    """of each, px; within 10 % of that of the outline"""

    def laid_out(
        self, straight: Positions, around: Window, most: int
    ) -> tuple[Float32[np.ndarray, "H W 2"], Float64[np.ndarray, "runs 2"]]:
        """Boxes of all runs, one below the other, all of one length: where their pixels are, and their begins.

        Parameters
        ----------
        straight : for each pixel of the straightened exemplar its place in the exemplar, px.
        around : the window of a run.
        most : pixels of all boxes; runs beyond are left out, evenly.
        """
        from texloom.stages.kernels.core.resample import sampled

        first, shape = box_of(around)
        offsets = (np.moveaxis(np.indices(shape), 0, -1) + first).astype(np.float64)
        length = float(np.hypot(*self.outline.base))
        unit = self.outline.base / length
        along = matrix_product(offsets, unit)[..., None] * unit
        count = min(len(self.begins), max(1, most // int(shape.prod())))
        chosen = np.arange(count) * len(self.begins) // count
        scales = (self.lengths[chosen] / length - 1)[:, None, None, None]
        places = self.begins[chosen, None, None] + offsets + scales * along
        outside = ((places < 0) | (places > np.array(straight.shape[:2]) - 1)).any(axis=-1)
        found = sampled(straight, places.reshape(-1, 2)).reshape(*outside.shape, 2)
        found[outside] = -1
        points = np.arange(count)[:, None] * np.array([shape[0], 0]) - first
        return found.reshape(-1, shape[1], 2).astype(np.float32), points.astype(np.float64)


def course_runs(
    features: Float32[np.ndarray, "h w c"],
    valid: Bool[np.ndarray, "h w"],
    vertex: Float64[np.ndarray, "2"],
    outline: CellOutline,
) -> CourseRuns | None:
    """Runs of one length, of which there are most; none where fewer than eight are seen, or in one course alone.

    Parameters
    ----------
    features : of the straightened exemplar.
    valid : which of its pixels may be used.
    vertex : of its courses, px.
    outline : a rectangle along them, see `course_outline`.
    """
    edges = course_edges(features, valid, vertex, outline)
    unit = outline.base / np.hypot(*outline.base)
    height = float(np.hypot(*outline.side))
    found = [
        (row, start + one, start + other)
        for row, start, joints in zip(edges.rows, edges.first, _joints_of(edges, height), strict=True)
        for number, one in enumerate(joints)
        for other in joints[number + 1 :]
        if _SHORTEST * height <= other - one <= _LONGEST * height
    ]
    if not found:
        return None
    rows, begin, end = (np.array(one) for one in zip(*found, strict=True))
    lengths = end - begin
    near = np.abs(lengths[:, None] / lengths - 1) <= STRETCH
    best = int(np.argmax(near.sum(axis=0)))
    kept = near[:, best]
    if kept.sum() < _FEWEST or len(np.unique(rows[kept])) < _FROM:
        return None
    places = vertex + rows[kept, None] * outline.side + begin[kept, None] * unit
    length = round(float(lengths[best]))
    phase = (outline.phase or (0.0, 0.0))[0]
    frame = np.rint(np.array([outline.side, length * unit]))
    return CourseRuns(CellOutline.rectangle(frame, (phase, 0.0)), places, lengths[kept])


def _joints_of(edges: CourseEdges, height: float) -> list[list[float]]:
    """Where each course has clear joints, px from its begin."""
    smooth = [gaussian_blur(line[None], max(1.0, _BLUR * height))[0] for line in edges.changes]
    usual = float(np.median(np.concatenate(smooth)))
    reach, around = max(1, round(_APART * height)), max(1, round(_WIDE * height))
    joints = []
    for line in smooth:
        peaks = [
            int(at)
            for at in np.flatnonzero(line >= _CLEAR * usual)
            if reach <= at < len(line) - reach and line[at] == line[at - reach : at + reach + 1].max()
        ]
        # a wide joint has a peak at one of its edges
        joints.append([at + _middle(np.maximum(line[at - around : at + around + 1] - usual, 0)) for at in peaks])
    return joints


def _middle(weights: np.ndarray) -> float:
    places = np.arange(len(weights)) - len(weights) // 2
    return float((weights * places).sum() / weights.sum())
