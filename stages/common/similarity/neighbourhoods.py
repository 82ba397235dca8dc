"""Square neighbourhoods as short integer vectors of their principal components.

Integers make distances exact, so that results do not depend on the order of summation. A neighbourhood is
identified by its top-left pixel; `places` are the top-left pixels of whole ones.
"""

import math
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int16, Int32, Int64

from texloom.stages.common.similarity.components import components
from texloom.stages.kernels.core.threads import run_spans
from texloom.stages.kernels.core.vector_size import DIMENSIONS
from texloom.stages.numerics.matrices import matrix_product, row_product
from texloom.stages.vocabulary.arrays import Channels
from texloom.stages.vocabulary.masks import count_excluded
from texloom.stages.vocabulary.scratch import bands

UNIT = 16
"""fixed-point steps per CIELAB unit: fine enough that rounding is a thousandth of a typical patch distance"""

_MAX_VALUE = 300 * UNIT  # includes the strongest guidance
_MAX_LENGTH = 2047  # of a vector; products are then exact in single precision
_SAMPLE_SIZE = 4096  # neighbourhoods from which the components are computed; more change no energy
_BLOCK_SIZE = 1 << 11  # neighbourhoods projected at a time
_MAX_PRODUCTS = 1 << 18  # multiplications for which BLAS does not start threads of its own


def fixed_point(features: Float32[np.ndarray, "h w c"]) -> Int16[np.ndarray, "h wc"]:
    """Round to steps of 1 / `UNIT` and lay a pixel's channels side by side in its row."""
    height, width, channels = features.shape
    values = np.empty((height, width * channels), np.int16)
    for band in bands(height):
        steps = np.clip(np.rint(features[band] * UNIT), -_MAX_VALUE, _MAX_VALUE)
        values[band] = steps.reshape(len(steps), width * channels)
    return values


def places(height: int, width: int, size: int) -> tuple[int, int]:
    """Number of whole neighbourhoods of ``size`` x ``size`` px down and across."""
    return height - size + 1, width - size + 1


Rectangles: TypeAlias = Annotated[Int32[np.ndarray, "n 4"], Channels(("row", "column", "height", "width"))]
"""position and size of each texture in an atlas, px; at least a pixel apart"""


def numbers_in(rectangles: Rectangles, height: int, width: int) -> Int32[np.ndarray, "h w"]:
    """The number of the texture that each pixel of an atlas belongs to, from 1; 0 for pixels between them."""
    numbers = np.zeros((height, width), np.int32)
    for number, (row, column, down, across) in enumerate(rectangles.tolist(), 1):
        numbers[row : row + down, column : column + across] = number
    return numbers


def inside_of(rectangles: Rectangles | None, height: int, width: int) -> Bool[np.ndarray, "h w"]:
    """The pixels of an atlas that belong to a texture; all without ``rectangles``."""
    if rectangles is None:
        return np.ones((height, width), bool)
    return numbers_in(rectangles, height, width) > 0


def whole(inside: Bool[np.ndarray, "h w"], size: int | tuple[int, int]) -> Bool[np.ndarray, "p q"]:
    """Top-left pixels of the rectangles of ``size`` that are entirely inside."""
    down, across = (size, size) if isinstance(size, int) else size
    return np.asarray(count_excluded(inside, down, across) == 0)


