"""The courses of an exemplar: rows at an even spacing whose elements need not line up, as in a brick wall."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float32, Float64
from pydantic import Field

from texloom.stages.analysis.regularity.lattice import detail, gradient_magnitude, valid_lightness
from texloom.stages.common.grids.working_size import working_image
from texloom.stages.kernels.core.elementary_functions import cos, squared_size
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.vocabulary.arrays import Channels, Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.masks import valid_pixels

_MAX_SIDE = 256  # px of the shorter side at which candidates are compared
_MIN_COURSES = 4  # of an exemplar
_SEGMENTS = 4  # of a course, compared one by one
_MAX_BINS = 48  # of a profile across a course
_MIN_COVERAGE = 0.8  # of a segment's area inside the exemplar
_MIN_WEIGHT = 1e-9  # of a bin that is not empty
_MIN_PERIOD = 3.0  # px at which candidates are compared
_CANDIDATES = 8  # peaks of the spectrum
_MULTIPLES = (1, 2, 3)  # of the period of a peak; a profile's harmonics may exceed its fundamental
_MIN_PROMISING = 0.45  # confidence of a candidate that is worth a refinement
_MAX_COSINE = 0.9  # of the angle between directions that differ clearly
_CLEARER = 0.1  # of what the confidence of other rows lacks to 1; of weaves it is .35 and more
_DIVISORS = (2, 3)  # of a period, tried last
_TOLERANCE = 0.05  # of confidence that a shorter period may lose
_STEPS = (0.02, 0.007, 0.0025)  # of the refinement, relative to the period
_TURNS = ((1, 0), (-1, 0), (0, 1), (0, -1))


class CoursesParams(Params):
    """When courses are accepted."""

    confidence: float = Field(0.75, ge=-1, le=1)
    """minimum mean correlation of the profiles across courses"""
    worst: float = Field(0.45, ge=-1, le=1)
    """the same for each course alone"""
    lead: float = Field(0.33, ge=0, le=1)
    """minimum difference to the confidence of rows in another direction: where both show, elements line up along
    neither, as in a weave; less is enough where courses lack a tenth of what those rows lack to certainty, as where
    all blocks are equally long"""
    min_length: float = Field(10.0, ge=2)
    """minimum period, px"""

    def reduced(self, step: int) -> "CoursesParams":
        """The same for a picture whose pixels are ``step`` px of the exemplar."""
        return self.model_copy(update={"min_length": self.min_length / step})


@dataclasses.dataclass(frozen=True)
class Courses:
    """The period of the courses, if there are any."""

    generators: Vectors
    """one row: the step from a course to the next, at right angles to both, px; no rows where there are none"""
    best: Annotated[Float32[np.ndarray, "tried 2"], Channels(("row", "column"))]
    """the best period, accepted or not"""
    confidence: float
    """mean correlation of a segment's profile with the mean profile of all other courses, -1..1"""
    worst: float
    """the same of the least similar course"""
    rival: float
    """``confidence`` of the best rows in a clearly different direction; 0 where ``confidence`` is too low"""


@stage(version=2)
def courses(image: Image, params: CoursesParams) -> Courses:
    """Find evenly spaced parallel rows, whatever their elements' phase along them.

    Candidates are the peaks of the power spectrum of lightness and of gradient magnitude. For each, segments of
    every course are averaged along it, and each such profile is compared with the mean of the other courses. Random
    textures, and lines at uneven distances, have profiles that differ from course to course; patterns of two
    dimensions have rows in several directions.

    Parameters
    ----------
    image : the exemplar.

    Raises
    ------
    InputError
        all pixels are excluded.

    References
    ----------
    Ours.
    """
    small, step = working_image(image)
    lightness = valid_lightness(small)
    planes = unshaded(lightness, gradient_magnitude(lightness, valid_pixels(small)))
    found = detected_courses(planes, params.reduced(step))
    return dataclasses.replace(
        found, generators=found.generators * np.float32(step), best=found.best * np.float32(step)
    )


