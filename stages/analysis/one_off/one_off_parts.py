"""What an exemplar shows once, so that a texture of it would repeat it, or show it in pieces."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from texloom.stages.analysis.one_off.crossing_lines import crossing_line
from texloom.stages.analysis.one_off.foreign_search import foreign_search, looks_foreign
from texloom.stages.analysis.one_off.margin_search import MIN_SIDE, is_another_texture
from texloom.stages.common.grids.pyramid import resized_mask
from texloom.stages.vocabulary.arrays import Image, Mask, Vectors
from texloom.stages.vocabulary.declare import Outline, Params, stage
from texloom.stages.vocabulary.masks import valid_pixels, with_usable
from texloom.stages.vocabulary.messages import OWN_STEP
from texloom.stages.vocabulary.progress import Progress, report

_LOG = logging.getLogger(__name__)

_SURE, _DOUBTFUL = 4.0, 3.5  # times as unlike the rest as is usual: none, and one, of 38 shared exemplars had more
_SURE_LINE, _DOUBTFUL_LINE = 1.6, 1.42  # times as visible as the next line; the exemplars had at most 1.38
_LINES, _FEW = 3, 3  # at most, of lines and doubtful parts; what is there more often is how the exemplar is
_MOST = 0.125  # of what is usable; more is no part but what the exemplar is of
_THIN = 0.05  # of the exemplar, of a line among several materials: broader ones are where these meet
_OTHERWISE = {
    "told": f": --set {OWN_STEP}.one_off=leave_out leaves it out, one_off=keep_whole lays it once",
    "left out": f": --set {OWN_STEP}.one_off=use uses all alike, one_off=keep_whole lays them once",
}
"""what may be done instead"""
_SHADE = np.array([0.6, 0.0, 0.25], np.float32)


class OneOffPartsParams(Params):
    """What happens to parts that are shown once."""

    one_off: Literal["auto", "leave_out", "keep_whole", "use"] = "auto"
    """`auto`: what is surely shown once is left out, doubtful parts are only told; `leave_out`: doubtful parts too
    are left out; `keep_whole`: both are left out here, and kept for `whole_parts`, which lays each once, whole, or
    across all of the result; `use`: nothing is searched, and all is used alike"""


@dataclasses.dataclass(frozen=True)
class OneOffParts:
    """The exemplar without what it shows once, or all of it."""

    image: Image
    """with a channel `usable`, 0 on parts that are left out; as it was where none is"""
    kept: Mask
    """true on parts that are to be laid whole into the result; nowhere unless `keep_whole`"""
    picture: Image | None
    """the exemplar with the parts under a tint; None without parts"""
    mask: Image | None
    """the parts, black on white, to edit and give back; None without parts"""
    table: dict[str, Any]
    """``why``: a sentence, empty without parts; ``done``: `left out`, `kept whole`, `told` or `none`; ``share``: of
    what is usable, the parts; ``sure``: whether they surely are parts; ``unlike``: how many times as far from what
    explains it the least explained place is than is usual, 0 where none looked so; ``lines``: for each line
    across, how many times it stands out more than the next"""


@dataclasses.dataclass(frozen=True)
class _Detection:
    mask: Mask
    sure: bool
    unlike: float = 0.0
    lines: tuple[float, ...] = ()
    margins: bool = False


def outlines(params: OneOffPartsParams, known: Mapping[str, Any]) -> dict[str, Outline]:  # noqa: ARG001
    """The image keeps its size and maps."""
    image = known.get("image")
    return {} if image is None else {"image": Outline(image.height, image.width, image.channels)}


@stage(version=1, outlines=outlines, seconds=(0.4, 0))
def one_off_parts(
    image: Image, params: OneOffPartsParams, generators: Vectors | None = None, margins: Mask | None = None
) -> OneOffParts:
    """Find what an exemplar shows once, and leave it out where that is sure.

    Two searches: parts that no quarter of the exemplar looks like, as `foreign_parts` of photographs are, which the
    mean cell of a lattice does not explain either: signs, stains, cornices; and lines from border to border that
    stand out more than any other, see `crossing_line`: pipes and cracks. Together they are at most an eighth of the
    exemplar; more is left out at its borders, up to a third of it, where it surely is another texture, see
    `is_another_texture`, and else told as doubtful where it is in few pieces, since then it has several materials.

    Parameters
    ----------
    image : the exemplar; what is excluded in it is not looked at.
    generators : of its lattice, as from `lattice_selection`; less than two count as none.
    margins : strips of another material, as of `foreign_margins`, that are excluded in it already; maybe of another
        size than the image, which was scaled.

    References
    ----------
    Ours; see `foreign_search` and `crossing_line`.

    Examples
    --------
    >>> import numpy as np, texloom
    >>> wall = np.random.default_rng(0).uniform(0.4, 0.6, (96, 96, 3)).astype(np.float32)
    >>> wall[20:36, 40:64] = (0.6, 0.0, 0.0)
    >>> texloom.stages.one_off_parts(wall).table["done"]
    'left out'
    """
    known = valid_pixels(image)
    valid = np.ones((image.height, image.width), np.bool_) if known is None else known
    found = _Detection(np.zeros(valid.shape, np.bool_), False)
    if params.one_off != "use" and min(valid.shape) >= MIN_SIDE:
        found = _found(image, valid, generators)
    if margins is not None and margins.any() and params.one_off != "use":
        found = _with_margins(found, margins, doubtful=params.one_off != "auto")
    left_out = params.one_off == "leave_out" or (params.one_off == "auto" and found.sure)
    done = "none"
    if found.mask.any():
        done = "kept whole" if params.one_off == "keep_whole" else "left out" if left_out else "told"
    elif params.one_off in ("leave_out", "keep_whole"):
        _LOG.warning("nothing in the exemplar is shown once, so that one_off=%s changes nothing", params.one_off)
    share = float(found.mask.sum()) / float((valid | found.mask).sum())
    why = _why(done, share, found)
    if why:
        _LOG.warning("%s%s", why, _OTHERWISE.get(done, ""))
    table = {
        "why": why,
        "done": done,
        "share": round(share, 4),
        "sure": found.sure,
        "unlike": round(found.unlike, 2),
        "lines": [round(line, 2) for line in found.lines],
    }
    without = with_usable(image, valid & ~found.mask) if done in ("left out", "kept whole") else image
    return OneOffParts(
        image=without,
        kept=found.mask if done == "kept whole" else np.zeros(valid.shape, np.bool_),
        picture=None if done == "none" else _tinted(image, found.mask),
        mask=None if done == "none" else _drawn(np.repeat(~found.mask[..., None], 3, axis=2)),
        table=table,
    )


def _tinted(image: Image, parts: Mask) -> Image:
    return _drawn(np.where(parts[..., None], 0.3 * image.color + _SHADE, image.color))


def _drawn(planes: np.ndarray) -> Image:
    return Image(np.asarray(planes, np.float32), ("R", "G", "B"))


def _found(image: Image, valid: Mask, generators: Vectors | None) -> _Detection:
    """The parts, and whether they surely are: sure ones, or where there are none, doubtful ones."""
    repeats = generators is not None and len(generators) == 2  # then its mean cell leaves little doubt
    thresholds = (_SURE,) if repeats else (_SURE, _DOUBTFUL)
    unlike, looks = 0.0, looks_foreign(image, valid, generators, thresholds[-1])
    parts, doubtful = (np.zeros(valid.shape, np.bool_) for _ in range(2))
    several = False  # materials
    for threshold in thresholds if looks else ():
        far, foreign, _ = foreign_search(image, valid, generators, threshold, less=1.0)
        unlike = max(unlike, float(far.max()))
        foreign &= valid
        if foreign.sum() > _MOST * valid.sum():
            several = _pieces(foreign) > _FEW  # as flowers and their ground are: none is foreign
            if several:
                break
            sure = threshold == _SURE and is_another_texture(image, valid, foreign)
            return _Detection(foreign, sure, unlike, margins=sure)
        if foreign.any():
            if threshold == _SURE:
                parts = foreign
            elif _pieces(foreign) <= _FEW:
                doubtful = foreign
            break
    report(Progress(0.7))
    lines: list[float] = []
    for _ in range(_LINES):
        rest = valid & ~parts & ~doubtful
        line = crossing_line(image if rest.all() else with_usable(image, rest), rest)
        if line is None or line.stands_out < _DOUBTFUL_LINE or (several and line.mask.mean() > _THIN):
            break
        if line.stands_out < _SURE_LINE:
            if not parts.any():
                doubtful, lines = doubtful | line.mask, [*lines, line.stands_out]
            break
        parts, lines = parts | line.mask, [*lines, line.stands_out]
    sure = bool(parts.any() and parts.sum() <= _MOST * valid.sum())
    return _Detection(parts if parts.any() else doubtful, sure, unlike, tuple(lines))


def _with_margins(found: _Detection, margins: Mask, doubtful: bool) -> _Detection:
    """With strips along the borders, which are sure; and with doubtful parts only where these are asked for."""
    strips = resized_mask(margins, *found.mask.shape)
    kept = found if found.sure or doubtful else _Detection(np.zeros_like(strips), True, found.unlike)
    return dataclasses.replace(kept, mask=kept.mask | strips, sure=True, margins=True)


def _pieces(parts: Mask) -> int:
    import cv2

    return int(cv2.connectedComponents(parts.astype(np.uint8), connectivity=8)[0]) - 1


def _why(done: str, share: float, found: _Detection) -> str:
    if done == "none":
        return ""
    what = "unlike all the rest" if not found.lines else "unlike all the rest, or in a line that crosses it once"
    if found.margins:
        what += ", along a border"
    if done == "told" and share > _MOST:
        return f"{share:.0%} of the exemplar are unlike all the rest, as another material is; all is used alike"
    if done == "told":
        return f"{share:.1%} of the exemplar may be shown once ({what}); it is used like all else"
    if done == "kept whole":
        return f"{share:.1%} of the exemplar are shown once ({what}), and are laid whole into the result"
    return f"{share:.1%} of the exemplar are shown once ({what}), and are left out"
