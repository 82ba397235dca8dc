"""What an exemplar looks like around every pixel, at every level: all that per-pixel synthesis asks of it."""

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from jaxtyping import Bool, Float32, Int16, Int32
from pydantic import Field

from texloom.stages.arrays import Channels, Image, Jacobian, Mask, ScalarMap
from texloom.stages.color import lab_from_linear
from texloom.stages.common import appearance as _appearance
from texloom.stages.common import distorted_appearance
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.progress import Progress, report

LEAST = 16
"""px of an exemplar's shorter side"""

_LARGEST = 2**21  # px of an exemplar, which take up to half a kilobyte each

_EIGHT = Channels(tuple(f"c{number}" for number in range(8)))


class AppearanceStackParams(Params):
    """How the exemplar is seen."""

    toroidal: bool = False
    """the exemplar continues across its borders"""
    coarsest: int = Field(16, ge=2, le=64)
    """pixels of the coarsest level along the exemplar's shorter side, at least: fewer let larger structures be
    arranged, and leave fewer whole neighbourhoods where the exemplar is not toroidal"""
    k: int = Field(2, ge=1, le=8)
    """places in a similarity set, with the pixel itself; more find better continuations, and take longer"""
    min_separation: float = Field(0.2, ge=0, lt=0.5)
    """least distance of the places in a set from each other, as a share of the exemplar's shorter side; where it is
    small, a smooth spot looks most like itself and spreads"""
    guidance: float = Field(1.0, ge=0, le=10)
    """factor on the distance to features, where it is given"""


@dataclasses.dataclass(frozen=True)
class AppearanceStack:
    """Levels from the finest, whose pixels are 1 px apart, to the coarsest, each twice as far apart as the last."""

    appearance: Annotated[Int16[np.ndarray, "levels h w 8"], _EIGHT]
    """what a window of 5x5 samples around each pixel looks like: its principal components; in units of its own at
    each level"""
    basis: Int16[np.ndarray, "levels 64 8"]
    """from the appearances one step away, 8 values each (up left, up, up right, left, right, down left, down, down
    right), to the 8 principal components of all; orthonormal but for a factor of 2048"""
    candidates: Int32[np.ndarray, "levels h w k"]
    """places that look like each, row * w + column, the most alike first: the pixel itself where its neighbourhood
    is whole, else one that is; the first once more where there are no others"""
    toroidal: bool
    """whether the exemplar continues across its borders"""


def check_image(params: AppearanceStackParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """The exemplar must hold some neighbourhoods, and be countable."""
    image = known.get("image")
    if image is None:
        return
    shape = f"{image.height}x{image.width} px"
    if min(image.height, image.width) < LEAST:
        raise InputError(f"image: {shape} is too small to synthesise from, which takes {LEAST}x{LEAST} px")
    if image.height * image.width > _LARGEST:
        raise InputError(f"image: {shape} is more than the {_LARGEST} px that can be synthesised from")


def level_count(shape: tuple[int, int], coarsest: int) -> int:
    """Levels of an exemplar of ``shape`` whose coarsest has at least ``coarsest`` pixels a side."""
    return max(1, int(np.floor(np.log2(min(shape) / coarsest))) + 1)


@stage(version=1, check=check_image)
def appearance_stack(
    image: Image,
    params: AppearanceStackParams,
    distance: ScalarMap | None = None,
    jacobian: Jacobian | None = None,
    stack: Float32[np.ndarray, "levels h w c"] | None = None,
    valid: Bool[np.ndarray, "levels h w"] | None = None,
    known: Mask | None = None,
    tileable: bool = False,
) -> AppearanceStack:
    """Describe every neighbourhood of an exemplar in a few numbers, and find others like it, at every level.

    The levels are a Gaussian stack: all have the exemplar's size, and each is blurred twice as much as the last. A
    pixel's appearance is a 5x5 window of samples 2**level px apart, in the 8 principal components of all windows; a
    place is compared by the appearances of its eight neighbours, once more in 8 components. Neighbourhoods that are
    not whole are left out of the similarity sets: those near the border of an exemplar that is not toroidal, and
    those with samples that are not ``valid``.

    Parameters
    ----------
    image : only its colour is compared.
    distance : to features, 0..100, compared like a fourth channel of colour; see `signed_distance`.
    jacobian : how the texture is distorted in ``image``; none where it is flat.
    stack : the levels of what is compared, finest first, where they are made elsewhere; ``distance`` is not used
        then.
    valid : for each level the pixels that can be used; all where it is not given.
    known : the pixels of distorted texture that are described, since others may continue them; all that can be
        used where it is not given.
    tileable : what was made to continue across its borders is toroidal too.

    Raises
    ------
    InputError
        the exemplar is too small or too large, a value is not finite, or a level has no whole neighbourhood.
    ValueError
        inputs that do not belong together.

    References
    ----------
    [LefebvreHoppe2006]_ section 3, appearance vectors; [LefebvreHoppe2005]_ section 4, Gaussian stack;
    [Tong2002]_ similarity sets; [Eisenacher2008]_ section 3.2, distortion, and section 3.3, places for
    neighbourhoods that are not whole. Unlike there, vectors are whole numbers, so that sums are exact.
    """
    check_image(params, {"image": image})
    if not np.isfinite(image.pixels).all():
        raise InputError("image: a value is not finite")
    shape = (image.height, image.width)
    for name, field in (("distance", distance), ("jacobian", jacobian)):
        if field is not None and field.shape[:2] != shape:
            raise ValueError(f"{name} of shape {field.shape} for an exemplar of {shape}")
    toroidal = params.toroidal or tileable
    if jacobian is not None and toroidal:
        raise InputError("toroidal: a distorted exemplar cannot continue across its borders")
    if stack is None:
        planes = lab_from_linear(image.color)
        if distance is not None and params.guidance:
            planes = np.concatenate([planes, distance[..., None] * np.float32(params.guidance)], axis=2)
        count = level_count(shape, params.coarsest)
        stack = _appearance.gaussian_stack(planes, count, toroidal)
    if stack.shape[1:3] != shape or (valid is not None and valid.shape != stack.shape[:3]):
        raise ValueError(f"stack {stack.shape} or valid do not belong to an exemplar of {shape}")

    min_separation = max(1, round(params.min_separation * min(shape)))
    if known is None:
        known = np.ones(shape, bool) if valid is None else valid.any(axis=0)
    found = []
    for level, planes in enumerate(stack):
        usable = np.ones(shape, bool) if valid is None else valid[level]
        if jacobian is None:
            whole = _appearance.whole(usable, level, toroidal)
            made = (
                _appearance.analyse(planes, whole, level, toroidal, params.k, min_separation)
                if whole.any()
                else None
            )
        else:
            made = distorted_appearance.analyse(planes, known, usable, level, jacobian, params.k, min_separation)
        if made is None:
            raise InputError(f"level {level}: no neighbourhood of the exemplar is whole; raise coarsest")
        found.append(made)
        report(Progress((level + 1) / len(stack), scale=level + 1, scales=len(stack)))
    appearance, basis, candidates = (np.stack(part) for part in zip(*found, strict=True))
    return AppearanceStack(appearance, basis, candidates, toroidal)
