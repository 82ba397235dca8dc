"""How well a candidate plane holds: what is seen on it from the front repeats or is even, with straight lines."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from texloom.stages.analysis.photographs import bezier
from texloom.stages.analysis.photographs.evenness import evenness
from texloom.stages.analysis.photographs.geometry import patch_of_plane
from texloom.stages.analysis.photographs.plane_candidates import Cells, PlaneCandidate
from texloom.stages.analysis.regularity.lattice import detail, gradient_magnitude, self_correlation
from texloom.stages.common.features.line_segments import Segments
from texloom.stages.kernels.core.elementary_functions import arctan2, cbrt
from texloom.stages.numerics.matrices import inverse_of, matrix_product
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.progress import Progress, report

_HOLDS = 0.45  # confidence from which a plane is taken
_MIN_AREA = 0.05  # share of the photograph, of such a plane
_EVEN, _CLEARLY_EVEN = 0.55, 0.70  # of a frontal surface that has no lines; clean exemplars have .73 or more
_REPEATS = 0.3  # repetition times evenness, of one that is less even
_SIDE = 192  # px of the longer side of a plane seen from the front
_FINE_SIDE = 384  # px, at which a repetition is sought that is not seen there: of many small tiles
_SEEN = 0.6  # repetition from which it is
_MIN_SIDE = 12  # px of its shorter side
_STRAIGHT, _NEARLY = np.radians(2.0), np.radians(12.0)  # of an axis: straight lines, and lines that should be
_MIN_SHOWN = 0.5  # share of a plane, and of a block of it, that the photograph shows
_NEAR, _FAR = 0.05, 0.4  # offsets of repetitions, shares of the longer and of each side


@dataclass(frozen=True)
class RankedPlane:
    """A candidate with its measures, each 0..1."""

    candidate: PlaneCandidate
    repetition: float
    """the highest correlation with itself, moved"""
    evenness: float
    """how alike parts are in colour and detail"""
    straightness: float
    """share of the length of lines near the directions of its sides that is within 2 degrees of them, without what
    chance has there"""

    @property
    def confidence(self) -> float:
        """The geometric mean of the three."""
        return float(cbrt(self.repetition * self.evenness * self.straightness))

    @property
    def area(self) -> float:
        """Share of the photograph."""
        return float(self.candidate.area.mean())

    @property
    def holds(self) -> bool:
        """Whether it may be taken unasked."""
        return self.confidence >= _HOLDS and self.area >= _MIN_AREA

    @property
    def is_surface(self) -> bool:
        """Whether it looks like one surface, with lines or without."""
        return self.evenness >= _EVEN or self.repetition * self.evenness >= _REPEATS

    @property
    def is_clear(self) -> bool:
        """Whether it looks like one surface without a doubt."""
        return self.evenness >= _CLEARLY_EVEN or self.repetition * self.evenness >= _REPEATS

    @property
    def merit(self) -> tuple[bool, float]:
        """By which planes are ranked: what holds comes first; then confidence, and a little the area."""
        return self.holds, self.confidence * float(np.sqrt(np.sqrt(self.area)))


def as_frontal(image: Image, segments: Segments) -> RankedPlane | None:
    """The whole photograph as a frontal plane; none where it is too small or narrow."""
    cells = Cells((image.height, image.width))
    down, across = image.height - 1, image.width - 1
    corners = cells.places(np.array([[0, 0], [0, across], [down, across], [down, 0]], float))
    none = Segments(np.zeros((0, 2, 2)))
    return measured(
        image, PlaneCandidate(corners, np.ones(cells.shape, np.bool_), 0.0, (none, none)), segments, cells
    )


def ranked(image: Image, candidates: list[PlaneCandidate], segments: Segments, cells: Cells) -> list[RankedPlane]:
    """The candidates that can be seen from the front, the best first.

    Parameters
    ----------
    segments : all line segments of the photograph.
    """
    planes = []
    for number, candidate in enumerate(candidates):
        planes.append(measured(image, candidate, segments, cells))
        report(Progress((number + 1) / len(candidates)))
    return sorted((plane for plane in planes if plane is not None), key=lambda plane: plane.merit, reverse=True)


def measured(image: Image, candidate: PlaneCandidate, segments: Segments, cells: Cells) -> RankedPlane | None:
    """A candidate with its measures; none where it cannot be seen from the front."""
    from texloom.stages.kernels.core.resample import sampled

    corners = cells.pixels(candidate.corners)
    shape = (image.height, image.width)
    patch = patch_of_plane(corners, shape)
    if patch is None:
        return None
    size = np.array(patch.size) * _SIDE / max(patch.size)
    if size.min() < _MIN_SIDE:
        return None

    def seen(times: float) -> tuple[Float32[np.ndarray, "h w 3"], Mask]:
        rows, columns = np.rint(size * times).astype(int).tolist()
        places = bezier.even_points(patch.controls, patch.space, (rows, columns))
        inside = ((places >= 0) & (places <= np.array(shape) - 1)).all(axis=2)
        return lab_from_linear(sampled(image.color, places)), inside

    lab, shown = seen(1.0)
    if shown.mean() < _MIN_SHOWN:
        return None
    repetition = _repetition(lab, shown)
    if repetition < _SEEN:
        repetition = max(repetition, _repetition(*seen(_FINE_SIDE / _SIDE)))
    return RankedPlane(
        candidate,
        repetition,
        evenness(lab, shown, _MIN_SHOWN),
        _straightness(segments, corners, size, cells),
    )


def _repetition(lab: Float32[np.ndarray, "h w 3"], shown: Mask) -> float:
    """The highest peak of the autocorrelation of lightness or of the length of its gradient."""
    import cv2

    lightness = np.where(shown, lab[..., 0], lab[shown][:, 0].mean())
    best = 0.0
    for plane in (lightness, gradient_magnitude(lightness, shown)):
        correlation = self_correlation(detail(plane))
        offsets = np.abs(np.moveaxis(np.indices(correlation.shape), 0, 2) - np.array(correlation.shape) // 2)
        counts = (np.hypot(*np.moveaxis(offsets, 2, 0)) > _NEAR * max(plane.shape)) & (
            offsets < _FAR * np.array(plane.shape)
        ).all(axis=2)
        peaks = correlation >= cv2.dilate(correlation, np.ones((3, 3), np.uint8))
        best = max(best, float(correlation[counts & peaks].max(initial=0.0)))
    return min(best, 1.0)


def _straightness(segments: Segments, corners: np.ndarray, size: np.ndarray, cells: Cells) -> float:
    ends = np.concatenate([cells.pixels(segments.ends), np.ones((*segments.ends.shape[:2], 1))], axis=2)
    flat = matrix_product(ends, inverse_of(bezier.homography(corners)).T)
    lengths = np.where((flat[..., 2] > 0).all(axis=1), segments.lengths, 0)
    flat = flat[..., :2] / np.where(flat[..., 2:] > 0, flat[..., 2:], 1)
    lengths = np.where(((flat >= 0) & (flat <= 1)).all(axis=(1, 2)), lengths, 0)
    down, across = np.abs((flat[:, 1] - flat[:, 0]) * size).T
    off = arctan2(np.minimum(down, across), np.maximum(down, across))
    near = float(lengths[off < _NEARLY].sum())
    chance = _STRAIGHT / _NEARLY
    share = float(lengths[off < _STRAIGHT].sum()) / near if near else 0.0
    return float(max(0.0, share - chance) / (1 - chance))
