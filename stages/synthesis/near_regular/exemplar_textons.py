"""Textons: the cells of a straightened exemplar, and the cost of any two of them side by side."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from texloom.stages.common.regularity.lattice_cells import reduced
from texloom.stages.numerics.filters import interpolated
from texloom.stages.numerics.matrices import inverse_of, matrix_product, row_product

_MAX_CELL = 48.0  # px to which longer cells are reduced for comparisons
_MAX_TEXTONS = 2048  # of more a random subset is compared
_MIN_SHARE = 0.6  # of the largest number of whole cells that the chosen partition must have
_UNIT = 4.0  # fixed-point steps per CIELAB unit: sums of products are exact in any order


@dataclass(frozen=True)
class Textons:
    """The whole cells of an exemplar."""

    generators: Float64[np.ndarray, "2 2"]
    """of the lattice whose parallelograms are the cells, px in the straightened exemplar"""
    places: Float64[np.ndarray, "textons 2"]
    """lattice coordinates of each texton's first corner; times ``generators`` plus ``origin`` in px"""
    origin: Float64[np.ndarray, "2"]
    zone: Float64[np.ndarray, "2"]
    """width of the boundary zones along either generator, as a share of the cell"""
    costs: tuple[Float32[np.ndarray, "textons textons"], Float32[np.ndarray, "textons textons"]]
    """mean squared CIELAB difference in the zone if the second texton follows the first, along either generator"""
    levels: tuple[Float32[np.ndarray, " textons"], Float32[np.ndarray, " textons"]]
    """mean square of CIELAB in the zone at the end of each texton, along either generator"""


