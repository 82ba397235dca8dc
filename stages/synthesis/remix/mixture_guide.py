"""A map of where a texture shows which of several exemplars, as a guide."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.analysis.control.guide import LABEL_STRENGTH, contrast
from texloom.stages.common.features.control import painted_mean
from texloom.stages.common.grids.gradient import linear_gradient
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.common.similarity.neighbourhoods import Rectangles, numbers_in
from texloom.stages.numerics.filters import gaussian_blur, padded
from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.declare import InputError, Outline, Params, stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.sizes import Size
from texloom.stages.vocabulary.tileable import Tileable

_PURE = 0.15  # of a gradient's length at either end, where it stays at the first and at the last exemplar
_STRENGTH = 0.3  # of that of labels, which would cut elements in two
_PATCH_SHARE = 4  # of an exemplar's shorter side, patches of a transition
_MIN_PATCHES = 4  # of a transition along the shorter side of the result
_CELLS = 4  # of the noise, a patch
_SOFT = 0.3  # of the way between two exemplars, in which the texture decides


class MixtureGuideParams(Params):
    """Where the texture shows which exemplar, and what lies between."""

    size: Size | None = (1024, 1024)
    """size of the result, px; null: that of the map, which it needs then"""
    angle: float = Field(0.0, ge=-360, le=360)
    """where there is no map: direction from the first exemplar to the last, degrees from along a row towards
    growing rows"""
    tileable: Tileable | None = None
    """where there is no map: axes along which the gradient goes there and back, so that it tiles"""
    patchiness: float = Field(0.6, ge=0, le=1)
    """how far patches of the one lie within the other, 0..1: 0 for one border where the map is halfway between two,
    1 for patches wherever the map is between them"""
    patch: int | None = Field(None, ge=4, le=4096)
    """diameter of these patches, px; null: a quarter of the smallest exemplar's shorter side, or of the
    result's"""
    weight: float = Field(1.0, gt=0, le=10)
    """factor on the strength that is chosen by the exemplars' contrast: 0.3 guides weakly, 3 enforces"""


@dataclasses.dataclass(frozen=True)
class MixtureGuide:
    """The map as a plane in which patches are compared."""

    exemplar: Float32[np.ndarray, "h w k"]
    """position of each pixel between the exemplars, CIELAB units"""
    target: Float32[np.ndarray, "H W k"]
    """the same of the result"""
    way: Float32[np.ndarray, "H W"]
    """place of each pixel of the result along the exemplars, without patches: 0 for the first, 1 for the next"""
    wanted: list[float]
    """how much of the texture is to come from each exemplar, 0..1, together 1"""


def outlines(params: MixtureGuideParams, known: Mapping[str, Any]) -> dict[str, Outline]:
    """The target has the size of the result."""
    given = known.get("map")
    size = params.size or (None if given is None else (given.height, given.width))
    return {} if size is None else {"target": Outline(*size), "way": Outline(*size)}


@stage(version=1, outlines=outlines)
def mixture_guide(
    image: Image,
    rectangles: Rectangles,
    names: list[str],
    params: MixtureGuideParams,
    rng: np.random.Generator,
    map: Image | None = None,
) -> MixtureGuide:
    """Make a guide of a map between several exemplars.

    Between two exemplars the result has patches of either, the more of one the nearer the map is to it: structures
    change from one kind to the other and none is half of each.

    Parameters
    ----------
    image : all exemplars in one picture.
    rectangles, names : of the exemplars in it; see `exemplar_sheet`.
    map : black for the first exemplar, white for the last, those between at equal steps; of any size. None for a
        gradient.

    Raises
    ------
    InputError
        there is one exemplar; neither ``size`` nor a map tells the result's size.

    References
    ----------
    [Zhou2023]_ for progression maps as guides; patches between are ours.
    """
    if len(names) < 2:
        raise InputError(f"exemplars: a mixture needs two or more, got {len(names)}")
    size = params.size or (None if map is None else (map.height, map.width))
    if size is None:
        raise InputError("size: give the size of the result, or a map that has it")
    strength = np.float32(params.weight * _STRENGTH * LABEL_STRENGTH * contrast(image))
    numbers = numbers_in(rectangles, image.height, image.width)
    own = np.maximum(numbers - 1, 0)[..., None].astype(np.float32) * strength
    if map is None:
        way = linear_gradient(size, params.angle, params.tileable or NOWHERE, _PURE)
    else:
        way = _levels(map, size)
    way = way * np.float32(len(names) - 1)
    before = np.minimum(np.floor(way), len(names) - 2)
    patch = params.patch or min(int(rectangles[:, 2:].min()) // _PATCH_SHARE, min(size) // _MIN_PATCHES)
    threshold = 0.5 + params.patchiness * (_noise(size, max(patch, _CELLS), rng) - 0.5)
    side = np.clip((way - before - threshold) / _SOFT + 0.5, 0, 1)  # 0 for the exemplar before, 1 for the next
    number = before + side
    wanted = np.bincount(np.rint(number).astype(int).ravel(), minlength=len(names)) / number.size
    target = (number * strength)[..., None].astype(np.float32)
    if map is None:  # a ramp that begins at once would show as a line
        part = way - before
        way = before + part * part * (3 - 2 * part)
    return MixtureGuide(own, target, way.astype(np.float32), wanted.tolist())


def _levels(given: Image, size: tuple[int, int]) -> ScalarMap:
    """The mean of a map's colours as they were painted, 0..1."""
    return np.clip(resize(painted_mean(given)[..., None], *size, bilinear=True)[..., 0], 0, 1)


def _noise(size: tuple[int, int], patch: int, rng: np.random.Generator) -> ScalarMap:
    """Smooth noise of patches of a diameter, uniform in 0..1; it tiles."""
    rows, columns = (max(2, round(side * _CELLS / patch)) for side in size)
    margin = 2 * _CELLS
    white = padded(rng.standard_normal((rows, columns)).astype(np.float32), margin, ["wrap", "wrap"])
    smooth = gaussian_blur(white, _CELLS / 4)[margin : margin + rows, margin : margin + columns]
    rank = np.empty(smooth.size, np.float32)
    rank[np.argsort(smooth.ravel(), kind="stable")] = (np.arange(smooth.size) + 0.5) / smooth.size
    return resize(rank.reshape(rows, columns, 1), *size, bilinear=True)[..., 0]
