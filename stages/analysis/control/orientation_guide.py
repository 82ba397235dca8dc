"""Orientation as a guide: the directions of an exemplar, and those that a result is to have."""

import dataclasses

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.analysis.control.guide import VALUE_STRENGTH, contrast
from texloom.stages.common.geometry.orientation import doubled
from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.declare import Params, stage


class OrientationGuideParams(Params):
    """Weight of orientation."""

    weight: float = Field(1.0, gt=0, le=10)
    """factor on the strength that is chosen by the exemplar's contrast: 0.3 guides weakly, 3 enforces"""


@dataclasses.dataclass(frozen=True)
class OrientationGuide:
    """Orientations as planes in which patches are compared."""

    exemplar: Float32[np.ndarray, "h w k"]
    """points on a circle, CIELAB units; those of perpendicular orientations are opposite"""
    target: Float32[np.ndarray, "H W k"]
    """the same of the result"""
    strength: float
    """distance of perpendicular orientations, CIELAB units"""


@stage(version=1)
def orientation_guide(
    image: Image,
    angle: ScalarMap,
    target_angle: Float32[np.ndarray, "H W"],
    params: OrientationGuideParams,
) -> OrientationGuide:
    """Make a guide of the orientations of an exemplar and of those that its result is to have.

    Parameters
    ----------
    image : the exemplar.
    angle : its orientation, radians; see `orientation_field`.
    target_angle : that of the result.

    References
    ----------
    [Zhou2023]_ for orientation fields that direct textures; [Hertzmann2001]_ for guides. Doubled angles make
    opposite directions equal.
    """
    strength = params.weight * VALUE_STRENGTH * contrast(image)
    own, target = (
        doubled(field, np.ones_like(field)) * np.float32(strength / 2) for field in (angle, target_angle)
    )
    return OrientationGuide(own, target, strength)
