"""Tiles of a lattice: where their borders run, which pixels they have, and which an exemplar shows whole."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

_SAMPLES = 48  # of a cell along each generator
_CELLS = 64  # that are compared with each other
_LEANS = np.linspace(-0.75, 0.75, 13)
_TRIED = 6  # border lines of each kind that are combined
_ENOUGH = 0.75  # share of the most whole tiles that a choice of borders must leave


@dataclass(frozen=True)
class Shape:
    """A parallelogram with two sides along the lattice, whose others may lean; its copies cover the plane."""

    base: Float64[np.ndarray, "2"]
    """a displacement of the lattice, px"""
    side: Float64[np.ndarray, "2"]
    """to the next row of the lattice, plus any part of ``base``, px"""
    phase: Float64[np.ndarray, "2"]
    """from a vertex to the tile's corner, px"""

    def moved(self, change: Float64[np.ndarray, "2 2"]) -> "Shape":
        """The shape after a linear map of the plane, given for rows."""
        return Shape(self.base @ change, self.side @ change, self.phase @ change)


@dataclass(frozen=True)
class Window:
    """The pixels of a tile, grown by half an overlap on each side, and a grid along its sides."""

    offsets: Int64[np.ndarray, "p 2"]
    """of the pixels from the tile's corner"""
    grid: tuple[int, int]
    """samples along the side and along the base, about a px apart"""
    at: tuple[np.ndarray, np.ndarray]
    """sample of each pixel, by row and column of the grid"""
    nearest: Int64[np.ndarray, "m n"]
    """pixel of each sample, as an index into ``offsets``"""
    overlap: int
    """samples that neighbours share"""

    @classmethod
    def of(cls, shape: Shape, overlap: int) -> "Window":
        """The window of a tile; ``overlap`` in px."""
        sides = [max(overlap, round(float(np.hypot(*side)))) for side in (shape.side, shape.base)]
        grid = (sides[0] + overlap, sides[1] + overlap)
        frame = np.array([shape.side / sides[0], shape.base / sides[1]])
        corners = (np.array([(0, 0), (0, grid[1]), (grid[0], 0), grid]) - overlap / 2) @ frame
        low, high = np.floor(corners.min(axis=0)).astype(int), np.ceil(corners.max(axis=0)).astype(int) + 1
        box = np.moveaxis(np.indices(high - low), 0, -1).reshape(-1, 2) + low
        sample = np.floor(box @ np.linalg.inv(frame) + overlap / 2).astype(np.int64)
        inside = ((sample >= 0) & (sample < grid)).all(axis=1)
        offsets, sample = box[inside], sample[inside]
        number = np.zeros(high - low, np.int64)
        number[tuple((offsets - low).T)] = np.arange(len(offsets))
        middles = (np.moveaxis(np.indices(grid), 0, -1) + 0.5 - overlap / 2) @ frame
        # A sample at the very border may round to a pixel outside; those of its neighbour will do.
        pixel = np.clip(np.rint(middles).astype(np.int64), low, high - 1) - low
        taken = np.zeros(high - low, bool)
        taken[tuple((offsets - low).T)] = True
        nearest = np.where(taken[tuple(np.moveaxis(pixel, 2, 0))], number[tuple(np.moveaxis(pixel, 2, 0))], -1)
        return cls(offsets, grid, (sample[:, 0], sample[:, 1]), nearest, overlap)


def whole(
    window: Window,
    corners: Float64[np.ndarray, "n 2"],
    change: np.ndarray,
    known: Bool[np.ndarray, "h w"],
    spare: int,
) -> np.ndarray:
    """Which tiles lie inside an exemplar, with ``spare`` px around.

    Parameters
    ----------
    corners : of the tiles, px.
    change : from the window's plane to the exemplar's, for rows.
    known : the exemplar's pixels that may be used.
    """
    import cv2

    offsets = window.offsets @ change
    low = np.rint(corners + offsets.min(axis=0)) - spare
    high = np.rint(corners + offsets.max(axis=0)) + spare
    found = ((low >= 0) & (high <= np.array(known.shape) - 1)).all(axis=1)
    if known.all():
        return np.asarray(found)
    clear = cv2.erode(known.astype(np.uint8), np.ones((2 * spare + 1, 2 * spare + 1), np.uint8)) > 0
    pixels = np.rint(corners[found][:, None] + offsets).astype(np.int64)
    found[found] = clear[pixels[..., 0], pixels[..., 1]].all(axis=1)
    return np.asarray(found)


