"""How much a texture varies within a patch."""

import numpy as np
from jaxtyping import Float32

from texloom.stages.kernels.core.loading import loaded

_WINDOW = 8  # px, side of a patch


def local_variance(planes: Float32[np.ndarray, "h w c"]) -> float:
    """Square of the deviation within a window of 8 px, all planes together, in the mean of all windows.

    Distances of patches grow with it, so that penalties relative to it have the same effect on textures of high and
    of low contrast. The square of the mean deviation is less than the mean variance where only parts vary, such as
    rocks below a sky, which would break up under penalties that suit the rocks.
    """
    ndimage = loaded("scipy.ndimage")
    mean = ndimage.uniform_filter(planes, (_WINDOW, _WINDOW, 0), mode="nearest")
    squares = np.square(planes - mean).sum(axis=2)
    variances = ndimage.uniform_filter(squares, _WINDOW, mode="nearest")
    return float(np.sqrt(np.maximum(variances, 0)).mean(dtype=np.float64)) ** 2
