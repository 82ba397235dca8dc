"""Tiles of a lattice: their borders, their pixels, and which of them an exemplar shows whole."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import inverse_of, matrix_product

_SAMPLES = 48  # of a cell along each generator
_MAX_CELLS = 64  # that are compared with each other
_SHEARS = np.linspace(-0.75, 0.75, 13)  # of a tile's sides along its base, relative to the base
_SHEAR_COST = 0.02
_ROWS = 6  # rows of least variation that borders are tried along
_COLUMNS = 2
_MIN_TILES = 0.75  # share of the largest number of whole tiles that a shape must leave


@dataclass(frozen=True)
class Shape:
    """A parallelogram with two sides along the lattice and two sheared ones, whose copies tile the plane."""

    base: Float64[np.ndarray, "2"]
    """a displacement of the lattice, px"""
    side: Float64[np.ndarray, "2"]
    """step to the next row of the lattice, plus any multiple of ``base``, px"""
    phase: Float64[np.ndarray, "2"]
    """from a vertex to the tile's corner, px"""

    def moved(self, change: Float64[np.ndarray, "2 2"]) -> "Shape":
        """The shape after a linear map, given as a matrix for row vectors."""
        return Shape(
            matrix_product(self.base, change), matrix_product(self.side, change), matrix_product(self.phase, change)
        )


@dataclass(frozen=True)
class Window:
    """The pixels of a tile with half an overlap on each side, and a sampling grid along its sides."""

    offsets: Int64[np.ndarray, "p 2"]
    """of the pixels from the tile's corner"""
    grid: tuple[int, int]
    """samples along the side and along the base, about 1 px apart"""
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
        corners = matrix_product(np.array([(0, 0), (0, grid[1]), (grid[0], 0), grid]) - overlap / 2, frame)
        low, high = np.floor(corners.min(axis=0)).astype(int), np.ceil(corners.max(axis=0)).astype(int) + 1
        box = np.moveaxis(np.indices(high - low), 0, -1).reshape(-1, 2) + low
        sample = np.floor(matrix_product(box, inverse_of(frame)) + overlap / 2).astype(np.int64)
        inside = ((sample >= 0) & (sample < grid)).all(axis=1)
        offsets, sample = box[inside], sample[inside]
        number = np.full(high - low, -1)
        number[tuple((offsets - low).T)] = np.arange(len(offsets))
        middles = matrix_product(np.moveaxis(np.indices(grid), 0, -1) + 0.5 - overlap / 2, frame)
        # A sample at the border may round to a pixel outside, which is clipped.
        pixel = np.clip(np.rint(middles).astype(np.int64), low, high - 1) - low
        nearest = number[tuple(np.moveaxis(pixel, 2, 0))]
        return cls(offsets, grid, (sample[:, 0], sample[:, 1]), nearest, overlap)


def whole(
    window: Window,
    corners: Float64[np.ndarray, "n 2"],
    to_exemplar: np.ndarray,
    valid: Bool[np.ndarray, "h w"],
    spare: int,
) -> np.ndarray:
    """Which tiles lie inside the valid pixels of an exemplar, with ``spare`` px around.

    Parameters
    ----------
    corners : of the tiles, px.
    to_exemplar : linear map from the window's plane to the exemplar's, for row vectors.
    """
    import cv2

    offsets = matrix_product(window.offsets, to_exemplar)
    low = np.rint(corners + offsets.min(axis=0)) - spare
    high = np.rint(corners + offsets.max(axis=0)) + spare
    inside = ((low >= 0) & (high <= np.array(valid.shape) - 1)).all(axis=1)
    if valid.all():
        return np.asarray(inside)
    eroded = cv2.erode(valid.astype(np.uint8), np.ones((2 * spare + 1, 2 * spare + 1), np.uint8)) > 0
    pixels = np.rint(corners[inside][:, None] + offsets).astype(np.int64)
    inside[inside] = eroded[pixels[..., 0], pixels[..., 1]].all(axis=1)
    return np.asarray(inside)


