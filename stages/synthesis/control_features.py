"""What neighbourhoods of a texture under control are compared by: colour, further maps and control, in one unit."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.arrays import Image
from texloom.stages.common.control import CONTROL_WEIGHT, check_aspect, check_control, check_finite, fit_scale
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.synthesis._kcoherence.correlation import correlation

_DETAIL = 1.5, 2.0  # px, standard deviations of a blur, and of the window in which what it takes away is measured
_CONTRAST = 4.0, 4.0


class ControlFeaturesParams(Params):
    """How much control counts."""

    control_weight: float = Field(CONTROL_WEIGHT, gt=0, le=100)
    """how much control counts: its variance, all channels together, by that of the texture. 1 lets both count
    alike, 0.25 favours colour, 4 favours control; the same scale as in `reconstruct`"""
    detail: float = Field(2.0, ge=0, le=10)
    """how much the strength of fine detail counts, relative to its colour. Means of neighbourhoods are blurred, and
    smooth ones would always be nearest to them; means of their strengths are not. 0 leaves it out"""
    contrast: float = Field(0.0, ge=0, le=10)
    """how much the strength of what is some pixels large counts, likewise: with 3 blotches and shades stay, at the
    price of one more plane to compare; 0 leaves it out"""


@dataclasses.dataclass(frozen=True)
class ControlFeatures:
    """Planes to compare by."""

    planes: Float32[np.ndarray, "h w c"]
    """CIELAB, the texture's further maps, control at the texture's size, and the strengths of fine and of coarser
    detail; all in CIELAB units"""
    explained: float
    """share of the texture's variance that control explains beyond chance, 0..1; 0 without control"""


def check_pair(params: Any, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """The control map must have the texture's aspect ratio."""
    texture, control = known.get("texture"), known.get("control")
    if texture is not None and control is not None:
        check_aspect(control, "control", (texture.height, texture.width), "texture")


@stage(version=3, check=check_pair)
def control_features(
    texture: Image, params: ControlFeaturesParams, control: Image | None = None
) -> ControlFeatures:
    """Bring texture and control to one size and one unit.

    Parameters
    ----------
    texture : any number of channels: colour, and frames or maps after it.
    control : any number of channels; coarser or finer than the texture, of the same aspect ratio. None for a
        texture that is the same all over.

    Raises
    ------
    InputError
        control of another aspect ratio; values that are not finite; a texture or a control map that is constant.

    References
    ----------
    [Wei2008]_ section 3: a pixel is a vector of colour, control and whatever else there is. Detail is ours.
    """
    check_finite(texture, "texture")
    if (np.ptp(texture.pixels, axis=(0, 1)) == 0).all():
        raise InputError("texture: every channel is constant, so that there is nothing to summarise")
    if control is not None:
        check_control(control, "control")
        check_pair(params, {"texture": texture, "control": control})
    scale = fit_scale(texture, control, params.control_weight)
    colors = scale.of_texture(texture)
    planes, explained = [colors], 0.0
    if control is not None:
        explained = correlation(texture, control, scale)
        planes.append(scale.of_control(control, texture.height, texture.width))
    for weight, (blur, window) in ((params.detail, _DETAIL), (params.contrast, _CONTRAST)):
        if weight:
            planes.append(weight * _strength(colors, blur, window))
    return ControlFeatures(np.ascontiguousarray(np.concatenate(planes, axis=2), np.float32), explained)


def _strength(colors: Float32[np.ndarray, "h w c"], blur: float, window: float) -> Float32[np.ndarray, "h w 1"]:
    """Root mean square, in a window, of what a blur takes away; both by their standard deviation, px."""
    import cv2

    taken = colors - cv2.GaussianBlur(colors, (0, 0), blur).reshape(colors.shape)
    energy = cv2.GaussianBlur(np.square(taken).sum(axis=2), (0, 0), window)
    strength: np.ndarray = np.sqrt(energy)[..., None]
    return strength