def detected_courses(planes: tuple[ScalarMap, ScalarMap], params: CoursesParams) -> Courses:
    """The courses of an image with these `unshaded` planes, see `courses`."""
    none = np.zeros((0, 2), np.float32)
    best, confidence, worst = none, 0.0, 0.0
    for plane in planes:
        candidate, likeness, least = _best_period(plane, params.min_length)
        if likeness > confidence:
            best, confidence, worst = candidate.astype(np.float32)[None], likeness, least
    accepted = confidence >= params.confidence and worst >= params.worst
    rival = 0.0
    if accepted:
        period = best[0].astype(np.float64)
        rival = max(_best_period(plane, params.min_length, period)[1] for plane in planes)
        accepted = confidence - rival >= params.lead or 1 - confidence <= _CLEARER * (1 - rival)
    return Courses(best if accepted else none, best, confidence, worst, rival)


def clearest_plane(lightness: ScalarMap, valid: Mask | None, period: np.ndarray) -> ScalarMap:
    """The one of lightness and its gradient magnitude, without shading, whose courses are more alike."""
    planes = unshaded(lightness, gradient_magnitude(lightness, valid))
    return max(planes, key=lambda plane: _confidence(plane, period.astype(np.float64))[0])


def unshaded(lightness: ScalarMap, gradients: ScalarMap) -> tuple[ScalarMap, ScalarMap]:
    """Lightness and its gradient magnitude, without shading: courses and lines are sought in both."""
    return detail(lightness), detail(gradients)


def _best_period(
    plane: ScalarMap, min_length: float, away_from: np.ndarray | None = None
) -> tuple[Float64[np.ndarray, "2"], float, float]:
    """The period of greatest confidence, that confidence, and the least one of a course.

    Parameters
    ----------
    away_from : a period from whose direction that sought differs clearly.
    """
    import cv2

    scale = max(1.0, min(plane.shape) / _MAX_SIDE)
    if min(plane.shape) < _MIN_COURSES * min_length or float(plane.std()) < 1e-6:
        return np.zeros(2), 0.0, 0.0
    small = plane
    if scale > 1:
        sides = tuple(round(side / scale) for side in plane.shape)
        small = cv2.resize(plane, sides[::-1], interpolation=cv2.INTER_AREA)
    periods = _spectral_periods(small, max(min_length / scale, _MIN_PERIOD))
    if away_from is not None:
        unit = away_from / np.hypot(*away_from)
        periods = [
            period for period in periods if abs(matrix_product(period, unit)) < _MAX_COSINE * np.hypot(*period)
        ]
    scored = [(period, *_confidence(small, period)) for period in periods]
    if not scored:
        return np.zeros(2), 0.0, 0.0
    highest = max(likeness for _, likeness, _ in scored)
    if highest < _MIN_PROMISING:
        return np.zeros(2), 0.0, 0.0
    shortest = min(
        (period for period, likeness, _ in scored if likeness >= highest - _TOLERANCE),
        key=lambda period: float(np.hypot(*period)),
    )
    best = _refined_period(small, shortest)
    for divisor in _DIVISORS:
        while np.hypot(*best[0]) >= divisor * max(min_length / scale, _MIN_PERIOD):
            finer = _refined_period(small, best[0] / divisor)
            if finer[1] < best[1] - _TOLERANCE:
                break
            best = finer
    return best[0] * scale, best[1], best[2]


