"""The minimum boundary cut between what stands and what is laid over it."""

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
    """How wide a rectangle overlaps what stands on each of its sides, px; 0 where it does not."""

    top: int = 0
    left: int = 0
    bottom: int = 0
    right: int = 0

    def mask(self, shape: tuple[int, int]) -> Bool[np.ndarray, "m n"]:
        """True in the strips of a rectangle of ``shape``."""
        covered = np.ones(shape, bool)
        covered[self.top : shape[0] - self.bottom, self.left : shape[1] - self.right] = False
        return covered


def laid_over(errors: Float32[np.ndarray, "m n"], strips: Strips) -> Bool[np.ndarray, "m n"]:
    """The pixels of a rectangle that replace what stands: those within the cuts through all of its strips.

    Parameters
    ----------
    errors : squared difference of the rectangle and what stands; 0 where nothing stands.
    strips : opposite ones do not meet.
    """
    new = np.ones(errors.shape, bool)
    # Each strip in turn is seen with its outer border to the left.
    for turns, width in enumerate((strips.left, strips.top, strips.right, strips.bottom)):
        if width:
            strip = _turned(errors, turns)[:, :width]
            path = cheapest_path(strip)
            _turned(new, turns)[:, :width] &= np.arange(width) >= path[:, None]
    return new


def _turned(plane: np.ndarray, turns: int) -> np.ndarray:
    """A view whose left border is the left, top, right or bottom one of ``plane``."""
    view = plane.T if turns % 2 else plane
    return view[:, ::-1] if turns >= 2 else view


def enclosed(
    errors: Float32[np.ndarray, "m n"], strips: Strips, limit: float = np.inf
) -> tuple[Bool[np.ndarray, "m n"], float]:
    """The pixels of a rectangle within the cheapest cut through its strips, and what it costs.

    Unlike the cuts of `laid_over`, this may go any way, and is one through all strips: the minimum cut, but that
    where there are four it may miss a little.

    Parameters
    ----------
    errors : what each pixel beside the cut costs; 0 where nothing stands.
    strips : opposite ones do not meet.

    References
    ----------
    [Kwatra2003]_ section 3, without the maximum flow that is not needed in a plane.
    """
    from texloom.stages.kernels.seams.boundary_cut import cheapest_loop

    widths = (strips.top, strips.left, strips.bottom, strips.right)
    framed = np.empty((errors.shape[0] + 2, errors.shape[1] + 2), np.float32)
    framed[1:-1, 1:-1] = errors
    for turns, width in enumerate(widths):
        outside = np.rot90(framed, -turns)
        outside[0] = outside[1] if width else -1
    # The cut closes below, at best where it is free.
    turns = next((side for side, width in enumerate(widths) if not width), 0) + 2
    top, left, bottom, right = (widths[(side + turns) % 4] for side in range(4))
    framed = np.ascontiguousarray(np.rot90(framed, -turns))
    height, width = framed.shape
    inside = np.empty(framed.shape, bool)
    core = (top + 1, height - bottom - 1, left + 1, width - right - 1)
    cost = cheapest_loop(framed, core, limit, inside)
    return np.ascontiguousarray(np.rot90(inside, turns)[1:-1, 1:-1]), float(cost)
