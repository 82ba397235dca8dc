"""Features in which neighbourhoods are compared: colour, further maps, control and detail, in one unit."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.features.control import (
    CONTROL_WEIGHT,
    check_pair,
    fit_scale,
    resize_control,
)
from texloom.stages.common.features.principal_planes import COLOR_PLANES, CONTROL_PLANES
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.synthesis.control_maps.coarse_level import Guide
from texloom.stages.synthesis.control_maps.correlation import correlation
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Outline, Params, stage
from texloom.stages.vocabulary.frame_stacks import frame_count

_DETAIL = 1.5, 2.0  # px, standard deviations of the blur that defines detail, and of the window of its strength
_CONTRAST = 4.0, 4.0


class ControlFeaturesParams(Params):
    """Weights of control and of detail."""

    control_weight: float = Field(CONTROL_WEIGHT, gt=0, le=100)
    """variance of control, all channels together, relative to that of the texture: 1 weighs both alike, 0.25
    favours colour, 4 favours control; the same scale as in `reconstruct`"""
    detail: float = Field(2.0, ge=0, le=10)
    """weight of the strength of fine detail relative to colour; 0 omits it. Means of neighbourhoods are blurred, so
    that without this plane smooth neighbourhoods would always be nearest to them"""
    contrast: float = Field(0.0, ge=0, le=10)
    """weight of the strength of detail a few pixels large: 3 preserves blotches and shading, at the cost of one
    more plane; 0 omits it"""
    coarse: float = Field(0.75, ge=0, le=10)
    """weight of the colours of a coarse level relative to colour; so a compaction has what it asks for"""


@dataclasses.dataclass(frozen=True)
class ControlFeatures:
    """The feature planes."""

    planes: Float32[np.ndarray, "h w c"]
    """CIELAB, the texture's further maps, control at the texture's size, the strengths of fine and of coarse
    detail, and the guide, in CIELAB units; of a frame stack the principal planes of all frames"""
    explained: float
    """share of the texture's variance that control explains beyond chance, 0..1; 0 without control"""
    control: Image | None
    """the control map at the texture's size, from which a texture of that size can be made again"""


def outlines(params: ControlFeaturesParams, known: Mapping[str, Any]) -> dict[str, Outline]:
    """Control, and the planes, if no channel of texture or control is constant; of frame stacks at most these."""
    texture, control = known.get("texture"), known.get("control")
    if texture is None:
        return {}
    names = [*"Lab", *texture.channels[1 if texture.channels[0] == "Y" else 3 :]]
    if frame_count(texture.channels) > 1:
        names = [f"principal.{number}" for number in range(min(COLOR_PLANES, 3 * frame_count(texture.channels)))]
    controls = () if control is None else control.channels
    names += [
        f"control.{name}" for name in controls[: CONTROL_PLANES if frame_count(controls or "Y") > 1 else None]
    ]
    names += [name for name in ("detail", "contrast") if getattr(params, name)]
    names += [f"coarse.{name}" for name in "Lab"] if known.get("guide") is not None and params.coarse else []
    found = {"planes": Outline(texture.height, texture.width, tuple(names))}
    if control is not None:
        found["control"] = Outline(texture.height, texture.width, control.channels)
    return found


@stage(version=3, check=check_pair, outlines=outlines)
def control_features(
    texture: Image, params: ControlFeaturesParams, control: Image | None = None, guide: Guide | None = None
) -> ControlFeatures:
    """Combine texture and control in planes of one size and one unit.

    Parameters
    ----------
    texture : any number of channels: colour, and maps after it; or a frame stack, whose frames count alike.
    control : any number of channels, or a frame stack; coarser or finer than the texture, of the same aspect
        ratio. None for a stationary texture.
    guide : colours of a coarse level at the texture's size; see `coarse_level`.

    Raises
    ------
    InputError
        control of another aspect ratio; values that are not finite; a texture or a control map that is constant.

    References
    ----------
    [Wei2008]_ section 3: a pixel is a vector of colour, control and further properties. Detail is ours.
    """
    scale = fit_scale(texture, control, params.control_weight)
    colors = scale.of_texture(texture)
    planes, explained, resized = [colors], 0.0, None
    if control is not None:
        resized = resize_control(control, texture.height, texture.width)
        planes.append(scale.of_control(control, texture.height, texture.width))
        explained = correlation(colors, planes[1])
    for weight, (blur, window) in ((params.detail, _DETAIL), (params.contrast, _CONTRAST)):
        if weight:
            planes.append(weight * _strength(colors, blur, window))
    if guide is not None and params.coarse:
        planes.append(np.float32(params.coarse) * guide)
    return ControlFeatures(np.ascontiguousarray(np.concatenate(planes, axis=2), np.float32), explained, resized)


def _strength(colors: Float32[np.ndarray, "h w c"], blur: float, window: float) -> Float32[np.ndarray, "h w 1"]:
    """Root mean square, in a window, of the difference from a blur; both by their standard deviation, px."""

    detail = colors - gaussian_blur(colors, blur)
    energy = gaussian_blur(np.square(detail).sum(axis=2), window)
    strength: np.ndarray = np.sqrt(energy)[..., None]
    return strength