@dataclass(frozen=True)
class _Frame:
    """The straightened exemplar in lattice coordinates, where cells are rectangles."""

    generators: Float64[np.ndarray, "2 2"]
    low: Int64[np.ndarray, "2"]
    """lattice coordinates of the first corner"""
    sides: tuple[int, int]
    """of a cell, px of the frame"""
    zone: tuple[int, int]
    """px of the frame"""
    lab: Float32[np.ndarray, "h w c"]
    valid: Bool[np.ndarray, "h w"]

    def whole(self) -> Bool[np.ndarray, "h w"]:
        """Where a cell with its zones is inside the exemplar, indexed by its first pixel."""
        sums = np.pad(np.cumsum(np.cumsum(self.valid, axis=0), axis=1), ((1, 0), (1, 0)))
        down, across = (side + zone for side, zone in zip(self.sides, self.zone, strict=True))
        whole = np.zeros(self.valid.shape, bool)
        inner = sums[down:, across:] - sums[:-down, across:] - sums[down:, :-across] + sums[:-down, :-across]
        whole[: inner.shape[0], : inner.shape[1]] = inner == down * across
        return whole

    def per_phase(self, plane: np.ndarray) -> Float64[np.ndarray, "p q"]:
        """Sum over all cells at each position in a cell."""
        p, q = self.sides
        return plane.reshape(plane.shape[0] // p, p, plane.shape[1] // q, q).sum(axis=(0, 2), dtype=np.float64)

    def spread(self) -> Float64[np.ndarray, "p q"]:
        """Variance between cells at each position in a cell; infinite where only one cell is visible."""
        count = self.per_phase(self.valid)
        total = np.zeros(self.sides)
        for plane in np.moveaxis(np.where(self.valid[..., None], self.lab, 0), 2, 0):
            mean = self.per_phase(plane) / np.maximum(count, 1)
            total += self.per_phase(plane.astype(np.float64) ** 2) / np.maximum(count, 1) - mean**2
        return np.where(count > 1, np.maximum(total, 0), np.inf)


def _frame(
    lab: Float32[np.ndarray, "h w c"],
    source: Float32[np.ndarray, "h w 2"],
    generators: np.ndarray,
    origin: np.ndarray,
    zone: float,
    usable: np.ndarray | None,
) -> _Frame:
    import cv2

    lengths = np.hypot(*generators.T)
    factor = min(1.0, _MAX_CELL / float(lengths.max()))
    sides = np.maximum(4, np.rint(lengths * factor)).astype(int)
    shape = np.array(source.shape[:2])
    corners = matrix_product(
        np.array([(0, 0), (0, 1), (1, 0), (1, 1)]) * (shape - 1) - origin, inverse_of(generators)
    )
    low, high = np.floor(corners.min(axis=0)).astype(np.int64), np.ceil(corners.max(axis=0)).astype(np.int64)
    lines = [a + (np.arange((b - a) * side) + 0.5) / side for a, b, side in zip(low, high, sides, strict=True)]
    straight = lines[0][:, None, None] * generators[0] + lines[1][None, :, None] * generators[1] + origin
    inside = ((straight >= 0) & (straight <= shape - 1)).all(axis=2)
    straight = straight.astype(np.float32)
    places = interpolated(source, straight[..., 0], straight[..., 1])
    size = np.array(lab.shape[:2])
    inside &= ((places >= 0) & (places <= size - 1)).all(axis=2)
    if usable is not None:
        # Pixels used by the interpolation, and between the frame's samples, must not be masked either.
        wide = 2 * (2 + int(np.ceil(1.5 / factor))) + 1
        unmasked = cv2.erode(usable.astype(np.uint8), np.ones((wide, wide), np.uint8)).astype(bool)
        nearest = np.clip(np.rint(places), 0, size - 1).astype(np.int64)
        inside &= unmasked[nearest[..., 0], nearest[..., 1]]
    planes = list(np.moveaxis(lab.reshape(*lab.shape[:2], -1), 2, 0))
    if factor < 1:
        small = (round(lab.shape[1] * factor), round(lab.shape[0] * factor))
        planes = [cv2.resize(plane, small, interpolation=cv2.INTER_AREA) for plane in planes]
        places = ((places + 0.5) * (np.array(small[::-1]) / size) - 0.5).astype(np.float32)
    sampled = [interpolated(plane, places[..., 0], places[..., 1]) for plane in planes]
    widths = np.maximum(2, 2 * np.rint(sides * zone / 2)).astype(int)
    return _Frame(
        np.asarray(generators, np.float64),
        low,
        (int(sides[0]), int(sides[1])),
        (int(widths[0]), int(widths[1])),
        np.stack(sampled, axis=2),
        inside,
    )


def _bases(generators: np.ndarray) -> list[np.ndarray]:
    """Pairs of short generators of the lattice."""
    a, b = reduced(generators)
    return [np.array(pair) for pair in ((a, b), (a, a + b), (b, a + b), (a, b - a), (b, b - a))]


def _ring(values: np.ndarray, width: int) -> np.ndarray:
    """Cyclic means over ``width`` values from each one on."""
    doubled = np.concatenate([values, values[: width - 1]])
    return np.convolve(doubled, np.full(width, 1 / width), "valid")


def find_textons(
    lab: Float32[np.ndarray, "h w c"],
    source: Float32[np.ndarray, "h w 2"],
    generators: np.ndarray,
    origin: np.ndarray,
    zone: float,
    rng: np.random.Generator,
    usable: Bool[np.ndarray, "h w"] | None = None,
    courses: bool = False,
) -> Textons | None:
    """Partition an exemplar into the cells of its lattice; none if it shows no whole cell.

    Of all short generators and all phases the partition is chosen whose borders run where cells are most similar.

    Parameters
    ----------
    lab : the exemplar's CIELAB colours, or lightness alone; other features may follow.
    source : for every pixel of the straightened exemplar its position in the exemplar, px.
    generators, origin : the regular lattice of the straightened exemplar, px.
    zone : width of the boundary zones, as a share of a cell's side.
    usable : false for masked pixels of the exemplar, which cells must not contain; none for no mask.
    courses : cells may begin anywhere along the second generator.
    """
    partitions: list[tuple[float, int, _Frame, np.ndarray, tuple[int, int]]] = []
    for basis in [generators] if courses else _bases(generators):
        frame = _frame(lab, source, basis, origin, zone, usable)
        whole = frame.whole()
        counts = frame.per_phase(whole)
        spread = frame.spread()
        lengths = np.hypot(*basis.T)
        rows, columns = (_ring(spread.mean(axis=1 - axis), frame.zone[axis]) for axis in (0, 1))
        if courses:
            columns = np.zeros(frame.sides[1])
        cost = lengths[1] * rows[:, None] + lengths[0] * columns[None, :]
        for at in np.argwhere((counts > 0) & np.isfinite(cost) | (counts == counts.max()) & (counts > 0)):
            phase = (int(at[0]), int(at[1]))
            partitions.append((float(cost[phase]), int(counts[phase]), frame, whole, phase))
    if not partitions:
        return None
    largest = max(count for _, count, *_ in partitions)
    _, _, frame, whole, phase = min(
        (entry for entry in partitions if entry[1] >= _MIN_SHARE * largest), key=lambda entry: entry[0]
    )
    p, q = frame.sides
    if courses:
        corners = np.argwhere(whole[phase[0] :: p]) * [p, 1] + [phase[0], 0]
    else:
        corners = np.argwhere(whole[phase[0] :: p, phase[1] :: q]) * [p, q] + phase
    if len(corners) > _MAX_TEXTONS:
        corners = corners[np.sort(rng.choice(len(corners), _MAX_TEXTONS, replace=False))]
    return _measured(frame, corners, origin)


def _measured(frame: _Frame, corners: Int64[np.ndarray, "textons 2"], origin: np.ndarray) -> Textons:
    sides, zone = np.array(frame.sides), np.array(frame.zone)
    whole = np.rint(frame.lab * _UNIT)
    costs, levels = [], []
    for axis in (0, 1):
        shape = sides + zone
        shape[axis] = zone[axis]
        last = corners + np.where(np.arange(2) == axis, sides, 0)
        first_strips, last_strips = (_strips(whole, at, shape) for at in (corners, last))
        squares = [(strips**2).sum(axis=1) for strips in (last_strips, first_strips)]
        values = first_strips.shape[1] / frame.lab.shape[2] * _UNIT**2
        difference = squares[0][:, None] + squares[1][None, :] - 2 * row_product(last_strips, first_strips.T)
        costs.append((np.maximum(difference, 0) / values).astype(np.float32))
        levels.append((squares[0] / values).astype(np.float32))
    return Textons(
        generators=frame.generators,
        places=frame.low + (corners + zone / 2) / sides,
        origin=np.asarray(origin, np.float64),
        zone=zone / sides,
        costs=(costs[0], costs[1]),
        levels=(levels[0], levels[1]),
    )


def _strips(plane: np.ndarray, corners: np.ndarray, shape: np.ndarray) -> Float64[np.ndarray, "n values"]:
    windows = np.lib.stride_tricks.sliding_window_view(plane, tuple(shape), axis=(0, 1))
    return np.asarray(windows[corners[:, 0], corners[:, 1]].reshape(len(corners), -1), np.float64)
