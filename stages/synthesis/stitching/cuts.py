"""Minimum boundary cuts between the already synthesised region and a block that overlaps it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int64


def cheapest_path(errors: Float32[np.ndarray, "n m"]) -> Int64[np.ndarray, "n"]:  # type: ignore[name-defined]
    """Column of every row on the path down ``errors`` with the least sum; it moves one column a row at most.

    References
    ----------
    [Efros2001]_ section 2.1.
    """
    from texloom.stages.kernels.seams.boundary_cut import cheapest_path as kernel

    path = np.empty(errors.shape[0], np.int64)
    kernel(np.ascontiguousarray(errors), path)
    return path


@dataclass(frozen=True)
class Strips:
    """Widths of a rectangle's overlaps with the synthesised region on each side, px; 0 for no overlap."""

    top: int = 0
    left: int = 0
    bottom: int = 0
    right: int = 0

    def mask(self, shape: tuple[int, int]) -> Bool[np.ndarray, "m n"]:
        """True in the strips of a rectangle of ``shape``."""
        mask = np.ones(shape, bool)
        mask[self.top : shape[0] - self.bottom, self.left : shape[1] - self.right] = False
        return mask


def laid_over(errors: Float32[np.ndarray, "m n"], strips: Strips) -> Bool[np.ndarray, "m n"]:
    """The pixels of a rectangle that replace the synthesised region: those inside one cut through each strip.

    Parameters
    ----------
    errors : squared difference of the rectangle and the synthesised region; 0 outside the region.
    strips : opposite ones do not meet.

    References
    ----------
    [Efros2001]_ section 2.1.
    """
    new = np.ones(errors.shape, bool)
    for side, width in enumerate((strips.left, strips.top, strips.right, strips.bottom)):
        if width:
            path = cheapest_path(_side_to_left(errors, side)[:, :width])
            _side_to_left(new, side)[:, :width] &= np.arange(width) >= path[:, None]
    return new


def _side_to_left(plane: np.ndarray, side: int) -> np.ndarray:
    """A view whose left border is the left, top, right or bottom one of ``plane``."""
    view = plane.T if side % 2 else plane
    return view[:, ::-1] if side >= 2 else view


def enclosed(
    errors: Float32[np.ndarray, "m n"], strips: Strips, limit: float = np.inf
) -> tuple[Bool[np.ndarray, "m n"], float]:
    """The pixels of a rectangle inside the minimum cut through its strips, and the cost of the cut.

    Unlike the cuts of `laid_over` this is one cut of any shape through all strips. It is the minimum cut for up to
    three strips, and close to it for four.

    Parameters
    ----------
    errors : cost of each pixel beside the cut; 0 outside the synthesised region.
    strips : opposite ones do not meet.
    limit : cost from which a cut is not wanted; the returned cost is then infinite.

    References
    ----------
    [Kwatra2003]_ section 3; in the plane a shortest path replaces the maximum flow.
    """
    from texloom.stages.kernels.seams.boundary_cut import cheapest_loop

    widths = (strips.top, strips.left, strips.bottom, strips.right)
    framed = np.empty((errors.shape[0] + 2, errors.shape[1] + 2), np.float32)
    framed[1:-1, 1:-1] = errors
    for side, width in enumerate(widths):
        border = np.rot90(framed, -side)
        border[0] = border[1] if width else -1
    # The loop closes at the bottom, if possible at a side without overlap, where it costs nothing.
    rotation = next((side for side, width in enumerate(widths) if not width), 0) + 2
    top, left, bottom, right = (widths[(side + rotation) % 4] for side in range(4))
    framed = np.ascontiguousarray(np.rot90(framed, -rotation))
    height, width = framed.shape
    inside = np.empty(framed.shape, bool)
    core = (top + 1, height - bottom - 1, left + 1, width - right - 1)
    cost = cheapest_loop(framed, core, limit, inside)
    return np.ascontiguousarray(np.rot90(inside, rotation)[1:-1, 1:-1]), float(cost)
