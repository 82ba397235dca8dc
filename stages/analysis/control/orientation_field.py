"""Orientation field: the dominant orientation of a texture at every pixel."""

import dataclasses

import numpy as np
from pydantic import Field

from texloom.stages.common.geometry.orientation import (
    Doubled,
    completed,
    length_of,
    painted,
    pictured,
    smoothed,
)
from texloom.stages.common.grids.size_checks import same_size
from texloom.stages.kernels.core.elementary_functions import cos, exp, sin
from texloom.stages.numerics.matrices import eigenvectors, matrix_product, square_sums
from texloom.stages.vocabulary.arrays import ColorField, Image, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Params, stage

_FREQUENCY = 0.23  # of the filters, cycles per px
_SIGMA_ALONG, _SIGMA_ACROSS = 2.4, 1.8  # px; of a filter's Gaussian window
_RADIUS = 6  # px; of a filter
_NOISE = 0.05  # regularisation of the confidence, as a share of the largest mean response of a scale


class OrientationFieldParams(Params):
    """How orientations are measured and smoothed."""

    angles: int = Field(24, ge=8, le=180)
    """number of filter orientations"""
    scales: int = Field(3, ge=1, le=6)
    """number of filter scales, each twice the one before; the finest responds to wavelengths of 4 px"""
    sigma: float = Field(4.0, gt=0, le=32)
    """standard deviation of the bilateral filter by distance, px"""
    color_sigma: float = Field(12.0, gt=0, le=200)
    """standard deviation of the bilateral filter by colour, CIELAB units"""
    passes: int = Field(2, ge=0, le=8)
    """passes of the bilateral filter"""
    stiffness: float = Field(1.0, gt=0, le=1e4)
    """smoothness of the diffusion into pixels of low confidence; larger is smoother"""
    stroke_radius: float = Field(24.0, gt=0, le=4096)
    """px around a painted stroke within which it overrides the filters"""


@dataclasses.dataclass(frozen=True)
class OrientationField:
    """The orientation field and a visualisation of it."""

    angle: ScalarMap
    """orientation along the texture, radians, 0..pi, from along a row towards growing rows"""
    confidence: ScalarMap
    """0..1, of the filters or strokes; 0 where the orientation is diffused from the surroundings"""
    picture: Image
    """line integral convolution of the field over the texture, fainter where the confidence is low"""


@stage(version=2, check=same_size("strokes", "image", "texture"))
def orientation_field(
    image: Image, params: OrientationFieldParams, strokes: Image | None = None
) -> OrientationField:
    """Measure the dominant orientation of a texture at every pixel.

    Oriented quadrature filters respond to waves at several scales; the most confident scale is used. Orientations
    are smoothed by a bilateral filter, and diffused into pixels of low confidence.

    Parameters
    ----------
    image : the texture; only its colour is used.
    strokes : lines painted along the wanted orientations, on a transparent layer or on black, of the texture's
        size. Near them they replace the filters' responses.

    Raises
    ------
    InputError
        strokes do not have the texture's size, or nothing is painted.

    References
    ----------
    [Wei2008]_ section 4.2 for its use; [Paris2004]_ section 4 for oriented filters, their variance as confidence,
    and bilateral smoothing. Unlike there, filters are quadrature pairs and the variance is that of doubled angles.
    Strokes are ours.
    """
    lab = lab_from_linear(image.color)
    vectors = _filtered(_principal(lab), params)
    if strokes is not None:
        wanted, near = painted(strokes, params.stroke_radius)
        vectors = vectors * (1 - near)[..., None] + wanted * near[..., None]
    for _ in range(params.passes):
        vectors = smoothed(vectors, lab, params.sigma, params.color_sigma)
    if strokes is not None:
        # Smoothing must not mix painted orientations with their surroundings.
        vectors = np.where(near[..., None] == 1, wanted, vectors)
    angle, confidence = completed(vectors, params.stiffness)
    return OrientationField(angle, confidence, pictured(image.color, angle, confidence))


def _principal(lab: ColorField) -> ScalarMap:
    """The first principal component of colour."""
    values = lab.reshape(-1, 3).astype(np.float64)
    values -= values.mean(axis=0)
    _, vectors = eigenvectors(square_sums(values) / len(values))
    return np.asarray(matrix_product(values, vectors[:, 2]).reshape(lab.shape[:2]), np.float32)


def _filtered(plane: ScalarMap, params: OrientationFieldParams) -> Doubled:
    """Doubled-angle vectors of the most confident scale at each pixel."""
    import cv2

    height, width = plane.shape
    responses = []
    for scale in range(params.scales):
        if scale > 0:
            if min(plane.shape) < 4 * _RADIUS:
                break
            plane = cv2.pyrDown(plane)
        responses.append(_responses(plane, params.angles))
    noise = _NOISE * max(float(total.mean()) for _, total in responses) + 1e-9
    best: Doubled = np.zeros((height, width, 2), np.float32)
    for sums, total in responses:
        # The image is mirrored beyond its border, where orientations differ; confidence is reduced there.
        rows, columns = (np.minimum(np.arange(side), np.arange(side)[::-1]) for side in total.shape)
        inside = np.minimum(rows[:, None], columns)
        weight = np.clip(inside / _RADIUS, 0, 1)[..., None]
        vectors = (sums / (total + noise)[..., None] * weight).astype(np.float32)
        if vectors.shape != best.shape:
            vectors = cv2.resize(vectors, (width, height), interpolation=cv2.INTER_LINEAR)
        more_confident = length_of(vectors) > length_of(best)
        best = np.where(more_confident[..., None], vectors, best)
    return best


def _responses(plane: ScalarMap, angles: int) -> tuple[np.ndarray, np.ndarray]:
    """Sum of doubled-angle vectors weighted by the energy of each filter pair, and the sum of the energies."""
    import cv2

    rows, columns = np.mgrid[-_RADIUS : _RADIUS + 1, -_RADIUS : _RADIUS + 1].astype(np.float64)
    total = np.zeros(plane.shape, np.float64)
    sums = np.zeros((*plane.shape, 2), np.float64)
    for angle in np.pi * np.arange(angles) / angles:
        along = columns * cos(angle) + rows * sin(angle)
        across = rows * cos(angle) - columns * sin(angle)
        window = exp(-((along / _SIGMA_ALONG) ** 2 + (across / _SIGMA_ACROSS) ** 2) / 2)
        energy = np.zeros(plane.shape, np.float64)
        for wave in (cos, sin):
            kernel = window * wave(2 * np.pi * _FREQUENCY * across)
            kernel -= window * kernel.sum() / window.sum()  # no response to constant colour
            energy += cv2.filter2D(plane, cv2.CV_32F, kernel, borderType=cv2.BORDER_REFLECT).astype(np.float64) ** 2
        total += energy
        sums += energy[..., None] * [cos(2 * angle), sin(2 * angle)]
    return sums, total
