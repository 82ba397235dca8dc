"""Appearance vectors and similarity sets of an exemplar at every level, for per-pixel synthesis."""

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from jaxtyping import Bool, Float32, Int16, Int32
from pydantic import Field

from texloom.stages.common.grids.size_checks import check_side
from texloom.stages.common.similarity import appearance, distorted_appearance
from texloom.stages.kernels.core.elementary_functions import log2
from texloom.stages.vocabulary.arrays import Channels, Image, Jacobian, Mask, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Outline, Params, stage
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.sizes import format_size

MIN_SIDE = 16
"""minimum of an exemplar's shorter side, px"""

_MAX_PIXELS = 2**21  # of an exemplar; each takes up to half a kilobyte

_EIGHT = Channels(tuple(f"c{number}" for number in range(8)))


class AppearanceStackParams(Params):
    """How the exemplar is analysed."""

    toroidal: bool = False
    """the exemplar continues across its borders"""
    coarsest: int = Field(16, ge=2, le=64)
    """minimum size of the coarsest level along the exemplar's shorter side, in its pixels; smaller values reproduce
    larger structures and leave fewer whole neighbourhoods where the exemplar is not toroidal"""
    k: int = Field(2, ge=1, le=8)
    """size of a similarity set, including the pixel itself; larger sets give better continuations and take
    longer"""
    similar_levels: int = Field(16, ge=0, le=16)
    """levels, from the finest, whose sets are of size ``k``; those of the others contain only the pixel itself, so
    that larger structures are continued, never replaced by similar ones, of which smooth ones would spread"""
    min_separation: float = Field(0.2, ge=0, lt=0.5)
    """minimum distance between the members of a set, as a share of the exemplar's shorter side; with small values
    smooth areas match themselves and spread"""
    guidance: float = Field(1.0, ge=0, le=10)
    """factor on the distance to features, if given"""


@dataclasses.dataclass(frozen=True)
class AppearanceStack:
    """Levels from the finest, with samples 1 px apart, to the coarsest; the spacing doubles at each level."""

    appearance: Annotated[Int16[np.ndarray, "levels h w 8"], _EIGHT]
    """principal components of the window of 5x5 samples around each pixel; the unit differs between levels"""
    basis: Int16[np.ndarray, "levels 64 8"]
    """from the appearances one step away, 8 values each (up left, up, up right, left, right, down left, down, down
    right), to their 8 principal components; orthonormal times 2048"""
    candidates: Int32[np.ndarray, "levels h w k"]
    """similarity set of each pixel, row * w + column, the nearest first: the pixel itself where its neighbourhood
    is whole, else one whose is; the first is repeated where there are no others"""
    toroidal: bool
    """whether the exemplar continues across its borders"""


