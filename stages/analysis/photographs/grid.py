"""How patches lie in their photograph: the lines of a grid, and outlines."""

import numpy as np
from jaxtyping import Float64

from texloom.stages.analysis.photographs import bezier
from texloom.stages.analysis.photographs.geometry import Patch, pixels_inside
from texloom.stages.vocabulary.arrays import Mask
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import format_size

_CELLS_ALONG = 8  # cells along a patch's longer side
_MIN_CELLS_ACROSS = 2  # along the shorter side of a long patch, where that takes no more than _MAX_CELLS_ALONG
_MAX_CELLS_ALONG = 64
_POINTS = 65  # of a line


def grid_parameters(patch: Patch) -> tuple[Float64[np.ndarray, "*rows"], Float64[np.ndarray, "*columns"]]:
    """The parameters u and v of lines that cut a patch into cells which are square in the texture, with 0 and 1.

    The last cell of a row or column may be narrower.
    """
    shorter, longer = sorted(patch.size)
    side = max(longer / _MAX_CELLS_ALONG, min(longer / _CELLS_ALONG, shorter / _MIN_CELLS_ACROSS))
    shares = [np.append(np.arange(0, 1 - 1e-6, side / size), 1) for size in patch.size]
    return bezier.even_parameters(patch.space, (shares[0], shares[1]))


def grid_lines(patch: Patch) -> tuple[Float64[np.ndarray, "m n 2"], Float64[np.ndarray, "k n 2"]]:
    """Lines down and across a patch, px, at its `grid_parameters`."""
    rows, columns = grid_parameters(patch)
    along = np.linspace(0, 1, _POINTS)
    down = bezier.points(patch.controls, *np.broadcast_arrays(along, columns[:, None]))
    return down, bezier.points(patch.controls, *np.broadcast_arrays(rows[:, None], along))


def outlined(patches: list[Patch], shape: tuple[int, int]) -> Mask:
    """The pixels inside the outlines of all patches.

    Raises
    ------
    InputError
        a patch is outside the photograph.
    """
    along = np.linspace(0, 1, 33)
    zero, one = np.zeros(33), np.ones(33)
    u, v = (np.concatenate(parts) for parts in ([zero, along, one, along[::-1]], [along, one, along[::-1], zero]))
    covered = np.zeros(shape, np.bool_)
    for patch in patches:
        part = pixels_inside([np.clip(bezier.points(patch.controls, u, v), -1e5, 1e5)], shape)
        if not part.any():
            raise InputError(f"{patch.name}: is outside the photograph of {format_size(shape)}")
        covered |= part
    return covered
