"""The part of a picture that shows whole periods of its lattice, so that it can be made tileable."""

import dataclasses
import itertools
import logging
import math
from typing import Annotated

import numpy as np
from jaxtyping import Float32, Float64
from pydantic import Field

from texloom.stages.analysis.exemplars.plain_margins import inside_margins
from texloom.stages.common.regularity.lattice_cells import steps_along
from texloom.stages.numerics.matrices import determinant, inverse_of, matrix_product
from texloom.stages.vocabulary.arrays import Channels, Image, Vectors
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.facts import TORUS
from texloom.stages.vocabulary.normals import turned
from texloom.stages.vocabulary.sizes import format_size
from texloom.stages.vocabulary.tileable import Tileable

_LOG = logging.getLogger(__name__)

_AXES = ("down", "across")
_FITS = 0.08  # periods by which a part may miss whole ones, where the lattice leans or is not quite even
_FITS_AS_IT_IS = 0.03  # the same of a side that is not cut
_FEW = 0.05  # share of a side that may be cut off without looking for another way
_WORTH = 1.02  # times the area that cutting leaves, that resampling has to leave
_MIN_PERIODS = 2.0  # that a side has to show; of fewer nobody knows whether they return


class WholePeriodsParams(Params):
    """How much may be cut off."""

    keep_size: bool = False
    """the picture stays as it is, whatever its periods and margins"""
    most: float = Field(0.2, ge=0, le=0.5)
    """largest share of a side that is cut off"""
    scaled: float = Field(0.04, ge=0, le=0.2)
    """largest lean of the lattice, as a share, that is removed by resampling where cutting alone would take more
    than a twentieth of a side; 0 never resamples"""
    tileable: Tileable = TORUS
    """the sides that are to have whole periods: x the width, y the height, both"""


@dataclasses.dataclass(frozen=True)
class WholePeriods:
    """The part."""

    image: Image
    """the middle of the picture, bit-identical unless it is scaled"""
    generators: Vectors
    """the lattice where the part has whole periods, else no rows"""
    lattice: Annotated[Float32[np.ndarray, "known 2"], Channels(("row", "column"))]
    """the lattice of the part, whether its sides fit or not; no rows where it has none"""


