"""Signs that a photograph shows no frontal plane: lines that converge, and texture that becomes finer."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from texloom.stages.analysis.photographs.vanishing import pointing_to
from texloom.stages.common.features.line_segments import Segments
from texloom.stages.common.grids.pyramid import reduced
from texloom.stages.kernels.core.elementary_functions import arctan2, log, phase_of, phasor
from texloom.stages.numerics.filters import gaussian_blur, gradients
from texloom.stages.numerics.matrices import least_squares, matrix_product, solve
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear

_MIN_SHARE = 0.12  # of the length of all segments, of lines that converge
_MIN_LINES = 12  # any two lines meet in a point
_CONVERGING = np.radians(20)  # between the directions of a tenth of such lines to either side
_SIDE = 512  # px at which texture is measured
_CELLS = 12  # along the longer side
_FINEST = 1.0  # px: standard deviation by which noise is removed
_MIN_VARIANCE = 1.0  # squared CIELAB, of a cell with texture
_MIN_TEXTURED = 0.7  # share of the cells
_MIN_ERRORS = 8.0  # standard errors of a change that counts
_MAX_REST = 0.15  # standard deviation of what a quadratic leaves, of the natural logarithm: even texture
_CURVED = 0.2  # change of the logarithm from the middle to the longer border, by the square
_TILTED = 0.35  # the same, linear
_MAYBE = 0.4  # share of both from which they are told: a trunk that turns away little


@dataclass(frozen=True)
class DepthCues:
    """What speaks against a frontal plane."""

    converging: float
    """share of the length of line segments that clearly converge to one point"""
    tilted: bool
    """the texture becomes finer to one side"""
    curved: bool
    """the texture becomes finer from the middle to both sides"""
    hint: str = ""
    """a weaker sign, in words, where there is none of these; else empty"""

    @property
    def reason(self) -> str:
        """In words; empty without any."""
        if self.curved:
            return "the texture becomes finer to both sides, as on a curved surface"
        if self.converging:
            return f"{self.converging:.0%} of the length of its lines converge, as in perspective"
        return "the texture becomes finer to one side, as in perspective" if self.tilted else ""


def depth_cues(image: Image, segments: Segments, points: list[Float64[np.ndarray, "3"]]) -> DepthCues:
    """The signs of depth.

    The frequency of the texture along rows, or columns, is that at which its gradients have their energy; its
    logarithm over the photograph is fitted by a quadratic. On a plane that is tilted it grows to one side; on a
    cylinder or sphere to both, along the direction in which the surface turns away.

    Parameters
    ----------
    points : vanishing points of the segments.

    References
    ----------
    Ours; [Gibson1950]_ has the gradients of texture as a cue to depth.
    """
    total = float(segments.lengths.sum())
    converging = 0.0
    for point in points:
        own = segments[pointing_to(point, segments)]
        share = float(own.lengths.sum()) / total
        if share >= _MIN_SHARE and len(own.ends) >= _MIN_LINES and _spread(own) >= _CONVERGING:
            converging = max(converging, share)
    tilt, curve = _texture_changes(image)
    hint = ""
    if tilt >= _MAYBE * _TILTED or curve >= _MAYBE * _CURVED:
        to = "one side" if tilt / _TILTED >= curve / _CURVED else "both sides"
        hint = f"the texture becomes a little finer to {to}, so that it may be tilted or curved"
    return DepthCues(converging, tilt > _TILTED, curve > _CURVED, hint)


def _spread(segments: Segments) -> float:
    """Angle between the directions that a tenth of the length is to either side of."""
    along = segments.ends[:, 1] - segments.ends[:, 0]
    directions, lengths = arctan2(along[:, 0], along[:, 1]), segments.lengths
    middle = phase_of((lengths * phasor(2 * directions)).sum(keepdims=True))[0] / 2
    off = np.mod(directions - middle + np.pi / 2, np.pi) - np.pi / 2
    order = np.argsort(off, kind="stable")
    sums = np.cumsum(lengths[order])
    low, high = (off[order][np.searchsorted(sums, share * sums[-1])] for share in (0.1, 0.9))
    return float(high - low)


def _texture_changes(image: Image) -> tuple[float, float]:
    """By how much an even texture clearly becomes finer to one side, and to both; 0 where that is not clear."""
    lightness = lab_from_linear(reduced(image.color, _SIDE))[..., 0].astype(np.float64)
    fine = gaussian_blur(lightness, _FINEST)
    cell = max(fine.shape) / _CELLS
    counts = [int(side / cell) for side in fine.shape]
    if min(counts) < 4:
        return 0.0, 0.0
    rows, columns = (((np.arange(count) + 0.5) * cell).astype(int) for count in counts)
    at = np.ix_(rows, columns)
    variance = gaussian_blur(np.square(fine - gaussian_blur(fine, cell / 2)), cell / 2)[at]
    textured = variance >= _MIN_VARIANCE
    if textured.mean() < _MIN_TEXTURED:
        return 0.0, 0.0
    y, x = (
        (np.array(places, float) - side / 2) / (max(fine.shape) / 2)
        for places, side in zip(np.meshgrid(rows, columns, indexing="ij"), fine.shape, strict=True)
    )
    y, x = y[textured], x[textured]
    terms = np.stack([y, x, y * y, x * x, x * y, np.ones_like(x)], axis=1)
    errors = np.sqrt(np.diag(solve(matrix_product(terms.T, terms), np.eye(6))))
    tilt = curve = 0.0
    for axis, slope in enumerate(gradients(fine)):
        energy = gaussian_blur(np.square(slope / 32), cell / 2)[at]
        frequency = log(np.maximum(energy[textured], 1e-6) / variance[textured]) / 2
        fitted = least_squares(terms, frequency)
        rest = frequency - matrix_product(terms, fitted)
        deviation = float(np.sqrt(np.square(rest).sum() / (len(rest) - 6)))
        clear = np.abs(fitted) > _MIN_ERRORS * deviation * errors
        if deviation < _MAX_REST:
            curve = max(curve, float(fitted[2 + axis] * clear[2 + axis]))
        changes = float(np.abs(fitted[:2])[clear[:2]].max(initial=0.0))
        if deviation < (2 if changes > _TILTED else 1) * _MAX_REST:
            tilt = max(tilt, changes)
    return tilt, curve
