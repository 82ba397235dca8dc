"""The coarse colours that a painted control map asks for, kept up to date while it is painted."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from jaxtyping import Float32

from texloom.stages.common.grids.pyramid import resize, scaled
from texloom.stages.common.per_pixel.levels import Rect
from texloom.stages.kernels.core.threads import run_all, spans, thread_count
from texloom.stages.numerics.matrices import row_product
from texloom.stages.synthesis.control_maps.coarse_level import Guide
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.sizes import format_size

_REACH = 2  # coarse pixels to every side that are compared
_CODES = 255  # of control: whole numbers, whose distances are exact in any order
_ALIKE = 1.5  # times the least squared difference, of places that are as good
_SAME = 0.01  # of control's range, the mean difference that counts as none
_MOST = 1 << 13  # coarse pixels of the texture; a larger coarse level is reduced to so many
_BLOCK = 512  # coarse pixels compared with all of the texture at a time
_MIN_SHARED_PIXELS = 20_000  # fewer are left to one thread


@dataclass(frozen=True)
class CoarseColours:
    """The colours of a texture without its detail, which a canvas of its compaction follows."""

    level: Image
    """the coarse level of the texture; see `coarse_level`"""
    control: Image
    """the control map of the texture, of its size"""
    guide: Guide
    """the colours at the compaction's pixels, CIELAB; see `compact`"""


def check_coarse(coarse: CoarseColours, image: Image, control: Image) -> None:
    """`InputError` where the colours do not belong to a compaction with its control map."""
    if coarse.guide.shape[:2] != (image.height, image.width):
        raise InputError(
            f"coarse: guide of {format_size(coarse.guide.shape[:2])} for an image of {format_size(image)}"
        )
    if coarse.control.channels != control.channels:
        raise InputError(
            f"coarse: control has channels {' '.join(coarse.control.channels)}, that of the image "
            f"{' '.join(control.channels)}"
        )
    if coarse.level.height > coarse.control.height or coarse.level.width > coarse.control.width:
        raise InputError(
            f"coarse: level of {format_size(coarse.level)} for a control map of {format_size(coarse.control)}"
        )