def variation(
    features: Float32[np.ndarray, "h w c"], vertices: Float64[np.ndarray, "n 2"], frame: Float64[np.ndarray, "2 2"]
) -> Float64[np.ndarray, "m m"]:
    """How much cells differ from each other at each place of a cell, by shares of the generators ``frame``."""
    import cv2

    shares = (np.moveaxis(np.indices((_SAMPLES, _SAMPLES)), 0, -1) + 0.5) / _SAMPLES
    some = vertices[:: max(1, len(vertices) // _CELLS)]
    places = np.rint(some[:, None, None] + shares @ frame).astype(np.int64)
    inside = ((places >= 0) & (places < features.shape[:2])).all(axis=-1)
    places = np.where(inside[..., None], places, 0)
    values = np.where(inside[..., None], features[places[..., 0], places[..., 1]], 0).astype(np.float64)
    count = np.maximum(inside.sum(axis=0), 1)[..., None]
    spread = (values**2).sum(axis=0) / count - (values.sum(axis=0) / count) ** 2
    around = np.pad(np.maximum(spread, 0).sum(axis=2), 6, mode="wrap")
    return np.asarray(cv2.GaussianBlur(around, (0, 0), 1.5)[6:-6, 6:-6])


def best_shape(
    features: Float32[np.ndarray, "h w c"],
    vertices: Float64[np.ndarray, "n 2"],
    generators: Float64[np.ndarray, "2 2"],
    overlap: int,
) -> Shape:
    """The tile whose borders run where the exemplar's cells are most alike.

    Two sides follow a generator, or the sum or difference of both; the others may lean, as the ends of bricks do
    not follow the lattice of a running bond. Of the best, one is taken that leaves about as many whole tiles as
    any.
    """
    found: list[tuple[float, int, Shape]] = []
    first, second = generators
    for base, other in ((first, second), (second, first), (first + second, first), (first - second, first)):
        # As upright on the base as the lattice has it.
        other = other - np.rint(other @ base / (base @ base)) * base  # noqa: PLW2901
        spread = variation(features, vertices, np.array([other, base]))
        along = spread.mean(axis=1)
        down = np.arange(_SAMPLES)
        for row in np.argsort(along, kind="stable")[:_TRIED]:
            for lean in _LEANS:
                across = np.rint(down * lean).astype(int)
                lines = spread[(row + down)[:, None] % _SAMPLES, (across[:, None] + down) % _SAMPLES].mean(axis=0)
                side = other + lean * base
                for column in np.argsort(lines, kind="stable")[:2]:
                    cost = along[row] * np.hypot(*base) + lines[column] * np.hypot(*side)
                    phase = ((row + 0.5) * other + (column + 0.5) * base) / _SAMPLES
                    found.append((float(cost) * (1 + 0.02 * abs(lean)), len(found), Shape(base, side, phase)))
    found.sort(key=lambda entry: entry[:2])
    counts = np.array([_room(shape, overlap, vertices, features.shape[:2]) for _, _, shape in found])
    # The first of the cheapest that leaves enough.
    return found[int(np.argmax(counts >= _ENOUGH * counts.max()))][2]


def _room(shape: Shape, overlap: int, vertices: Float64[np.ndarray, "n 2"], size: tuple[int, ...]) -> int:
    """How many tiles of a shape lie inside an exemplar, each with half an overlap around."""
    sides = np.array([shape.side, shape.base])
    grown = sides * (1 + overlap / np.hypot(*sides.T))[:, None]
    begin = shape.phase - (grown - sides).sum(axis=0) / 2
    corners = vertices + begin
    low = corners + np.minimum(grown, 0).sum(axis=0)
    high = corners + np.maximum(grown, 0).sum(axis=0)
    return int(((low >= 0) & (high <= np.array(size) - 1)).all(axis=1).sum())
