"""How texture lies on the faces of a surface."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner


@inner
def texture_axes(shares, directions, normal, otherwise, axes):
    """Fill the unit vectors down and across the texture at a place of a face.

    Parameters
    ----------
    shares : (3,) barycentric coordinates of the place
    directions : (3, 3) down the texture at each corner
    normal : (3,) of the face, of length 1
    otherwise : (3,) down the texture where the directions have no part in the face
    axes : (2, 3), output
    """
    along = 0.0
    for k in range(3):
        axes[0, k] = shares[0] * directions[0, k] + shares[1] * directions[1, k] + shares[2] * directions[2, k]
        along += axes[0, k] * normal[k]
    length = 0.0
    for k in range(3):
        axes[0, k] -= along * normal[k]
        length += axes[0, k] ** 2
    if length < 1e-18:
        length = 0.0
        for k in range(3):
            axes[0, k] = otherwise[k]
            length += otherwise[k] ** 2
    length = max(np.sqrt(length), 1e-300)
    for k in range(3):
        axes[0, k] /= length
    axes[1, 0] = normal[1] * axes[0, 2] - normal[2] * axes[0, 1]
    axes[1, 1] = normal[2] * axes[0, 0] - normal[0] * axes[0, 2]
    axes[1, 2] = normal[0] * axes[0, 1] - normal[1] * axes[0, 0]


@inner
def barycentric(corners, row, column, shares):
    """Fill (3,) coordinates of a place among (3, 2) corners, kept within them."""
    a, b = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1]
    c, d = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1]
    r, s = row - corners[0, 0], column - corners[0, 1]
    area = a * d - b * c
    one, two = max((r * d - s * c) / area, 0.0), max((a * s - b * r) / area, 0.0)
    zero = max(1.0 - one - two, 0.0)
    total = zero + one + two
    shares[0], shares[1], shares[2] = zero / total, one / total, two / total


@compiled
def frames(faces, places, corners, directions, normals, per_pixel, out, first, last):
    """Fill the axes of texture at places ``first`` to ``last``, see `texture_axes`.

    Parameters
    ----------
    faces : (n,) int64, of the places
    places : (n, 2) float64, row and column of the result
    corners : (faces, 3, 2) float64, the same of the faces' corners
    directions, normals : (faces, 3, 3) and (faces, 3) float64
    per_pixel : (faces, 3, 2) float64, displacement for a row and a column of the result
    out : (n, 2, 3) float64
    """
    shares = np.empty(3)
    for at in range(first, last):
        face = faces[at]
        barycentric(corners[face], places[at, 0], places[at, 1], shares)
        texture_axes(shares, directions[face], normals[face], per_pixel[face, :, 0], out[at])


@compiled
def jacobians(faces, places, corners, directions, normals, per_pixel, scale, out, first, last):
    """Fill the Jacobians from px of texture to px of the result; for arguments see `frames`.

    Parameters
    ----------
    scale : world units of a px of texture
    out : (n, 4) float32
    """
    shares, axes = np.empty(3), np.empty((2, 3))
    for at in range(first, last):
        face = faces[at]
        barycentric(corners[face], places[at, 0], places[at, 1], shares)
        texture_axes(shares, directions[face], normals[face], per_pixel[face, :, 0], axes)
        a = b = c = d = 0.0
        for k in range(3):
            a += axes[0, k] * per_pixel[face, k, 0]
            b += axes[0, k] * per_pixel[face, k, 1]
            c += axes[1, k] * per_pixel[face, k, 0]
            d += axes[1, k] * per_pixel[face, k, 1]
        factor = scale / (a * d - b * c)
        out[at, 0], out[at, 1], out[at, 2], out[at, 3] = d * factor, -b * factor, -c * factor, a * factor
