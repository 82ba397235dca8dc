"""Strips of another texture along the borders of a picture, by a line that parts them from the rest."""

from __future__ import annotations

import dataclasses
import itertools
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64

from texloom.stages.common.grids.pyramid import reduced, resized_mask
from texloom.stages.kernels.core.threads import run_spans
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.masks import fill_excluded

MIN_SIDE = 48  # px of the shorter side of a picture that is searched; less shows too little of all else
_SIDE = 256  # px of the longer side, at which they are searched
_BOXES = 20, 10  # of the shorter side, in which textures are compared
_LEAST_BOX = 6  # px
_STEPS = 1, 2, 4  # px to both sides, over which steepness is taken
_STEEP = 0.7  # weight of steepness against colours
_NOTICED = 1.5  # CIELAB, a deviation below which differences do not count
_NARROWEST, _WIDEST = 0.06, 0.35  # of the side: a strip
_MOST = 0.35  # share of the picture that all strips have
_CUTS = 2  # lines that are tried along each border
_LEAST_CORNER, _MOST_CORNER = 0.2, 0.8  # of the side: both sides of a corner
_CORNER_JUMP = 3.0  # CIELAB by which a corner differs across both of its lines
_JUMP = 0.25  # usual deviations of lines by which a strip differs from the rest, across its line too
_INSIDE, _OUTSIDE = 0.7, 0.3  # share of a box in a strip, from which it is of it, and down to which of the rest
_FEW, _FEW_OF_REST = 4, 20  # boxes
_NEAREST_OF_STRIP, _FARTHEST_OF_REST = 0.15, 0.9  # quantiles of distances that are compared
_LEAST_USUAL = 0.25  # of a unit: what is less does not show, however even a texture is
_APART, _APART_ONCE = 2.0, 3.0  # times as far from the rest, at each of two sizes of boxes, or at the only one
_PIECES = 16  # of work that threads share
_CONTOUR = 0.03  # of the side, beside a line, that are neither of the strip nor of the rest: it may be a contour
_BENDS = 0.1  # of the side, by which a line may bend away from the straight one
_STRAIGHT = 0.08  # of what tells a strip from the rest that a bent line has to win
_MARGIN = 2  # px by which strips are wider: their borders are soft

Features: TypeAlias = Float32[np.ndarray, "h w k"]


@dataclasses.dataclass(frozen=True)
class _Cut:
    """A line along a border, ``at`` px away from it; ``turns`` of a quarter to the left bring that border up.

    Of a corner it is the first ``wide`` px of the line, which then leads back to the border beside it.
    """

    turns: int
    at: int
    wide: int | None = None

    def strip(self, shape: tuple[int, int], margin: int = 0) -> Mask:
        inside = np.zeros(shape, np.bool_)
        wide = None if self.wide is None else self.wide + margin
        np.rot90(inside, self.turns)[: self.at + margin, :wide] = True
        return inside


def margin_search(image: Image, valid: Mask) -> Mask:
    """Strips of another texture along one or several borders of a picture; nowhere true where there are none.

    Texture is told by means in boxes of two sizes: of CIELAB, its deviations, and the steepness of lightness down
    and across over three lengths, in deviations of all boxes. Lines along each border, and around each corner, are
    tried where these jump. A strip is of another texture where nearly all of its boxes are at least twice as far
    from the most alike one of the rest as nearly all of the rest are from theirs: drifts, courses and large motifs
    have others like them.

    Parameters
    ----------
    image : searched at 256 px.
    valid : where it counts.

    References
    ----------
    Ours. [Efros2001]_ section 2.1 for the cheapest path, along which a strip ends.
    """
    known = _reduced(valid)
    texture = _Texture(image, known)
    cuts = [_cuts(texture, turns) for turns in range(4)]
    together = [*_together(cuts), *((cut,) for turns in range(4) for cut in _corner(texture, turns))]
    if not together:
        return np.zeros(valid.shape, np.bool_)
    boxes = texture.boxes()
    best = 1.0
    chosen: tuple[_Cut, ...] = ()
    for candidate in together:
        strips = [cut.strip(known.shape) for cut in candidate]
        if np.logical_or.reduce(strips)[known].sum() > _MOST * known.sum():
            continue
        apart = _apart(boxes, strips)
        if apart > best:
            best, chosen = apart, candidate
    found = np.zeros(known.shape, np.bool_)
    for cut in chosen:
        found |= _bent(texture, cut, chosen)
    return np.asarray(resized_mask(found, *valid.shape) & valid)