def variation(
    features: Float32[np.ndarray, "h w c"], vertices: Float64[np.ndarray, "n 2"], frame: Float64[np.ndarray, "2 2"]
) -> Float64[np.ndarray, "m m"]:
    """Variance between cells at each position in a cell, in coordinates of the generators ``frame``."""

    shares = (np.moveaxis(np.indices((_SAMPLES, _SAMPLES)), 0, -1) + 0.5) / _SAMPLES
    corners = vertices[:: max(1, len(vertices) // _MAX_CELLS)]
    places = np.rint(corners[:, None, None] + matrix_product(shares, frame)).astype(np.int64)
    inside = ((places >= 0) & (places < features.shape[:2])).all(axis=-1)
    places = np.where(inside[..., None], places, 0)
    values = np.where(inside[..., None], features[places[..., 0], places[..., 1]], 0).astype(np.float64)
    count = np.maximum(inside.sum(axis=0), 1)[..., None]
    variance = (values**2).sum(axis=0) / count - (values.sum(axis=0) / count) ** 2
    wrapped = np.pad(np.maximum(variance, 0).sum(axis=2), 6, mode="wrap")
    return np.asarray(gaussian_blur(wrapped, 1.5)[6:-6, 6:-6])


def course_shape(
    features: Float32[np.ndarray, "h w c"],
    vertices: Float64[np.ndarray, "n 2"],
    generators: Float64[np.ndarray, "2 2"],
) -> Shape:
    """The tile along courses whose borders between them run where the courses are most similar."""
    first, base = generators
    upright = first - matrix_product(first, base) / matrix_product(base, base) * base
    row = int(np.argmin(variation(features, vertices, np.array([upright, base])).mean(axis=1)))
    return Shape(base, upright, (row + 0.5) / _SAMPLES * upright)


def best_shape(
    features: Float32[np.ndarray, "h w c"],
    vertices: Float64[np.ndarray, "n 2"],
    generators: Float64[np.ndarray, "2 2"],
    overlap: int,
) -> Shape:
    """The tile whose borders run where the exemplar's cells are most similar.

    Two sides follow a generator, or the sum or difference of both; the others may be sheared, as the ends of bricks
    do not follow the lattice of a running bond. The shape of least cost that leaves nearly as many whole tiles as
    any is returned.
    """
    shapes: list[tuple[float, int, Shape]] = []
    first, second = generators
    for base, other in ((first, second), (second, first), (first + second, first), (first - second, first)):
        upright = other - np.rint(matrix_product(other, base) / matrix_product(base, base)) * base
        for cost, shape in _shapes(features, vertices, base, upright):
            shapes.append((cost, len(shapes), shape))
    shapes.sort(key=lambda entry: entry[:2])
    counts = np.array([_whole_tiles(shape, overlap, vertices, features.shape[:2]) for _, _, shape in shapes])
    return shapes[int(np.argmax(counts >= _MIN_TILES * counts.max()))][2]


def _shapes(
    features: Float32[np.ndarray, "h w c"],
    vertices: Float64[np.ndarray, "n 2"],
    base: Float64[np.ndarray, "2"],
    upright: Float64[np.ndarray, "2"],
) -> Iterator[tuple[float, Shape]]:
    """Cost of the borders, and shape, of candidate tiles with sides along ``base``."""
    spread = variation(features, vertices, np.array([upright, base]))
    row_cost = spread.mean(axis=1)
    line = np.arange(_SAMPLES)
    for row in np.argsort(row_cost, kind="stable")[:_ROWS]:
        for shear in _SHEARS:
            across = np.rint(line * shear).astype(int)
            column_cost = spread[(row + line)[:, None] % _SAMPLES, (across[:, None] + line) % _SAMPLES].mean(axis=0)
            side = upright + shear * base
            for column in np.argsort(column_cost, kind="stable")[:_COLUMNS]:
                cost = row_cost[row] * np.hypot(*base) + column_cost[column] * np.hypot(*side)
                phase = ((row + 0.5) * upright + (column + 0.5) * base) / _SAMPLES
                yield float(cost) * (1 + _SHEAR_COST * abs(shear)), Shape(base, side, phase)


def _whole_tiles(shape: Shape, overlap: int, vertices: Float64[np.ndarray, "n 2"], size: tuple[int, ...]) -> int:
    """Number of tiles of a shape that lie inside an exemplar, each with half an overlap around."""
    sides = np.array([shape.side, shape.base])
    grown = sides * (1 + overlap / np.hypot(*sides.T))[:, None]
    begin = shape.phase - (grown - sides).sum(axis=0) / 2
    corners = vertices + begin
    low = corners + np.minimum(grown, 0).sum(axis=0)
    high = corners + np.maximum(grown, 0).sum(axis=0)
    return int(((low >= 0) & (high <= np.array(size) - 1)).all(axis=1).sum())
