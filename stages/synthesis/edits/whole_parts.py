"""Parts that an exemplar shows once, laid whole into a texture that was made without them."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Int64

from texloom.stages.synthesis.stitching.cuts import Strips, enclosed
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Outline, Params, stage
from texloom.stages.vocabulary.masks import without_usable
from texloom.stages.vocabulary.sizes import format_size

_LOG = logging.getLogger(__name__)

_RING = 1 / 16, 12  # of the exemplar's shorter side, and px at least: around a part, in which it is cut out
_OVERLAP = 1 / 6  # of a part that crosses the exemplar, with the piece that continues it
_REACH = 48  # px around the wanted place, at most a third of the exemplar, in which the best one is searched
_CONTINUES = 3  # px across, by which a piece may be moved to continue the one before
_COMPARED = 1200  # pixels of the ring
_UNIT = 16.0  # steps of a CIELAB unit in sums, which are then the same on all machines
_EDGE = 0.02  # of the exemplar's side, from its border, that a part reaches which crosses it


@dataclasses.dataclass(frozen=True)
class WholeParts:
    """The texture with the parts."""

    image: Image
    """all its channels"""
    match: Correspondence
    """source of each pixel in the exemplar"""
    exemplar: Image
    """the one with the parts, which the texture is now of"""
    pieces: list[dict[str, int]]
    """``row``, ``column``, ``height``, ``width``, px, of each piece of the exemplar that was laid"""


@dataclasses.dataclass(frozen=True)
class _PartBox:
    """A rectangle of the exemplar around a part."""

    top: int
    left: int
    height: int
    width: int

    @property
    def size(self) -> Int64[np.ndarray, "2"]:
        return np.array([self.height, self.width])


def outlines(params: Params, known: Mapping[str, Any]) -> dict[str, Outline]:  # noqa: ARG001
    """The texture keeps its size and maps."""
    image = known.get("image")
    return {} if image is None else {"image": Outline(image.height, image.width, image.channels)}


@stage(version=1, outlines=outlines, in_bands=True)
def whole_parts(exemplar: Image, image: Image, match: Correspondence, kept: Mask) -> WholeParts:
    """Lay each part once into a texture: at its own place, relative to the sides, or across all of the texture.

    A part is laid with a ring of what is around it, where this differs least from the texture, near the wanted
    place, so that courses and lattices go on; the minimum cut through the ring joins both. Of a part from border to
    border, as a pipe, pieces of the whole exemplar follow each other, each where it continues the one before.

    Parameters
    ----------
    exemplar : with the parts.
    image, match : the texture, made without them, and its source map.
    kept : true on the parts, of the exemplar's size; nothing is done where it is nowhere.

    Raises
    ------
    InputError
        ``kept`` has not the exemplar's size.

    References
    ----------
    [Kwatra2003]_ section 4: patches are placed where they match, and cut out; the chain of pieces is ours.
    """
    if kept.shape != (exemplar.height, exemplar.width):
        raise InputError(f"kept is {format_size(kept.shape)}, the exemplar {format_size(exemplar)}")
    if not kept.any():
        return WholeParts(image, match, exemplar, [])
    laying = _Laying(without_usable(exemplar), image, match)
    for part in _components(kept):
        laying.lay(part)
    return WholeParts(image.with_pixels(laying.pixels), laying.match, exemplar, laying.pieces)


def _components(kept: Mask) -> list[Mask]:
    import cv2

    count, labels = cv2.connectedComponents(kept.astype(np.uint8), connectivity=8)
    return [labels == label for label in range(1, count)]


class _Laying:
    """A texture into which pieces of its exemplar are laid."""

    def __init__(self, exemplar: Image, image: Image, match: Correspondence):
        self.exemplar = exemplar
        self.wraps = image.wraps
        self.own = np.rint(lab_from_linear(exemplar.color) * _UNIT).astype(np.int64)
        self.lab = np.rint(lab_from_linear(image.color) * _UNIT).astype(np.int64)
        self.pixels, self.match = image.pixels.copy(), match.copy()
        self.size = np.array(match.shape[:2])
        self.ring = max(_RING[1], round(_RING[0] * min(self.own.shape[:2])))
        self.reach = min(_REACH, min(self.own.shape[:2]) // 3)
        self.pieces: list[dict[str, int]] = []

    def lay(self, part: Mask) -> None:
        """A part, once, or from border to border."""
        shape = np.array(part.shape)
        rows, columns = np.nonzero(part)
        first = np.array([rows.min(), columns.min()])
        last = np.array([rows.max(), columns.max()]) + 1
        edge = _EDGE * shape
        crosses = [axis for axis in (0, 1) if first[axis] <= edge[axis] and last[axis] >= (shape - edge)[axis]]
        low, high = np.maximum(first - self.ring, 0), np.minimum(last + self.ring, shape)
        piece = _PartBox(*(int(value) for value in (*low, *(high - low))))
        wanted = np.rint((first + last) / 2 / shape * self.size - (first + last) / 2 + low).astype(np.int64)
        if len(crosses) != 1:
            inner = np.clip(wanted, 0, np.maximum(self.size - (high - low), 0))
            self._put(part, piece, self._best(part, piece, inner, None, 0), None, 0)
            return
        axis = crosses[0]
        if self.wraps[axis]:
            _LOG.warning("a part crosses the exemplar: it may not meet itself at the borders of the result")
        length = int((high - low)[axis])
        overlap = max(1, round(_OVERLAP * length))
        begun, ended = (_middle(part, axis, slice(*ends)) for ends in ((0, overlap), (length - overlap, length)))
        wanted[axis] = 0
        before = 0
        while wanted[axis] + before < self.size[axis]:
            place = self._best(part, piece, wanted, axis, before)
            self._put(part, piece, place, axis, before)
            before = overlap
            wanted = place.copy()
            wanted[axis] += length - overlap
            wanted[1 - axis] += round(ended - begun)

    def _best(
        self, part: Mask, piece: _PartBox, wanted: Int64[np.ndarray, "2"], axis: int | None, before: int
    ) -> np.ndarray:
        """The place near the wanted one at which the piece differs least from what is there."""
        inside = part[piece.top : piece.top + piece.height, piece.left : piece.left + piece.width]
        counts = ~inside
        if axis is not None and before:
            along = np.arange(inside.shape[axis])
            begins = (along < before).reshape((-1, 1) if axis == 0 else (1, -1))
            counts = counts | begins  # the part itself is there
        rows, columns = np.nonzero(counts)
        some = slice(None, None, max(1, len(rows) // _COMPARED))
        rows, columns = rows[some], columns[some]
        own = self.own[rows + piece.top, columns + piece.left]
        reach = np.array([self.reach, self.reach])
        if axis is not None and before:
            reach[1 - axis] = min(self.reach, _CONTINUES)
            reach[axis] = min(self.reach, before // 2)
        best, least = wanted, np.inf
        for down in range(-int(reach[0]), int(reach[0]) + 1):
            for across in range(-int(reach[1]), int(reach[1]) + 1):
                at = (wanted[0] + down + rows, wanted[1] + across + columns)
                seen = (at[0] >= 0) & (at[0] < self.size[0]) & (at[1] >= 0) & (at[1] < self.size[1])
                leaves = axis is not None and not before and (down, across)[axis] > 0  # its border would be seen
                if leaves or 4 * np.count_nonzero(seen) < len(seen):
                    continue
                cost = np.square(own[seen] - self.lab[at[0][seen], at[1][seen]]).sum() / np.count_nonzero(seen)
                if cost < least:
                    best, least = wanted + np.array([down, across]), float(cost)
        return np.asarray(best)

    def _put(self, part: Mask, piece: _PartBox, place: np.ndarray, axis: int | None, before: int) -> None:
        """Copy the piece inside the minimum cut through its ring."""
        low = np.maximum(place, 0)
        high = np.minimum(place + piece.size, self.size)
        if (high <= low).any():
            return
        there = slice(low[0], high[0]), slice(low[1], high[1])
        source = low - place + np.array([piece.top, piece.left])
        here = tuple(slice(start, start + extent) for start, extent in zip(source, high - low, strict=True))
        errors = np.square(self.own[here] - self.lab[there]).sum(axis=2).astype(np.float32)
        inside = part[here]
        widths = self._widths(inside, axis, before)
        new, _ = enclosed(errors, Strips(*widths))
        self.pixels[there][new] = self.exemplar.pixels[here][new]
        self.lab[there][new] = self.own[here][new]
        rows, columns = np.nonzero(new)
        self.match[there][new] = np.stack([rows + source[0], columns + source[1]], axis=1)
        self.pieces.append(
            {
                "row": int(low[0]),
                "column": int(low[1]),
                "height": int(high[0] - low[0]),
                "width": int(high[1] - low[1]),
            }
        )

    def _widths(self, inside: Mask, axis: int | None, before: int) -> tuple[int, int, int, int]:
        """Of the strips above, left, below and right of the part; of the piece before, its overlap."""
        rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
        if not len(rows):
            return 0, 0, 0, 0
        widths = [int(rows[0]), int(columns[0]), inside.shape[0] - 1 - int(rows[-1])]
        widths.append(inside.shape[1] - 1 - int(columns[-1]))
        if axis is not None:
            widths[axis], widths[axis + 2] = min(before, inside.shape[axis] - 1), 0
        return widths[0], widths[1], widths[2], widths[3]


def _middle(part: Mask, axis: int, ends: slice) -> float:
    """Mean place across, px, of a part between two places along ``axis``."""
    some = part[ends] if axis == 0 else part[:, ends]
    places = np.nonzero(some)[1 - axis]
    return float(places.mean()) if len(places) else 0.0