def is_another_texture(image: Image, valid: Mask, parts: Mask) -> bool:
    """Whether all pieces of ``parts`` touch a border of the picture and are of another texture than the rest.

    The measure is that of `margin_search`; pieces may have any contour, such as a corner, but not more than a third
    of the picture together.
    """
    import cv2

    known = _reduced(valid)
    small = _reduced(parts) & known
    if small.sum() > _MOST * known.sum():
        return False
    count, labels = cv2.connectedComponents(small.astype(np.uint8), connectivity=8)
    pieces = [labels == label for label in range(1, count)]
    touch = [piece[0].any() or piece[-1].any() or piece[:, 0].any() or piece[:, -1].any() for piece in pieces]
    return bool(pieces) and all(touch) and _apart(_Texture(image, known).boxes(), pieces) > 1


def _together(cuts: list[list[_Cut]]) -> list[tuple[_Cut, ...]]:
    """The cuts alone, the best ones of opposite borders, and of all: a frame."""
    alone = [(cut,) for cut in itertools.chain.from_iterable(cuts)]
    both = [pair for one in (0, 1) for pair in itertools.product(cuts[one], cuts[one + 2])]
    every = [tuple(one[0] for one in cuts)] if all(cuts) else []
    return [*alone, *both, *every]


@dataclasses.dataclass(frozen=True)
class _Boxes:
    """Boxes of one size, and how unlike their textures are."""

    places: Int64[np.ndarray, "n 3"]
    """first row and column, and side, px"""
    distances: Float64[np.ndarray, "n n"]
    """in usual deviations; infinite between boxes that are near"""

    def share(self, sums: Int32[np.ndarray, "H W"]) -> Float64[np.ndarray, "n"]:  # type: ignore[name-defined]
        """Share of each box that is in a mask of these `_sums`."""
        row, column, side = self.places.T
        below, beyond = row + side, column + side
        inside = sums[below, beyond] - sums[row, beyond] - sums[below, column] + sums[row, column]
        return np.asarray(inside / np.square(side))

    def nearest(self, some: np.ndarray, others: np.ndarray) -> Float64[np.ndarray, "n"]:  # type: ignore[name-defined]
        """How unlike the most alike of ``others`` is, of each of ``some``; 0 where all are near."""
        least = self.distances[some][:, others].min(axis=1)
        return np.where(np.isfinite(least), least, 0)


class _Texture:
    """Sums of what tells textures apart, over boxes."""

    def __init__(self, image: Image, known: Mask) -> None:
        lab = lab_from_linear(reduced(np.ascontiguousarray(fill_excluded(image).color), _SIDE))
        self.features: Features = np.concatenate([lab, *_steepness(lab[..., 0])], axis=2)
        self.known = known
        self.beside = max(_LEAST_BOX, round(min(known.shape) / _BOXES[0]))  # px on each side of a line
        planes = [self.features, np.square(lab), np.ones((*known.shape, 1), np.float32)]
        counted = np.concatenate(planes, axis=2) * known[..., None]
        self._sums = np.pad(counted.astype(np.float64).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0), (0, 0)))

    def means(
        self, turns: int, top: np.ndarray, bottom: np.ndarray, left: np.ndarray, right: np.ndarray
    ) -> tuple[Float64[np.ndarray, "*n k"], Float64[np.ndarray, "*n"]]:
        """Means of features and deviations of CIELAB between rows and columns, and how many px are known there.

        Of the picture after ``turns`` of a quarter to the left.
        """
        height, width = self.known.shape
        if turns == 1:
            top, bottom, left, right = left, right, width - bottom, width - top
        elif turns == 2:
            top, bottom, left, right = height - bottom, height - top, width - right, width - left
        elif turns == 3:
            top, bottom, left, right = height - right, height - left, top, bottom
        sums = self._sums
        total = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
        mean = total[..., :-1] / np.maximum(total[..., -1:], 1)
        mean[..., -3:] = np.sqrt(np.maximum(mean[..., -3:] - np.square(mean[..., :3]), 0))
        return mean, total[..., -1]

    def boxes(self) -> list[_Boxes]:
        """Of all sizes."""
        shorter = min(self.known.shape)
        return [self._boxes(max(_LEAST_BOX, round(shorter / count))) for count in _BOXES]

    def _boxes(self, side: int) -> _Boxes:
        """Beside each other, as far as they are known."""
        from texloom.stages.kernels.core.squared_distances import squared_distances

        rows, columns = (_evenly(length, side) for length in self.known.shape)
        places = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=2).reshape(-1, 2)
        row, column = places.T
        mean, count = self.means(0, row, row + side, column, column + side)
        shown = count >= _INSIDE * side * side
        places, units = np.column_stack([places, np.full(len(places), side)])[shown], mean[shown]
        if not len(places):
            return _Boxes(places, np.zeros((0, 0)))
        low, high = np.quantile(units, (0.25, 0.75), axis=0)
        units = units / ((high - low) / 1.35 + _NOTICED)
        distances = np.empty((len(units), len(units)))
        given = (np.ascontiguousarray(units.T), distances)
        run_spans(squared_distances, given, len(units), _PIECES)
        distances = np.sqrt(distances / units.shape[1])
        near = np.abs(places[:, None, :2] - places[None, :, :2]).max(axis=2) < 2 * side
        distances[near] = np.inf
        return _Boxes(places, distances)


