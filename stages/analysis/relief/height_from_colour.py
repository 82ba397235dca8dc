"""Heights guessed from colour: what is darker than its surroundings lies deeper, the wider the deeper."""

import dataclasses
import logging
from typing import Literal

import numpy as np
from jaxtyping import Int32
from pydantic import Field

from texloom.stages.analysis.relief.added_maps import (
    HEIGHT,
    from_zero_to_one,
    has_map,
    smoothed,
    with_map,
    within,
)
from texloom.stages.common.grids.screened_poisson import divided_by_frequency
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.facts import DISPLACEMENT, MapFacts
from texloom.stages.vocabulary.masks import fill_excluded, nearest_valid, valid_pixels
from texloom.stages.vocabulary.sizes import format_size

_LOG = logging.getLogger(__name__)

_LIMIT = 2.0  # robust standard deviations of lightness beyond which it tells less and less of height
_SPAN = 0.5  # of the picture's height or width that a network of joints spans
_MOST, _LEAST = 0.4, 0.01  # shares of a picture that joints cover
_ENCLOSED = 0.1  # share of a picture that the largest part between joints covers
_APART = 0.75  # standard deviations between the tones of joints and of the rest, where they do not enclose parts
_PART = 0.001  # share of a picture that a part covers, as a brick, whose width counts
_THIN = 0.6  # of the median width of parts, up to which what spans the picture is a joint
_STEEPNESS = 1 / 4  # width of a joint's flanks, as a share of the joints' mean width


class HeightFromColourParams(Params):
    """How deep the surface is, and what colour says of it."""

    relief: float = Field(0.015, gt=0, le=DISPLACEMENT)
    """depth from the lowest to the highest point, as a share of the picture's width"""
    scale: float = Field(0.125, gt=0, le=1)
    """size of the largest forms that are relief, as a share of the shorter side; slower changes of tone are not"""
    dark: Literal["auto", "deep", "high"] = "auto"
    """whether what is darker lies deeper or higher; `auto`: deeper, as a note says"""
    joints: float = Field(0.3, ge=-1, le=1)
    """depth of joints, as a share of the whole depth, whatever their tone: 0 treats them as anything else, below 0
    raises them"""


@dataclasses.dataclass(frozen=True)
class HeightFromColour:
    """The exemplar with heights."""

    image: Image
    """with a channel `height` around 0.5: high is bright, and 1 is a twentieth of the picture's width, as exported
    documents assume; a map that was there is kept"""
    joints: Mask
    """true on joints that got a depth of their own"""


@stage(version=1)
def height_from_colour(
    image: Image, params: HeightFromColourParams, structure: Mask | None = None
) -> HeightFromColour:
    """Estimate heights from lightness, without a trained model.

    Under light from all sides a hollow is dark by how much of the sky its walls hide, whatever its size: a surface
    enlarged as a whole looks the same. So the same darkness means a depth in proportion to the width, and the
    waves of lightness, CIELAB, are divided by their frequency. Forms larger than ``scale`` fade out, as tone drifts
    for other reasons, and so does the excess of what is much brighter or darker than usual, such as stains.

    Joints tell more than tone. Where features form a network across the picture that encloses parts or has a tone
    of its own, they are lowered by ``joints``, even if they are brighter, and the parts that they enclose, such as
    bricks of several colours, are brought to one mean tone.

    Dark colour on a level surface is taken for relief: this is a guess, as a note says.

    Parameters
    ----------
    image : the exemplar; its excluded pixels have no influence.
    structure : features, as of `otsu`, among which joints are searched.

    Raises
    ------
    InputError
        all pixels are excluded.
    ValueError
        ``structure`` has another size.

    References
    ----------
    Ours. [LangerZucker1994]_ for how light from the whole sky darkens hollows; [Pentland1990]_ for heights as waves
    of brightness divided by their frequency, there under light from one side.
    """
    none = np.zeros((image.height, image.width), bool)
    if structure is not None and structure.shape != none.shape:
        raise ValueError(f"structure of shape {structure.shape} for an image of {format_size(image)}")
    if has_map(image, HEIGHT):
        return HeightFromColour(image, none)
    valid = valid_pixels(image)
    lightness = np.ascontiguousarray(lab_from_linear(fill_excluded(image).color)[..., 0])
    joints = None if structure is None or params.joints == 0 else _joints(structure, lightness, valid)
    network: ScalarMap | None = None
    if joints is not None:
        network = _softened(joints, image)
        lightness, level = _of_one_tone(lightness, joints)
        lower = np.maximum if params.dark == "high" else np.minimum  # tone must not raise them
        lightness = np.where(joints, lower(lightness, level), lightness)
    lowest = np.square(2 * np.pi / (params.scale * min(image.height, image.width)))  # (radians / px)^2
    detail = divided_by_frequency(lightness, image.wraps, lambda s: (s + lowest) / np.maximum(s, 1e-12))
    detail -= np.float32(np.median(within(detail, valid)))
    limit = _LIMIT * 1.4826 * float(np.median(np.abs(within(detail, valid)))) + 1e-6
    detail = detail / np.sqrt(1 + np.square(detail / np.float32(limit)))
    waves = divided_by_frequency(detail, image.wraps, lambda s: (s + lowest) / np.sqrt(np.maximum(s, 1e-12)))
    height = from_zero_to_one(-waves if params.dark == "high" else waves, valid)
    if network is not None:
        share = np.float32(params.joints)
        height = from_zero_to_one((1 - abs(share)) * height - share * network, valid)
    _report(params, None if joints is None else float(joints.mean()))
    height = np.float32(0.5) + (height - np.float32(0.5)) * np.float32(params.relief / DISPLACEMENT)
    made = with_map(image, HEIGHT, height[..., None], (HEIGHT,), MapFacts())
    return HeightFromColour(made, none if joints is None else joints)


