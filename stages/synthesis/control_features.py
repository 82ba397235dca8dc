"""What neighbourhoods of a texture under control are compared by: colour, further maps and control, in one unit."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field as Knob

from stages.arrays import Image
from stages.declare import InputError, Params, stage
from stages.synthesis._control import CONTROL_WEIGHT, check_aspect, check_control, check_finite, fit_scale


class ControlFeaturesParams(Params):
    """How much control counts."""

    control_weight: float = Knob(CONTROL_WEIGHT, gt=0, le=100)
    """how much control counts: its variance, all channels together, by that of the texture. 1 lets both count
    alike, 0.25 favours colour, 4 favours control; the same scale as in `reconstruct`"""


@dataclasses.dataclass(frozen=True)
class ControlFeatures:
    """Planes to compare by."""

    planes: Float32[np.ndarray, "h w c"]
    """CIELAB, the texture's further maps, and control at the texture's size; all in CIELAB units"""


def check_pair(params: Any, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """The control map must have the texture's aspect ratio."""
    texture, control = known.get("texture"), known.get("control")
    if texture is not None and control is not None:
        check_aspect(control, "control", (texture.height, texture.width), "texture")


@stage(version=1, check=check_pair)
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
    [Wei2008]_ section 3: a pixel is a vector of colour, control and whatever else there is.
    """
    check_finite(texture, "texture")
    if (np.ptp(texture.pixels, axis=(0, 1)) == 0).all():
        raise InputError("texture: every channel is constant, so that there is nothing to summarise")
    if control is not None:
        check_control(control, "control")
        check_pair(params, {"texture": texture, "control": control})
    scale = fit_scale(texture, control, params.control_weight)
    planes = scale.of_texture(texture)
    if control is not None:
        planes = np.concatenate([planes, scale.of_control(control, texture.height, texture.width)], axis=2)
    return ControlFeatures(np.ascontiguousarray(planes, np.float32))
