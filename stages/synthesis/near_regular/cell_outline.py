"""The outline of a lattice's cell: the closed line along which a joint of two cells of an exemplar shows least."""

from collections import deque
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from texloom.stages.kernels.core.loading import loaded
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import inverse_of, matrix_product

_MAX_SAMPLES = 48  # of a cell along a generator
_MIN_SAMPLES = 4
_MAX_CELLS = 64  # that are compared with each other
_BLUR = 0.8  # samples
_UNIT = 1000.0  # whole steps of the mean cost: sums are exact in any order
_LENGTH_COST = 0.05  # of a px of the outline, in mean costs
_AROUND = 1 / 24  # of the shorter generator, over which contrast is measured
_FLAT = 0.25  # of the mean variation, added to contrast: flat places where cells are alike hide joints too
_MIN_TILES = 0.75  # share of the largest number of whole cells that an outline must leave
_FEW_TILES = 8  # whole cells below which their number counts more than how a joint shows
_LOOPS = ((0, 1), (1, 0), (1, 1), (1, -1))  # generators that the first line may follow
_SIDES = ((0, 1), (1, 0), (1, 1), (1, -1))  # steps to the corners that a line may continue at


@dataclass(frozen=True)
class CellOutline:
    """A region whose copies at the points of a lattice cover the plane once: a parallelogram, a hexagon, a pair of
    planks."""

    generators: Float64[np.ndarray, "2 2"]
    """of the lattice, px"""
    lift: Int64[np.ndarray, "m n 2"]
    """for samples of the parallelogram of both generators, the step to the region's copy that they belong to"""
    base: Float64[np.ndarray, "2"]
    """displacement along which copies of the region lie in rows, px"""
    side: Float64[np.ndarray, "2"]
    """to the next row, px"""
    phase: tuple[float, float] | None = None
    """of a parallelogram, where it begins, as shares of the generators"""

    @classmethod
    def rectangle(cls, generators: np.ndarray, phase: tuple[float, float]) -> "CellOutline":
        """The parallelogram of both generators that begins at ``phase``, as shares of the generators."""
        samples = _samples(generators)
        lines = [
            ((np.arange(count) + 0.5) / count < share).astype(np.int64)
            for count, share in zip(samples, phase, strict=True)
        ]
        lift = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
        return cls(np.asarray(generators, np.float64), lift, generators[1], generators[0], phase)

    def moved(self, generators: np.ndarray) -> "CellOutline":
        """The outline on another lattice, by which the plane is sheared and stretched."""
        change = matrix_product(inverse_of(self.generators), generators)
        return CellOutline(
            np.asarray(generators, np.float64),
            self.lift,
            matrix_product(self.base, change),
            matrix_product(self.side, change),
            self.phase,
        )

    def cell_of(self, places: Float64[np.ndarray, "*n 2"]) -> Int64[np.ndarray, "*n 2"]:
        """Which copy of the region each place lies in, as a step; ``places`` in px from a point of the lattice."""
        position = matrix_product(places, inverse_of(self.generators))
        step = np.floor(position)
        sample = np.minimum((position - step) * self.lift.shape[:2], np.array(self.lift.shape[:2]) - 1)
        row, column = np.moveaxis(sample.astype(np.int64), -1, 0)
        return np.asarray(step.astype(np.int64) - self.lift[row, column])

    @cached_property
    def box(self) -> tuple[Float64[np.ndarray, "2"], Float64[np.ndarray, "2"]]:
        """Least and greatest row and column of the region, px from its point of the lattice."""
        count = np.array(self.lift.shape[:2])
        corner = np.moveaxis(np.indices(self.lift.shape[:2]), 0, -1)[:, :, None] + np.array(
            [(0, 0), (0, 1), (1, 0), (1, 1)]
        )
        places = matrix_product(corner / count + self.lift[:, :, None], self.generators).reshape(-1, 2)
        return places.min(axis=0), places.max(axis=0)


def _samples(generators: np.ndarray) -> tuple[int, int]:
    lengths = np.hypot(*np.asarray(generators, np.float64).T)
    rows, columns = np.clip(np.rint(lengths), _MIN_SAMPLES, _MAX_SAMPLES).astype(int)
    return int(rows), int(columns)


