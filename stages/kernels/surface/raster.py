"""Drawing triangles: which one covers each pixel."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled

_SLACK = 1e-6  # of barycentric coordinates: pixel centres on an edge belong to both of its triangles
_INSIDE = 1e-2  # barycentric coordinates beyond which a pixel is not near an edge


@compiled
def _pixels(least, most, size):
    """The pixels between two coordinates, the end not included."""
    return max(0, int(np.ceil(least - 1e-3))), min(size, int(np.floor(most + 1e-3)) + 1)


@compiled
def draw(corners, faces, origin_row, origin_col, owner, depth):
    """Fill the pixels whose centre a triangle covers; of several the nearest one, of equally near ones the first.

    Parameters
    ----------
    corners : (n, 3, 3) float64, row, column and depth of every corner
    faces : (m,) int64, the triangles to draw
    origin_row, origin_col : of the arrays' first pixel
    owner : (h, w) int32, the triangle of each pixel; -1 where there is none
    depth : (h, w) float32, of what is drawn; infinite where nothing is

    Returns
    -------
    how many pixels were drawn again, away from the triangles' edges.
    """
    height, width = owner.shape
    again = 0
    for at in range(faces.size):
        face = faces[at]
        r0, c0 = corners[face, 0, 0] - origin_row, corners[face, 0, 1] - origin_col
        r1, c1 = corners[face, 1, 0] - origin_row, corners[face, 1, 1] - origin_col
        r2, c2 = corners[face, 2, 0] - origin_row, corners[face, 2, 1] - origin_col
        area = (r1 - r0) * (c2 - c0) - (r2 - r0) * (c1 - c0)
        if area == 0:
            continue
        top, bottom = _pixels(min(r0, r1, r2), max(r0, r1, r2), height)
        left, right = _pixels(min(c0, c1, c2), max(c0, c1, c2), width)
        for row in range(top, bottom):
            for column in range(left, right):
                one = ((row - r0) * (c2 - c0) - (r2 - r0) * (column - c0)) / area
                two = ((r1 - r0) * (column - c0) - (row - r0) * (c1 - c0)) / area
                zero = 1 - one - two
                least = min(zero, one, two)
                if least < -_SLACK:
                    continue
                if owner[row, column] >= 0 and least > _INSIDE:
                    again += 1
                here = zero * corners[face, 0, 2] + one * corners[face, 1, 2] + two * corners[face, 2, 2]
                if np.float32(here) < depth[row, column]:
                    owner[row, column], depth[row, column] = face, here
    return again
