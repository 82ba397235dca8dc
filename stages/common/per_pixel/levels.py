"""Per-pixel synthesis of a window of an endless texture, or of a torus; whole, or where something has changed."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int16, Int32, Integer

from texloom.stages.common.per_pixel.phases import Phases
from texloom.stages.common.per_pixel.tables import Tables
from texloom.stages.kernels.core.elementary_functions import log2
from texloom.stages.kernels.core.threads import run_all, spans, thread_count
from texloom.stages.kernels.per_pixel.arguments import Bonuses, Distortion, LevelState, PhaseMaps, Pieces, Subpass
from texloom.stages.vocabulary.arrays import Jacobian
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.progress import Progress, report

SUBPASSES = ((0, 0), (1, 1), (0, 1), (1, 0))
"""row and column, modulo 2, of the pixels of each subpass of a correction pass"""

_MIN_SHARED_PIXELS = 3000  # of a subpass; fewer are left to one thread
NO_REPETITION = PhaseMaps(np.zeros((1, 2), np.uint32), np.zeros((1, 2), np.uint32), (0, 0, 0, 0))
"""that of an exemplar that does not repeat"""


@dataclass(frozen=True)
class Rect:
    """Rows ``top`` to ``bottom`` and columns ``left`` to ``right``, the ends not included; empty if none."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def empty(self) -> bool:
        """Whether it has no pixel."""
        return self.bottom <= self.top or self.right <= self.left

    def grown(self, down: int, across: int | None = None) -> "Rect":
        """Dilated by ``down`` px above and below and ``across``, else as many, beside; an empty one stays so."""
        if self.empty:
            return self
        beside = down if across is None else across
        return Rect(self.top - down, self.bottom + down, self.left - beside, self.right + beside)

    def moved(self, rows: int, columns: int) -> "Rect":
        """Shifted."""
        return Rect(self.top + rows, self.bottom + rows, self.left + columns, self.right + columns)

    def within(self, other: "Rect") -> "Rect":
        """The intersection."""
        return Rect(
            max(self.top, other.top),
            min(self.bottom, other.bottom),
            max(self.left, other.left),
            min(self.right, other.right),
        )

    def joined(self, other: "Rect") -> "Rect":
        """The bounding rectangle of both."""
        if self.empty or other.empty:
            return other if self.empty else self
        return Rect(
            min(self.top, other.top),
            max(self.bottom, other.bottom),
            min(self.left, other.left),
            max(self.right, other.right),
        )

    @property
    def coarser(self) -> "Rect":
        """The pixels of the next coarser level whose children it holds."""
        return Rect(self.top // 2, -(-self.bottom // 2), self.left // 2, -(-self.right // 2))

    @property
    def finer(self) -> "Rect":
        """All children."""
        return Rect(2 * self.top, 2 * self.bottom, 2 * self.left, 2 * self.right)


NOTHING = Rect(0, 0, 0, 0)

Extent: TypeAlias = tuple[int, int, int, int]


def halved(planes: Float32[np.ndarray, "H W k"]) -> Float32[np.ndarray, "p q k"]:
    """Means of 2x2 pixels; the last row and column count twice where a side is odd."""
    from texloom.stages.kernels.per_pixel.control_pyramid import halve

    height, width, count = planes.shape
    coarse = np.empty((-(-height // 2), -(-width // 2), count), np.float32)
    halve(np.ascontiguousarray(planes), coarse, 0, coarse.shape[1], 0, coarse.shape[0])
    return coarse


def distortion_of(tables: Tables, own: Jacobian, number: int) -> Distortion:
    """The distortion of a level's texels, by their Jacobians.

    Every texel is compared at the level of the exemplar whose samples are as far apart as its own.
    """
    assert tables.jacobian is not None, "the tables are those of a texture that is not distorted"
    a, b, c, d = np.moveaxis(own, 2, 0)
    determinant = a * d - b * c
    finest = number - log2(np.abs(determinant)) / 2
    sampled = np.clip(np.rint(finest), 0, tables.levels - 1)
    factor = np.ldexp(1.0, (number - sampled).astype(np.int32)) / determinant
    inverse = np.stack([d * factor, -b * factor, -c * factor, a * factor], axis=2).astype(np.float32)
    return Distortion(tables.jacobian, inverse.reshape(-1, 4), sampled.astype(np.uint8).ravel())


def piece_starts(tables: Tables) -> Int32[np.ndarray, "*n"]:
    """The places around which pieces of a distorted exemplar are taken."""
    nearest_valid = tables.candidates[-tables.places :, 0]
    return np.flatnonzero(nearest_valid == np.arange(len(nearest_valid))).astype(np.int32)


@dataclass(frozen=True)
class Style:
    """Params of the arrangement in the units of the kernels."""

    key: int
    """of the random numbers, 64 bits"""
    jitter: tuple[float, ...]
    """greatest displacement at each level, finest first, in steps, 0..1"""
    passes: tuple[int, ...]
    """corrections of each level, finest first; a level's result depends on 4 px a pass around it"""
    block: int
    """side of the pieces that the coarsest level starts from, px of that level"""
    tries: int
    """places tried for a piece under control"""
    coherence_bonus: int
    """see `texloom.stages.kernels.per_pixel.arguments.Bonuses`"""
    control_bonus: int
    tolerance: float
    """deviation from the wanted control that counts as none, 0..1"""

    def key_of(self, number: int) -> np.uint64:
        """Of the random numbers of a level."""
        return np.uint64((self.key + number) % 2**64)

    def amplitude_of(self, number: int) -> int:
        """Greatest displacement at a level, 2**-16 px."""
        return round(min(self.jitter[number], 1.0) * 65536 * (1 << number))

    def tolerance_of(self, number: int, strengths: tuple[float, ...]) -> int:
        """Squared distance from the wanted control that counts as none at a level; see `Tables.strengths`."""
        return round((self.tolerance * strengths[number]) ** 2) if strengths else 0


@dataclass
class Level:
    """The state of a level: an array for what comes from the coarser level, and one for each pass.

    Arrays cover a window with all it depends on; along axes that wrap all there is, with a border of one pixel.
    Rectangles in methods are in pixels of the array.
    """

    number: int
    origin: tuple[int, int]
    """of the arrays in the endless result, px of the level; -1 where it wraps"""
    wrap: Wraps
    states: Integer[np.ndarray, "states rows columns"]
    given: Int16[np.ndarray, "rows columns k"]
    pinned: Integer[np.ndarray, "pinned_rows pinned_columns"]
    distortion: Distortion | None = None

    @property
    def for_kernels(self) -> LevelState:
        """As kernels take it, where the arrays are explained."""
        return LevelState(self.number, *self.origin, self.states, self.given, self.pinned)

    @property
    def everything(self) -> Rect:
        """The whole arrays, but for borders where it wraps."""
        rows, columns = self.states.shape[1:]
        return Rect(0, rows, 0, columns).grown(-int(self.wrap.down), -int(self.wrap.across))

    def allowed(self, subpasses: int) -> Rect:
        """The pixels that can be computed in so many subpasses from the beginning of the level."""
        return self.everything.grown(*self.wrap.where_open(-subpasses))

    def reach(self, changed: Rect, by: int) -> Rect:
        """The pixels that ``changed`` can influence; all rows or columns where it crosses a border that wraps."""
        grown = changed.grown(by)
        if not self.wrap or grown.empty:
            return grown
        whole = self.everything
        if self.wrap.down and (grown.top < whole.top or grown.bottom > whole.bottom):
            grown = replace(grown, top=whole.top, bottom=whole.bottom)
        if self.wrap.across and (grown.left < whole.left or grown.right > whole.right):
            grown = replace(grown, left=whole.left, right=whole.right)
        return grown

    def close(self, state: int) -> None:
        """Copy the opposite sides into borders that wrap."""
        array = self.states[state]
        if self.wrap.down:
            array[0], array[-1] = array[-2], array[1]
        if self.wrap.across:
            array[:, 0], array[:, -1] = array[:, -2], array[:, 1]


def subpass(number: int, index: int) -> Subpass:
    """Subpass ``index`` of pass ``number``."""
    row, column = SUBPASSES[index]
    beside = (1 - row, column), (row, 1 - column), (1 - row, 1 - column)
    return Subpass(number, *(int(SUBPASSES.index(other) < index) for other in beside))


def _in_strips(kernel: Callable[..., Extent], shared: tuple[Any, ...], area: Rect, step: int) -> Rect:
    """Run a kernel over the rows of ``area`` on all threads; where anything has changed."""
    if area.empty:
        return NOTHING
    rows = -(-(area.bottom - area.top) // step)
    pixels = rows * -(-(area.right - area.left) // step)
    pieces = 1 if pixels < _MIN_SHARED_PIXELS else thread_count()
    if pixels > 8 * _MIN_SHARED_PIXELS:
        pieces *= 4
    calls = [
        (*shared, (area.top + first * step, min(area.bottom, area.top + last * step), area.left, area.right))
        for first, last in spans(rows, pieces)
    ]
    changed = NOTHING
    for part in run_all(kernel, calls):
        changed = changed.joined(Rect(*part))
    return changed


class Levels:
    """All levels of a result.

    Parameters
    ----------
    window : rows and columns of the endless result, px; along axes that wrap from 0, sides divisible by twice the
        coarsest step.
    """

    def __init__(self, tables: Tables, style: Style, window: Rect, wrap: Wraps):
        self.tables, self.style, self.window, self.wrap = tables, style, window, wrap
        self.levels: list[Level] = []
        self.repetition = NO_REPETITION
        self.pieces = Pieces(tables.core, tables.endless, np.zeros(1, np.int32), style.block, style.tries)
        self.bonuses = Bonuses(style.coherence_bonus, style.control_bonus)
        area = window
        dimensions = tables.values.shape[1] - 8
        for number in range(tables.levels):
            passes = style.passes[number]
            area = area.grown(1 if wrap.down else 4 * passes, 1 if wrap.across else 4 * passes)
            shape = (area.bottom - area.top, area.right - area.left)
            self.levels.append(
                Level(
                    number=number,
                    origin=(area.top, area.left),
                    wrap=wrap,
                    states=np.full((passes + 1, *shape), -1, np.int32),
                    given=np.zeros((*shape, dimensions), np.int16),
                    pinned=np.empty((0, 0), np.int32),
                )
            )
            area = area.grown(-int(wrap.down), -int(wrap.across)).coarser

    def finest(self, area: Rect | None = None) -> Int32[np.ndarray, "H W"]:
        """The result's places: all, or those of ``area``, px of the endless result, which lies in the window."""
        level = self.levels[0]
        stored = self._fetched((area or self.window).moved(-level.origin[0], -level.origin[1]))
        if level.distortion is None:
            return stored
        rows, columns = ((part + 128) // 256 for part in (stored >> 32, stored & (2**32 - 1)))
        return (rows * self.tables.pitch + columns).astype(np.int32)

    def positions(self) -> tuple[Float32[np.ndarray, "H W"], Float32[np.ndarray, "H W"]]:
        """Rows and columns in the exemplar of a distorted result's pixels, in fractions of a pixel."""
        stored = self._fetched(self.window.moved(-self.levels[0].origin[0], -self.levels[0].origin[1]))
        margin = np.float32(self.tables.margin)
        rows, columns = ((part / 256).astype(np.float32) - margin for part in (stored >> 32, stored & (2**32 - 1)))
        return rows, columns

    def _fetched(self, area: Rect) -> Integer[np.ndarray, "H W"]:
        """A part of the finest level's last state."""
        return self.levels[0].states[-1, area.top : area.bottom, area.left : area.right]

    def _positions(self, places: np.ndarray) -> np.ndarray:
        """Positions of places; -1 stays."""
        rows, columns = np.divmod(places.astype(np.int64), self.tables.pitch)
        return np.where(places < 0, np.int64(-1), rows * 256 << 32 | columns * 256)

    def bend(self, field: Jacobian) -> None:
        """Let the texture be distorted; beyond a field that is smaller than the result, its border is repeated."""
        for level in self.levels:
            rows, columns = self._pixels(level)
            near = (
                line % side if around else np.clip(line, 0, side - 1)
                for line, side, around in zip((rows, columns), field.shape[:2], self.wrap, strict=True)
            )
            own = field[np.ix_(*near)]
            level.distortion = distortion_of(self.tables, own, level.number)
            level.states = np.full(level.states.shape, -1, np.int64)
            level.pinned = self._positions(level.pinned)
            field = halved(field)
        self.pieces = self.pieces._replace(starts=piece_starts(self.tables))

    def pin(self, fixed: Bool[np.ndarray, "H W"], places: Int32[np.ndarray, "H W"]) -> None:
        """Fix pixels at places; the arrays' pixel (0, 0) is that of the endless result."""
        height, width = fixed.shape
        for level in self.levels:
            rows, columns = (index * 2**level.number + 2**level.number // 2 for index in self._pixels(level))
            rows = rows % height if self.wrap.down else rows
            columns = columns % width if self.wrap.across else columns
            inside = ((rows >= 0) & (rows < height))[:, None] & ((columns >= 0) & (columns < width))
            at = np.clip(rows, 0, height - 1)[:, None], np.clip(columns, 0, width - 1)
            level.pinned = np.where(inside & fixed[at], places[at], np.int32(-1))
            if level.distortion is not None:
                level.pinned = self._positions(level.pinned)

    def repeat(self, phases: Phases, chart: Float32[np.ndarray, "H W 2"] | None = None) -> None:
        """Lay the coarsest level in phase with the repetition of the exemplar.

        Parameters
        ----------
        chart : where pixels of the endless result, from (0, 0), lie in the flat texture, if it is distorted.
        """
        level = self.levels[-1]
        rows, columns = (index * 2**level.number for index in self._pixels(level))
        if chart is None:
            size = self.window.bottom - self.window.top, self.window.right - self.window.left
            wanted = phases.of_result(rows, columns, size if self.wrap else None, self.wrap)
        else:
            near = (
                np.clip(index + 2**level.number // 2, 0, size - 1)
                for index, size in zip((rows, columns), chart.shape[:2], strict=True)
            )
            wanted = phases.of_places(chart[np.ix_(*near)])
        self.repetition = phases.repetition(wanted.reshape(-1, 2))

    def _pixels(self, level: Level) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of a level's arrays in the endless result, px of the level."""
        shape = level.states.shape[1:]
        return np.arange(shape[0]) + level.origin[0], np.arange(shape[1]) + level.origin[1]

    def run(self) -> None:
        """Compute everything."""
        count = len(self.levels)
        for level in reversed(self.levels):
            self._update(level, level.everything, level.everything)
            report(Progress(0.25**level.number, scale=count - level.number, scales=count))

    def update(self, changed: list[Rect]) -> Rect:
        """Compute what depends on changes of control.

        Parameters
        ----------
        changed : for each level where `Level.given` has changed, px of its arrays.

        Returns
        -------
        where the result has changed, px of the endless result.
        """
        before = NOTHING
        for level in reversed(self.levels):
            if level.number == len(self.levels) - 1:
                before = changed[level.number] if self.style.tries else NOTHING
            after = self._update(level, before, changed[level.number])
            if level.number and not after.empty:
                finer = self.levels[level.number - 1]
                children = after.moved(*level.origin).finer.moved(-finer.origin[0], -finer.origin[1])
                before = children.within(finer.everything)
            else:
                before = NOTHING
        level = self.levels[0]
        return after.moved(*level.origin).within(self.window)

    def _update(self, level: Level, coarser: Rect, given: Rect) -> Rect:
        """Bring a level up to date after changes of what it begins with, and of its control."""
        changed = self._begin(level, coarser.within(level.everything))
        for number in range(self.style.passes[level.number]):
            changed = self._correct(level, number, changed, given)
        return changed

    def _begin(self, level: Level, area: Rect) -> Rect:
        if area.empty:
            return NOTHING
        return self._start(level, area) if level.number == len(self.levels) - 1 else self._refine(level, area)

    def _start(self, level: Level, area: Rect) -> Rect:
        """Fill the coarsest level with pieces; where it differs from before, or more."""
        from texloom.stages.kernels.per_pixel.correction import start

        number = level.number
        shared = (
            level.for_kernels, self.tables.exemplar, level.distortion, self.pieces, self.repetition,
            self.style.tolerance_of(number, self.tables.strengths), self.style.key_of(number),
        )  # fmt: skip
        changed = _in_strips(start, shared, area, 1)
        level.close(0)
        return changed

    def _refine(self, level: Level, area: Rect) -> Rect:
        """Begin a level from the next coarser one; where it differs from before, or more."""
        from texloom.stages.kernels.per_pixel.correction import refine

        number = level.number
        shared = (
            level.for_kernels, self.levels[number + 1].for_kernels, self.tables.exemplar, level.distortion,
            self.style.amplitude_of(number), self.style.key_of(number),
        )  # fmt: skip
        changed = _in_strips(refine, shared, area, 1)
        level.close(0)
        return changed

    def _correct(self, level: Level, number: int, changed: Rect, given: Rect) -> Rect:
        """One pass; where its result differs, after ``changed`` of the state before it."""
        corrected = NOTHING
        for index, (row, column) in enumerate(SUBPASSES):
            area = level.reach(changed.joined(corrected), 1).joined(given)
            area = area.within(level.allowed(4 * number + index + 1))
            top = area.top + (area.top + level.origin[0] + row) % 2
            left = area.left + (area.left + level.origin[1] + column) % 2
            if not area.empty:
                part = self._correct_subpass(level, subpass(number, index), replace(area, top=top, left=left))
                corrected = corrected.joined(part)
        return corrected

    def _correct_subpass(self, level: Level, part: Subpass, area: Rect) -> Rect:
        """Correct every second pixel of every second row; where they differ from before, or more."""
        from texloom.stages.kernels.per_pixel.correction import correct

        shared = (
            level.for_kernels, part, self.tables.exemplar, self.tables.vectors, level.distortion, self.bonuses,
            self.style.tolerance_of(level.number, self.tables.strengths),
        )  # fmt: skip
        changed = _in_strips(correct, shared, area, 2)
        level.close(part.number + 1)
        return changed
