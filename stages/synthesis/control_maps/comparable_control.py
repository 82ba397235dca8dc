"""Control of an exemplar and of a target, made comparable."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from texloom.stages.synthesis.control_maps.detail_of_control import as_smooth_as
from texloom.stages.synthesis.control_maps.even_demand import evenly_demanded
from texloom.stages.synthesis.control_maps.known_control import extrapolated

_NOTABLE = 1 / 20  # of the range; change of a value that is reported
_FARTHEST = 1 / 4  # of the range, which values move at most for even use, unless blur has mixed all materials


class Comparable(NamedTuple):
    """What is compared instead of the maps themselves."""

    own: Float32[np.ndarray, "h w k"]
    """control of the exemplar, with no more detail than the target"""
    blurred: bool
    """whether it is blurred, so that the target has no lines"""
    wanted: Float32[np.ndarray, "H W k"]
    """control of the target, with values of which the exemplar has enough pixels"""
    rare: float
    """share of the target that changes by more than a twentieth of the range, 0..1"""


def comparable(
    own: Float32[np.ndarray, "h w k"],
    wanted: Float32[np.ndarray, "H W k"],
    strength: float,
    toroidal: bool,
    use: Float32[np.ndarray, "h w"] | None = None,
    evenly: bool = True,
) -> Comparable:
    """Control as pixels are compared by.

    Parameters
    ----------
    own, wanted : control of the exemplar and of the target, 0 to ``strength``.
    toroidal : the exemplar wraps around.
    use : how often each pixel of the exemplar may be used, relative to the others; none: all alike.
    evenly : values move so that pixels suffice; false where colours are asked for too and ``use`` is not known:
        pixels of one value need not serve all of the target's.
    """
    smooth = as_smooth_as(own, wanted, toroidal)
    blurred = smooth is not own
    if not evenly:
        return Comparable(smooth, blurred, wanted, 0.0)
    alike, moved = evenly_demanded(smooth, wanted, np.inf if blurred else _FARTHEST * strength, use)
    moved, _ = extrapolated(alike, moved, strength)
    changed = np.linalg.norm(moved - wanted, axis=2) > _NOTABLE * strength
    return Comparable(alike, blurred, moved, float(changed.mean()))