def _steepness(lightness: ScalarMap) -> list[Features]:
    """How steep lightness is, down and across, over several lengths: (h, w, 1) each."""
    import cv2

    planes = []
    for step in _STEPS:
        size = (step + 1, step + 1)
        smooth = lightness if step == 1 else cv2.blur(lightness, size, borderType=cv2.BORDER_REFLECT)
        weight = np.float32(_STEEP / step**0.5)
        for axis in (0, 1):
            beside = [(step, step) if axis == one else (0, 0) for one in (0, 1)]
            wide = np.pad(smooth, beside, "edge")
            ends = np.arange(smooth.shape[axis])
            slope = np.take(wide, ends + 2 * step, axis) - np.take(wide, ends, axis)
            planes.append(np.asarray(np.abs(slope) * weight, np.float32)[..., None])
    return planes


def _evenly(length: int, side: int) -> np.ndarray:
    """First pixels of sections that cover a length with little overlap."""
    count = max(1, -(-length // side))
    return np.unique(np.rint(np.linspace(0, max(0, length - side), count)).astype(np.int64))


def _cuts(texture: _Texture, turns: int) -> list[_Cut]:
    """Lines along a border where the texture jumps most."""
    length, across = np.rot90(texture.known, turns).shape
    beside = texture.beside
    first, last = max(beside, round(_NARROWEST * length)), round(_WIDEST * length)
    if last <= first or length - last < beside:
        return []

    def means(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        zero = np.zeros_like(begin)
        made: np.ndarray = texture.means(turns, begin, end, zero, zero + across)[0]
        return made

    every = np.arange(length)
    lines = means(every, every + 1)
    usual = _NOTICED + 1.48 * np.median(np.abs(lines - np.median(lines, axis=0)), axis=0)
    at = np.arange(first, last + 1)
    strip = means(np.zeros_like(at), at) - means(at, np.full_like(at, length))
    jump = _length(strip / usual) * _length((means(at - beside, at) - means(at, at + beside)) / usual)
    found = []
    for _ in range(_CUTS):
        best = int(jump.argmax())
        if jump[best] < _JUMP**2:
            break
        found.append(_Cut(turns, int(at[best])))
        jump[np.abs(at - at[best]) <= beside] = 0
    return found


def _corner(texture: _Texture, turns: int) -> list[_Cut]:
    """The corner at both of whose lines the texture jumps most."""
    height, width = np.rot90(texture.known, turns).shape
    beside, means = texture.beside, texture.means
    downs, acrosses = (
        np.arange(max(beside, round(_LEAST_CORNER * length)), length - beside, beside // 2)
        for length in (height, width)
    )
    at, wide = (one.ravel() for one in np.meshgrid(downs, acrosses, indexing="ij"))
    fits = (at * wide <= _MOST * height * width) & (at <= _MOST_CORNER * height) & (wide <= _MOST_CORNER * width)
    at, wide = at[fits], wide[fits]
    if not len(at):
        return []

    def jump(at: np.ndarray, wide: np.ndarray) -> np.ndarray:
        zero = np.zeros_like(at)
        above, below = (means(turns, at + one, at + one + beside, zero, wide)[0] for one in (-beside, 0))
        left, right = (means(turns, zero, at, wide + one, wide + one + beside)[0] for one in (-beside, 0))
        return np.asarray(np.minimum(_length(above - below), _length(left - right)))

    best = int(jump(at, wide).argmax())
    near = np.arange(-(beside // 2), beside // 2 + 1)
    finer, wider = (one.ravel() for one in np.meshgrid(at[best] + near, wide[best] + near, indexing="ij"))
    inside = (finer >= beside) & (finer <= height - beside) & (wider >= beside) & (wider <= width - beside)
    finer, wider = finer[inside], wider[inside]
    steep = jump(finer, wider)
    most = int(steep.argmax())
    return [_Cut(turns, int(finer[most]), int(wider[most]))] if steep[most] >= _CORNER_JUMP else []


def _length(rows: np.ndarray) -> Float64[np.ndarray, "n"]:  # type: ignore[name-defined]
    return np.asarray(np.sqrt(np.square(rows).mean(axis=1)))


def _apart(sizes: list[_Boxes], parts: list[Mask]) -> float:
    """How many times farther each part is from the rest than is needed, at the size where that is least."""
    import cv2

    side = 2 * round(_CONTOUR * min(parts[0].shape)) + 1
    either = cv2.dilate(np.logical_or.reduce(parts).astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    sums_of_either, *sums = (_sums(mask) for mask in (either, *parts))
    found = []
    for boxes in sizes:
        rest = boxes.share(sums_of_either) <= _OUTSIDE
        inside = [boxes.share(one) >= _INSIDE for one in sums]
        if np.count_nonzero(rest) < _FEW_OF_REST or min(np.count_nonzero(one) for one in inside) < _FEW:
            continue
        usual = np.quantile(boxes.nearest(rest, rest), _FARTHEST_OF_REST)
        for one in inside:
            nearest = np.quantile(boxes.nearest(one, rest), _NEAREST_OF_STRIP)
            found.append(float(nearest) / max(float(usual), _LEAST_USUAL))
    if not found:
        return 0.0
    return min(found) / (_APART if len(found) > len(parts) else _APART_ONCE)


def _sums(mask: Mask) -> Int32[np.ndarray, "H W"]:
    """How many pixels of a mask are above and left of each corner of a pixel."""
    out = np.zeros((mask.shape[0] + 1, mask.shape[1] + 1), np.int32)
    np.cumsum(mask, axis=0, dtype=np.int32, out=out[1:, 1:])
    np.cumsum(out[1:, 1:], axis=1, out=out[1:, 1:])
    return out


def _reduced(mask: Mask) -> Bool[np.ndarray, "H W"]:
    return np.asarray(reduced(mask[..., None].astype(np.float32), _SIDE)[..., 0] > 0.5)


def _bent(texture: _Texture, cut: _Cut, chosen: tuple[_Cut, ...]) -> Mask:
    """A strip with the contour at which it ends, where a straight line ends it clearly worse, and a margin."""
    if cut.wide is not None:
        return cut.strip(texture.known.shape, _MARGIN)
    from texloom.stages.kernels.seams.boundary_cut import cheapest_path

    shape = texture.known.shape
    strips = np.logical_or.reduce([one.strip(shape) for one in chosen])
    of_strip, of_rest, spread = _moments(texture, cut.strip(shape), ~strips)
    weight = (of_strip - of_rest) / (spread + _NOTICED**2)
    middle = (of_strip + of_rest) / 2
    odds = ((texture.features - middle) * weight).sum(axis=2) * texture.known
    turned = np.rot90(odds, cut.turns)
    reach = round(_BENDS * len(turned))
    first, last = max(1, cut.at - reach), min(len(turned) - 1, cut.at + reach)
    near = np.pad(turned[first:last], ((1, 0), (0, 0)))
    wrong = -2 * near.cumsum(axis=0)  # of what lies before a line, against all that lies behind it
    path = np.empty(wrong.shape[1], np.int64)
    cheapest_path(np.ascontiguousarray(wrong.T, np.float32), path)
    straight = float(wrong[cut.at - first].sum())
    won = straight - float(wrong[path, np.arange(len(path))].sum())
    ends = path + first if won > _STRAIGHT * abs(straight) else np.full(len(path), cut.at)
    made = np.zeros(shape, np.bool_)
    np.rot90(made, cut.turns)[:] = np.arange(len(turned))[:, None] < ends + _MARGIN
    return made


def _moments(texture: _Texture, strip: Mask, rest: Mask) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means of the features of two parts, and the sum of their variances."""
    one, other = (texture.features[mask & texture.known].astype(np.float64) for mask in (strip, rest))
    return one.mean(axis=0), other.mean(axis=0), one.var(axis=0) + other.var(axis=0)
