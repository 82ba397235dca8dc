"""Delighting: the colour of a surface without the shadows and highlights of the light it was photographed in."""

import dataclasses
import logging
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64
from pydantic import Field

from texloom.stages.analysis.light.clipped_highlights import clipped_highlights
from texloom.stages.analysis.light.penumbra import light_left, shadow_gain
from texloom.stages.analysis.light.shadow_evidence import evidence
from texloom.stages.analysis.light.shadow_segments import (
    LogColor,
    Shadow,
    find_shadow,
    first_guesses,
    log_color,
)
from texloom.stages.kernels.core.elementary_functions import exp, log
from texloom.stages.numerics.filters import interpolated
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.masks import USABLE, fill_excluded, valid_pixels

_LOG = logging.getLogger(__name__)

_SIDE = 256  # px at which shadows are searched
_BORDER_SIDE = 1024  # px at which their borders are found
_MIN_SIDE = 96  # px of a picture in which shadow can be told from texture
_SURE = 0.5  # confidence from which a shadow is removed
_DOUBT = 0.25  # confidence from which a part is mentioned


class DelightParams(Params):
    """How much of the light is removed."""

    strength: float | None = Field(None, ge=0, le=1)
    """share of the shadow that is removed, of logarithms of light: 0 keeps the picture, 1 removes all that may be
    shadow; null: all, where it is sure that it is shadow"""


@dataclasses.dataclass(frozen=True)
class Delight:
    """The surface in even light, and the light."""

    image: Image
    """all maps of the picture, with colours in even light; clipped highlights are excluded by a channel `usable`.
    Bit-identical to the picture if nothing was found"""
    light: Image
    """the light that was removed, relative to full light; 0 in clipped highlights"""
    table: dict[str, Any]
    """``found``: ``kind``, ``confidence`` and ``removed``, 0..1, ``share`` of the picture, and ``why``, a
    sentence, of each"""


@stage(version=1)
def delight(image: Image, params: DelightParams) -> Delight:
    """Remove cast shadows, such as of a pole or of leaves, and exclude clipped highlights.

    Light changes a texture's colours alike: logarithms are shifted by the same amount everywhere in shadow, more
    in red than in blue where sky replaces the sun. So the picture is divided into two parts that have one
    distribution but for such a shift. That this is shadow and no other material is likely if detail has the same
    contrast in both, dark and bright colours are shifted alike, the texture continues across the border, and the
    parts are larger than the texture's own, as `texloom.stages.analysis.light.shadow_evidence` measures. The
    penumbra is what remains at the border on average along it. The light of each channel is then divided out.

    Slow drift stays; `tone` removes it.

    Parameters
    ----------
    image : its excluded pixels have no influence.

    Raises
    ------
    InputError
        all pixels are excluded.

    References
    ----------
    Ours. [Finlayson2009]_ for shadows as shifts of logarithms along one direction.
    """
    full = Delight(image, _picture(np.ones((image.height, image.width, 3), np.float32)), {"found": []})
    if params.strength == 0 or min(image.height, image.width) < _MIN_SIDE:
        return full
    valid = valid_pixels(image)
    known = np.ones((image.height, image.width), np.bool_) if valid is None else valid
    color = np.ascontiguousarray(fill_excluded(image).color)
    found, gain = [], np.ones_like(color)
    clipped = clipped_highlights(color, known)
    if clipped.any():
        found.append(_told_highlights(float(clipped.sum() / known.sum())))
    shadowed = _shadow(color, known & ~clipped, params)
    if shadowed is not None:
        row, removed = shadowed
        found.append(row)
        gain = removed
    if not clipped.any() and not any(row["removed"] for row in found):
        return dataclasses.replace(full, table={"found": found})
    made = _lit_evenly(image, gain)
    if clipped.any():
        made = _excluding(made, known & ~clipped)
    return Delight(made, _picture(np.where(clipped[..., None], 0, gain).astype(np.float32)), {"found": found})


def _shadow(
    color: Float32[np.ndarray, "h w 3"], valid: Mask, params: DelightParams
) -> tuple[dict[str, Any], Float32[np.ndarray, "h w 3"]] | None:
    """What is told of a shadow, and the light that it leaves."""
    small, kept = _reduced(color, valid, _SIDE)
    if kept.sum() < _MIN_SIDE**2 // 2:
        return None
    found = _likeliest(log_color(small), kept)
    if found is None or (params.strength is None and found[2] < _DOUBT):
        return None
    shadow, share, confidence = found
    strength = params.strength if params.strength is not None else float(confidence >= _SURE)
    row = _told_shadow(shadow, kept, confidence, strength)
    if strength == 0:
        return row, np.ones_like(color)
    share, shift = _at_full_size(color, valid, shadow, share)
    return row, np.asarray(exp(np.float32(strength) * log(shadow_gain(share, shift))), np.float32)


