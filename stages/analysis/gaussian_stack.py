"""Gaussian stack of a texture that is distorted, and covers only a part of its picture."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float32, Int64
from pydantic import Field

from texloom.stages.arrays import Image, Jacobian, Mask, ScalarMap
from texloom.stages.color import lab_from_linear
from texloom.stages.common.distorted_appearance import whole_count
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.kernels.core.threads import run_spans
from texloom.stages.masks import nearest
from texloom.stages.progress import Progress, report

_SHARP = 0.5  # levels by which a pixel may be less sharp than the level it is used at
_PIECES = 16
_MOST = 8.0  # times brighter or darker
_WIDER = 3  # levels by which light varies more slowly than the coarsest level
_TURNS = 2
_COARSE = 4  # px apart light is found
_AREA = 1 / 12  # variance of a mean over a pixel, px squared
_VARIANCE = 0.36  # of a Gaussian after which samples 1 px apart are enough, px squared


class GaussianStackParams(Params):
    """How far the stack goes."""

    most: int = Field(6, ge=1, le=10)
    """levels, if so many have whole neighbourhoods"""
    whole: float = Field(0.15, gt=0, le=1)
    """share of the pixels used, at least, whose neighbourhoods at the coarsest level lie in the region with all
    their samples; more gives smaller structures and more choice"""
    distant: bool = False
    """pixels that lack the finest detail are used at the coarser levels; what comes from there is exchanged for
    what looks alike when detail is added, which breaks structures"""
    even: float = Field(0.0, ge=0, le=1)
    """how much of the light that varies slowly over the region is taken out, so that pieces of it fit together: 0
    leaves all, 1 nothing of what is wider than the coarsest level's neighbourhoods"""


_LEAST = 16  # whole neighbourhoods of the coarsest level


@dataclasses.dataclass(frozen=True)
class GaussianStack:
    """Levels from the finest, each with half the detail of the last."""

    stack: Float32[np.ndarray, "levels h w c"]
    """CIELAB"""
    colors: Float32[np.ndarray, "levels h w 3"]
    """linear light"""
    valid: Bool[np.ndarray, "levels h w"]
    """the pixels of the region that are sharp enough"""
    image: Image
    """the finest level"""
    jacobian: Jacobian
    """that of the photograph, there"""
    known: Mask
    """all pixels of the region, there"""
    corner: Int64[np.ndarray, "2"]
    """row and column in the photograph of the first pixel of all these, which are as large as the region takes"""


@stage(version=1)
def gaussian_stack(
    image: Image, jacobian: Jacobian, level: ScalarMap, region: Mask, params: GaussianStackParams
) -> GaussianStack:
    """Blur a distorted texture as if it were flat, and tell at which levels each pixel is sharp enough to be used.

    Every level is blurred by two Gaussian means along the texture's two directions, as wide in the texture
    everywhere. What a pixel lacks in sharpness already is taken off.

    Parameters
    ----------
    jacobian, level, region : see `jacobian_field`.

    Raises
    ------
    InputError : no neighbourhood of the region is whole.

    References
    ----------
    [Eisenacher2008]_ section 3.2, sparse distorted Gaussian stack. Unlike there, pixels count as sharp up to half a
    level below; those that lack detail are left out of all levels unless they are asked for; and blur that the
    camera has made is counted in, along each direction by itself: where the texture is foreshortened in one, it is
    still blurred along the other, at the finest level too.
    """
    rows, columns = (np.flatnonzero(region.any(axis=axis)) for axis in (1, 0))
    window = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    jacobian, level, region = (np.ascontiguousarray(field[window]) for field in (jacobian, level, region))
    colors, valid = [], []
    planes = np.ascontiguousarray(image.color[window], np.float32)
    # variance along each direction, squared elements: of a pixel's area to begin with
    made = [_AREA / np.maximum(np.square(jacobian[..., [axis, 2 + axis]]).sum(axis=2), 1e-12) for axis in (0, 1)]
    for number in range(params.most):
        usable = region & (level <= (number if params.distant else 0) + _SHARP)
        found = whole_count(usable, number, jacobian)
        if found < _LEAST or (number and found < params.whole * np.count_nonzero(usable)):
            break
        planes = _blurred(planes, jacobian, region, made, number)
        colors.append(planes)
        valid.append(usable)
        report(Progress((number + 1) / params.most, scale=number + 1, scales=params.most))
    if not colors:
        raise InputError(
            f"region: of the neighbourhoods in it, 7x7 elements large, fewer than {_LEAST} are whole; mark more of "
            "the photograph"
        )
    if params.even:
        light = _light(planes, jacobian, region, len(colors), made)
        mean = light[region].mean(axis=0)
        factor = np.clip(mean / np.maximum(light, 1e-6 + 1e-3 * mean), 1 / _MOST, _MOST) ** np.float32(params.even)
        colors = [one * factor for one in colors]
    light = np.stack(colors)
    lab = np.stack([lab_from_linear(one) for one in light])
    corner = np.array([rows[0], columns[0]], np.int64)
    return GaussianStack(lab, light, np.stack(valid), Image(light[0], ("R", "G", "B")), jacobian, region, corner)


def _light(
    planes: Float32[np.ndarray, "h w 3"],
    jacobian: Jacobian,
    region: Mask,
    number: int,
    made: list[np.ndarray],
) -> Float32[np.ndarray, "h w 3"]:
    """What remains of the coarsest level, and of those beyond it, where detail is taken out further."""
    from texloom.stages.kernels.core.resample import sampled

    grid = np.s_[::_COARSE, ::_COARSE]
    coarse, inside = np.ascontiguousarray(planes[grid]), np.ascontiguousarray(region[grid])
    bent = np.ascontiguousarray(jacobian[grid]) / np.float32(_COARSE)
    light = np.ones_like(coarse)
    for _ in range(_TURNS):  # what is left near borders, where means are of one side, is found by the next turn
        done, left = [one[grid] for one in made], coarse / light
        for further in range(_WIDER):
            left = _blurred(left, bent, inside, done, number + further)
        light = light * np.maximum(left, 1e-6)
    row, column = nearest(inside)
    light = light[row, column]
    return sampled(light, np.moveaxis(np.indices(region.shape) / _COARSE, 0, 2))


def _blurred(
    planes: Float32[np.ndarray, "h w 3"], jacobian: Jacobian, region: Mask, made: list[np.ndarray], number: int
) -> Float32[np.ndarray, "h w 3"]:
    """As much as level ``number`` takes; ``made`` is what has been done already, variances down and across."""
    from texloom.stages.kernels.distortion.blur import blur_along

    wanted = np.float32(_AREA + _VARIANCE * (4.0**number - 1))
    for axis in (0, 1):
        sigma = np.sqrt(np.maximum(wanted - made[axis], 0), dtype=np.float32)
        made[axis] = np.maximum(made[axis], wanted)
        out = np.empty_like(planes)
        run_spans(blur_along, (planes, jacobian, region, sigma, axis, out), len(region), _PIECES)
        planes = out
    return planes