def _report(params: HeightFromColourParams, share: float | None) -> None:
    side = (
        "high (--set height.dark=deep turns it)"
        if params.dark == "high"
        else "deep (--set height.dark=high turns it)"
    )
    lowered = (
        ""
        if share is None
        else (
            f"; joints, {100 * share:.0f} % of the picture, {'lowered' if params.joints > 0 else 'raised'} by "
            f"{abs(params.joints):g} of the depth (--set height.joints=0 ignores them, less than 0 raises them)"
        )
    )
    _LOG.warning("heights are a guess from colour: dark is %s%s", side, lowered)


def _joints(structure: Mask, lightness: ScalarMap, valid: Mask | None) -> Mask | None:
    """The features with what lies between two outlines, if they are a network across the picture; else None.

    It has to enclose parts, as joints do bricks, or to differ in tone.
    """
    import cv2

    joints = structure | _between_outlines(structure)
    spans, labels = _spanning(joints)
    rest = ~joints if valid is None else ~joints & valid
    if not _LEAST <= float(joints.mean()) <= _MOST or not spans.any() or not rest.any():
        return None
    network = spans[labels] if valid is None else spans[labels] & valid
    if not network.any():
        return None
    boxes = cv2.connectedComponentsWithStats((~joints).astype(np.uint8), connectivity=4)[2]
    if boxes[1:, cv2.CC_STAT_AREA].max() <= _ENCLOSED * joints.size:
        return joints
    difference = lightness[network].mean(dtype=np.float64) - lightness[rest].mean(dtype=np.float64)
    return joints if abs(difference) >= _APART * lightness[rest].std(dtype=np.float64) else None


def _between_outlines(structure: Mask) -> Mask:
    """Thin parts that span the picture, as mortar of which the features are the outlines."""
    import cv2

    rest = (~structure).astype(np.uint8)
    squared = np.rint(np.square(cv2.distanceTransform(rest, cv2.DIST_L2, cv2.DIST_MASK_PRECISE), dtype=np.float64))
    spans, labels = _spanning(~structure)
    widest = np.zeros(spans.size)
    np.maximum.at(widest, labels, squared)
    sizes = np.bincount(labels.ravel(), minlength=spans.size)
    sizes[0] = 0
    parts = sizes >= _PART * structure.size
    thin = spans & (widest <= _THIN**2 * np.median(widest[parts])) if parts.any() else np.zeros_like(spans)
    return thin[labels]


def _spanning(mask: Mask) -> tuple[np.ndarray, Int32[np.ndarray, "h w"]]:
    """Which of the components of a mask reach across the picture, and their numbers by pixel, 0 outside."""
    import cv2

    _, labels, boxes, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    height, width = mask.shape
    spans = (boxes[:, cv2.CC_STAT_HEIGHT] >= _SPAN * height) | (boxes[:, cv2.CC_STAT_WIDTH] >= _SPAN * width)
    spans[0] = False  # the background
    return spans, labels


def _of_one_tone(lightness: ScalarMap, joints: Mask) -> tuple[ScalarMap, np.float32]:
    """``lightness`` with the same mean in all parts between joints, and this; joints follow the nearest part."""
    import cv2

    count, parts = cv2.connectedComponents((~joints).astype(np.uint8), connectivity=4)
    labels = parts.ravel()
    sums = np.bincount(labels, lightness.ravel().astype(np.float64), count)
    means = sums / np.maximum(np.bincount(labels, minlength=count), 1)
    row, column = nearest_valid(~joints)
    level = np.float32(lightness.mean(dtype=np.float64))
    return lightness - means.astype(np.float32)[parts[row, column]] + level, level


def _softened(joints: Mask, image: Image) -> ScalarMap:
    """1 on joints, 0 elsewhere, with flanks between."""
    ends = np.count_nonzero(joints[1:] != joints[:-1]) + np.count_nonzero(joints[:, 1:] != joints[:, :-1])
    width = 2 * int(np.count_nonzero(joints)) / max(int(ends), 1)
    return np.clip(smoothed(joints.astype(np.float32), image.wraps, max(0.5, _STEEPNESS * width)), 0, 1)