def _spectral_periods(plane: ScalarMap, min_length: float) -> list[Float64[np.ndarray, "2"]]:
    """Periods of the strongest peaks of the power spectrum and their multiples, if enough courses fit."""
    import cv2

    height, width = plane.shape
    # Hann's window
    down, across = (0.5 + 0.5 * cos(np.pi * np.arange(1 - side, side, 2) / (side - 1)) for side in (height, width))
    window = np.outer(down, across).astype(np.float32)
    power = squared_size(np.fft.fftshift(np.fft.fft2(plane * window), axes=0)[:, : width // 2])
    rows = np.fft.fftshift(np.fft.fftfreq(height))[:, None]
    columns = (np.arange(width // 2) / width)[None, :]
    frequency = np.hypot(rows, columns)
    # Textures have more power at low frequencies.
    power = np.asarray(power * frequency**2, np.float32)
    power[(frequency > 1 / min_length) | (frequency < 1.5 / min(height, width))] = 0
    is_peak = (power >= cv2.dilate(power, np.ones((3, 3), np.uint8))) & (power > 0)
    row, column = np.nonzero(is_peak)
    order = np.argsort(-power[row, column], kind="stable")[:_CANDIDATES]
    periods = []
    for index in order:
        vector = np.array([rows[row[index], 0], columns[0, column[index]]])
        base = vector / matrix_product(vector, vector)
        for multiple in _MULTIPLES:
            period = base * multiple
            if matrix_product(np.abs(period), plane.shape) >= _MIN_COURSES * matrix_product(period, period):
                periods.append(period)
    return periods


def _refined_period(
    plane: ScalarMap, period: Float64[np.ndarray, "2"]
) -> tuple[Float64[np.ndarray, "2"], float, float]:
    """The period of greatest confidence near another, its confidence, and the least one of a course."""
    best, least = _confidence(plane, period)
    for step in _STEPS:
        improved = True
        while improved:
            improved = False
            normal = np.array([-period[1], period[0]])
            for along, across in _TURNS:
                moved = period + step * (along * period + across * normal)
                value, low = _confidence(plane, moved)
                if value > best + 1e-6:
                    period, best, least, improved = moved, value, low, True
    if tuple(np.rint(period * 1e6)) < (0, 0):
        period = -period
    return period, best, least


def _confidence(plane: ScalarMap, period: Float64[np.ndarray, "2"]) -> tuple[float, float]:
    """Mean correlation of segments' profiles with the other courses' mean, and that of the least similar course."""
    profiles, known = _profiles(plane, period)
    counts = known.sum(axis=1)
    if (counts > 0).sum() < _MIN_COURSES - 1:
        return 0.0, 0.0
    total = (profiles * known[..., None]).sum(axis=1)
    others = total.sum(axis=0) - total
    others = others / np.maximum(np.linalg.norm(others, axis=1, keepdims=True), 1e-12)
    likeness = (profiles * others[:, None]).sum(axis=2)
    by_course = (likeness * known).sum(axis=1)[counts > 0] / counts[counts > 0]
    return float(by_course.mean()), float(by_course.min())


def _profiles(
    plane: ScalarMap, period: Float64[np.ndarray, "2"]
) -> tuple[Float64[np.ndarray, "courses segments bins"], Bool[np.ndarray, "courses segments"]]:
    """Profile across each segment of each course, with mean 0 and length 1, and whether most of it is known."""
    from texloom.stages.kernels.lattice.course_sums import course_sums

    length = float(np.hypot(*period))
    bins = int(np.clip(round(length), 4, _MAX_BINS))
    rows, columns = (np.arange(side, dtype=np.float64) for side in plane.shape)
    across = rows * (period[0] / length**2), columns * (period[1] / length**2)
    along = rows * (-period[1] / length), columns * (period[0] / length)
    # sums of the two are extreme where both are
    lowest = float(np.floor(across[0].min() + across[1].min())), float(along[0].min() + along[1].min())
    count = int((across[0].max() + across[1].max()) - lowest[0]) + 2
    longest = float((along[0].max() + along[1].max()) - lowest[1])
    sums = np.zeros((2, 2, _SEGMENTS, count * bins))
    segments = _SEGMENTS, _SEGMENTS / (longest + 1e-9)
    course_sums(np.ascontiguousarray(plane), across, along, lowest, bins, segments, sums)
    number, total = (
        # Shared by two bins, else those of a course with fewer pixels across would be empty.
        np.moveaxis((whole - after + np.roll(after, 1)).reshape(_SEGMENTS, count, bins), 0, 1)
        for whole, after in sums
    )
    area = length * longest / _SEGMENTS
    known = (number.sum(axis=2) >= _MIN_COVERAGE * area) & (number > _MIN_WEIGHT).all(axis=2)
    profiles = total / np.maximum(number, _MIN_WEIGHT)
    profiles -= profiles.mean(axis=2, keepdims=True)
    norm = np.linalg.norm(profiles, axis=2, keepdims=True)
    return np.divide(profiles, norm, out=np.zeros_like(profiles), where=norm > 1e-9), known
