"""Guides: pictures that say what lies where in the exemplar and what is to lie where in the result."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.features.control import (
    check_aspect,
    check_control,
    check_finite,
    match_channels,
    painted_values,
)
from texloom.stages.common.features.labels import assign_labels, label_colors, simplex, unknown_color
from texloom.stages.common.features.maps import map_channels
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.kernels.core.elementary_functions import cos, sin
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Outline, Params, stage
from texloom.stages.vocabulary.masks import EXCLUSION_CHANNELS, fill_excluded, valid_pixels

MAX_PLANES = 15
"""of a guide"""

VALUE_STRENGTH = 3.2
"""range of a value, in deviations of colour"""

LABEL_STRENGTH = 1.6
"""distance of two labels, in deviations of colour"""

_MIN_SPREAD, _MAX_SPREAD = 8.0, 60.0  # CIELAB units of deviation of colour that count
_WINDOW = 10  # px, in which a guide is compared
_MIN_COARSENESS = 0.1
_MIN_RANGE = 1e-3  # of a channel that is not constant
_SAME = 4 / 255  # maximum difference of two channels that are one


class GuideParams(Params):
    """How guides are read, and their weight."""

    kind: Literal["auto", "labels", "values", "angles"] = "auto"
    """`labels`: a few colours, all equally different; `values`: every channel is a quantity, such as height or age;
    `angles`: brightness is an orientation, black 0 and white 180 degrees from along a row towards growing rows;
    `auto`: `labels` for pictures of a few flat colours, else `values`"""
    weight: float = Field(1.0, gt=0, le=10)
    """factor on the strength that is chosen by the exemplar's contrast: 0.3 guides weakly, 3 enforces"""


@dataclasses.dataclass(frozen=True)
class Guide:
    """The guides as planes in which patches are compared."""

    exemplar: Float32[np.ndarray, "h w k"]
    """CIELAB units; of the exemplar's size"""
    target: Float32[np.ndarray, "H W k"]
    """the same of the result, of the target guide's size; NaN where that is transparent"""
    kind: str
    """`labels`, `values` or `angles`"""
    labels: int
    """number of labels; 0 without"""
    strength: float
    """distance of two labels, or range of a value, CIELAB units"""


def check_guides(params: GuideParams, known: Mapping[str, Any]) -> None:
    """The guides must fit the exemplar and each other."""
    image, own, target = (known.get(name) for name in ("image", "exemplar_guide", "target_guide"))
    if image is not None and own is not None:
        check_aspect(own, "exemplar_guide", (image.height, image.width), "exemplar")
    if isinstance(own, Image):
        check_control(own, "exemplar_guide")
    if isinstance(target, Image):
        check_finite(target, "target_guide")
    if isinstance(own, Image) and isinstance(target, Image):
        _read(own, target, None, params)


def outlines(params: GuideParams, known: Mapping[str, Any]) -> dict[str, Outline]:  # noqa: ARG001
    """The planes have the sizes of exemplar and target guide."""
    image, target = known.get("image"), known.get("target_guide")
    sizes = {"exemplar": image, "target": target}
    return {name: Outline(one.height, one.width) for name, one in sizes.items() if one is not None}


@stage(version=1, check=check_guides, outlines=outlines)
def guide(image: Image, exemplar_guide: Image, target_guide: Image, params: GuideParams) -> Guide:
    """Read a guide of the exemplar and one of the result, so that the result can follow.

    Labels are recognised by their colours, also after compression and with antialiased borders, and become points
    of which any two are equally far apart. Values are scaled by their range in the exemplar, beyond which those of
    the target are clipped. The strength is chosen by the spread of the exemplar's colours, which it must outweigh,
    and is lower where the exemplar's guide is finer than the target's, as a map of specks of rust is finer than
    painted areas of rust: no part of the exemplar then follows exactly.

    Parameters
    ----------
    image : the exemplar; what is excluded in it does not count.
    exemplar_guide : what lies where in the exemplar; of its aspect ratio.
    target_guide : what is to lie where in the result, with the same channels and, if labels, colours. Where it is
        transparent, anything may lie.

    Raises
    ------
    InputError
        the guides do not fit the exemplar or each other: aspect ratio, channels, colours of
        labels; one is constant.

    References
    ----------
    [Hertzmann2001]_ section 4.4, texture by numbers: two labelled pictures and one texture determine the other;
    [Zhou2023]_ for progression maps. The distance of labels, and the strength, are ours.
    """
    valid = valid_pixels(image)
    own, target, colors = _read(exemplar_guide, target_guide, valid, params)
    own = resize(own, image.height, image.width, bilinear=True)
    factor = VALUE_STRENGTH if colors is None else LABEL_STRENGTH
    factor *= min(1.0, _coarseness(own) / _coarseness(target))
    asked = valid_pixels(target_guide)
    if asked is not None:
        target = np.where(asked[..., None], target, np.float32(np.nan))
    strength = params.weight * factor * contrast(image)
    kind = params.kind if params.kind != "auto" else "values" if colors is None else "labels"
    return Guide(own * np.float32(strength), target * np.float32(strength), kind, len(colors or ()), strength)


