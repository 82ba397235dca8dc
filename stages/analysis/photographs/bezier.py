"""Rational bicubic Bézier patches in photographs: planes in perspective, and curved surfaces.

Control points have shape (4, 4, 3); [i, j] belongs to i/3 down and j/3 across the texture. Each is
(row * w, column * w, w) in px of the photograph with weight w. A point of the surface is the sum of the control
points weighted by Bernstein polynomials of (u, v), 0..1 down and across; its pixel is the first two components
divided by the third.
"""

from typing import TypeAlias

import numpy as np
from jaxtyping import Float64

from texloom.stages.numerics.matrices import eigenvectors, matrix_product, square_sums

Controls: TypeAlias = Float64[np.ndarray, "4 4 3"]

_DEFAULT_FOCAL_LENGTH = 1.2  # in units of the photograph's longer side, where the view does not determine it
_MIN_SLANT = 1e-4  # product of the sides' convergences, per longer side squared, below which they count as parallel
_PARAMETERS = np.linspace(0, 1, 33)  # where curves are sampled to measure their lengths


def homography(corners: Float64[np.ndarray, "4 2"]) -> Float64[np.ndarray, "3 3"]:
    """From (u, v, 1) of the unit square to (row * w, column * w, w); corners clockwise from (0, 0).

    By direct linear transformation; scaled so that w is 1 at the first corner.
    """
    # Corners are normalised for a well-conditioned system.
    middle = corners.mean(axis=0)
    spread = np.hypot(*(corners - middle).T).mean() / np.sqrt(2)
    normalised = (corners - middle) / spread
    system = []
    for (u, v), (row, column) in zip(((0, 0), (0, 1), (1, 1), (1, 0)), normalised, strict=True):
        system.append([u, v, 1, 0, 0, 0, -row * u, -row * v, -row])
        system.append([0, 0, 0, u, v, 1, -column * u, -column * v, -column])
    # The direction that the system shortens most, to 0.
    solution = eigenvectors(square_sums(np.array(system)))[1][:, 0].reshape(3, 3)
    denormalise = np.array([[spread, 0, middle[0]], [0, spread, middle[1]], [0, 0, 1]])
    matrix = matrix_product(denormalise, solution)
    return np.asarray(matrix / matrix[2, 2])


def of_plane(matrix: Float64[np.ndarray, "3 3"], beyond: float = 0.0) -> Controls:
    """The homography's plane as a patch, extended by ``beyond`` times its size on every side."""
    at = np.linspace(-beyond, 1 + beyond, 4)
    u, v = np.meshgrid(at, at, indexing="ij")
    return matrix_product(np.stack([u, v, np.ones_like(u)], axis=2), matrix.T)


def focal_length(matrices: list[Float64[np.ndarray, "3 3"]], shape: tuple[int, int]) -> float | None:
    """Focal length in px from views of rectangles; None where their sides are parallel in the image.

    The least squares solution of all views together. The principal point is assumed at the centre of the
    photograph, and pixels to be square.
    """
    above = below = 0.0
    for matrix in matrices:
        first, second = _centred(matrix.T[:2], shape)
        lengths = np.hypot(*first[:2]) * np.hypot(*second[:2])
        cosine, slant = matrix_product(first[:2], second[:2]) / lengths, first[2] * second[2] / lengths
        if abs(slant) * max(shape) ** 2 >= _MIN_SLANT:
            above -= cosine * slant
            below += slant**2
    return float(np.sqrt(above / below)) if above > 0 else None


def _centred(points: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Homogeneous points relative to the photograph's centre."""
    moved = np.array(points, np.float64)
    moved[..., 0] -= (shape[0] - 1) / 2 * moved[..., 2]
    moved[..., 1] -= (shape[1] - 1) / 2 * moved[..., 2]
    return moved


def in_space(controls: Controls, shape: tuple[int, int], focal: float | None) -> Controls:
    """Control points of the surface in camera space, up to scale."""
    moved = _centred(controls, shape)
    moved[..., 2] *= _DEFAULT_FOCAL_LENGTH * max(shape) if focal is None else focal
    return moved


def bernstein(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cubic Bernstein polynomials and their derivatives, (..., 4)."""
    s = 1 - t
    values = np.stack([s * s * s, 3 * t * s**2, 3 * t**2 * s, t * t * t], axis=-1)
    slopes = np.stack([-3 * s**2, 3 * s**2 - 6 * t * s, 6 * t * s - 3 * t**2, 3 * t**2], axis=-1)
    return values, slopes


def lengths(space: Controls) -> tuple[float, float]:
    """Arc lengths of the middle curves, down and across, in the units of ``space``."""
    down, across = (float(chords.sum()) for chords in _chords(space))
    return down, across


def even_parameters(space: Controls, shares: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The parameters u and v up to which the middle curves have these shares, 0..1, of their lengths."""
    down, across = (
        np.interp(share, np.append(0, np.cumsum(chords)) / chords.sum(), _PARAMETERS)
        for share, chords in zip(shares, _chords(space), strict=True)
    )
    return down, across


def _chords(space: Controls) -> tuple[np.ndarray, np.ndarray]:
    """Lengths of the pieces into which `_PARAMETERS` cut the middle curves, down and across."""
    middle = bernstein(np.array(0.5))[0]
    down = matrix_product(bernstein(_PARAMETERS)[0], np.einsum("ijk,j->ik", space, middle))
    across = matrix_product(bernstein(_PARAMETERS)[0], np.einsum("ijk,i->jk", space, middle))
    return np.linalg.norm(np.diff(down, axis=0), axis=1), np.linalg.norm(np.diff(across, axis=0), axis=1)


def points(controls: Controls, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Rows and columns of the points (u, v), (..., 2) px."""
    homogeneous = np.einsum("...i,...j,ijk->...k", bernstein(u)[0], bernstein(v)[0], controls)
    return np.asarray(homogeneous[..., :2] / homogeneous[..., 2:])


def even_points(controls: Controls, space: Controls, shape: tuple[int, int]) -> Float64[np.ndarray, "h w 2"]:
    """Rows and columns, px, of the middles of ``shape`` cells at even steps along the middle curves of a patch."""
    height, width = shape
    u, v = even_parameters(space, ((np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width))
    rows, columns = (bernstein(t)[0] for t in (u, v))
    places = np.einsum("ui,ijk,vj->uvk", rows, controls, columns)
    return np.asarray(places[..., :2] / places[..., 2:])
