"""The grid that shows how a patch lies in its photograph."""

import numpy as np
from jaxtyping import Float64

from texloom.stages.analysis._distortion import bezier
from texloom.stages.analysis._distortion.geometry import Patch

_CELLS_ALONG = 8  # cells along a patch's longer side
_MIN_CELLS_ACROSS = 2  # along the shorter side of a long patch, where that takes no more than _MAX_CELLS_ALONG
_MAX_CELLS_ALONG = 64
_POINTS = 65  # of a line


def grid_lines(patch: Patch) -> tuple[Float64[np.ndarray, "m n 2"], Float64[np.ndarray, "k n 2"]]:
    """Lines down and across a patch, px, that cut it into cells which are square in the texture, and its borders.

    The last cell of a row or column may be narrower.
    """
    shorter, longer = sorted(patch.size)
    side = max(longer / _MAX_CELLS_ALONG, min(longer / _CELLS_ALONG, shorter / _MIN_CELLS_ACROSS))
    shares = [np.append(np.arange(0, 1 - 1e-6, side / size), 1) for size in patch.size]
    rows, columns = bezier.even_parameters(patch.space, (shares[0], shares[1]))
    along = np.linspace(0, 1, _POINTS)
    down = bezier.points(patch.controls, *np.broadcast_arrays(along, columns[:, None]))
    return down, bezier.points(patch.controls, *np.broadcast_arrays(rows[:, None], along))