def contrast(image: Image) -> float:
    """Root of the summed variances of an exemplar's colours and maps, CIELAB units, within what guides outweigh."""
    valid = valid_pixels(image)
    lab = lab_from_linear(fill_excluded(image).color)
    values = lab.reshape(-1, 3) if valid is None else lab[valid]
    spread = float(np.sqrt(values.var(axis=0, dtype=np.float64).sum()))
    # All maps together count as much as colour.
    spread *= np.sqrt(2) if map_channels(image.channels) else 1
    return float(np.clip(spread, _MIN_SPREAD, _MAX_SPREAD))


def _coarseness(planes: "_GuidePlanes") -> float:
    """Share of a guide's variance that is left in means over windows of a patch's size, 0..1."""
    import cv2

    total = float(planes.var(axis=(0, 1), dtype=np.float64).sum())
    means = [cv2.blur(plane, (_WINDOW, _WINDOW)) for plane in np.ascontiguousarray(np.moveaxis(planes, 2, 0))]
    kept = sum(float(plane.var(dtype=np.float64)) for plane in means)
    return max(kept / total, _MIN_COARSENESS) if total > 0 else 1.0


_GuidePlanes: TypeAlias = Float32[np.ndarray, "_ _ _"]


def _read(
    own: Image, target: Image, valid: Mask | None, params: GuideParams
) -> tuple[_GuidePlanes, _GuidePlanes, list[str] | None]:
    """Planes of unit strength, each of the guide's own size, and the colours of labels, None without."""
    own, target = _opaque(own), _opaque(target)
    try:
        target = match_channels(target, own)
    except InputError as error:
        raise InputError(
            str(error).replace("target:", "target_guide:").replace("control", "exemplar_guide")
        ) from None
    values, wanted = painted_values(own), painted_values(target)
    if valid is not None and valid.shape != values.shape[:2]:
        valid = (
            resize(valid[..., None].astype(np.float32), values.shape[0], values.shape[1], bilinear=True)[..., 0]
            > 0.5
        )
    if params.kind == "angles":
        return _doubled(values), _doubled(wanted), None
    colors = None
    if params.kind in ("auto", "labels"):
        colors = label_colors(values, valid)
        if colors is None and params.kind == "labels":
            raise InputError("exemplar_guide: is not a picture of a few flat colours; give kind=values")
    if colors is None:
        return *_scaled(values, wanted, valid), None
    return *_labelled(values, wanted, colors), [_shown(color) for color in colors]


def _opaque(image: Image) -> Image:
    """Without alpha; what is transparent is like the nearest pixel that is not."""
    image = fill_excluded(image)
    kept = [index for index, name in enumerate(image.channels) if name not in EXCLUSION_CHANNELS]
    names = tuple(image.channels[index] for index in kept)
    return image.elsewhere(np.ascontiguousarray(image.pixels[..., kept]), names)


def _doubled(values: _GuidePlanes) -> _GuidePlanes:
    angle = 2 * np.pi * values[..., 0]
    return np.stack([cos(angle), sin(angle)], axis=2).astype(np.float32) / 2


def _scaled(values: _GuidePlanes, wanted: _GuidePlanes, valid: Mask | None) -> tuple[_GuidePlanes, _GuidePlanes]:
    counted = values.reshape(-1, values.shape[2]) if valid is None else values[valid]
    low, span = counted.min(axis=0), np.ptp(counted, axis=0)
    varying: list[int] = []
    for index in np.flatnonzero(span > _MIN_RANGE):
        if all(np.abs(counted[:, index] - counted[:, other]).max() > _SAME for other in varying):
            varying.append(int(index))
    if not 1 <= len(varying) <= MAX_PLANES:
        raise InputError(f"exemplar_guide: {len(varying)} channels vary; a guide has 1 to {MAX_PLANES}")

    def scaled(planes: _GuidePlanes) -> _GuidePlanes:
        share = np.clip((planes[..., varying] - low[varying]) / span[varying], 0, 1)
        return np.asarray(share / np.sqrt(len(varying)), np.float32)

    return scaled(values), scaled(wanted)


def _labelled(values: _GuidePlanes, wanted: _GuidePlanes, colors: np.ndarray) -> tuple[_GuidePlanes, _GuidePlanes]:
    found = label_colors(wanted)
    if found is None:  # a single label, or few flat pixels
        found = np.median(wanted.reshape(-1, wanted.shape[2]), axis=0, keepdims=True)
    strange = unknown_color(found, colors)
    if strange is not None:
        known = ", ".join(_shown(color) for color in colors)
        raise InputError(
            f"target_guide: its colour {_shown(strange)} is no label of exemplar_guide, which has {known}; "
            "paint both with the same colours, or give kind=values"
        )
    points = simplex(len(colors))
    return points[assign_labels(values, colors)], points[assign_labels(wanted, colors)]


def _shown(color: np.ndarray) -> str:
    codes = np.rint(np.clip(color, 0, 1) * 255).astype(int)
    return "#" + "".join(f"{code:02x}" for code in (np.repeat(codes, 3) if len(codes) == 1 else codes))
