"""Directions along a control map: those of its contours, as of a river that the map has the distance to."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.features.control import check_aspect, check_finite, painted_values
from texloom.stages.common.geometry.jacobians import rotations
from texloom.stages.common.geometry.orientation import (
    Doubled,
    completed,
    gradient_tensor,
    pictured,
    signed_angles,
)
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.kernels.core.elementary_functions import cos, sin
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Image, Jacobian, ScalarMap
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.sizes import Size, format_size
from texloom.stages.vocabulary.tileable import Tileable

_DETAIL = 3.0  # px; standard deviation of the blur before gradients are taken, wider than the steps of 8 bit
_NOISE = 0.05  # regularisation of the confidence, as a share of the mean squared gradient
_STIFFNESS = 4.0  # of the diffusion into pixels of low confidence
_MARGIN = 256  # px; of its other end that follow each border of a tileable map, at most
_ONE_SIDED = 0.1  # mean sine between directions and gradients from which directions have a rising side


class ControlDirectionParams(Params):
    """Size and smoothness of the field."""

    sigma: float = Field(8.0, gt=0, le=256)
    """standard deviation of the smoothing of directions, px; smaller follows tighter bends"""
    size: Size | None = None
    """size of the field, px; null: that of ``image``, or of the map"""
    tileable: Tileable = NOWHERE
    """the map continues across its borders"""


@dataclasses.dataclass(frozen=True)
class ControlDirection:
    """Directions along a control map."""

    angle: ScalarMap
    """direction of the contour at each pixel, with signs that agree between neighbours; radians, 0..2 pi, from
    along a row towards growing rows"""
    jacobian: Jacobian
    """the rotation of a texture whose rows run along the contours"""
    picture: Image
    """line integral convolution of the field over the map, fainter where directions come from the surroundings"""


def check_map(params: ControlDirectionParams, known: Mapping[str, Any]) -> None:
    """The map must be finite, have the aspect ratio of the field, and more than one row and column."""
    control, image = known.get("control"), known.get("image")
    if isinstance(control, Image):
        check_finite(control, "control")
    if control is None:
        return
    if params.size is not None:
        check_aspect(control, "control", params.size, "size")
    elif image is not None:
        check_aspect(control, "control", (image.height, image.width), "image")
    elif min(control.height, control.width) < 2:
        raise InputError(f"control: {format_size(control)} have no directions; the minimum is 2 x 2 px")


@stage(version=1, check=check_map)
def control_direction(
    control: Image, params: ControlDirectionParams, image: Image | None = None
) -> ControlDirection:
    """Find the directions in which a texture runs that runs along its control map.

    Where a river is drawn by the distance to it, its banks and strata run along the contours of that distance; so
    do cracks, veins, or the grain of wood around a knot. Such a texture must turn with its map, since an exemplar
    does not have pieces of every direction. `appearance_stack` and `per_pixel` turn it, given the Jacobians of the
    exemplar's map and of the target.

    Orientations are perpendicular to the gradients of all channels together, averaged as doubled angles, and
    diffused into even regions. Where the map rises to one side of them in the mean, directions have it on the same
    hand in every map; else they run down and to the right in the mean.

    Parameters
    ----------
    control : the map, of any number of channels, compared in the values that were painted.
    image : the texture that the map belongs to, for its size.

    Raises
    ------
    InputError
        a value is not finite; the map has another aspect ratio than the field, or a single row or column.

    Examples
    --------
    >>> import numpy as np, texloom
    >>> slope = np.tile(np.linspace(0, 1, 64, dtype=np.float32), (64, 1))  # rises to the right
    >>> angle = texloom.stages.control_direction(slope).angle  # along its columns
    >>> bool(np.allclose(angle % np.pi, np.pi / 2, atol=0.02))
    True

    References
    ----------
    [Wei2008]_ sections 4.2 and 5, orientation beside control; [LefebvreHoppe2006]_ section 3.3 for the Jacobians.
    That the directions are those of the control map is ours.
    """
    height, width = params.size or (
        (control.height, control.width) if image is None else (image.height, image.width)
    )
    planes = resize(painted_values(control), height, width, bilinear=True)
    margin = [
        min(_MARGIN, side // 2) if around else 0
        for side, around in zip((height, width), params.tileable, strict=True)
    ]
    padded = np.pad(planes, [(side, side) for side in (*margin, 0)], mode="wrap")
    vectors, down, across = _along_contours(padded, params.sigma)
    orientation, confidence = completed(vectors, _STIFFNESS)
    inside = tuple(slice(side, side + length) for side, length in zip(margin, (height, width), strict=True))
    confidence, orientation, down, across = (
        np.ascontiguousarray(part[inside]) for part in (confidence, orientation, down, across)
    )
    angle = _with_rising_side(signed_angles(orientation, params.tileable), down, across)
    light = np.repeat(_in_range(planes).mean(axis=2, keepdims=True, dtype=np.float32), 3, axis=2)
    return ControlDirection(angle, rotations(angle), pictured(light, angle, confidence))


def _along_contours(
    planes: Float32[np.ndarray, "h w k"], sigma: float
) -> tuple[Doubled, Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """Orientations along the contours, with their confidence, and the gradient of all channels together."""

    def smooth(planes: np.ndarray, deviation: float) -> np.ndarray:
        blurred = gaussian_blur(planes, deviation, "edge")
        return np.asarray(blurred).reshape(planes.shape)

    # Gradients, not the map, are smoothed: beyond its border the map is unknown, and flat it would turn them.
    down, across = (smooth(np.ascontiguousarray(part), _DETAIL) for part in np.gradient(planes, axis=(0, 1)))
    channels = zip(np.moveaxis(down, 2, 0), np.moveaxis(across, 2, 0), strict=True)
    tensor = smooth(np.sum([gradient_tensor(*gradient) for gradient in channels], axis=0), sigma)
    noise = _NOISE * float(tensor[..., 2].mean()) + 1e-12
    return tensor[..., :2] / (tensor[..., 2:] + np.float32(noise)), down.sum(axis=2), across.sum(axis=2)


def _with_rising_side(
    angle: ScalarMap, down: Float32[np.ndarray, "h w"], across: Float32[np.ndarray, "h w"]
) -> ScalarMap:
    """Directions, all reversed or none, so that those of an exemplar and of its target correspond."""
    sine, cosine = sin(angle), cos(angle)
    sides = (cosine * down - sine * across).astype(np.float64)
    rise = float(sides.sum()) / max(float(np.abs(sides).sum()), 1e-12)
    is_reversed = rise < 0 if abs(rise) > _ONE_SIDED else float((sine + cosine).sum(dtype=np.float64)) < 0
    return np.asarray((angle + np.pi * is_reversed) % (2 * np.pi), np.float32)


def _in_range(planes: Float32[np.ndarray, "h w k"]) -> Float32[np.ndarray, "h w k"]:
    """Each plane from 0 to 1."""
    low, high = planes.min(axis=(0, 1)), planes.max(axis=(0, 1))
    return np.asarray((planes - low) / np.maximum(high - low, np.float32(1e-12)))