class PaintedColours:
    """A painted map and the colours that belong to it.

    Each coarse pixel takes the colour of one of the texture around which control is alike, 5 x 5 coarse pixels: of
    those that are about as good as the best the one nearest to its own place, in the texture and its mirror images
    around it. So under the texture's map they are its own colours, wide even areas show more than one of them, and
    a stroke changes only those near it. They are enlarged along the borders of control.

    Parameters
    ----------
    own : control of the texture, 0..1.
    colours : planes of the coarse level, of any range.
    size : height and width of what is painted, px.
    """

    def __init__(
        self,
        own: Float32[np.ndarray, "h w k"],
        colours: Float32[np.ndarray, "p q 3"],
        size: tuple[int, int],
        wrap: Wraps,
    ):
        few = min(1.0, sqrt(_MOST / (colours.shape[0] * colours.shape[1])))
        height, width = (scaled(side, few) for side in colours.shape[:2])
        self._wrap, self._period = wrap, (height, width)
        self._colours = resize(colours, height, width).reshape(-1, colours.shape[2])
        codes = np.empty((height, width, own.shape[2]), np.float32)
        _reduce(own, codes, Rect(0, height, 0, width))
        self._known = self._windows(codes, Rect(0, height, 0, width), Wraps())
        self._lengths = np.square(self._known).sum(axis=1)
        self._tolerance = np.float32(self._known.shape[1] * (_SAME * _CODES) ** 2)
        self._own = codes.reshape(-1, own.shape[2]) / np.float32(_CODES)
        sides = tuple(scaled(side, height / own.shape[0]) for side in size)
        self._codes = np.empty((*sides, own.shape[2]), np.float32)
        self._places = np.full(sides, -1, np.int64)
        self.planes = np.zeros((*size, own.shape[2] + colours.shape[2]), np.float32)
        """control as it is painted, 0..1, and the colours"""

    def paint(self, control: Float32[np.ndarray, "h w k"], top: int, left: int) -> Rect:
        """Replace a rectangle of control, which lies inside; where `planes` may have changed."""
        area = Rect(top, top + control.shape[0], left, left + control.shape[1])
        count = self._codes.shape[2]
        self.planes[area.top : area.bottom, area.left : area.right, :count] = control
        (rows, columns), (height, width) = self._places.shape, self.planes.shape[:2]
        blocks = Rect(
            _block(area.top, height, rows), _block(area.bottom - 1, height, rows) + 1,
            _block(area.left, width, columns), _block(area.right - 1, width, columns) + 1,
        )  # fmt: skip
        _reduce(self.planes[..., :count], self._codes, blocks)
        near = self._within(blocks.grown(_REACH))
        changed = self._within(self._match(near).grown(1))
        area = area.joined(
            Rect(
                _first(changed.top, height, rows), _first(changed.bottom, height, rows),
                _first(changed.left, width, columns), _first(changed.right, width, columns),
            )
        )  # fmt: skip
        self._enlarge(area)
        return area

    def _within(self, part: Rect) -> Rect:
        """The coarse pixels of a rectangle; along an axis that wraps all where it crosses the border."""
        rows, columns = self._places.shape
        top, bottom, left, right = part.top, part.bottom, part.left, part.right
        if self._wrap.down and (top < 0 or bottom > rows):
            top, bottom = 0, rows
        if self._wrap.across and (left < 0 or right > columns):
            left, right = 0, columns
        return Rect(top, bottom, left, right).within(Rect(0, rows, 0, columns))

    def _match(self, part: Rect) -> Rect:
        """Find the places of coarse pixels anew; those that have changed."""
        windows = self._windows(self._codes, part, self._wrap)
        down, across = (
            place.ravel()
            for place in np.meshgrid(
                _mirrored(np.arange(part.top, part.bottom), self._period[0]),
                _mirrored(np.arange(part.left, part.right), self._period[1]),
                indexing="ij",
            )
        )
        found = np.empty(len(windows), np.int64)
        for first in range(0, len(windows), _BLOCK):
            own = slice(first, first + _BLOCK)
            found[own] = self._nearest(windows[own], down[own], across[own])
        places = self._places[part.top : part.bottom, part.left : part.right]
        different = places != found.reshape(places.shape)
        places[:] = found.reshape(places.shape)
        rows, columns = np.flatnonzero(different.any(axis=1)), np.flatnonzero(different.any(axis=0))
        if not rows.size:
            return Rect(0, 0, 0, 0)
        return Rect(
            part.top + int(rows[0]), part.top + int(rows[-1]) + 1,
            part.left + int(columns[0]), part.left + int(columns[-1]) + 1,
        )  # fmt: skip

    def _nearest(self, windows: np.ndarray, down: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Of the places that are alike, the one nearest to a row and column of the texture."""
        lengths = np.square(windows).sum(axis=1)[:, None]
        unlike = lengths + self._lengths - 2 * row_product(windows, self._known.T)
        alike = unlike <= _ALIKE * unlike.min(axis=1, keepdims=True) + self._tolerance
        rows, columns = (np.arange(side, dtype=np.float32) for side in self._period)
        away = np.square(rows - down[:, None])[:, :, None] + np.square(columns - across[:, None])[:, None, :]
        nearest: np.ndarray = np.where(alike, away.reshape(alike.shape), np.inf).argmin(axis=1)
        return nearest

    def _windows(self, codes: Float32[np.ndarray, "h w k"], part: Rect, wrap: Wraps) -> np.ndarray:
        """Control around coarse pixels, a row of whole numbers each."""
        sides = (part.top, part.bottom), (part.left, part.right)
        rows, columns = (
            np.arange(first - _REACH, last + _REACH) % side
            if around
            else np.clip(np.arange(first - _REACH, last + _REACH), 0, side - 1)
            for (first, last), side, around in zip(sides, codes.shape[:2], wrap, strict=True)
        )
        side = 2 * _REACH + 1
        around = np.lib.stride_tricks.sliding_window_view(codes[np.ix_(rows, columns)], (side, side), axis=(0, 1))
        windows: np.ndarray = around.reshape(around.shape[0] * around.shape[1], -1)
        return windows

    def _enlarge(self, area: Rect) -> None:
        """Fill the colours of an area, px."""
        from texloom.stages.kernels.per_pixel.joint_bilinear import enlarge

        coarse, own = self._colours[self._places], self._own[self._places]
        shared = coarse, own, (self._wrap.down, self._wrap.across), self.planes, own.shape[2], area.left, area.right
        pixels = (area.bottom - area.top) * (area.right - area.left)
        pieces = spans(area.bottom - area.top, 1 if pixels < _MIN_SHARED_PIXELS else thread_count())
        run_all(enlarge, [(*shared, area.top + first, area.top + last) for first, last in pieces])


def _mirrored(index: np.ndarray, period: int) -> np.ndarray:
    """An index that runs to and fro between 0 and ``period``."""
    turned = index % (2 * period)
    return np.where(turned < period, turned, 2 * period - 1 - turned)


def _first(block: int, fine: int, coarse: int) -> int:
    """The first of ``fine`` pixels that belongs to one of ``coarse``."""
    return block * fine // coarse


def _block(pixel: int, fine: int, coarse: int) -> int:
    """The one of ``coarse`` pixels that one of ``fine`` belongs to."""
    return ((pixel + 1) * coarse - 1) // fine


def _reduce(control: Float32[np.ndarray, "H W k"], codes: Float32[np.ndarray, "h w k"], part: Rect) -> None:
    """Fill a part of the coarse codes: means of control, rounded."""
    bounds = [
        np.array([_first(number, fine, coarse) for number in range(first, last + 1)])
        for first, last, fine, coarse in zip(
            (part.top, part.left), (part.bottom, part.right), control.shape, codes.shape, strict=False
        )
    ]
    (top, bottom), (left, right) = ((int(one[0]), int(one[-1])) for one in bounds)
    sums = np.rint(control[top:bottom, left:right] * np.float32(_CODES)).astype(np.int64)
    for axis, one in enumerate(bounds):
        sums = np.add.reduceat(sums, one[:-1] - one[0], axis=axis)
    counts = np.diff(bounds[0])[:, None] * np.diff(bounds[1])
    codes[part.top : part.bottom, part.left : part.right] = np.rint(sums / counts[..., None])
