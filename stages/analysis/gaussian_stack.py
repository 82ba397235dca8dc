"""Gaussian stack of a texture that is distorted, and covers only a part of its picture."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float32
from pydantic import Field as Knob

from stages.analysis._appearance import whole
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
    neighbourhoods: int = Knob(400, ge=1)
    """whole neighbourhoods that the coarsest level has at least; more give smaller structures and more choice"""


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
    level below, and blur that the camera has made is counted in.
    """
    from stages.kernels.distorted_blur import blur_along
    from stages.kernels.threads import run_all, spans

    colors, valid = [], []
    planes = np.ascontiguousarray(image.color, np.float32)
    made = np.power(4.0, level.astype(np.float64))  # elements that a pixel is a mean of
    for number in range(params.most):
        usable = region & (level <= number + _SHARP)
        if np.count_nonzero(whole(usable, number, False, jacobian)) < params.neighbourhoods:
            break
        sigma = (0.6 * np.sqrt(np.maximum(4.0**number - made, 0))).astype(np.float32)
        made = np.maximum(made, 4.0**number)
        for axis in (0, 1):
            out = np.empty_like(planes)
            run_all(
                blur_along,
                [(planes, jacobian, region, sigma, axis, out, *span) for span in spans(image.height, _PIECES)],
            )
            planes = out
        colors.append(planes)
        valid.append(usable)
        report(Progress((number + 1) / params.most, scale=number + 1, scales=params.most))
    if not colors:
        raise InputError(
            f"region: it has fewer than {params.neighbourhoods} whole neighbourhoods of 7x7 elements; mark more of "
            "the photograph, or lower neighbourhoods"
        )
    light = np.stack(colors)
    lab = np.stack([lab_from_linear(one) for one in light])
    return GaussianStack(lab, light, np.stack(valid), Image(light[0], ("R", "G", "B")))
