"""Signed distance to features of a distorted texture."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float32, Int64
from pydantic import Field

from texloom.stages.common.geometry.jacobians import inverted
from texloom.stages.common.grids.size_checks import same_size
from texloom.stages.vocabulary.arrays import Image, Jacobian, Mask
from texloom.stages.vocabulary.declare import InputError, Params, stage

_PIECES = 16


class FeatureDistanceParams(Params):
    """Kind, range and weight of the distances."""

    directional: bool = False
    """distances along both directions of the texture, two planes a class, instead of Euclidean ones"""
    max_distance: float = Field(0.2, gt=0, le=1)
    """distances are clipped to this, as a share of the side of a square with the area of the region's texture"""
    guidance: float = Field(1.0, gt=0, le=10)
    """factor on the planes that are appended to the stack"""


@dataclasses.dataclass(frozen=True)
class FeatureDistance:
    """Distances to features in the flat texture."""

    elements: Float32[np.ndarray, "h w planes"]
    """a plane for each class, or two, down and across: elements of texture, positive outside features, negative
    inside; all 0 for a class that covers all pixels or none"""
    planes: Float32[np.ndarray, "h w planes"]
    """the same scaled to 0..100, the range of L"""
    stack: Float32[np.ndarray, "levels p q c"]
    """the given levels with ``planes`` appended to their channels; without levels ``planes`` alone, as one level"""
    picture: Image
    """the first three of ``planes`` as red, green and blue"""


@stage(version=1, check=same_size("features", "image", "photograph"))
def feature_distance(
    image: Image,
    jacobian: Jacobian,
    region: Mask,
    params: FeatureDistanceParams,
    structure: Mask | None = None,
    features: Image | None = None,
    classes: Bool[np.ndarray, "classes h w"] | None = None,
    stack: Float32[np.ndarray, "levels p q c"] | None = None,
    corner: Int64[np.ndarray, "2"] | None = None,
) -> FeatureDistance:
    """Measure distances to features in the distorted texture of a photograph, as guidance for synthesis.

    Features outside the region count too, since distances near its border would otherwise be too large.

    Parameters
    ----------
    image : the photograph; only its size matters.
    jacobian, region : see `jacobian_field`.
    structure : true on features; exactly one of ``structure``, ``features`` and ``classes`` is given.
    features : an image, bright on features, one class a channel.
    classes : the features of each class, see `jacobian_field`.
    stack : the levels to which the distances are appended, see `gaussian_stack`.
    corner : row and column of the levels' first pixel in the photograph; default [0, 0].

    Raises
    ------
    InputError
        not exactly one of structure, features and classes is given; or features have another size or values that
        are not finite.
    ValueError
        the shapes of the inputs do not match.

    References
    ----------
    [Eisenacher2008]_ section 3.1, distances through the Jacobians, in several classes and along directions;
    [Danielsson1980]_ the sweeps; [LefebvreHoppe2006]_ section 4, features as channels. Unlike there, the nearest
    feature is propagated and the straight line to it is measured, since accumulated vectors become too short where
    Jacobians are extrapolated beyond patches.
    """
    shape = (image.height, image.width)
    by_class = _features_by_class(structure, features, classes)
    for name, field in (
        ("jacobian", jacobian),
        ("region", region),
        ("structure", structure),
        ("classes", by_class[0]),
    ):
        if field is not None and field.shape[:2] != shape:
            raise ValueError(f"{name} of shape {field.shape} for a photograph of {shape}")
    row, column = (0, 0) if corner is None else (int(part) for part in corner)
    if stack is not None and (row + stack.shape[1] > shape[0] or column + stack.shape[2] > shape[1]):
        raise ValueError(f"stack of shape {stack.shape} at {row}, {column} for a photograph of {shape}")
    area = jacobian[..., 0].astype(np.float64) * jacobian[..., 3] - jacobian[..., 1] * jacobian[..., 2]
    limit = params.max_distance * float(np.sqrt((1 / np.abs(area[region])).sum()))
    measure = _directional if params.directional else _euclidean
    elements = np.concatenate([measure(features, jacobian, limit) for features in by_class], axis=2)
    planes = _scaled(elements)
    guidance = planes[None] * np.float32(params.guidance)
    if stack is not None:
        guidance = guidance[:, row : row + stack.shape[1], column : column + stack.shape[2]]
        guidance = np.concatenate([stack, np.broadcast_to(guidance, (*stack.shape[:3], planes.shape[2]))], axis=3)
    light = np.zeros((*shape, 3), np.float32)
    light[..., : planes.shape[2]] = planes[..., :3] / 100
    return FeatureDistance(elements, planes, guidance, Image(light, ("R", "G", "B")))


def _features_by_class(
    structure: Mask | None, features: Image | None, classes: Bool[np.ndarray, "classes h w"] | None
) -> Bool[np.ndarray, "classes h w"]:
    if sum(source is not None for source in (structure, features, classes)) != 1:
        raise InputError("structure, features and classes: give exactly one of them")
    if classes is not None:
        return classes
    if features is None:
        return np.asarray(structure)[None]
    if not np.isfinite(features.pixels).all():
        raise InputError("features: a value is not finite")
    return np.moveaxis(features.pixels, 2, 0) >= 0.5


def _euclidean(structure: Mask, jacobian: Jacobian, limit: float) -> Float32[np.ndarray, "h w 1"]:
    """Distance to the nearest feature pixel outside, minus the distance to the nearest other pixel inside."""
    from texloom.stages.kernels.core.threads import run_all
    from texloom.stages.kernels.distortion.nearest_feature import spread

    if structure.all() or not structure.any():
        return np.zeros((*structure.shape, 1), np.float32)
    inverse = inverted(jacobian.astype(np.float64))
    own = np.arange(structure.size).reshape(structure.shape)
    work = [
        (np.where(features, own, -1), np.where(features, 0.0, np.inf), inverse)
        for features in (structure, ~structure)
    ]
    run_all(spread, work)
    outside, inside = (np.minimum(np.sqrt(square), limit) for _, square, _ in work)
    return (outside - inside)[..., None].astype(np.float32)


def _directional(structure: Mask, jacobian: Jacobian, limit: float) -> Float32[np.ndarray, "h w 2"]:
    """Distances to the features' border down and across, the smaller of both senses."""
    from texloom.stages.kernels.core.threads import run_all, spans
    from texloom.stages.kernels.distortion.nearest_feature import walk

    out = np.zeros((2, *structure.shape), np.float32)
    if structure.any() and not structure.all():
        shared = np.ascontiguousarray(structure), np.ascontiguousarray(jacobian)
        rows = spans(structure.shape[0], _PIECES)
        run_all(walk, [(*shared, axis, limit, out[axis], *span) for axis in (0, 1) for span in rows])
    return np.moveaxis(out, 0, 2)


def _scaled(elements: Float32[np.ndarray, "h w planes"]) -> Float32[np.ndarray, "h w planes"]:
    """Each plane scaled to 0..100; 0 where it is constant."""
    low, span = elements.min(axis=(0, 1)), np.ptp(elements, axis=(0, 1))
    return np.clip((elements - low) * (100 / np.where(span > 0, span, 1)), 0, 100).astype(np.float32)