@stage(version=2)
def whole_periods(image: Image, generators: Vectors, params: WholePeriodsParams) -> WholePeriods:
    """Cut a picture to whole periods of its lattice, so that its pattern can go on across its borders.

    A length fits if it is nearly a step of the lattice along its axis: then opposite borders show the same part of
    a cell. The longest one is taken, and the middle of the picture cut out. Straight lines at uneven distances have
    no period.

    Plain margins around the picture are cut off first, see `plain_margins`.

    Where that would take more than a twentieth of a side, as where the lattice leans, the parallelogram of steps of
    the lattice that is nearest to the picture is resampled to a rectangle, if that changes scale and direction by
    a few per cent only; normals turn with it.

    Parameters
    ----------
    image : the picture that is made tileable.
    generators : its lattice, two rows of px, or one, at right angles to its courses; no rows where it has none. See
        `lattice_selection`.

    References
    ----------
    Ours; [Liu2004]_ for tiles that are cells of a lattice.
    """
    if not params.keep_size:
        image = _without_margins(image)
    sides = (image.height, image.width)
    no_rows = np.zeros((0, 2), np.float32)
    if not len(generators) or _are_lines(generators, sides):
        return WholePeriods(image, no_rows, no_rows)
    none = WholePeriods(image, no_rows, generators)
    if params.keep_size:
        return none
    steps = steps_along(generators.astype(np.float64))
    parts = [
        _whole(steps[axis], side, params.most) if wanted else side
        for axis, (side, wanted) in enumerate(zip(sides, params.tileable, strict=True))
    ]
    known = [part or 0 for part in parts]
    fits = None not in parts and not any(
        wanted and abs(off - np.rint(off)) > _FITS
        for wanted, off in zip(params.tileable, steps[:, 0] * known, strict=True)
        if len(generators) == 1  # courses that lean have too few periods along them to be cut by
    )
    if not fits or any(part < (1 - _FEW) * side for part, side in zip(known, sides, strict=True)):
        vectors = _near_sides(steps, sides, params)
        if vectors is not None and determinant(vectors) > _WORTH * fits * math.prod(known):
            return _scaled(image, generators, vectors)
    if None in parts:
        axis = parts.index(None)
        _LOG.warning(
            "the pattern has a period, but no %d px of the picture are whole periods %s, and it stays as "
            "it is: the new band bridges the difference. --set fitted.most=.3 may cut off more",
            round((1 - params.most) * sides[axis]),
            _AXES[axis],
        )
        return none
    height, width = known
    if (height, width) == sides:
        return WholePeriods(image, generators, generators)
    _LOG.warning("%s; --set keep_size=true keeps all of it", _told_of((height, width), sides))
    top, left = ((side - part) // 2 for side, part in zip(sides, known, strict=True))
    return WholePeriods(image.cropped(slice(top, top + height), slice(left, left + width)), generators, generators)


def _without_margins(image: Image) -> Image:
    rows, columns = inside_margins(image.color)
    height, width = rows.stop - rows.start, columns.stop - columns.start
    if (height, width) == (image.height, image.width):
        return image
    _LOG.warning(
        "the picture has a plain margin, which was cut off: %s of %s are left; --set keep_size=true keeps it",
        format_size((height, width)),
        format_size((image.height, image.width)),
    )
    return image.cropped(rows, columns)


def _told_of(part: tuple[int, int], sides: tuple[int, int]) -> str:
    """What was cut off."""
    return (
        f"the pattern has a period, and the picture was cut to whole ones: {format_size(part)} of "
        f"{format_size(sides)}, {100 * (1 - part[1] / sides[1]):.1f} % of its width and "
        f"{100 * (1 - part[0] / sides[0]):.1f} % of its height less"
    )


def _near_sides(
    steps: np.ndarray, sides: tuple[int, int], params: WholePeriodsParams
) -> Float64[np.ndarray, "2 2"] | None:
    """Steps of the lattice that are nearest to the sides of a picture, down and across, within it; or none.

    Parameters
    ----------
    steps : of the lattice along its generators, for a px of each side.
    """
    wanted = params.tileable
    found = []
    for axis, side in enumerate(sides):
        vectors = np.zeros((1, 2))
        vectors[0, axis] = side
        if wanted[axis]:
            vectors = _steps_near(steps, axis, sides, vectors)
            vectors = vectors[vectors[:, axis] >= (1 - params.most) * side]
        lean = np.abs(vectors[:, 1 - axis]) / vectors[:, axis]
        found.append(vectors[lean <= params.scaled])
    pairs = [np.stack(pair) for pair in itertools.product(*found)]
    for pair in pairs:
        for axis in (0, 1):
            if not wanted[axis]:  # it makes room for the lean of the other one
                pair[axis, axis] -= abs(pair[1 - axis, axis])
    inside = [pair for pair in pairs if (np.abs(pair).sum(axis=0) <= np.array(sides) + 1e-6).all()]
    return max(inside, key=lambda pair: float(determinant(pair)), default=None)


def _steps_near(
    steps: np.ndarray, axis: int, sides: tuple[int, int], whole: Float64[np.ndarray, "1 2"]
) -> Float64[np.ndarray, "n 2"]:
    """Steps of the lattice that are nearly a side of a picture; ``whole``: that side."""
    side, other = sides[axis], 1 - axis
    if steps.shape[1] == 1:
        step = abs(steps[axis, 0])
        if step * side >= _MIN_PERIODS:
            periods = np.floor(step * side) - np.arange(2.0)
            return np.eye(2)[axis] * periods[periods >= 1, None] / step
        drift = steps[axis, 0] * side  # along courses, which must not have it
        return whole + np.eye(2)[other] * (np.rint(drift) - drift) / steps[other, 0]
    if np.abs(steps[axis]).max() * side < _MIN_PERIODS:
        return whole
    reach = [int(np.ceil((np.abs(steps[:, one]) * sides).sum())) for one in (0, 1)]
    counts = np.stack(np.meshgrid(*(np.arange(-one, one + 1.0) for one in reach), indexing="ij"), axis=2)
    vectors: np.ndarray = matrix_product(counts.reshape(-1, 2), inverse_of(steps))
    return vectors[(vectors[:, axis] > 0) & (vectors[:, axis] <= side)]


def _scaled(image: Image, generators: Vectors, vectors: Float64[np.ndarray, "2 2"]) -> WholePeriods:
    """The parallelogram of two steps of the lattice in the middle of a picture, as a rectangle."""
    from texloom.stages.kernels.core.resample import sampled

    sides = (image.height, image.width)
    height, width = round(vectors[0, 0]), round(vectors[1, 1])
    axes = vectors / np.array([[height], [width]])  # px of the picture for one of the rectangle, down and across
    first = (np.array(sides) - np.abs(vectors).sum(axis=0)) / 2 - np.minimum(vectors, 0).sum(axis=0)
    rows, columns = np.arange(height)[:, None, None], np.arange(width)[None, :, None]
    pixels = sampled(image.pixels, first + rows * axes[0] + columns * axes[1])
    back = inverse_of(axes)
    jacobian = np.broadcast_to(back.T.ravel().astype(np.float32), (height, width, 4))
    lean = max(abs(vectors[0, 1]) / vectors[0, 0], abs(vectors[1, 0]) / vectors[1, 1])
    _LOG.warning(
        "%s; it was resampled, as its lattice leans by %.1f %%; --set fitted.scaled=0 only cuts, --set "
        "keep_size=true keeps all of it",
        _told_of((height, width), sides),
        100 * lean,
    )
    made = image.elsewhere(turned(pixels, image.channels, jacobian))
    scaled = matrix_product(generators, back).astype(np.float32)
    return WholePeriods(made, scaled, scaled)


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
