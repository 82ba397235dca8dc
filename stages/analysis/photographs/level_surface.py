"""A surface whose lattice is regular and level: what is left of tilt and bend is taken out of it."""

import dataclasses
import logging
import math
from typing import Any

import numpy as np
from jaxtyping import Float64
from pydantic import Field

from texloom.stages.analysis.regularity.deformed_lattice import DeformedLattice, lattice_through
from texloom.stages.analysis.regularity.lattice_tracking import track_lattice
from texloom.stages.analysis.regularity.straighten import straightening
from texloom.stages.common.grids.resampled import resampled
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import inverse_of, matrix_product
from texloom.stages.vocabulary.arrays import Image, Vectors
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.masks import fill_excluded, valid_pixels
from texloom.stages.vocabulary.progress import Progress, report

_LOG = logging.getLogger(__name__)

_REACH = 0.2  # of the shorter generator, around the place that a neighbour predicts
_STIFFNESS = 0.1  # of the lattice: slow bends are followed, single elements hardly
_LEAST_DETECTED = 0.5  # of the vertices inside
_MIN_VERTICES = 9
_LEAST = 1.0  # px of the largest move
_MOST_STRAIN = 0.15  # share of a generator by which it may differ from its neighbour's after the moves
_UPRIGHT = 0.06  # tangent of the angle to a side up to which lines of the lattice are made level
_STEPS = range(-2, 3)  # generators that such a line may consist of
_BETTER = 0.005  # correlation of cells beside each other, by which it has to rise
_OVERLAP = 0.1  # of the usable pixels, that have another one a generator away
_COARSE = 8  # px between the places at which the warp is computed


class LevelSurfaceParams(Params):
    """Whether a surface is warped."""

    level: bool = Field(True)
    """warp a surface that repeats in two directions, so that its rows and columns run straight and level"""


@dataclasses.dataclass(frozen=True)
class LevelSurface:
    """A surface with a regular lattice."""

    image: Image
    """of the surface's size; pixels that come from beyond it are excluded"""
    generators: Vectors
    """of its lattice, px; those given where nothing is changed"""
    table: dict[str, Any]
    """``why``: a sentence, empty where nothing is changed; ``moved``: by how much pixels are moved at most, px;
    ``detected``: share of the lattice's vertices that were found"""


@stage(version=1)
def level_surface(image: Image, generators: Vectors, params: LevelSurfaceParams) -> LevelSurface:
    """Warp a surface from the front so that its lattice becomes regular, and its lines level.

    What a homography and a lens leave, a degree of tilt or some px of bend, makes joints of a texture kink where
    pieces from different places meet. The lattice's vertices are detected (`deformed_lattice`), smoothed so that
    single elements stay as they lie, and moved to the nearest regular lattice; lines of this within 3.4 degrees of
    a side become parallel to it. The warp is taken if enough vertices are detected, neighbours hardly move apart,
    and cells are more alike afterwards.

    Parameters
    ----------
    image : the surface from the front.
    generators : of its repetition, as from `lattice_selection`.

    References
    ----------
    [Lin2004]_ appendix A for the deformation of a near-regular texture. The rest is ours.
    """
    kept = LevelSurface(image, generators, {"why": "", "moved": 0.0, "detected": 0.0})
    if not params.level or len(generators) != 2:
        return kept
    try:
        known, correlations = track_lattice(image, generators.astype(np.float64), _REACH)
        found = lattice_through(image, known, _STIFFNESS, correlations**2)
    except InputError:  # no lattice is detected
        return kept
    report(Progress(0.3))
    middle = (np.array([image.height, image.width]) - 1) / 2
    turn = _level(found.generators.astype(np.float64))
    places, targets = (one.astype(np.float64) for one in (found.vertices, found.regular))
    targets = matrix_product(targets - middle, turn) + middle
    inside = ((places >= 0) & (places <= 2 * middle)).all(axis=1)
    moved = float(np.hypot(*(targets - places)[inside].T).max(initial=0.0))
    enough = found.detected >= _LEAST_DETECTED and found.detected * inside.sum() >= _MIN_VERTICES
    if not enough or moved < _LEAST or _strain(found, targets - places, inside) > _MOST_STRAIN:
        return kept
    level = _warped(image, places, targets)
    report(Progress(0.8))
    own = matrix_product(found.generators.astype(np.float64), turn).astype(np.float32) + np.float32(0)  # no -0
    if _alike(level, own) < _alike(image, generators) + _BETTER:
        return kept
    why = f"rows and columns made straight and level, by up to {moved:.1f} px (--set level=false leaves them)"
    _LOG.warning("%s", why)
    return LevelSurface(level, own, {"why": why, "moved": moved, "detected": found.detected})