def check_image(params: AppearanceStackParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """The exemplar must be neither too small nor too large."""
    if (image := known.get("image")) is not None:
        check_side(image, MIN_SIDE)
        if image.height * image.width > _MAX_PIXELS:
            raise InputError(f"image: {format_size(image)} is too large; the maximum is {_MAX_PIXELS} px")


def level_count(shape: tuple[int, int], coarsest: int) -> int:
    """Number of levels of an exemplar of ``shape`` whose coarsest has at least ``coarsest`` pixels a side."""
    return max(1, int(np.floor(log2(min(shape) / coarsest))) + 1)


def outlines(params: AppearanceStackParams, known: Mapping[str, Any]) -> dict[str, Outline]:
    """The levels of an exemplar that is not distorted; those of one that is are found from its content."""
    image = known.get("image")
    if image is None or "stack" in known or "jacobian" in known:
        return {}
    levels = level_count((image.height, image.width), params.coarsest)
    return {"appearance": Outline(image.height, image.width, _EIGHT.names, levels)}


@stage(version=1, check=check_image, outlines=outlines)
def appearance_stack(
    image: Image,
    params: AppearanceStackParams,
    distance: ScalarMap | None = None,
    jacobian: Jacobian | None = None,
    stack: Float32[np.ndarray, "levels h w c"] | None = None,
    valid: Bool[np.ndarray, "levels h w"] | None = None,
    known: Mask | None = None,
) -> AppearanceStack:
    """Describe every neighbourhood of an exemplar by a short vector, and find its similarity set, at every level.

    The levels are a Gaussian stack: all have the exemplar's size, and each is blurred twice as much as the last. A
    pixel's appearance is a window of 5x5 samples 2**level px apart, projected on the 8 principal components of all
    windows. Pixels are compared by the appearances of their eight neighbours, projected on 8 components once more.
    Incomplete neighbourhoods are not in the similarity sets: those that cross the border of an exemplar that is not
    toroidal, and those with samples that are not ``valid``.

    Parameters
    ----------
    image : only its colour is compared; toroidal where it wraps, such as a tileable compaction.
    distance : to features, 0..100, compared like a fourth channel of colour; see `signed_distance`.
    jacobian : distortion of the texture in ``image``; None for a flat texture.
    stack : the planes to compare at each level, finest first; default: colour and ``distance``, blurred here.
    valid : the valid pixels of each level; default: all.
    known : the pixels of distorted texture that are described; default: those valid at some level.

    Raises
    ------
    InputError
        the exemplar is too small or too large, a value is not finite, or a level has no whole neighbourhood.
    ValueError
        the shapes of the inputs do not match.

    References
    ----------
    [LefebvreHoppe2006]_ section 3, appearance vectors; [LefebvreHoppe2005]_ section 4, Gaussian stack;
    [Tong2002]_ similarity sets; [Eisenacher2008]_ section 3.2, distortion, and section 3.3, replacement of
    incomplete neighbourhoods. Unlike there, vectors are integers, so that sums are exact.
    """
    if not np.isfinite(image.pixels).all():
        raise InputError("image: a value is not finite")
    shape = (image.height, image.width)
    for name, field in (("distance", distance), ("jacobian", jacobian)):
        if field is not None and field.shape[:2] != shape:
            raise ValueError(f"{name} of shape {field.shape} for an exemplar of {shape}")
    toroidal = params.toroidal or (jacobian is None and image.wraps.both)
    if jacobian is not None and toroidal:
        raise InputError("toroidal: a distorted exemplar cannot be toroidal")
    if stack is None:
        stack = _compared_levels(image, distance, params, toroidal)
    if stack.shape[1:3] != shape or (valid is not None and valid.shape != stack.shape[:3]):
        raise ValueError(f"stack of shape {stack.shape}, or valid, does not match an exemplar of {shape}")
    if valid is None:
        valid = np.ones(stack.shape[:3], bool)
    if known is None:
        known = valid.any(axis=0)

    min_separation = max(1, round(params.min_separation * min(shape)))
    vectors = np.zeros((*stack.shape[:3], appearance.COMPONENTS), np.int16)
    basis = np.zeros((len(stack), 8 * appearance.COMPONENTS, appearance.COMPONENTS), np.int16)
    candidates = np.zeros((*stack.shape[:3], params.k), np.int32)
    coarser: distorted_appearance.Neighbourhoods | None = None
    for level in reversed(range(len(stack))):
        whole = False
        k = params.k if level < params.similar_levels else 1
        sets = candidates[level] if k == params.k else np.zeros((*shape, k), np.int32)
        if jacobian is None:
            if flat := appearance.analyse(stack[level], valid[level], level, toroidal, k, min_separation):
                vectors[level], basis[level], sets[:] = flat
                whole = True
        elif both := distorted_appearance.analyse(
            stack[level], known, valid[level], level, jacobian, min_separation, coarser, vectors[level], sets
        ):
            basis[level], coarser = both
            whole = True
        if not whole:
            raise InputError(f"level {level}: no neighbourhood of the exemplar is whole; raise coarsest")
        if k < params.k:
            candidates[level] = sets
        done = len(stack) - level
        report(Progress(done / len(stack), scale=done, scales=len(stack)))
    return AppearanceStack(vectors, basis, candidates, toroidal)


def _compared_levels(
    image: Image, distance: ScalarMap | None, params: AppearanceStackParams, toroidal: bool
) -> Float32[np.ndarray, "levels h w c"]:
    """Colour, and the distance to features if given, blurred for every level."""
    planes = lab_from_linear(image.color)
    if distance is not None and params.guidance:
        planes = np.concatenate([planes, distance[..., None] * np.float32(params.guidance)], axis=2)
    return appearance.blurred_levels(planes, level_count(planes.shape[:2], params.coarsest), toroidal)
