"""CIELAB of linear light, a few pixels at a time: what is made on the way stays in the processor's cache."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled
from texloom.stages.kernels.core.elementary_functions import THIRD_OF_BITS

_BLOCK = 512  # pixels
_LINEAR_LIMIT = 216 / 24389  # below it lightness is linear
_SLOPE, _OFFSET = np.float32(841 / 108), np.float32(4 / 29)  # of the line there


@compiled
def fill_lab(color, matrix, lab):
    """Fill ``lab``; negative light counts as 0.

    Parameters
    ----------
    color : (n, 3) float32 or float64, linear light
    matrix : (3, 3) of the same type, from light to X, Y and Z relative to white, a column each
    lab : (n, 3) of the same type
    """
    kind = lab.dtype.type
    scaled, offset, limit = kind(_SLOPE), kind(_OFFSET), kind(_LINEAR_LIMIT)
    steps = 2 if lab.itemsize == 4 else 3  # two leave 6e-15, with which all float32 are as with more steps
    light, relative = np.empty((3, _BLOCK), lab.dtype), np.empty((3, _BLOCK), lab.dtype)
    value, root = np.empty(_BLOCK), np.empty(_BLOCK)
    for first in range(0, len(color), _BLOCK):
        count = min(_BLOCK, len(color) - first)
        for i in range(count):
            for j in range(3):
                given = color[first + i, j]
                light[j, i] = kind(0) if given <= 0 else given  # what is not finite stays
        for k in range(3):
            own, red, green, blue = relative[k], matrix[0, k], matrix[1, k], matrix[2, k]
            for i in range(count):
                total = light[0, i] * red + light[1, i] * green + light[2, i] * blue
                own[i] = total
                value[i] = np.float64(total) if total > 0 else 1.0
            for i in range(count):
                bits = np.float64(value[i]).view(np.uint64) // np.uint64(3) + np.uint64(THIRD_OF_BITS)
                root[i] = np.uint64(bits).view(np.float64)
            for i in range(count):
                r, v = root[i], value[i]
                for _ in range(steps):  # Halley's method
                    cube = r * r * r
                    r = r * ((cube + 2 * v) / (2 * cube + v))
                root[i] = r
            for i in range(count):
                own[i] = kind(root[i]) if own[i] > limit else scaled * own[i] + offset
        for i in range(count):
            x, y, z = relative[0, i], relative[1, i], relative[2, i]
            lab[first + i, 0] = kind(116) * y - kind(16)
            lab[first + i, 1] = kind(500) * (x - y)
            lab[first + i, 2] = kind(200) * (y - z)
