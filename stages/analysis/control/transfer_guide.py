"""A picture as a guide: which parts of an exemplar render which parts of it."""

import dataclasses
import logging
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.analysis.control.guide import VALUE_STRENGTH, contrast
from texloom.stages.common.features.slow_features import ranks
from texloom.stages.common.grids.pyramid import resize, resized_mask
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Outline, Params, stage
from texloom.stages.vocabulary.masks import fill_excluded, valid_pixels
from texloom.stages.vocabulary.sizes import Size

_STRENGTH = 0.9  # of that of values; with less, grounds of small elements show little of a picture
_EDGES = 0.5  # of a value's range, the strongest edge
_AREA = 0.02  # of the exemplar's shorter side, deviation of the blur that leaves areas, not elements
_CLEAR = 0.45  # deviation of these over that of all lightness, from which on they show a picture
_MOST = 2.5  # times less than that, for which the guide is made stronger
_VISIBLE = 2.0  # CIELAB units, deviation of areas with which a picture is hardly seen

_LOG = logging.getLogger(__name__)


class TransferGuideParams(Params):
    """How the picture is rendered."""

    size: Size | None = None
    """size of the result, px; null: that of the picture"""
    weight: float = Field(1.0, gt=0, le=10)
    """how closely the picture is followed: 0.3 shows more of the texture, 3 more of the picture"""
    detail: float = Field(2.0, ge=0, le=64)
    """deviation of the blur by which lightness is compared, px of result and exemplar: the larger, the coarser is
    the structure that is followed; 0 for none"""
    edges: float = Field(1.0, ge=0, le=10)
    """how much edges of the picture are rendered by contours of the exemplar; 0 for not at all"""


@dataclasses.dataclass(frozen=True)
class TransferGuide:
    """Lightness and edges as planes in which patches are compared."""

    exemplar: Float32[np.ndarray, "h w k"]
    """CIELAB units; of the exemplar's size"""
    target: Float32[np.ndarray, "H W k"]
    """the same of the result"""


def outlines(params: TransferGuideParams, known: Mapping[str, Any]) -> dict[str, Outline]:
    """The target has the size of the result."""
    given = known.get("picture")
    size = params.size or (None if given is None else (given.height, given.width))
    return {} if size is None else {"target": Outline(*size)}


@stage(version=2, outlines=outlines)
def transfer_guide(
    image: Image,
    picture: Image,
    params: TransferGuideParams,
    contours: ScalarMap | None = None,
    picture_contours: Float32[np.ndarray, "m n"] | None = None,
) -> TransferGuide:
    """Make a guide of a picture, so that an exemplar renders it: light parts by light ones, edges by contours.

    Lightness is compared by rank: the darkest part of the picture asks for the darkest part of the exemplar,
    however dark that is, and the whole exemplar is used. An exemplar whose light and dark are of the size of its
    elements, such as gravel, follows the guide up to four times as closely as one with light and dark areas; one
    that is as light everywhere is warned of.

    Parameters
    ----------
    image : the exemplar; what is excluded in it does not count.
    picture : what is rendered; where it is transparent, anything may lie.
    contours, picture_contours : strength of contours of both, 0..1, see `edges`; none without edges.

    References
    ----------
    [Efros2001]_ section 4, texture transfer, by correspondence maps of blurred luminance; [Hertzmann2001]_ section
    4.3. Ranks, edges and the strength by areas are ours.
    """
    size = params.size or (picture.height, picture.width)
    lightness = _lightness(image)
    shown = picture.elsewhere(resize(fill_excluded(picture).pixels, *size, bilinear=True))
    valid, asked = valid_pixels(image), valid_pixels(picture)
    if asked is not None:
        asked = resized_mask(asked, *size)
    planes = [ranks(_smooth(lightness, params.detail), valid)]
    wanted = [ranks(_smooth(_lightness(shown), params.detail), asked)]
    if contours is not None and picture_contours is not None and params.edges:
        planes.append(contours * np.float32(_EDGES * params.edges))
        found = resize(picture_contours[..., None], *size, bilinear=True)[..., 0]
        wanted.append(found * np.float32(_EDGES * params.edges))
    strength = np.float32(params.weight * _strength(lightness, valid) * VALUE_STRENGTH * contrast(image))
    target = np.stack(wanted, axis=2) * strength
    if asked is not None:
        target[~asked] = np.nan
    return TransferGuide(np.stack(planes, axis=2) * strength, target)


def _strength(lightness: ScalarMap, valid: Mask | None) -> float:
    """Of the guide beside that of values: more, the less of the exemplar's lightness is of areas."""
    own = lightness, _smooth(lightness, _AREA * min(lightness.shape))
    whole, areas = (float((one if valid is None else one[valid]).std(dtype=np.float64)) for one in own)
    if areas < _VISIBLE:
        _LOG.warning(
            "the exemplar is nearly as light everywhere (its areas differ by %.1f CIELAB units): little of the "
            "picture will be seen; --set weight=3 shows more, --source control=PICTURE gives the result its light",
            areas,
        )
    lacking = min(max(_CLEAR * whole / max(areas, 1e-9), 1.0), _MOST)
    return _STRENGTH * lacking * math.sqrt(lacking)


def _lightness(image: Image) -> ScalarMap:
    return np.ascontiguousarray(lab_from_linear(fill_excluded(image).color)[..., 0])


def _smooth(lightness: ScalarMap, deviation: float) -> ScalarMap:
    return gaussian_blur(lightness, deviation) if deviation else lightness
