"""Delighting: the colour of a surface without the shadows and highlights of the light it was photographed in."""

import dataclasses
import functools
import logging
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64
from pydantic import Field

from texloom.stages.analysis.light.cell_light import CellLight, cell_light, expected_of
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
from texloom.stages.analysis.regularity.mean_cell import MeanCell, mean_cell
from texloom.stages.kernels.core.elementary_functions import exp, log
from texloom.stages.numerics.filters import gaussian_blur, interpolated
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.masks import fill_excluded, valid_pixels, with_usable
from texloom.stages.vocabulary.progress import Progress, report

_LOG = logging.getLogger(__name__)

_SIDE = 256  # px at which shadows are searched
_BORDER_SIDE = 1024  # px at which their borders are found
_MIN_SIDE = 96  # px of a picture in which shadow can be told from texture
_MIN_CELL = 6  # px of a view, of the shorter generator
_SURE = 0.6  # confidence from which a shadow is removed
_DOUBT = 0.25  # confidence from which a part is mentioned
_LIT = 0.9  # of full light, from which a pixel is in light
_SPOT = 0.006  # deviation of a blur in which spots of light in the shadow are seen, as a share of the shorter side
_BRIGHTEST = 0.99  # quantile of pixels in light that pixels in shadow do not exceed either
_VISIBLE = 0.1  # range of logarithms of soft light that is seen


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
def delight(image: Image, params: DelightParams, generators: Vectors | None = None) -> Delight:
    """Remove cast shadows, such as of a pole or of leaves, and exclude clipped highlights.

    Light changes a texture's colours alike: logarithms are shifted by the same amount everywhere in shadow, more
    in red than in blue where sky replaces the sun. So the picture is divided into two parts that have one
    distribution but for such a shift. That this is shadow and no other material is likely if detail has the same
    contrast in both, dark and bright colours are shifted alike, the texture continues across the border, and the
    parts are larger than the texture's own, as `texloom.stages.analysis.light.shadow_evidence` measures. The
    penumbra is what remains at the border on average along it. The light of each channel is then divided out.

    On a lattice both are told better by what the median cell does not explain, and light that changes within cells
    as it does between them, such as a soft reflection, is removed too. Other slow drift stays; `tone` removes it.

    Parameters
    ----------
    image : its excluded pixels have no influence.
    generators : of its lattice, as of `lattice_selection`; only two help.

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
    report(Progress(0.3))
    for row, left in _light(color, known & ~clipped, generators, params):
        report(Progress(0.6))
        found.append(row)
        gain = gain * left
    report(Progress(0.8))
    if not clipped.any() and not any(row["removed"] for row in found):
        return dataclasses.replace(full, table={"found": found})
    gain = _no_brighter(color, gain, known & ~clipped)
    made = _lit_evenly(image, gain) if (gain != 1).any() else image
    if clipped.any():
        made = with_usable(made, known & ~clipped)
    return Delight(made, _picture(np.where(clipped[..., None], 0, gain).astype(np.float32)), {"found": found})


@dataclasses.dataclass(frozen=True)
class _View:
    """The picture at a lower resolution."""

    colors: LogColor
    valid: Mask
    generators: Vectors
    """of its lattice, px of this view; empty where it has none"""

    @functools.cached_property
    def cells(self) -> MeanCell:
        """Of its lattice."""
        return mean_cell(self.colors, self.generators, self.valid)

    @functools.cached_property
    def residual(self) -> LogColor:
        """What is left of the colours without what all cells share, at the same level."""
        return self.colors - expected_of(self.cells)


def _light(
    color: Float32[np.ndarray, "h w 3"], valid: Mask, generators: Vectors | None, params: DelightParams
) -> Iterator[tuple[dict[str, Any], Float32[np.ndarray, "h w 3"] | np.float32]]:
    """What is told of each light that was found, and its share that is removed."""
    small = _view(color, valid, generators, _SIDE)
    if small.valid.sum() < _MIN_SIDE**2 // 2:
        return
    lattice = len(small.generators) == 2
    left: LogColor | None = None
    found = _likeliest(small, [False, True] if lattice else [False])
    if found is not None and (params.strength is not None or found.confidence >= _DOUBT):
        strength = params.strength if params.strength is not None else float(found.confidence >= _SURE)
        row = _told_shadow(found, small.valid, strength)
        if strength > 0:
            share, shift = _at_full_size(color, valid, generators, found)
            yield row, np.asarray(exp(np.float32(strength) * log(shadow_gain(share, shift))), np.float32)
            left = log(shadow_gain(found.share, found.shadow.shift)).astype(np.float32)
        else:
            yield row, np.float32(1)
    if not lattice:
        return
    soft = cell_light(small.residual - (0 if left is None else left), small.cells, small.generators, small.valid)
    if soft is None or (params.strength is None and (soft.confidence < _DOUBT or soft.range < _VISIBLE)):
        return
    strength = params.strength if params.strength is not None else float(soft.confidence >= _SURE)
    field = np.float32(strength) * _stretched(soft.field, valid.shape)
    yield _told_soft(soft, strength), np.asarray(exp(field), np.float32)


@dataclasses.dataclass(frozen=True)
class _ShadowEstimate:
    shadow: Shadow
    share: ScalarMap
    confidence: float
    by_cells: bool
    """whether it was found in what the median cell leaves"""


def _likeliest(view: _View, by_cells: Iterable[bool]) -> _ShadowEstimate | None:
    """The shadow of greatest confidence, of several first guesses."""
    best: _ShadowEstimate | None = None
    for cells in by_cells:
        colors = view.residual if cells else view.colors
        for guess in first_guesses(colors, view.valid):
            shadow = find_shadow(colors, view.valid, guess)
            if shadow is None:
                continue
            share = light_left(shadow, view.valid)
            proof = evidence(shadow, share, view.valid)
            if proof is not None and (best is None or proof.confidence > best.confidence):
                best = _ShadowEstimate(shadow, share, proof.confidence, cells)
    return best


def _at_full_size(
    color: Float32[np.ndarray, "h w 3"], valid: Mask, generators: Vectors | None, found: _ShadowEstimate
) -> tuple[ScalarMap, Float64[np.ndarray, "3"]]:
    """Share of direct light at every pixel, and the shift; the border is found again at a higher resolution."""
    import cv2

    if found.share.shape == valid.shape:
        return found.share, found.shadow.shift
    finer = _view(color, valid, generators, _BORDER_SIDE)
    colors = finer.residual if found.by_cells else finer.colors
    mask = found.shadow.mask.astype(np.uint8)
    guess = cv2.resize(mask, finer.valid.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    fine = find_shadow(colors, finer.valid, guess, refine=True)
    share = found.share if fine is None else light_left(fine, finer.valid)
    shift = found.shadow.shift if fine is None else fine.shift
    return np.clip(_stretched(share, valid.shape), 0, 1), shift


def _stretched(plane: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """At another size, interpolated linearly."""
    rows, columns = (
        ((np.arange(full) + 0.5) * part / full - 0.5).astype(np.float32)
        for full, part in zip(shape, plane.shape, strict=False)
    )
    return interpolated(plane, *np.meshgrid(rows, columns, indexing="ij"))


def _view(color: Float32[np.ndarray, "h w 3"], valid: Mask, generators: Vectors | None, side: int) -> _View:
    """At no more than ``side`` px, and the pixels without influence of excluded ones."""
    import cv2

    factor = max(1.0, max(valid.shape) / side)
    frame = np.zeros((0, 2), np.float32) if generators is None else generators
    if len(frame) and np.hypot(*frame.T).min() < _MIN_CELL * factor:
        frame = frame[:0]  # cells of few pixels say nothing about light
    if factor == 1:
        return _View(log_color(color), valid, frame)
    size = (round(valid.shape[1] / factor), round(valid.shape[0] / factor))
    share = cv2.resize(valid.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    small = cv2.resize(color, size, interpolation=cv2.INTER_AREA)
    scale = np.array(size[::-1]) / valid.shape
    return _View(log_color(small), share > 1 - 1e-3, (frame * scale).astype(np.float32))


def _no_brighter(
    color: Float32[np.ndarray, "h w 3"], gain: Float32[np.ndarray, "h w 3"], valid: Mask
) -> Float32[np.ndarray, "h w 3"]:
    """``gain`` raised where shadow would become brighter than what is in light: there are spots of light in it."""
    bright = color.mean(axis=2)
    left = gain.mean(axis=2)
    in_light = valid & (left > _LIT)
    if not in_light.any():
        return gain
    deviation = max(1.0, _SPOT * min(valid.shape))
    seen = gaussian_blur(bright, deviation, "repeat")
    limit = np.float32(np.quantile(seen[in_light], _BRIGHTEST))
    excess = np.clip(seen / (left * limit), 1, 1 / np.maximum(left, 1e-3)).astype(np.float32)
    excess = np.where(left > _LIT, np.float32(1), excess)
    return np.minimum(gain * gaussian_blur(excess, deviation, "repeat")[..., None], np.maximum(gain, 1))


def _lit_evenly(image: Image, gain: Float32[np.ndarray, "h w 3"]) -> Image:
    pixels = image.pixels.copy()
    if image.channels[0] == "Y":
        pixels[..., :1] /= gain.mean(axis=2, keepdims=True)
    else:
        pixels[..., :3] /= gain
    return image.with_pixels(pixels).wrapping(False)  # a shadow ends at the border


def _picture(gain: Float32[np.ndarray, "h w 3"]) -> Image:
    return Image(gain, ("R", "G", "B"))


def _told_highlights(share: float) -> dict[str, Any]:
    why = f"clipped highlights hide {100 * share:.2g} % of the surface; they were excluded"
    _LOG.warning("%s (--set light.strength=0 keeps them)", why)
    return {"kind": "highlights", "confidence": 1.0, "removed": 1.0, "share": share, "why": why}


def _told_shadow(found: _ShadowEstimate, valid: Mask, strength: float) -> dict[str, Any]:
    share = float(found.shadow.mask[valid].mean())
    factors = " ".join(f"{factor:.2g}" for factor in np.asarray(exp(found.shadow.shift)))
    part = f"{share:.0%} of the picture, {factors} times less red, green and blue"
    return _told("shadow", "a cast shadow", part, found.confidence, share, strength)


def _told_soft(soft: CellLight, strength: float) -> dict[str, Any]:
    part = f"from darkest to brightest by {float(exp(np.array(soft.range))) - 1:.0%}"
    return _told("soft light", "soft light, such as shading or a reflection", part, soft.confidence, 1.0, strength)


def _told(kind: str, name: str, part: str, confidence: float, share: float, strength: float) -> dict[str, Any]:
    if strength > 0:
        extent = "" if strength == 1 else f" to {strength:.0%}"
        why = f"{name} ({part}; confidence {confidence:.2f}) was removed{extent}"
        _LOG.warning("%s (--set light.strength=0 keeps it)", why)
    else:
        why = f"there may be {name} ({part}; confidence {confidence:.2f}); it was kept"
        _LOG.warning("%s (--set light.strength=1 removes it)", why)
    return {"kind": kind, "confidence": confidence, "removed": strength, "share": share, "why": why}