def _likeliest(colors: LogColor, valid: Mask) -> tuple[Shadow, ScalarMap, float] | None:
    """The shadow of greatest confidence, of several first guesses, and its light."""
    best = None
    for guess in first_guesses(colors, valid):
        shadow = find_shadow(colors, valid, guess)
        if shadow is None:
            continue
        share = light_left(shadow, valid)
        proof = evidence(shadow, share, valid)
        if proof is not None and (best is None or proof.confidence > best[2]):
            best = shadow, share, proof.confidence
    return best


def _at_full_size(
    color: Float32[np.ndarray, "h w 3"], valid: Mask, shadow: Shadow, share: ScalarMap
) -> tuple[ScalarMap, Float64[np.ndarray, "3"]]:
    """Share of direct light at every pixel, and the shift; the border is found again at a higher resolution."""
    import cv2

    if share.shape == valid.shape:
        return share, shadow.shift
    finer, kept = _reduced(color, valid, _BORDER_SIDE)
    guess = cv2.resize(shadow.mask.astype(np.uint8), kept.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    fine = find_shadow(log_color(finer), kept, guess, refine=True)
    if fine is not None:
        shadow, share = fine, light_left(fine, kept)
    rows, columns = (
        ((np.arange(full) + 0.5) * part / full - 0.5).astype(np.float32)
        for full, part in zip(valid.shape, share.shape, strict=True)
    )
    return interpolated(share, *np.meshgrid(rows, columns, indexing="ij")), shadow.shift


def _reduced(
    color: Float32[np.ndarray, "h w 3"], valid: Mask, side: int
) -> tuple[Float32[np.ndarray, "p q 3"], Mask]:
    """At no more than ``side`` px, and the pixels without influence of excluded ones."""
    import cv2

    factor = max(valid.shape) / side
    if factor <= 1:
        return color, valid
    size = (round(valid.shape[1] / factor), round(valid.shape[0] / factor))
    share = cv2.resize(valid.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return cv2.resize(color, size, interpolation=cv2.INTER_AREA), share > 1 - 1e-3


def _lit_evenly(image: Image, gain: Float32[np.ndarray, "h w 3"]) -> Image:
    pixels = image.pixels.copy()
    if image.channels[0] == "Y":
        pixels[..., :1] /= gain.mean(axis=2, keepdims=True)
    else:
        pixels[..., :3] /= gain
    return image.with_pixels(pixels).wrapping(False)  # a shadow ends at the border


def _excluding(image: Image, valid: Mask) -> Image:
    usable = valid.astype(np.float32)
    if USABLE in image.channels:
        pixels = image.pixels.copy()
        pixels[..., image.channels.index(USABLE)] = usable
        return image.with_pixels(pixels)
    return image.with_pixels(np.dstack([image.pixels, usable]), (*image.channels, USABLE))


def _picture(gain: Float32[np.ndarray, "h w 3"]) -> Image:
    return Image(gain, ("R", "G", "B"))


def _told_highlights(share: float) -> dict[str, Any]:
    why = f"clipped highlights hide {100 * share:.2g} % of the surface; they were excluded"
    _LOG.warning("%s (--set light.strength=0 keeps them)", why)
    return {"kind": "highlights", "confidence": 1.0, "removed": 1.0, "share": share, "why": why}


def _told_shadow(shadow: Shadow, valid: Mask, confidence: float, strength: float) -> dict[str, Any]:
    share = float(shadow.mask[valid].mean())
    factors = " ".join(f"{factor:.2g}" for factor in np.asarray(exp(shadow.shift)))
    part = f"{share:.0%} of the picture, {factors} times less red, green and blue, confidence {confidence:.2f}"
    if strength > 0:
        removed = "" if strength == 1 else f" to {strength:.0%}"
        why = f"a cast shadow ({part}) was removed{removed}"
        _LOG.warning("%s (--set light.strength=0 keeps it)", why)
    else:
        why = f"a part may be in shadow ({part}); it was kept"
        _LOG.warning("%s (--set light.strength=1 removes it)", why)
    return {"kind": "shadow", "confidence": confidence, "removed": strength, "share": share, "why": why}
