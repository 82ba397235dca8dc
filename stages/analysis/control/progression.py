"""The trend of a non-stationary texture: how far each place of an exemplar is along it."""

import dataclasses
import logging
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.features.control import check_aspect, check_control, painted_mean
from texloom.stages.common.features.slow_features import mean_direction, pictured, ranks, slow_feature, window_means
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.common.grids.size_checks import check_side
from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Outline, Params, stage
from texloom.stages.vocabulary.masks import valid_pixels

_LOG = logging.getLogger(__name__)

_MIN_SIDE = 32  # px of an exemplar in which a trend can be told from texture
_WEAK = 0.1  # of the variance, below which a trend is said to be weak
_SMOOTH = 1 / 12  # of the shorter side, deviation within which a progression that is given is smoothed


class ProgressionParams(Params):
    """What counts as a trend."""

    min_trend: float = Field(0.02, ge=0, le=1)
    """share of the variance between pixels that has to change slowly; exemplars with less are refused"""
    reverse: bool = False
    """0 and 1 are exchanged; otherwise a trend that is found grows to the right, or down where it is upright"""


@dataclasses.dataclass(frozen=True)
class Progression:
    """How far along its trend each place of an exemplar is."""

    progression: ScalarMap
    """0..1, of the exemplar's size; evenly distributed, so that 0.5 is where half of the exemplar is less far"""
    slow: ScalarMap
    """the same of its slow part, which is to be continued"""
    share: float
    """confidence: share of the variance between pixels that the slow part has, 0..1; of one that is given 1"""
    angle: float
    """radians, of the direction in which it grows on the whole, from along a row towards growing rows"""
    picture: Image
    """the exemplar in hues from blue, 0, to yellow, 1"""
    table: dict[str, Any]
    """``trend``, as ``share``; ``angle``, degrees; ``found``: whether it was not given"""


def check_exemplar(params: ProgressionParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """The exemplar must be large enough, and a progression that is given must fit it."""
    image, given = known.get("image"), known.get("given")
    if image is not None:
        check_side(image, _MIN_SIDE)
    if image is not None and given is not None:
        check_aspect(given, "progression", (image.height, image.width), "exemplar")
    if isinstance(given, Image):
        check_control(given, "progression")


def outlines(params: ProgressionParams, known: Mapping[str, Any]) -> dict[str, Outline]:  # noqa: ARG001
    """All have the exemplar's size."""
    image = known.get("image")
    return {} if image is None else {name: Outline(image.height, image.width) for name in ("progression", "slow")}


@stage(version=1, check=check_exemplar, outlines=outlines)
def progression(image: Image, params: ProgressionParams, given: Image | None = None) -> Progression:
    """Find along what a texture changes, such as age, wear, moisture or the size of its grain.

    It is the weighted sum of statistics of windows, a sixteenth of the shorter side in deviation, of which the
    largest share changes slowly; see `slow_feature`. The statistics are colour and the detail at three sizes.

    Parameters
    ----------
    image : the exemplar; only its colour is measured, and what is excluded in it does not count.
    given : the progression, painted or measured, in place of the one that would be found: black where it is least.

    Raises
    ------
    InputError
        the exemplar is smaller than 32 x 32 px, or has no trend; the progression has another aspect ratio or is
        constant.

    References
    ----------
    [Zhou2018]_ for the expansion of non-stationary textures; [Zhou2023]_, whose progression maps are given.
    [WiskottSejnowski2002]_ for the slow features by which they are found here.
    """
    if given is None:
        feature = slow_feature(image)
        local, slow, share = feature.local, feature.slow, feature.share
        if share < params.min_trend:
            raise InputError(
                f"exemplar: has no trend: {100 * share:.1f} % of its variation is slow, and growth asks for "
                f"{100 * params.min_trend:.3g} %; enlarge it with self_tuning, or give its trend as "
                "--source progression=PICTURE"
            )
    else:
        local = painted_mean(given)
        slow, share = window_means(local, None, _SMOOTH * min(local.shape)), 1.0
    sign = np.float32(-1 if params.reverse else 1)
    angle = mean_direction(sign * slow)
    if given is None:
        _tell(share)
    valid = valid_pixels(image)
    found, wanted = (_at_size(sign * one, image) for one in (local, slow))
    found, wanted = ranks(found, valid), ranks(wanted, valid)
    lightness = np.ascontiguousarray(lab_from_linear(image.color)[..., 0])
    table = {"trend": round(share, 4), "angle": round(math.degrees(angle), 1), "found": given is None}
    return Progression(found, wanted, share, angle, pictured(found, lightness), table)


def _tell(share: float) -> None:
    if share < _WEAK:
        _LOG.warning(
            "the exemplar's trend is weak: %.0f %% of its variation is slow; progression.png shows what was found, "
            "and --source progression=PICTURE replaces it",
            100 * share,
        )


def _at_size(values: Float32[np.ndarray, "p q"], image: Image) -> ScalarMap:
    return resize(values[..., None], image.height, image.width, bilinear=True)[..., 0]
