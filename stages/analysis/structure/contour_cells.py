"""The cells of an exemplar between closed contours: bricks, stones, fruits, whatever their order."""

import functools

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from texloom.stages.common.grids.border import Border
from texloom.stages.common.grids.working_size import reduction
from texloom.stages.vocabulary.arrays import ScalarMap
from texloom.stages.vocabulary.scratch import bands

_DEPTH = 0.35  # of the strength of clear contours, of what lies between two cells
_CLEAR = 0.9  # quantile of an exemplar's strength that is a clear contour's
_WEAK = 0.2  # quantile of a cell's contour that has to be that much stronger than its inside
_MIN_SHARE = 0.6  # of the area of whole cells, in closed contours, of an exemplar that consists of cells
_MIN_COVER = 0.25  # of the exemplar's area, in such cells
MIN_CELLS = 8  # whole ones
MAX_AREA = 0.125  # of the exemplar's, of a cell
_RIM = 2  # px beside a contour that are not the inside of a cell


class ContourCells:
    """Basins of contour strength: which cell each pixel of an exemplar belongs to, and which pixels lie inside it.

    Of a large exemplar, whose contours are found at reduced size (see `working_image`), basins are too.

    Parameters
    ----------
    strength : of the exemplar's contours.
    border : by which the exemplar is continued.

    References
    ----------
    [Vincent1991]_ for watersheds by flooding; basins merge by depth.
    """

    whole: Bool[np.ndarray, "n"]
    """cells that no side of the exemplar cuts"""
    closed: Bool[np.ndarray, "n"]
    """of those, the ones in closed contours"""
    large: Bool[np.ndarray, "n"]
    """cells that have no inside as they are too large"""
    ground: float
    """share of the exemplar's area in them"""
    area: Int64[np.ndarray, "n"]
    """of the inside"""
    boxes: Int64[np.ndarray, "n 4"]
    """first row and column of the inside, last ones + 1"""

    def __init__(self, strength: ScalarMap, border: Border):
        step, shape, around = reduction(*strength.shape), strength.shape, border
        if step > 1:
            strength, border = strength[step // 2 :: step, step // 2 :: step], Border(1)
        depth = np.float32(_DEPTH * float(np.quantile(strength, _CLEAR)))
        height, width = strength.shape
        values = border.around(strength).astype(np.float32)
        order = np.argsort(values, axis=None, kind="stable")
        label = _basins(values, order, depth)
        count = int(label.max()) + 1
        line = _line_between(label)
        apart = _apart(line)
        size = np.bincount(label.ravel(), minlength=count)
        small = size < MAX_AREA * height * width
        self.large = ~small
        self.ground = float(size[self.large].sum()) / label.size
        core = apart & small[label]
        inside = np.zeros(label.shape, bool)
        first = border.before
        inside[first + 1 : first + height - 1, first + 1 : first + width - 1] = True
        cut = np.bincount(label[~inside], minlength=count) > 0
        self.area = np.bincount(label[core], minlength=count)
        self.whole = small & ~cut & (self.area > 0)
        strong = _quantiles(label, values, order, line, _WEAK, count)
        weak = _quantiles(label, values, order, apart, 0.5, count)
        self.closed = closed = self.whole & (strong - weak > depth)
        total = int(size[self.whole].sum())
        self.closed_share = float(size[closed].sum()) / total if total else 0.0
        self.cover = float(size[closed].sum()) / (height * width)
        self.boxes = boxes_of(label, core, count)
        if step > 1:
            self.area, self.boxes = self.area * step**2, self.boxes * step + around.before
        self._label, self._core, self._step, self._shape, self._border = label, core, step, shape, around

    @functools.cached_property
    def label(self) -> Int64[np.ndarray, "h w"]:
        """Cell of each pixel, in the exemplar with its border."""
        return self._in_full(self._label)

    @functools.cached_property
    def core(self) -> Bool[np.ndarray, "h w"]:
        """Inside of cells, apart from the contours around it."""
        return self._in_full(self._core)

    @property
    def clear(self) -> bool:
        """Whether the exemplar consists of cells."""
        return bool(self.whole.sum() >= MIN_CELLS and self.closed_share >= _MIN_SHARE and self.cover >= _MIN_COVER)

    def _in_full(self, plane: np.ndarray) -> np.ndarray:
        """A plane of which each pixel becomes a square; rows and columns that are missing are like those beside."""
        if self._step == 1:
            return plane
        rows, columns = (
            np.minimum(self._border.lines(side) // self._step, own - 1)
            for side, own in zip(self._shape, plane.shape, strict=True)
        )
        return np.asarray(np.take(plane, columns, axis=1)[rows])


def inside_of(label: Int64[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels that lie apart from the contours between cells."""
    return _apart(_line_between(label))


def _line_between(label: Int64[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels beside one of another cell."""
    line = np.zeros(label.shape, bool)
    for axis in (0, 1):
        ends = [np.s_[:-1], np.s_[1:]] if axis == 0 else [np.s_[:, :-1], np.s_[:, 1:]]
        differs = label[ends[0]] != label[ends[1]]
        line[ends[0]] |= differs
        line[ends[1]] |= differs
    return line


def _apart(line: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels that are not near such a line."""
    import cv2

    element = np.ones((2 * _RIM - 1,) * 2, np.uint8)
    return np.asarray(cv2.erode((~line).astype(np.uint8), element) > 0)


def boxes_of(label: np.ndarray, present: np.ndarray, count: int) -> Int64[np.ndarray, "n 4"]:
    """First row and column of the present pixels of each label, last ones + 1; of none, 0."""
    boxes = np.zeros((count, 4), np.int64)
    boxes[:, :2] = label.shape
    for band in bands(len(label)):
        rows, columns = np.nonzero(present[band])
        own = label[band][rows, columns]
        for index, places in enumerate((rows + band.start, columns)):
            np.minimum.at(boxes[:, index], own, places)
            np.maximum.at(boxes[:, index + 2], own, places + 1)
    boxes[boxes[:, 2] == 0] = 0
    return boxes


def _basins(values: Float32[np.ndarray, "h w"], order: np.ndarray, depth: np.float32) -> Int64[np.ndarray, "h w"]:
    """Basin of each pixel, numbered in the order of the pixels that name them; ``order``: by rising value."""
    from texloom.stages.kernels.cells.basins import flood

    basin = np.empty(values.size, np.int64)
    flood(values, order, depth, basin)
    number = np.cumsum(basin == np.arange(basin.size)) - 1
    return np.asarray(number[basin].reshape(values.shape), np.int64)


def _quantiles(
    label: Int64[np.ndarray, "h w"],
    values: Float32[np.ndarray, "h w"],
    order: np.ndarray,
    counted: Bool[np.ndarray, "h w"],
    share: float,
    count: int,
) -> Float64[np.ndarray, "k"]:  # type: ignore[name-defined]
    """That quantile of each label's values that are counted; 0 of none. ``order``: pixels by rising value."""
    rising = order[counted.ravel()[order]]
    own = label.ravel()[rising].astype(np.min_scalar_type(count))  # short numbers are sorted faster
    by_label = np.argsort(own, kind="stable")
    number = np.bincount(own, minlength=count)
    first = np.cumsum(number) - number
    result = np.zeros(count)
    has = number > 0
    middle = by_label[(first + ((number - 1) * share).astype(np.int64))[has]]
    result[has] = values.ravel()[rising[middle]]
    return result
