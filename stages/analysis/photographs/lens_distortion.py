"""Lens distortion: straight lines of a photograph that its lens bent are straightened."""

import dataclasses
import logging

import numpy as np
from pydantic import Field

from texloom.stages.analysis.photographs.vanishing import deviations, vanishing_points
from texloom.stages.common.features.line_segments import Frame, Segments, line_segments
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Document, Params, stage
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.scratch import bands

_LOG = logging.getLogger(__name__)

_TRIED = (-0.3, -0.2, -0.1, 0.0, 0.1)
_FINER = (0.05, 0.02, 0.01, 0.005)  # steps to both sides of the best
_FAMILIES = 3  # vanishing points
_MIN_SHARE = 0.06  # of the length of all segments, of each
_WIDTH = np.radians(1.0)  # of the agreement of a segment with its vanishing point
_MIN_GAIN = 0.1  # of agreement, over none, and over distortions ``_APART`` from it: lines that are not straight
_APART = 0.1  # agree hardly better with one distortion than with another
_MIN_AGREEMENT = 0.45  # share of the length of all segments, about; straight lines through lenses have .56 or more
_MIN_SEGMENTS = 60
_MAX_SEGMENTS = 300  # the longest


class LensDistortionParams(Params):
    """How much is straightened."""

    distortion: float | None = Field(None, ge=-0.4, le=0.25)
    """of the division model, with half the diagonal as the unit: below 0 where the lens makes barrels of squares,
    above 0 where it makes cushions; 0: none; null: by the photograph's lines"""
    geometry: Document | None = None
    """a file that says where the surfaces lie, in px of the photograph as it is: nothing is straightened"""


@dataclasses.dataclass(frozen=True)
class LensDistortion:
    """The straightened photograph."""

    image: Image
    """of the same size; the photograph itself where it is not distorted"""
    distortion: float
    """see `LensDistortionParams`; 0: none"""


@stage(version=2)
def lens_distortion(image: Image, params: LensDistortionParams) -> LensDistortion:
    """Estimate the radial distortion of a photograph's lens by its line segments, and remove it.

    A point at a distance r from the middle, in half diagonals, belongs at r / (1 + distortion r^2). Of several
    distortions that is taken at which most of the length of the segments points to few vanishing points; none where
    this is not clearly more than without, or than at distortions apart from it. The middle keeps its scale, borders
    are cropped.

    Parameters
    ----------
    image : the photograph.

    References
    ----------
    [Fitzgibbon2001]_ equation 5, the division model. The estimate by vanishing points is ours.
    """
    distortion = params.distortion
    if params.geometry is not None:
        distortion = 0.0
    elif distortion is None:
        segments = line_segments(image)
        report(Progress(0.3))
        distortion = estimated_distortion(segments)
        report(Progress(0.6))
        if distortion:
            _LOG.warning(
                "the lens bends lines, with a distortion of %.3f; straightened: --set distortion=0 leaves them",
                distortion,
            )
    return LensDistortion(straightened(image, distortion) if distortion else image, float(distortion))


def estimated_distortion(segments: Segments) -> float:
    """The distortion at which segments agree best with few vanishing points; 0 where none is clear."""
    if len(segments.ends) < _MIN_SEGMENTS:
        return 0.0
    segments = segments[np.argsort(-segments.lengths, kind="stable")[:_MAX_SEGMENTS]]
    agreements = {tried: _agreement(segments, tried) for tried in _TRIED}
    plain = agreements[0.0]
    for step in _FINER:
        best = max(agreements, key=lambda tried: agreements[tried])
        for tried in (round(best - step, 3), round(best + step, 3)):
            agreements.setdefault(tried, _agreement(segments, tried))
    best = max(agreements, key=lambda tried: agreements[tried])
    total = float(segments.lengths.sum())
    most = agreements[best] / (1 + _MIN_GAIN)  # of the agreement with others
    if most <= plain or agreements[best] <= _MIN_AGREEMENT * total:
        return 0.0
    return best if all(_agreement(segments, best + apart) < most for apart in (-_APART, _APART)) else 0.0


def _agreement(segments: Segments, distortion: float) -> float:
    """Length of the straightened segments that point to their vanishing point, weighted by how well."""
    squares = np.square(segments.ends).sum(axis=2, keepdims=True)
    straight = Segments(segments.ends / (1 + distortion * squares))
    points = vanishing_points(straight, _FAMILIES, _MIN_SHARE)
    if not points:
        return 0.0
    off = deviations(np.array(points), straight).min(axis=0)
    return float((segments.lengths * np.square(np.maximum(0, 1 - np.square(off / _WIDTH)))).sum())


def straightened(image: Image, distortion: float) -> Image:
    """The photograph without a distortion, sampled by cubic convolution."""
    from texloom.stages.kernels.core.resample import sampled

    frame = Frame((image.height, image.width))
    pixels = np.empty_like(image.pixels)
    for band in bands(image.height):
        rows = np.meshgrid(np.arange(image.height)[band], np.arange(image.width), indexing="ij")
        places = frame.places(np.stack(rows, axis=2).astype(np.float64))
        places *= min(1.0, 1 / (1 + distortion))  # so that all is shown by the photograph
        squares = np.square(places).sum(axis=2, keepdims=True)
        places *= 2 / (1 + np.sqrt(1 - 4 * distortion * squares))
        pixels[band] = sampled(image.pixels, frame.pixels(places))
        report(Progress(0.6 + 0.4 * band.stop / image.height))
    return image.elsewhere(pixels)
