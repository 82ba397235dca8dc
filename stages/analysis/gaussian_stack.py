"""Gaussian stack of a texture that is distorted, and covers only a part of its picture."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float32, Int64
from pydantic import Field as Knob

from stages.analysis._distorted import whole_count
from stages.arrays import Field, Image, Jacobian, Mask
from stages.color import lab_from_linear
from stages.declare import InputError, Params, stage
from stages.progress import Progress, report

_SHARP = 0.5  # levels by which a pixel may be less sharp than the level it is used at
_PIECES = 16


class GaussianStackParams(Params):
    """How far the stack goes."""

    most: int = Knob(6, ge=1, le=10)
    """levels, if so many have whole neighbourhoods"""
    whole: float = Knob(0.15, gt=0, le=1)
    """share of the pixels used, at least, whose neighbourhoods at the coarsest level lie in the region with all
    their samples; more gives smaller structures and more choice"""
    distant: bool = False
    """pixels that lack the finest detail are used at the coarser levels; what comes from there is exchanged for
    what looks alike when detail is added, which breaks structures"""


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
    image: Image, jacobian: Jacobian, level: Field, region: Mask, params: GaussianStackParams
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
    from stages.kernels.distorted_blur import blur_along
    from stages.kernels.threads import run_spans

    rows, columns = (np.flatnonzero(region.any(axis=axis)) for axis in (1, 0))
    window = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    jacobian, level, region = (np.ascontiguousarray(field[window]) for field in (jacobian, level, region))
    colors, valid = [], []
    planes = np.ascontiguousarray(image.color[window], np.float32)
    # squared elements along each direction that a pixel is a mean of
    made = [1 / np.maximum(np.square(jacobian[..., [axis, 2 + axis]]).sum(axis=2), 1e-12) for axis in (0, 1)]
    for number in range(params.most):
        usable = region & (level <= (number if params.distant else 0) + _SHARP)
        found = whole_count(usable, number, jacobian)
        if found < _LEAST or (number and found < params.whole * np.count_nonzero(usable)):
            break
        for axis in (0, 1):
            sigma = np.float32(0.6) * np.sqrt(np.maximum(np.float32(4.0**number) - made[axis], 0))
            made[axis] = np.maximum(made[axis], np.float32(4.0**number))
            out = np.empty_like(planes)
            run_spans(blur_along, (planes, jacobian, region, sigma, axis, out), len(region), _PIECES)
            planes = out
        colors.append(planes)
        valid.append(usable)
        report(Progress((number + 1) / params.most, scale=number + 1, scales=params.most))
    if not colors:
        raise InputError(
            f"region: of the neighbourhoods in it, 7x7 elements large, fewer than {_LEAST} are whole; mark more of "
            "the photograph"
        )
    light = np.stack(colors)
    lab = np.stack([lab_from_linear(one) for one in light])
    corner = np.array([rows[0], columns[0]], np.int64)
    return GaussianStack(lab, light, np.stack(valid), Image(light[0], ("R", "G", "B")), jacobian, region, corner)