def inside_at(inside: Bool[np.ndarray, "h w"], height: int, width: int) -> Bool[np.ndarray, "H W"]:
    """The pixels of a coarser grid that cover only pixels inside."""
    rows, columns = (
        (np.arange(count) * side // count, -(-np.arange(1, count + 1) * side // count))
        for count, side in zip((height, width), inside.shape, strict=True)
    )
    sums = np.pad(np.cumsum(np.cumsum(~inside, axis=0, dtype=np.int64), axis=1), ((1, 0), (1, 0)))
    down = sums[rows[1]] - sums[rows[0]]
    return np.asarray(down[:, columns[1]] == down[:, columns[0]])


def windows(pixels: Int16[np.ndarray, "h wc"], channels: int, size: int) -> np.ndarray:
    """All whole neighbourhoods, (places down, places across, size, size * channels), a view."""
    height, width = pixels.shape[0], pixels.shape[1] // channels
    down, across = places(height, width, size)
    row, value = pixels.strides
    return np.lib.stride_tricks.as_strided(
        pixels, (down, across, size, size * channels), (row, value * channels, row, value), writeable=False
    )


@dataclass(frozen=True)
class Components:
    """The principal components of a texture's neighbourhoods."""

    size: int
    """side of a neighbourhood, px"""
    channels: int
    mean: Float32[np.ndarray, " values"]
    basis: Float32[np.ndarray, "values 32"]
    """scaled so that no vector is longer than 2047; zeros where there are fewer components"""
    unit: float
    """vector length per fixed-point step"""

    @classmethod
    def of(cls, pixels: Int16[np.ndarray, "h wc"], channels: int, size: int) -> "Components":
        """Compute them from neighbourhoods sampled evenly."""
        every = windows(pixels, channels, size)
        step = max(1, math.ceil(math.sqrt(every.shape[0] * every.shape[1] / _SAMPLE_SIZE)))
        sample = every[::step, ::step].reshape(-1, size * size * channels).astype(np.float64)
        return cls.of_sample(sample, channels, size)

    @classmethod
    def of_sample(cls, sample: Float64[np.ndarray, "n values"], channels: int, size: int) -> "Components":
        """Compute them from neighbourhoods, one a row."""
        mean, basis = components(sample, DIMENSIONS)
        # A margin over the longest vector of the sample; longer vectors are shortened.
        longest = float(np.sqrt((row_product(sample - mean, basis) ** 2).sum(axis=1).max()))
        unit = _MAX_LENGTH / max(1.25 * longest, 1.0)
        return cls(size, channels, mean.astype(np.float32), np.ascontiguousarray(basis * unit, np.float32), unit)

    def vectors(self, pixels: Int16[np.ndarray, "h wc"], step: int = 1) -> Int16[np.ndarray, "n 32"]:
        """The vectors of whole neighbourhoods at every ``step`` px down and across, row by row."""
        down, across = places(pixels.shape[0], pixels.shape[1] // self.channels, self.size)
        rows, columns = np.arange(0, down, step), np.arange(0, across, step)
        return self._projected(pixels, (rows[:, None] * pixels.shape[1] + columns * self.channels).ravel())

    def vectors_at(
        self,
        pixels: Int16[np.ndarray, "h wc"],
        numbers: Int64[np.ndarray, "n"],  # type: ignore[name-defined]
    ) -> Int16[np.ndarray, "n 32"]:
        """The vectors of the whole neighbourhoods with these indices, row by row."""
        rows, columns = np.divmod(numbers, pixels.shape[1] // self.channels - self.size + 1)
        return self._projected(pixels, rows * pixels.shape[1] + columns * self.channels)

    def projected(self, rows: Int16[np.ndarray, "n values"]) -> Int16[np.ndarray, "n 32"]:
        """The vectors of neighbourhoods, one a row."""
        return self._projected(rows, np.arange(len(rows)) * self.mean.size, rows=1)

    def _projected(
        self, pixels: Int16[np.ndarray, "h wc"], starts: np.ndarray, rows: int | None = None
    ) -> Int16[np.ndarray, "n 32"]:
        """The vectors of the neighbourhoods of ``rows`` rows that begin at these flat indices of ``pixels``."""
        from texloom.stages.kernels.core.projection import project_windows

        rows = self.size if rows is None else rows
        vectors = np.empty((len(starts), DIMENSIONS), np.int16)
        image = pixels.astype(np.float32)
        offset = matrix_product(self.mean, self.basis)
        run = self.mean.size // rows
        fixed = (image, starts, rows, run, self.basis, offset, np.float32(_MAX_LENGTH), vectors)
        run_spans(project_windows, fixed, len(starts), math.ceil(len(starts) / _BLOCK_SIZE))
        return vectors
