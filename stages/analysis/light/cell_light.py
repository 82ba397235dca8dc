"""Soft light on a lattice: reflections, shading and vignettes, by what the median cell does not explain."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.analysis.light.shadow_segments import LogColor
from texloom.stages.analysis.regularity.mean_cell import MeanCell
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Mask, Vectors

_MIN_CELLS = 9
_WHOLE = 0.6  # share of the usual number of pixels, from which a cell counts
_OUTLIER = 3.0  # robust standard deviations beyond which residuals are clipped
_BLUR = 0.5  # deviation, as a share of the shorter generator
_BESIDE = 1.6  # distance of neighbours, in the longer generator
_FULL = 0.7  # of the slope between cells that is found within them too
_TAILS = (0.02, 0.98)  # quantiles between which the light's range is


@dataclasses.dataclass(frozen=True)
class CellLight:
    """Soft light over the cells of a lattice."""

    field: LogColor
    """logarithm of the light, relative to its median"""
    range: float
    """from the darkest to the brightest place, logarithm, mean of the channels"""
    confidence: float
    """0..1: how well the slopes between cells are those within cells"""


def cell_light(residual: LogColor, cells: MeanCell, generators: Vectors, valid: Mask) -> CellLight | None:
    """What differs smoothly from the median cell; None where less than nine cells are seen.

    Tiles may have tints of their own, which change from one to the next and not within; light changes within a
    tile as it does from the one before it to the one behind it. The correlation of both slopes, down and across,
    over all cells, tells one from the other.

    Parameters
    ----------
    residual : logarithms of the picture's colours less those that the median cell expects.
    cells : of the picture.
    generators : of its lattice, px.
    valid : pixels that count.

    References
    ----------
    Ours.
    """
    middle = np.median(residual[valid], axis=0)
    deviation = 1.4826 * np.median(np.abs(residual[valid] - middle), axis=0) + 1e-3
    limit = (_OUTLIER * deviation).astype(np.float32)
    clipped = np.clip(residual - middle.astype(np.float32), -limit, limit)
    lengths = np.hypot(*np.asarray(generators, np.float64).T)
    slopes = _slopes(clipped.mean(axis=2).astype(np.float64), cells, valid, _BESIDE * float(lengths.max()))
    if slopes is None:
        return None
    between, within = slopes
    product, squared = float((between * within).sum()), float(np.square(between).sum())
    alike = product / max(float(np.sqrt(squared * np.square(within).sum())), 1e-12)
    part = product / max(squared, 1e-12)
    share = valid.astype(np.float32)
    blur = _BLUR * float(lengths.min())
    field = np.stack(
        [
            gaussian_blur(clipped[..., k] * share, blur, "repeat")
            / np.maximum(gaussian_blur(share, blur, "repeat"), 1e-3)
            for k in range(clipped.shape[2])
        ],
        axis=2,
    )
    field -= np.median(field[valid], axis=0).astype(np.float32)
    low, high = np.quantile(field.mean(axis=2)[valid], _TAILS)
    confidence = float(np.clip(alike, 0, 1) * np.clip(part / _FULL, 0, 1))
    return CellLight(field.astype(np.float32), float(high - low), confidence)


def _slopes(
    plane: Float64[np.ndarray, "h w"], cells: MeanCell, valid: Mask, reach: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Down and across, of all whole cells: between a cell and its neighbours, and within it."""
    number, count = cells.number[valid], cells.count
    place = np.stack(np.nonzero(valid)).astype(np.float64)

    def sums(values: np.ndarray) -> np.ndarray:
        return np.bincount(number, values, count)

    pixels = sums(np.ones(number.size))
    full = pixels >= _WHOLE * float(np.quantile(pixels, 0.8))
    if full.sum() < _MIN_CELLS:
        return None
    mean = sums(plane[valid]) / np.maximum(pixels, 1)
    centre = np.stack([sums(axis) / np.maximum(pixels, 1) for axis in place])
    between, within = [], []
    for axis in (0, 1):
        offset = place[axis] - centre[axis][number]
        within.append(sums(plane[valid] * offset) / np.maximum(sums(np.square(offset)), 1e-9))
    whole = np.flatnonzero(full)
    near = [whole[np.hypot(*(centre[:, whole] - centre[:, [cell]])) <= reach] for cell in whole]
    for axis in (0, 1):
        values = []
        for others in near:
            apart = centre[axis, others] - centre[axis, others].mean()
            values.append(float((apart * mean[others]).sum()) / max(float(np.square(apart).sum()), 1e-9))
        between.append(values)
    return np.concatenate(between), np.concatenate([values[whole] for values in within])


def expected_of(cells: MeanCell) -> Float32[np.ndarray, "h w 3"]:
    """The picture that the median cell makes, less its mean, so that residuals keep the picture's level."""
    return np.asarray(cells.expected - cells.expected.mean(axis=(0, 1), dtype=np.float64), np.float32)