def _strain(found: DeformedLattice, moves: Float64[np.ndarray, "n 2"], inside: np.ndarray) -> float:
    """The largest difference between the moves of neighbouring vertices inside, in generators."""
    steps = found.steps - found.steps.min(axis=0)
    table = np.full((*(steps.max(axis=0) + 1), 2), np.nan)
    table[steps[inside, 0], steps[inside, 1]] = moves[inside]
    apart = (np.hypot(*np.moveaxis(np.diff(table, axis=axis), 2, 0)) for axis in (0, 1))
    lengths = np.hypot(*found.generators.astype(np.float64).T)
    return max(float(np.nanmax(one, initial=0.0) / length) for one, length in zip(apart, lengths, strict=True))


def _level(generators: Float64[np.ndarray, "2 2"]) -> Float64[np.ndarray, "2 2"]:
    """The matrix that makes lines of a lattice parallel to the sides, lengths kept; of row vectors."""
    lines = [
        matrix_product(np.array([one, other], np.float64), generators)
        for one in _STEPS
        for other in _STEPS
        if one or other
    ]
    found = []
    for axis in (0, 1):
        near = [line for line in lines if line[axis] > 0 and abs(line[1 - axis]) <= _UPRIGHT * line[axis]]
        found.append(min(near, key=lambda line: line[axis], default=np.eye(2)[axis]))
    upright = np.array(found)
    return matrix_product(inverse_of(upright), np.diag([math.hypot(*line) for line in upright]))


def _warped(image: Image, places: Float64[np.ndarray, "n 2"], targets: Float64[np.ndarray, "n 2"]) -> Image:
    """The image with what lies at ``places`` at ``targets``."""
    from texloom.stages.kernels.core.resample import sampled

    sides = np.array([image.height, image.width])
    warp = straightening(places, targets, sides)
    shape = -(-sides // _COARSE) + 1
    grid = np.moveaxis(np.indices(tuple(shape)), 0, -1).reshape(-1, 2) * float(_COARSE)
    moves = (warp(grid) - grid).reshape(*shape, 2)
    here = np.moveaxis(np.indices((image.height, image.width), np.float64), 0, -1)
    return resampled(image, here + sampled(moves, here / _COARSE).reshape(here.shape))


def _alike(image: Image, generators: Vectors) -> float:
    """Mean correlation of an image's lightness with itself, one and two generators away."""
    lightness = gaussian_blur(np.ascontiguousarray(lab_from_linear(fill_excluded(image).color)[..., 0]), 1.0)
    valid = valid_pixels(image)
    valid = np.ones(lightness.shape, bool) if valid is None else valid
    found = []
    for generator in generators:
        for times in (1, 2):
            down, across = (round(times * float(side)) for side in generator)
            one, other = _apart(down, image.height), _apart(across, image.width)
            both = valid[one[0], other[0]] & valid[one[1], other[1]]
            if both.sum() >= _OVERLAP * valid.sum():
                values = (lightness[row, column][both] for row, column in zip(one, other, strict=True))
                found.append(_correlation(*values))
    return float(np.mean(found)) if found else 0.0


def _apart(step: int, side: int) -> tuple[slice, slice]:
    """All places of a side that have another one a step away, and these."""
    return slice(max(0, -step), side - max(0, step)), slice(max(0, step), side - max(0, -step))


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    one, other = (values - values.mean(dtype=np.float64) for values in (one, other))
    norm = math.sqrt(float((one * one).sum()) * float((other * other).sum()))
    return float((one * other).sum()) / max(norm, 1e-9)