def variation(
    features: Float32[np.ndarray, "h w c"],
    valid: Bool[np.ndarray, "h w"],
    vertices: Float64[np.ndarray, "vertices 2"],
    generators: Float64[np.ndarray, "2 2"],
) -> Float64[np.ndarray, "p q"]:
    """Variance between cells at each sample of a cell; where fewer than two are seen, the greatest one of all."""
    values, inside = _samples_of_cells(features, valid, vertices, generators)
    number = inside.sum(axis=0)
    mean = values.sum(axis=0) / np.maximum(number, 1)[..., None]
    away = np.where(inside[..., None], (values - mean) ** 2, 0).sum(axis=(0, 3))
    variance = away / np.maximum(number - 1, 1)
    variance[number < 2] = variance.max(initial=0, where=number >= 2)
    reach = 4
    wrapped = np.pad(variance, reach, mode="wrap")
    return np.asarray(gaussian_blur(wrapped, _BLUR)[reach:-reach, reach:-reach])


def visibility(
    features: Float32[np.ndarray, "h w c"],
    valid: Bool[np.ndarray, "h w"],
    vertices: Float64[np.ndarray, "vertices 2"],
    generators: Float64[np.ndarray, "2 2"],
) -> Float64[np.ndarray, "p q"]:
    """The `variation` over the contrast around each sample: how much a joint of two cells would show there.

    Contours hide it, as of bricks in mortar that is not laid evenly; it shows inside bricks of different colours,
    even where these vary less between cells than the mortar does.
    """
    sigma = max(1.0, _AROUND * float(np.hypot(*np.asarray(generators).T).min()))
    means, squares = (
        np.stack([gaussian_blur(plane, sigma) for plane in np.moveaxis(one, 2, 0)], axis=2)
        for one in (features, np.square(features))
    )
    contrast = np.maximum(squares - np.square(means), 0).sum(axis=2, keepdims=True)
    values, inside = _samples_of_cells(contrast, valid, vertices, generators)
    around = values[..., 0].sum(axis=0) / np.maximum(inside.sum(axis=0), 1)
    varied = variation(features, valid, vertices, generators)
    return np.asarray(varied / np.maximum(around + _FLAT * varied.mean(), 1e-9))


