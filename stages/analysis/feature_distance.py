"""Distance to features of a texture that is distorted in its picture."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int64
from pydantic import Field

from texloom.stages.arrays import Image, Jacobian, Mask
from texloom.stages.common.jacobians import inverted
from texloom.stages.declare import InputError, Params, stage

_PIECES = 16


class FeatureDistanceParams(Params):
    """What is measured, and how much it counts."""

    directional: bool = False
    """distances along both directions of the texture, two planes a class, instead of the shortest ones"""
    farthest: float = Field(0.2, gt=0, le=1)
    """where distances end, as a share of the side of a square that is as large as the texture in the region"""
    guidance: float = Field(1.0, gt=0, le=10)
    """factor on the planes that are put into the stack"""


@dataclasses.dataclass(frozen=True)
class FeatureDistance:
    """How far every pixel is from features, as if the texture were flat."""

    elements: Float32[np.ndarray, "h w planes"]
    """a plane for each class, or down and across for each: elements of texture, positive outside features and
    negative inside; 0 everywhere where a class has no features or nothing else"""
    planes: Float32[np.ndarray, "h w planes"]
    """the same from 0, deep inside, to 100, the range of L"""
    stack: Float32[np.ndarray, "levels p q c"]
    """the given levels with ``planes`` behind their channels; without levels ``planes`` alone, as one level"""
    picture: Image
    """the first three of ``planes`` as red, green and blue"""


def check_features(params: FeatureDistanceParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """A picture of features is as large as the photograph."""
    features, image = known.get("features"), known.get("image")
    if features is not None and image is not None:
        sizes = (features.height, features.width), (image.height, image.width)
        if sizes[0] != sizes[1]:
            got, want = (f"{height}x{width} px" for height, width in sizes)
            raise InputError(f"features: {got}; must be as large as the photograph, {want}")


@stage(version=1, check=check_features)
def feature_distance(
    image: Image,
    jacobian: Jacobian,
    region: Mask,
    params: FeatureDistanceParams,
    mask: Mask | None = None,
    features: Image | None = None,
    classes: Bool[np.ndarray, "classes h w"] | None = None,
    stack: Float32[np.ndarray, "levels p q c"] | None = None,
    corner: Int64[np.ndarray, "2"] | None = None,
) -> FeatureDistance:
    """Measure distances to features through the distortion of a photograph, to guide synthesis by them.

    Features beyond the region count too, since what is near its border would else be far from everything.

    Parameters
    ----------
    image : the photograph; only its size matters.
    jacobian, region : see `jacobian_field`.
    mask : where features are; or instead
    features : a picture, bright at features: a class for every channel, one where it is grey; or
    classes : where features of each class are, see `jacobian_field`.
    stack : the levels that the distances are compared together with, see `gaussian_stack`.
    corner : row and column of the levels' first pixel in the photograph; [0, 0] if not given.

    Raises
    ------
    InputError
        there is neither a mask nor a picture of features, or both; or the picture is of another size or not finite.
    ValueError
        inputs that do not belong together.

    References
    ----------
    [Eisenacher2008]_ section 3.1, distances through the Jacobians, in several classes and along directions;
    [Danielsson1980]_ the sweeps; [LefebvreHoppe2006]_ section 4, features as channels. Unlike there, the nearest
    feature is passed on and the straight line to it is measured, since vectors that add up on the way become too
    short where Jacobians are continued beyond patches.
    """
    check_features(params, {"image": image, "features": features})
    shape = (image.height, image.width)
    known = _classes(mask, features, classes)
    for name, field in (("jacobian", jacobian), ("region", region), ("mask", mask), ("classes", known[0])):
        if field is not None and field.shape[:2] != shape:
            raise ValueError(f"{name} of shape {field.shape} for a photograph of {shape}")
    row, column = (0, 0) if corner is None else (int(part) for part in corner)
    if stack is not None and (row + stack.shape[1] > shape[0] or column + stack.shape[2] > shape[1]):
        raise ValueError(f"stack of shape {stack.shape} at {row}, {column} for a photograph of {shape}")
    area = jacobian[..., 0].astype(np.float64) * jacobian[..., 3] - jacobian[..., 1] * jacobian[..., 2]
    farthest = params.farthest * float(np.sqrt((1 / np.abs(area[region])).sum()))
    measured = _along if params.directional else _shortest
    elements = np.concatenate([measured(one, jacobian, farthest) for one in known], axis=2)
    planes = _scaled(elements)
    guiding = planes[None] * np.float32(params.guidance)
    if stack is not None:
        guiding = guiding[:, row : row + stack.shape[1], column : column + stack.shape[2]]
        guiding = np.concatenate([stack, np.broadcast_to(guiding, (*stack.shape[:3], planes.shape[2]))], axis=3)
    light = np.zeros((*shape, 3), np.float32)
    light[..., : planes.shape[2]] = planes[..., :3] / 100
    return FeatureDistance(elements, planes, guiding, Image(light, ("R", "G", "B")))


def _classes(
    mask: Mask | None, features: Image | None, classes: Bool[np.ndarray, "classes h w"] | None
) -> Bool[np.ndarray, "classes h w"]:
    if sum(given is not None for given in (mask, features, classes)) != 1:
        raise InputError("mask, features and classes: exactly one of them says where features are")
    if classes is not None:
        return classes
    if features is None:
        return np.asarray(mask)[None]
    if not np.isfinite(features.pixels).all():
        raise InputError("features: a value is not finite")
    return np.moveaxis(features.pixels, 2, 0) >= 0.5


def _shortest(mask: Mask, jacobian: Jacobian, farthest: float) -> Float32[np.ndarray, "h w 1"]:
    """To the nearest feature pixel outside, minus to the nearest other pixel inside."""
    from texloom.stages.kernels.core.threads import run_all
    from texloom.stages.kernels.distortion.nearest_feature import spread

    if mask.all() or not mask.any():
        return np.zeros((*mask.shape, 1), np.float32)
    inverse = inverted(jacobian.astype(np.float64))
    own = np.arange(mask.size).reshape(mask.shape)
    both = []
    for features in (mask, ~mask):
        both.append((np.where(features, own, -1), np.where(features, 0.0, np.inf), inverse))
    run_all(spread, both)
    outside, inside = (np.minimum(np.sqrt(square), farthest) for _, square, _ in both)
    return (outside - inside)[..., None].astype(np.float32)


def _along(mask: Mask, jacobian: Jacobian, farthest: float) -> Float32[np.ndarray, "h w 2"]:
    """To the features' border down and across, the nearer of both ways."""
    from texloom.stages.kernels.core.threads import run_all, spans
    from texloom.stages.kernels.distortion.nearest_feature import walk

    out = np.zeros((2, *mask.shape), np.float32)
    if mask.any() and not mask.all():
        shared = np.ascontiguousarray(mask), np.ascontiguousarray(jacobian)
        rows = spans(mask.shape[0], _PIECES)
        run_all(walk, [(*shared, axis, farthest, out[axis], *span) for axis in (0, 1) for span in rows])
    return np.moveaxis(out, 0, 2)


def _scaled(elements: Float32[np.ndarray, "h w planes"]) -> Float32[np.ndarray, "h w planes"]:
    """Each plane from 0 to 100; 0 where it is constant."""
    low, span = elements.min(axis=(0, 1)), np.ptp(elements, axis=(0, 1))
    return np.clip((elements - low) * (100 / np.where(span > 0, span, 1)), 0, 100).astype(np.float32)
