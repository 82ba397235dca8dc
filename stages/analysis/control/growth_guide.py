"""Growth of a non-stationary texture: its trend over a result of another size, as a guide."""

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
import pydantic
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.analysis.control.guide import VALUE_STRENGTH, contrast
from texloom.stages.common.features.control import painted_mean
from texloom.stages.common.features.slow_features import pictured
from texloom.stages.common.geometry.orientation import doubled
from texloom.stages.common.grids.gradient import linear_gradient
from texloom.stages.common.grids.path_trend import path_trend
from texloom.stages.common.grids.pyramid import resize, resized_mask
from texloom.stages.numerics.filters import gaussian_blur, interpolated
from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.declare import InputError, Outline, Params, stage
from texloom.stages.vocabulary.facts import NOWHERE, Wraps
from texloom.stages.vocabulary.masks import valid_pixels
from texloom.stages.vocabulary.sizes import Size
from texloom.stages.vocabulary.tileable import Tileable

_STRENGTH = 0.3  # of that of values, which would repeat the few parts that fit exactly
_GROWTH = 2  # times the exemplar's sides, where no size is given
_WINDOW = 1 / 24  # of the exemplar's shorter side, deviation within which orientations are smoothed

_Place = Annotated[float, Field(ge=-1, le=2)]
_Share = Annotated[float, Field(ge=0, le=1)]


class GrowthGuideParams(Params):
    """How the trend lies over the result."""

    size: Size | None = None
    """size of the result, px; null: that of the target, or without one twice the exemplar's"""
    angle: float | None = Field(None, ge=-360, le=360)
    """without a target: direction of a straight trend from 0 to 1, degrees from along a row towards growing rows;
    null: the exemplar's own, stretched over the result"""
    path: list[tuple[_Place, _Place]] | None = Field(None, min_length=2, max_length=1024)
    """without a target: corners of a path, [row, column] as shares of the result's sides, along which the trend
    runs from 0 to 1: `[[0.9, 0.1], [0.2, 0.5], [0.8, 0.9]]` rises and falls; each place is as far as the path's
    nearest point"""
    curve: list[_Share] = Field([0.0, 1.0], min_length=2, max_length=64)
    """what the progression becomes, 0..1, at equal steps of it from 0 to 1: `[1, 0]` reverses the trend, `[0.5, 1]`
    begins with what is half way, `[0, 1, 1]` ends it half way, `[0, 1, 0]` goes there and back"""
    tileable: Tileable | None = None
    """axes along which the trend goes there and back, so that it tiles; a target has to tile by itself"""
    weight: float = Field(1.0, gt=0, le=10)
    """factor on the strength that is chosen by the exemplar's contrast: 0.3 guides weakly, 3 enforces"""
    direction: float = Field(1.0, ge=0, le=10)
    """weight of the direction of the texture, of that of its progression; 0 leaves directions free. Directions are
    those of the exemplar, stretched, or those of strokes; a target, ``angle`` or ``path`` without strokes leaves
    them free"""

    @pydantic.model_validator(mode="after")
    def _is_one_trend(self) -> "GrowthGuideParams":
        if self.path is not None and self.angle is not None:
            raise ValueError("path and angle both say where the trend runs; give one of them")
        if self.path is not None and len(set(self.path)) < 2:
            raise ValueError("path: all its corners are the same place")
        return self


@dataclasses.dataclass(frozen=True)
class GrowthGuide:
    """The trend as planes in which patches are compared, and as pictures."""

    exemplar: Float32[np.ndarray, "h w k"]
    """CIELAB units; of the exemplar's size"""
    target: Float32[np.ndarray, "H W k"]
    """the same of the result; NaN where a target is transparent"""
    wanted: Float32[np.ndarray, "H W"]
    """progression of the result, 0..1"""
    picture: Image
    """``wanted`` in the hues of `progression`"""


def outlines(params: GrowthGuideParams, known: Mapping[str, Any]) -> dict[str, Outline]:
    """The target has the size of the result."""
    image, target = known.get("image"), known.get("target")
    if image is None and target is None and params.size is None:
        return {}
    return {"target": Outline(*_size(params, image, target))}