def _samples_of_cells(
    planes: Float32[np.ndarray, "h w c"],
    valid: Bool[np.ndarray, "h w"],
    vertices: Float64[np.ndarray, "vertices 2"],
    generators: Float64[np.ndarray, "2 2"],
) -> tuple[Float64[np.ndarray, "n p q c"], Bool[np.ndarray, "n p q"]]:
    """Of cells that an exemplar shows whole, (n, p, q, c), 0 where they may not be used, and where they may."""
    count = _samples(generators)
    shares = (np.moveaxis(np.indices(count), 0, -1) + 0.5) / count
    offsets = matrix_product(shares, generators)
    low, high = offsets.min(axis=(0, 1)), offsets.max(axis=(0, 1))
    seen = ((vertices + high >= 0) & (vertices + low <= np.array(valid.shape) - 1)).all(axis=1)
    corners = vertices[seen]
    corners = corners[:: max(1, len(corners) // _MAX_CELLS)]
    places = np.rint(corners[:, None, None] + offsets).astype(np.int64)
    inside = ((places >= 0) & (places < valid.shape)).all(axis=-1)
    places = np.where(inside[..., None], places, 0)
    inside &= valid[places[..., 0], places[..., 1]]
    values = np.where(inside[..., None], planes[places[..., 0], places[..., 1]], 0).astype(np.float64)
    return values, inside


def course_outline(
    features: Float32[np.ndarray, "h w c"],
    valid: Bool[np.ndarray, "h w"],
    vertices: Float64[np.ndarray, "vertices 2"],
    generators: Float64[np.ndarray, "2 2"],
) -> CellOutline:
    """The rectangle along courses whose borders between them run where the courses are most alike."""
    first, base = generators
    upright = first - matrix_product(first, base) / matrix_product(base, base) * base
    frame = np.array([upright, base])
    rows = variation(features, valid, vertices, frame).mean(axis=1)
    return CellOutline.rectangle(frame, ((int(np.argmin(rows)) + 0.5) / len(rows), 0.0))


def cell_outline(
    features: Float32[np.ndarray, "h w c"],
    valid: Bool[np.ndarray, "h w"],
    vertices: Float64[np.ndarray, "vertices 2"],
    generators: Float64[np.ndarray, "2 2"],
    reach: float,
) -> CellOutline:
    """The outline along which joints of the exemplar's cells show least, of any shape: it follows those of tiles.

    Two lines divide the plane into cells. The first follows a generator, or the sum or difference of both, from a
    point to its copy: of all such lines the one of least `visibility`. The second, found in the same way,
    joins the first one and its copy. Of the pairs that leave nearly as many whole cells as any, that of least cost
    is returned. Where that leaves fewer than eight, lines of least `variation` are taken if these leave more.

    Parameters
    ----------
    features : of the straightened exemplar.
    valid : which of its pixels may be used.
    vertices, generators : of its lattice, px.
    reach : px around a cell that have to be seen too.

    References
    ----------
    [EricksonHarPeled2004]_: two shortest loops cut a torus, here a lattice's cell, into a disk.
    """

    def outlines(cost: Float64[np.ndarray, "p q"]) -> list[tuple[float, int, CellOutline]]:
        """Of all first lines: cost, number of whole cells, and outline."""
        found = []
        for loop in _LOOPS:
            length, outline = _cheapest(cost, generators, loop)
            low, high = outline.box
            inside = (vertices + low - reach >= 0) & (vertices + high + reach <= np.array(valid.shape) - 1)
            found.append((length, int(inside.all(axis=1).sum()), outline))
        return found

    found = outlines(visibility(features, valid, vertices, generators))
    most = max(count for _, count, _ in found)
    if most < _FEW_TILES:
        others = outlines(variation(features, valid, vertices, generators))
        more = max(count for _, count, _ in others)
        if most < _MIN_TILES * more:
            found, most = others, more
    return min((entry for entry in found if entry[1] >= _MIN_TILES * most), key=lambda entry: entry[0])[2]


class _Cover:
    """The corners of the samples of 3 x 3 cells, and what lines between them cost."""

    def __init__(self, cost: Float64[np.ndarray, "m n"], generators: np.ndarray):
        self.m, self.n = cost.shape
        mean = float(cost.mean()) or 1.0
        # a corner at (i, j) is the first one of sample (i, j)
        before = np.roll(cost, 1, axis=0), np.roll(cost, 1, axis=1)
        per_px = [(cost + before[0]) / 2, (cost + before[1]) / 2, cost, before[1]]
        steps = np.array(_SIDES) / cost.shape
        lengths = np.hypot(*matrix_product(steps, generators).T)
        self.weights = np.stack(
            [
                np.maximum(1, np.rint(_UNIT * length * (plane / mean + _LENGTH_COST)))
                for length, plane in zip(lengths, per_px, strict=True)
            ]
        )
        """of the line from each corner to the next one on each of `_SIDES`"""
        self.shape = 3 * self.m, 3 * self.n
        self.number = np.arange(self.shape[0] * self.shape[1]).reshape(self.shape)

    def graph(self, weights: np.ndarray) -> object:
        """Of all lines inside the cover."""
        tails, heads, values = [], [], []
        for (down, across), plane in zip(_SIDES, weights, strict=True):
            wide = np.tile(plane, (3, 3))
            rows = np.s_[: self.shape[0] - down]
            first = np.s_[: self.shape[1] - 1] if across > 0 else np.s_[1:] if across < 0 else np.s_[:]
            last = np.s_[1:] if across > 0 else np.s_[:-1] if across < 0 else np.s_[:]
            tails.append(self.number[rows, first].ravel())
            heads.append(self.number[down:, last].ravel())
            values.append(wide[rows, first].ravel())
        count = self.number.size
        sparse = loaded("scipy.sparse")
        return sparse.csr_array(
            (np.concatenate(values), (np.concatenate(tails), np.concatenate(heads))), shape=(count, count)
        )

    def path(
        self, graph: object, corner: tuple[int, int], step: tuple[int, int], limit: float
    ) -> tuple[float, np.ndarray]:
        """The cheapest line from a corner to its copy one step away, as corners; none from ``limit`` on."""
        csgraph = loaded("scipy.sparse.csgraph")
        first = self.number[corner[0] + self.m, corner[1] + self.n]
        last = self.number[corner[0] + self.m * (1 + step[0]), corner[1] + self.n * (1 + step[1])]
        costs, previous = csgraph.dijkstra(
            graph, directed=False, indices=first, return_predecessors=True, limit=limit
        )
        if not np.isfinite(costs[last]):
            return np.inf, np.zeros((0, 2), np.int64)
        line = [last]
        while line[-1] != first:
            line.append(previous[line[-1]])
        return float(costs[last]), np.stack(np.divmod(np.array(line[::-1]), self.shape[1]), axis=1)


def _cheapest(
    cost: Float64[np.ndarray, "m n"], generators: np.ndarray, loop: tuple[int, int]
) -> tuple[float, CellOutline]:
    """The outline whose first line follows ``loop``, and its cost."""
    cover = _Cover(cost, generators)
    graph = cover.graph(cover.weights)
    # Every such line crosses the first row of corners, or the first column.
    starts = [(0, j) for j in range(cover.n)] if loop[0] else [(i, 0) for i in range(cover.m)]
    least, line = np.inf, np.zeros((0, 2), np.int64)
    for start in sorted(starts, key=lambda at: float(cover.weights[:, at[0], at[1]].sum())):
        length, found = cover.path(graph, start, loop, least)
        if length < least:
            least, line = length, found
    walls = _Walls(cover.m, cover.n)
    walls.add(line)
    weights = cover.weights.copy()
    # along the first line the second one is free
    for one, other_end in pairwise(line):
        side, at = _line_at(one, other_end)
        weights[side, at[0] % cover.m, at[1] % cover.n] = 1e-3
    other = (1, 0) if loop == (0, 1) else (0, 1)
    corner = int(line[0][0] % cover.m), int(line[0][1] % cover.n)
    length, second = cover.path(cover.graph(weights), corner, other, np.inf)
    walls.add(second)
    base, row = matrix_product(np.array([loop, other]), generators)
    return least + length, CellOutline(np.asarray(generators, np.float64), walls.lift(), base, row)


def _line_at(start: np.ndarray, end: np.ndarray) -> tuple[int, np.ndarray]:
    """Which of `_SIDES` a line between two corners follows, and from which corner."""
    step = tuple(int(one) for one in end - start)
    if step in _SIDES:
        return _SIDES.index(step), start
    return _SIDES.index((-step[0], -step[1])), end


class _Walls:
    """The sides of samples that an outline runs along, in one cell."""

    def __init__(self, m: int, n: int):
        self.above = np.zeros((m, n), bool)
        """between each sample and the one above"""
        self.before = np.zeros((m, n), bool)

    def add(self, line: Int64[np.ndarray, "k 2"]) -> None:
        """A line of corners; diagonals run along two sides."""
        for start, end in pairwise(line):
            middle = np.array([end[0], start[1]])
            for one, other in ((start, middle), (middle, end)):
                row, column = np.minimum(one, other) % self.above.shape
                if one[0] != other[0]:
                    self.before[row, column] = True
                elif one[1] != other[1]:
                    self.above[row, column] = True

    def lift(self) -> Int64[np.ndarray, "m n 2"]:
        """The step from each sample to its copy in the region that is reached from the first sample.

        Samples that lines enclose on their own, which is rare, are reached across these.
        """
        m, n = self.above.shape
        lift = np.zeros((m, n, 2), np.int64)
        seen = np.zeros((m, n), bool)
        queue = deque([(0, 0)])
        while queue:
            i, j = queue.pop()
            row, column = i % m, j % n
            if seen[row, column]:
                continue
            seen[row, column] = True
            lift[row, column] = i // m, j // n
            for place, wall in (
                ((i - 1, j), self.above[row, column]),
                ((i + 1, j), self.above[(row + 1) % m, column]),
                ((i, j - 1), self.before[row, column]),
                ((i, j + 1), self.before[row, (column + 1) % n]),
            ):
                (queue.appendleft if wall else queue.append)(place)
        return lift
