"""Tracking of courses: where the courses of an exemplar are along their length."""

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.analysis.regularity.vertices import Vertices
from texloom.stages.numerics.matrices import length_of, matrix_product

_PASSES = 2  # with the mean of the aligned courses as template
_MIN_CORRELATION = 0.4  # of a course with the template
_MIN_COVERAGE = 0.6  # of a strip's width inside the exemplar


def track_courses(
    plane: Float32[np.ndarray, "h w"], period: np.ndarray, along: np.ndarray, reach: float
) -> tuple[Vertices, Float64[np.ndarray, "n"]]:  # type: ignore[name-defined]
    """Where each course begins in each strip across all courses, and its correlation with the mean course.

    Parameters
    ----------
    period : the step from course to course, px.
    along : at right angles to it, a strip's width, px.
    reach : maximum deviation from even spacing, as a share of the period.

    Returns
    -------
    The vertices' steps count courses and strips.
    """
    profiles, first, middles = _strip_profiles(plane, period, along)
    length = float(np.hypot(*period))
    window = np.arange(round(length))
    shifts = np.arange(-round(reach * length), round(reach * length) + 1)
    starts = np.arange(np.ceil(-first / length), (profiles.shape[1] - length - first) // length + 1) * length
    # Samples by strip, course, shift and position in the course; NaN outside the exemplar.
    places = starts[:, None, None] + shifts[:, None] + window + first
    samples = np.stack([np.interp(places, np.arange(len(line)), line, np.nan, np.nan) for line in profiles])
    samples = samples - samples.mean(axis=-1, keepdims=True)
    samples /= np.maximum(np.linalg.norm(samples, axis=-1, keepdims=True), 1e-9)
    known = ~np.isnan(samples).any(axis=(2, 3))
    chosen = np.full(known.shape, len(shifts) // 2)
    likeness = np.zeros(samples.shape[:3])
    for _ in range(_PASSES):
        aligned = np.take_along_axis(samples, chosen[..., None, None], axis=2)[:, :, 0]
        template = aligned[known].sum(axis=0) if known.any() else np.zeros(len(window))
        likeness = matrix_product(samples, template / max(float(length_of(template)), 1e-9))
        chosen = np.argmax(np.where(known[..., None], likeness, 0), axis=2)
    best = np.take_along_axis(likeness, chosen[..., None], axis=2)[..., 0]
    strip, course = np.nonzero(known & (np.nan_to_num(best) >= _MIN_CORRELATION))
    moves = _subpixel(likeness[strip, course], chosen[strip, course]) + shifts[0]
    across = (starts[course] + moves)[:, None] * (period / length)
    vertices = across + middles[strip][:, None] * (along / np.hypot(*along))
    steps = np.stack([np.rint(starts[course] / length), strip], axis=1).astype(np.int64)
    return Vertices(steps, vertices, None), np.clip(best[strip, course], 0, 1)


def _strip_profiles(
    plane: Float32[np.ndarray, "h w"], period: np.ndarray, along: np.ndarray
) -> tuple[Float64[np.ndarray, "strips n"], float, Float64[np.ndarray, "strips"]]:  # type: ignore[name-defined]
    """Means along the courses in each strip, px by px across them; NaN where too little of the strip is known.

    Also returned are the index of the origin in a profile, and each strip's middle, px along the courses.
    """
    width = float(np.hypot(*along))
    rows, columns = (np.arange(side, dtype=np.float64) for side in plane.shape)
    unit, tangent = period / np.hypot(*period), along / width
    across = rows[:, None] * unit[0] + columns * unit[1]
    beside = rows[:, None] * tangent[0] + columns * tangent[1]
    low, begin = np.floor(across.min()), float(beside.min())
    count = max(1, int((beside.max() - begin) // width))
    begin += (float(beside.max()) - begin - count * width) / 2
    strip = np.floor((beside - begin) / width).astype(np.int64)
    bin_ = np.rint(across - low).astype(np.int64)
    length = int(bin_.max()) + 1
    inside = (strip >= 0) & (strip < count)
    index = strip[inside] * length + bin_[inside]
    number = np.bincount(index, minlength=count * length).reshape(count, length)
    total = np.bincount(index, plane[inside], minlength=count * length).reshape(count, length)
    profiles = np.where(number >= _MIN_COVERAGE * width, total / np.maximum(number, 1), np.nan)
    return profiles, -float(low), begin + (np.arange(count) + 0.5) * width


def _subpixel(likeness: Float64[np.ndarray, "n shifts"], best: np.ndarray) -> Float64[np.ndarray, "n"]:  # type: ignore[name-defined]
    """The sub-pixel index of each row's maximum, by a parabola through its neighbours."""
    inner = np.clip(best, 1, likeness.shape[1] - 2)
    row = np.arange(len(best))
    before, middle, after = (likeness[row, inner + step] for step in (-1, 0, 1))
    curvature = before - 2 * middle + after
    shift = 0.5 * np.divide(before - after, curvature, out=np.zeros_like(curvature), where=curvature < 0)
    return np.asarray(np.where(inner == best, best + np.clip(shift, -0.5, 0.5), best))