@stage(version=1, outlines=outlines)
def growth_guide(
    image: Image,
    progression: ScalarMap,
    slow: ScalarMap,
    params: GrowthGuideParams,
    orientation: ScalarMap | None = None,
    confidence: ScalarMap | None = None,
    target: Image | None = None,
    target_angle: Float32[np.ndarray, "m n"] | None = None,
) -> GrowthGuide:
    """Lay the trend of an exemplar over a result, as a guide for the patches of every place.

    Parameters
    ----------
    image : the exemplar; masked pixels do not count.
    progression, slow : how far each of its places is, see `progression`; the slow part is what the result repeats.
    orientation, confidence : orientation of the exemplar, see `orientation_field`; none leaves directions free.
    target : progression of the result, painted: black where it is least; of any size. Where it is transparent
        anything may lie. None stretches that of the exemplar.
    target_angle : orientation of the result, radians, of any size.

    Raises
    ------
    InputError
        there are a target and a path.

    References
    ----------
    [Zhou2023]_: maps of progression and orientation of exemplar and result guide the correspondence; they are made
    here where they are given there. Stretching the slow part, paths, and the strengths are ours.
    """
    size = _size(params, image, target)
    if target is not None and params.path is not None:
        raise InputError("path: a painted target says where the trend runs; leave one of them out")
    stretched = target is None and params.angle is None and params.path is None
    wraps = (params.tileable or NOWHERE) if target is None else NOWHERE
    if target is not None:
        wanted = _painted(target, size)
    elif params.path is not None:
        wanted = path_trend(size, params.path, wraps)
    elif params.angle is not None:
        wanted = linear_gradient(size, params.angle, wraps)
    else:
        wanted = _stretched(slow, size, wraps)
    wanted = np.interp(wanted, np.linspace(0, 1, len(params.curve)), params.curve).astype(np.float32)
    own, asked = progression[..., None], wanted[..., None]
    if orientation is not None and params.direction and (stretched or target_angle is not None):
        sure = np.ones_like(orientation) if confidence is None else confidence
        window = max(1.0, _WINDOW * min(orientation.shape))
        vectors = gaussian_blur(doubled(orientation, sure), window) * np.float32(params.direction)
        if target_angle is None:
            along = _stretched(vectors, size, wraps)
            along[..., 1] *= _mirrored(size, wraps)
        else:
            strong = np.float32(params.direction * float(sure.mean(dtype=np.float64)))
            along = resize(doubled(target_angle, np.ones_like(target_angle)) * strong, *size, bilinear=True)
        own, asked = np.concatenate([own, vectors / 2], axis=2), np.concatenate([asked, along / 2], axis=2)
    strength = np.float32(params.weight * _STRENGTH * VALUE_STRENGTH * contrast(image))
    goal = asked * strength
    goal[np.isnan(wanted)] = np.nan
    return GrowthGuide(own * strength, goal, wanted, pictured(wanted))


def _size(params: GrowthGuideParams, image: Any, target: Any) -> tuple[int, int]:
    """Height and width of the result."""
    if params.size is not None:
        return params.size
    return (_GROWTH * image.height, _GROWTH * image.width) if target is None else (target.height, target.width)


def _painted(target: Image, size: tuple[int, int]) -> ScalarMap:
    """The mean of a map's colours as they were painted, 0..1; NaN where it is transparent."""
    values = np.clip(resize(painted_mean(target)[..., None], *size, bilinear=True)[..., 0], 0, 1)
    asked = valid_pixels(target)
    return values if asked is None else np.where(resized_mask(asked, *size), values, np.float32(np.nan))


def _stretched(planes: np.ndarray, size: tuple[int, int], wraps: Wraps) -> np.ndarray:
    """Planes of the exemplar over the whole result; along axes that wrap there and back."""
    places = []
    for side, length, back in zip(size, planes.shape[:2], wraps, strict=True):
        share = (np.arange(side) + 0.5) / side
        share = 1 - np.abs(2 * share - 1) if back else share
        places.append((share * length - 0.5).astype(np.float32))
    rows, columns = np.meshgrid(*places, indexing="ij")
    return interpolated(planes, rows, columns)


def _mirrored(size: tuple[int, int], wraps: Wraps) -> ScalarMap:
    """-1 where the exemplar is mirrored along one axis, which reverses the sense of angles, else 1."""
    down, across = (
        np.where(back & (np.arange(side) >= side / 2), -1, 1) for side, back in zip(size, wraps, strict=True)
    )
    return (down[:, None] * across).astype(np.float32)
