"""The part of a picture that shows whole periods of its lattice, so that it can be made tileable."""

import dataclasses
import logging

import numpy as np
from pydantic import Field

from texloom.stages.synthesis.optimisation.lattice_phase import steps_along
from texloom.stages.vocabulary.arrays import Image, Vectors
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.facts import TORUS
from texloom.stages.vocabulary.sizes import format_size
from texloom.stages.vocabulary.tileable import Tileable

_LOG = logging.getLogger(__name__)

_AXES = ("down", "across")
_FITS = 0.08  # periods by which a part may miss whole ones, where the lattice leans or is not quite even
_FITS_AS_IT_IS = 0.03  # the same of a side that is not cut
_MIN_PERIODS = 2.0  # that a side has to show; of fewer nobody knows whether they return


class WholePeriodsParams(Params):
    """How much may be cut off."""

    keep_size: bool = False
    """the picture stays as it is, whatever its periods"""
    most: float = Field(0.2, ge=0, le=0.5)
    """largest share of a side that is cut off"""
    tileable: Tileable = TORUS
    """the sides that are to have whole periods: x the width, y the height, both"""


@dataclasses.dataclass(frozen=True)
class WholePeriods:
    """The part."""

    image: Image
    """the middle of the picture, bit-identical"""
    generators: Vectors
    """the lattice where the part has whole periods, else no rows"""


@stage(version=1)
def whole_periods(image: Image, generators: Vectors, params: WholePeriodsParams) -> WholePeriods:
    """Cut a picture to whole periods of its lattice, so that its pattern can go on across its borders.

    A length fits if it is nearly a step of the lattice along its axis: then opposite borders show the same part of
    a cell. The longest one is taken, and the middle of the picture cut out. Straight lines at uneven distances have
    no period.

    Parameters
    ----------
    image : the picture that is made tileable.
    generators : its lattice, two rows of px, or one, at right angles to its courses; no rows where it has none. See
        `lattice_selection`.

    References
    ----------
    Ours; [Liu2004]_ for tiles that are cells of a lattice.
    """
    sides = (image.height, image.width)
    none = WholePeriods(image, np.zeros((0, 2), np.float32))
    if params.keep_size or not len(generators) or _are_lines(generators, sides):
        return none
    steps = steps_along(generators.astype(np.float64))
    cut = list(sides)
    for axis, wanted in enumerate(params.tileable):
        if wanted:
            part = _whole(steps[axis], sides[axis], params.most)
            if part is None:
                _LOG.warning(
                    "the pattern has a period, but no %d px of the picture are whole periods %s, and it stays as "
                    "it is: the new band bridges the difference. --set fitted.most=.3 may cut off more",
                    round((1 - params.most) * sides[axis]),
                    _AXES[axis],
                )
                return none
            cut[axis] = part
    if tuple(cut) == sides:
        return WholePeriods(image, generators)
    _LOG.warning(
        "the pattern has a period, and the picture was cut to whole ones: %s of %s, %.1f %% of its width and "
        "%.1f %% of its height less; --set keep_size=true keeps all of it",
        format_size((cut[0], cut[1])),
        format_size(image),
        100 * (1 - cut[1] / sides[1]),
        100 * (1 - cut[0] / sides[0]),
    )
    top, left = ((side - part) // 2 for side, part in zip(sides, cut, strict=True))
    return WholePeriods(image.cropped(slice(top, top + cut[0]), slice(left, left + cut[1])), generators)


def _are_lines(generators: Vectors, sides: tuple[int, int]) -> bool:
    return len(generators) == 1 and bool((2 * np.abs(generators[0]) >= sides).any())


def _whole(steps: np.ndarray, side: int, most: float) -> int | None:
    """The longest part of a side with whole periods; none where the part cut off exceeds a share of ``most``.

    A side that shows too few periods, or as courses do none, is whole.

    Parameters
    ----------
    steps : of the lattice along its generators, for a px of the side.
    """
    step = float(np.abs(steps).max())
    if side * step < _MIN_PERIODS:
        return side
    parts = np.arange(side, 0, -1)
    away = np.abs(parts[:, None] * steps - np.rint(parts[:, None] * steps)).max(axis=1)
    if away[0] <= max(step, _FITS_AS_IT_IS):
        return side
    best = np.r_[False, (away[1:-1] <= away[:-2]) & (away[1:-1] <= away[2:]), False]  # of one number of periods
    fitting = np.flatnonzero(best & (away <= _FITS) & (parts >= (1 - most) * side))
    return int(parts[fitting[0]]) if len(fitting) else None
