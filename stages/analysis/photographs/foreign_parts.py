"""What does not belong to the surface of an exemplar: doors, pipes, trees, sky, people, borders."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.analysis.exemplars.exclusion_mask import ExclusionMaskParams, exclusion_mask
from texloom.stages.analysis.one_off.foreign_search import as_searched, counted, foreign_search, with_margin
from texloom.stages.analysis.photographs.blemishes import blemishes
from texloom.stages.analysis.photographs.evenness import picture_evenness
from texloom.stages.analysis.photographs.flatness import Flatness, flatness
from texloom.stages.analysis.photographs.long_lines import long_lines
from texloom.stages.analysis.photographs.main_surface import main_surface
from texloom.stages.analysis.photographs.one_off_bands import one_off_bands
from texloom.stages.analysis.photographs.other_plane import other_plane
from texloom.stages.common.grids.size_checks import check_same_size
from texloom.stages.numerics.matrices import determinant
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.masks import valid_pixels, with_usable
from texloom.stages.vocabulary.progress import Progress, report

_LOG = logging.getLogger(__name__)

_MIN_SIDE = 24  # px of the shorter one
_ALL = 1000.0  # times as far as usual, from which on nothing is foreign
_OTHERS = 0.1  # of a picture without a plane, that is masked, from which it may be of several surfaces
_FEW, _DOUBT = 0.5, 0.25  # of the picture: little, and too little for a surface
_UNEVEN, _HARDLY_EVEN = 0.45, 0.70  # evenness below which what is left is several surfaces, and may be
_LINED = 1.25  # sides of the surface, of long lines, from which what does not repeat is a collage
_COLLAGE = (
    "no repetition is clear though long straight lines cross the surface, so that the texture joins pieces of what "
    "is shown once, such as windows and doors: {another}crop the photograph to what repeats (--crop), or give a "
    "mask of it (--source mask=foreign.png)"
)
_BANDED = (
    "a band across the surface that does not repeat is masked; it may be the border of another surface: look at "
    "foreign.png; {another}give another mask (--source mask=foreign.png)"
)
_MAIN = (
    "the picture shows several surfaces: the one that most of it looks like is taken, {:.0%} of it; look at "
    "foreign.png; {another}crop it to another (--crop), or give a mask of that (--source mask=foreign.png)"
)
_SEVERAL = (
    "no plane is evident, and {:.0%} of the photograph differ from the rest, so that it may show several surfaces: "
    "look at foreign.png, give another mask (--source mask=foreign.png), or crop it to one surface (--crop)"
)
_MAIN_SHARE, _BETTER = 0.1, 0.2  # of the photograph, of a surface taken of several, and evenness that it adds
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
    bands across it that do not repeat (`one_off_bands`), such as a cornice, these are foreign too. Where it still
    is not, and nothing repeats, all but the `main_surface` is foreign, if that is clearly more even and a tenth of
    the photograph. So is what stands out on a plain surface (`blemishes`).

    Parameters
    ----------
    image : the surface from the front.
    generators : of its lattice, as from `lattice_selection`; less than two count as none.
    mask : used instead, where it is given: what is darker than middle grey is foreign.
    plane : the table of `plane_proposal`. Where it found none, no lines say that the surface is flat, so that it is
        doubted sooner. What is refused or doubted names another plane where one is proposed.

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
        unlike, foreign, explained = foreign_search(image, before, generators, params.unlike)
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
    repeats = generators is not None and len(generators) > 0
    main = False
    if judged and not repeats and even < _HARDLY_EVEN:
        rest, after = main_surface(image, before, params.unlike, max(_HARDLY_EVEN, even + _BETTER))
        main = bool(rest.any() and rest.sum() >= _MAIN_SHARE / _share(plane) * before.sum())
        if main:
            usable, even, by = rest, after, "looks"
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
        if not main and (left < _DOUBT * float(before.mean()) or 0 < cells < 2):
            raise InputError(
                f"image: {why}: no surface stands out; keep all (--set unlike=1000), crop, or give a mask "
                "of exemplar.png (--source mask=my.png)"
            )
        _LOG.warning("%s", why)
    another = f"take another plane ({option}, by planes.png), or " if (option := other_plane(plane)) else ""
    doubt = _BANDED.format(another=another) if banded else ""
    doubt = _MAIN.format(1 - masked, another=another) if main else doubt
    frontal = plane is not None and bool(plane["unasked"])
    if doubted:
        flat = flatness(image, usable)
        if judged and even < _HARDLY_EVEN:
            doubt = _doubt(even, another)
        elif flat.reason and (flat.turning or flat.falling or flat.folding or frontal):
            doubt = _not_flat(flat, another)
        elif frontal and by == "looks" and masked >= _OTHERS and not doubt:
            doubt = _SEVERAL.format(masked)
        elif not (doubt or repeats) and long_lines(image, usable) >= _LINED:
            doubt = _COLLAGE.format(another=another)
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


def _share(plane: Mapping[str, Any] | None) -> float:
    """Of the photograph, that is on the plane that is taken."""
    if plane is None or not plane["taken"]:
        return 1.0
    return min(1.0, float(plane["planes"][plane["taken"] - 1]["area"]) * float(plane["extended"]))


def _not_flat(flat: Flatness, another: str) -> str:
    sure = "is" if flat.is_curved else "may be"
    return (
        f"the surface {sure} not flat and seen from the front: {flat.reason}; {another}give corners or control "
        "points (--set geometry=my.yaml); --set unlike=1000 takes it as flat"
    )


def _doubt(even: float, another: str) -> str:
    does = "do" if even < _UNEVEN else "may"
    return (
        f"parts of the surface differ as several surfaces {does} (evenness {even:.2f}), and no cell repeats: "
        f"{another}give corners or control points (--set geometry=my.yaml), or a mask of what belongs to it in "
        "exemplar.png (--source mask=my.png); --set unlike=1000 takes all as one surface"
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


def _blemished(image: Image, valid: Mask, usable: Mask) -> Mask:
    """What stands out on a plain surface, with a margin."""
    lab, small = as_searched(image, valid)
    found = blemishes(lab, small, small & ~counted(usable))
    return with_margin(found, usable.shape) if found.any() else np.zeros(usable.shape, np.bool_)
