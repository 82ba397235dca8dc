"""What does not belong to the surface of an exemplar: doors, pipes, trees, sky, people, borders."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.analysis.exemplars.exclusion_mask import ExclusionMaskParams, exclusion_mask
from texloom.stages.analysis.photographs.blemishes import blemishes
from texloom.stages.analysis.photographs.evenness import picture_evenness
from texloom.stages.analysis.photographs.flatness import Flatness, flatness
from texloom.stages.analysis.photographs.foreign_outlines import likewise, outlined
from texloom.stages.analysis.photographs.one_off_bands import one_off_bands
from texloom.stages.analysis.photographs.unlikeness import unlikeness
from texloom.stages.analysis.regularity.mean_cell import mean_cell
from texloom.stages.common.grids.pyramid import reduced, resize
from texloom.stages.common.grids.size_checks import check_same_size
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import determinant
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.masks import fill_excluded, valid_pixels, with_usable
from texloom.stages.vocabulary.progress import Progress, report

_LOG = logging.getLogger(__name__)

_SIDE = 480  # px of the longer side, at which it is searched
_MIN_SIDE = 24  # px of the shorter one
_WINDOWS = 24, 48  # deviations of the windows that are compared: the side over these
_LESS = 0.75  # of the threshold, where others were found
_GROWS = 0.6  # of the threshold, down to which a foreign part reaches
_SURE = 0.4  # share of the first parts that reaches it: drifts of tone rise slowly
_CERTAIN = 2.0  # times the threshold, from which colours need not differ
_LEAST = 0.01  # share of the picture that is a part
_CONVEX = 0.6  # share of its convex hull; two shutters under a lintel have .63
_PIECE = 0.01  # share of the picture that is left between foreign parts
_EXPLAINS = 0.5  # median correlation of the cells with their median from which it explains the picture
_MIN_CELLS = 6.0
_MARGIN = 2.0  # px at which it is searched, by which masks are wider: borders are soft
_FINE = 1 / 12  # deviation of the window in a cell, of the shorter generator
_NOTICED = 1.5  # CIELAB
_TINT = np.array([25.0, 8.0, 8.0], np.float32)  # CIELAB by which light may change a cell
_ALL = 1000.0  # times as far as usual, from which on nothing is foreign
_OTHERS = 0.1  # of a picture without a plane, that is masked, from which it may be of several surfaces
_FEW, _DOUBT = 0.5, 0.25  # of the picture: little, and too little for a surface
_UNEVEN, _HARDLY_EVEN = 0.45, 0.70  # evenness below which what is left is several surfaces, and may be
_BANDED = (
    "a band across the surface that does not repeat is masked; it may be the border of another surface: look at "
    "foreign.png, give another mask (--source mask=foreign.png), or take another plane (--set plane=2)"
)
_SEVERAL = (
    "no plane is evident, and {:.0%} of the photograph differ from the rest, so that it may show several surfaces: "
    "look at foreign.png, give another mask (--source mask=foreign.png), or crop it to one surface (--crop)"
)
_SHADE = np.array([0.6, 0.0, 0.25], np.float32)


class ForeignPartsParams(Params):
    """How much parts may differ."""

    unlike: float = Field(4.0, ge=1.5, le=1e6)
    """how many times farther from what explains it a part is than is usual, to be foreign; from 1000 on none is"""


@dataclasses.dataclass(frozen=True)
class ForeignParts:
    """The exemplar without what does not belong to it."""

    image: Image
    """with a channel `usable`: 0 where a pixel is foreign or was excluded, else 1; as it was where none is"""
    mask: Image
    """the same as a picture to edit: white is used, black is not"""
    picture: Image
    """the exemplar with foreign parts under a tint"""
    unlike: ScalarMap
    """how many times farther from what explains it a pixel is than is usual"""
    table: dict[str, Any]
    """``why``: a sentence; ``masked``: share of what was usable; ``left``: share of the picture; ``cells``: of the
    lattice that are left, 0 without one; ``by``: `mask`, `lattice`, `looks` or `none`; ``evenness``: of what is
    left, 0..1; ``doubt``: why it may be no single surface, else empty"""


def check_mask(params: ForeignPartsParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """A mask must have the size of the exemplar."""
    check_same_size(known.get("mask"), "mask", known.get("image"), "exemplar")


@stage(version=2, check=check_mask)
def foreign_parts(
    image: Image,
    params: ForeignPartsParams,
    generators: Vectors | None = None,
    mask: Image | None = None,
    plane: dict[str, Any] | None = None,
) -> ForeignParts:
    """Propose a mask of what does not belong to the surface: what the rest does not explain.

    Parts are compared by their looks in windows of two sizes, see `unlikeness`; where some are found, once more:
    these explain no others then, and lesser ones count; then parts whose pixels look more like them than like the
    rest. Where a lattice has a mean cell that explains the
    picture, only what differs from this too is foreign: windows of a facade are not. Holes in what is foreign are
    filled, and small parts of either kind are given to the other. Where what is left is not even, but is without
    bands across it that do not repeat (`one_off_bands`), such as a cornice, these are foreign too; so is what
    stands out on a plain surface (`blemishes`).

    Parameters
    ----------
    image : the surface from the front.
    generators : of its lattice, as from `lattice_selection`; less than two count as none.
    mask : used instead, where it is given: what is darker than middle grey is foreign.
    plane : the table of `plane_proposal`. Where it found none, no lines say that the surface is flat, so that it is
        doubted sooner.

    Raises
    ------
    InputError
        a proposed mask leaves less than a quarter of what was usable, or not two cells of the lattice; what is left
        differs from part to part as several surfaces do, and no mean cell explains it, or is clearly curved (see
        `flatness`); or ``mask`` has another size.

    References
    ----------
    Ours; see `unlikeness` and `mean_cell`.
    """
    known = valid_pixels(image)
    before = np.ones((image.height, image.width), np.bool_) if known is None else known
    unlike = np.zeros(before.shape, np.float32)
    by = "mask" if mask is not None else "none"
    usable, explained = before, False
    if mask is not None:
        usable = exclusion_mask(image, ExclusionMaskParams(), mask=mask).valid
    elif min(before.shape) >= _MIN_SIDE and params.unlike < _ALL:
        unlike, foreign, explained = _searched(image, before, generators, params.unlike)
        usable = before & ~foreign
        if not usable.all() and (before & foreign).any():
            by = "lattice" if explained else "looks"
    doubted = mask is None and params.unlike < _ALL
    judged = doubted and not explained
    report(Progress(0.8))
    even = picture_evenness(image, usable)
    banded = False
    if judged and even < _HARDLY_EVEN:
        rest = usable & ~one_off_bands(image, usable)
        after = picture_evenness(image, rest)
        if after >= _HARDLY_EVEN and 0 < rest.sum() < usable.sum():
            usable, even, by, banded = rest, after, "looks", True
    if judged and min(before.shape) >= _MIN_SIDE:
        marked = _blemished(image, before, usable)
        if marked.any():
            usable, by = usable & ~marked, "looks"
            even = picture_evenness(image, usable)
    masked = 1 - float(usable.sum()) / float(before.sum())
    left = float(usable.mean())
    cells = 0.0
    if generators is not None and len(generators) == 2:
        cells = float(usable.sum()) / abs(float(determinant(generators.astype(np.float64))))
    why = _why(by, masked, left, cells, banded)
    if by in ("lattice", "looks"):
        if left < _DOUBT * float(before.mean()) or 0 < cells < 2:
            raise InputError(
                f"image: {why}: no surface stands out; keep all (--set unlike=1000), crop, or give a mask"
            )
        _LOG.warning("%s", why)
    doubt = _BANDED if banded else ""
    frontal = plane is not None and bool(plane["unasked"])
    if doubted:
        flat = flatness(image, usable)
        if judged and even < _HARDLY_EVEN:
            doubt = _doubt(even)
        elif flat.reason and (flat.turning or flat.falling or flat.folding or frontal):
            doubt = _not_flat(flat)
        elif frontal and by == "looks" and masked >= _OTHERS and not doubt:
            doubt = _SEVERAL.format(masked)
        if flat.is_curved or (judged and even < _UNEVEN):
            raise InputError(f"image: {doubt}")
    if doubt:
        _LOG.warning("%s", doubt)
    table = {
        "why": why,
        "masked": round(masked, 4),
        "left": round(left, 4),
        "cells": round(cells, 1),
        "by": by,
        "evenness": round(even, 3),
        "doubt": doubt,
    }
    white = np.repeat(usable.astype(np.float32)[..., None], 3, axis=2)
    tinted = np.where(usable[..., None], image.color, 0.3 * image.color + _SHADE)
    return ForeignParts(
        image=image if (usable == before).all() and mask is None else with_usable(image, usable),
        mask=Image(white, ("R", "G", "B")),
        picture=Image(np.asarray(tinted, np.float32), ("R", "G", "B")),
        unlike=unlike,
        table=table,
    )


def _not_flat(flat: Flatness) -> str:
    sure = "is" if flat.is_curved else "may be"
    return (
        f"the surface {sure} not flat and seen from the front: {flat.reason}; give corners or control points "
        "(--set geometry=my.yaml), or take another plane (--set plane=2, by planes.png); --set unlike=1000 takes "
        "it as flat"
    )


def _doubt(even: float) -> str:
    does = "do" if even < _UNEVEN else "may"
    return (
        f"parts of the surface differ as several surfaces {does} (evenness {even:.2f}), and no cell repeats: take "
        "another plane (--set plane=2, by planes.png), give corners or control points (--set geometry=my.yaml), or "
        "a mask of what belongs to it; --set unlike=1000 takes all as one surface"
    )


def _why(by: str, masked: float, left: float, cells: float, banded: bool) -> str:
    if by == "none":
        return "nothing differs from the rest"
    if by == "mask":
        return f"a mask is given: {left:.0%} of the picture are left"
    how = "and its mean cell " if by == "lattice" else ""
    why = f"{masked:.1%} of the exemplar are masked: unlike the rest {how}by what is usual"
    why += ", or in a band across it that does not repeat" if banded else ""
    if left < _FEW:
        why += f"; {left:.0%} of the picture are left"
        why += f", {cells:.1f} cells" if cells else ""
        why += ": little, so that the texture repeats itself"
    return f"{why}; edit foreign.png and give it back (--source mask=foreign.png), or keep all (--set unlike=1000)"


def _searched(
    image: Image, valid: Mask, generators: Vectors | None, threshold: float
) -> tuple[ScalarMap, Mask, bool]:
    """How unlike each pixel is, whether it is foreign, and whether a mean cell explains the picture."""
    lab = lab_from_linear(reduced(np.ascontiguousarray(fill_excluded(image).color), _SIDE))
    small = reduced(valid[..., None].astype(np.float32), _SIDE)[..., 0] > 0.5
    cell = None
    if generators is not None and len(generators) == 2:
        factor = np.array(lab.shape[:2]) / (image.height, image.width)
        cell = _unlike_cell(lab, small, (generators * factor).astype(np.float32))
    side = float(np.sqrt(small.sum()))
    unlike = np.zeros(small.shape, np.float32)
    found = np.zeros(small.shape, np.bool_)
    for done, share, most in ((0.2, 1.0, _SURE), (0.5, _LESS, 0.0)):
        report(Progress(done))
        looks = [unlikeness(lab, small, max(1.5, side / windows), found) for windows in _WINDOWS]
        unlike = np.maximum.reduce(looks) if cell is None else np.minimum(np.maximum.reduce(looks), cell[0])
        found = found | _parts(unlike, small, share * threshold, most)
        if not found.any():
            break
    planes = lab if cell is None else cell[1]
    found = outlined(planes, small, found, unlike >= _CERTAIN * threshold)  # windows blur outlines
    found = found | likewise(planes, small, found, _LEAST * float(small.sum()))
    foreign = _closed(found, small, _MARGIN)
    both = resize(np.stack([foreign, unlike], axis=2).astype(np.float32), image.height, image.width, bilinear=True)
    return np.ascontiguousarray(both[..., 1]), both[..., 0] > 0.5, cell is not None


def _blemished(image: Image, valid: Mask, usable: Mask) -> Mask:
    """What stands out on a plain surface, with a margin."""
    lab = lab_from_linear(reduced(np.ascontiguousarray(fill_excluded(image).color), _SIDE))
    small, left = (reduced(mask[..., None].astype(np.float32), _SIDE)[..., 0] > 0.5 for mask in (valid, usable))
    found = blemishes(lab, small, small & ~left)
    if not found.any():
        return np.zeros(usable.shape, np.bool_)
    wide = _grown(found, _MARGIN).astype(np.float32)[..., None]
    return np.asarray(resize(wide, image.height, image.width, bilinear=True)[..., 0] > 0.5)


def _unlike_cell(
    lab: Float32[np.ndarray, "h w 3"], valid: Mask, generators: Vectors
) -> tuple[ScalarMap, Float32[np.ndarray, "h w 3"]] | None:
    """How many times farther from the mean cell each pixel is than is usual, and what the mean cell leaves of it.

    None where the mean cell explains too little.
    """
    frame = generators.astype(np.float64)
    area, shorter = abs(float(determinant(frame))), float(np.hypot(*frame.T).min())
    if valid.sum() < _MIN_CELLS * area or shorter < 6:
        return None
    cell = mean_cell(lab, generators, valid)
    tint = np.clip(cell.per_cell(lab - cell.expected, valid), -_TINT, _TINT)
    if cell.explained(lab[..., 0], valid) < _EXPLAINS:
        return None
    toned = lab - tint
    left = toned - np.clip(toned, cell.lowest, cell.highest)
    rest = np.abs(left).mean(axis=2)
    usual = np.nan_to_num(cell.deviation)[cell.phase[..., 0], cell.phase[..., 1]]
    deviation = max(1.0, _FINE * shorter)
    counted = valid.astype(np.float32)
    weight = np.maximum(gaussian_blur(counted, deviation), np.float32(1e-6))
    mean, expected = (gaussian_blur(plane * counted, deviation) / weight for plane in (rest, usual))
    unlike = np.where(valid, 2 * mean / (expected + np.float32(_NOTICED)), 0)
    return np.asarray(unlike, np.float32), np.asarray(left, np.float32)


def _parts(unlike: ScalarMap, valid: Mask, threshold: float, sure: float) -> Mask:
    """Parts that are nearly as unlike as the threshold, and not small, of which more than a share reaches it."""
    import cv2

    near = (unlike >= max(1.5, _GROWS * threshold)) & valid
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(near.astype(np.uint8), connectivity=4)
    reach = np.bincount(labels.ravel(), (unlike >= threshold).ravel().astype(np.float64), minlength=count)
    large = (boxes[:, cv2.CC_STAT_AREA] >= _LEAST * valid.sum()) & (reach > sure * boxes[:, cv2.CC_STAT_AREA])
    large[0] = False
    return np.asarray(large[labels])


def _closed(found: Mask, valid: Mask, reach: float) -> Mask:
    """Foreign parts with a margin, their holes filled, and without small pieces of the rest."""
    import cv2

    if not found.any():
        return found
    rest = (valid & ~_filled(_grown(found, reach))).astype(np.uint8)
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(rest, connectivity=4)
    small = boxes[:, cv2.CC_STAT_AREA] < _PIECE * valid.sum()
    small[0] = True  # what is foreign, or was not known
    return np.asarray(small[labels])


def _filled(found: Mask) -> Mask:
    """Parts that fill most of their convex hull with all of it: a pane that mirrors the sky between shutters.

    Not parts at the border, such as a street with a door above it.
    """
    import cv2

    count, labels, boxes, _ = cv2.connectedComponentsWithStats(found.astype(np.uint8), connectivity=4)
    filled = found.astype(np.uint8)
    whole = np.arange(count) > 0
    for edge in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        whole[edge] = False
    for label in np.flatnonzero(whole):
        hull = np.zeros_like(filled)
        points = np.argwhere(labels == label)[:, ::-1].astype(np.int32)
        cv2.fillConvexPoly(hull, cv2.convexHull(points), 1)
        if boxes[label, cv2.CC_STAT_AREA] >= _CONVEX * hull.sum(dtype=np.int64):
            filled |= hull
    return filled > 0


def _grown(found: Mask, reach: float) -> Mask:
    """With what is within ``reach`` px."""
    import cv2

    side = 2 * max(1, round(reach)) + 1
    return cv2.dilate(found.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))) > 0
