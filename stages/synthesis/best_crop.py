"""The crop that best represents a texture: the baseline for a compaction."""

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.arrays import Image
from texloom.stages.declare import OddSize, stage
from texloom.stages.kernels.core.threads import run_all, spans
from texloom.stages.synthesis._compaction.summary import (
    Copied,
    SummaryParams,
    require_features,
    size_check,
    wanted_size,
)
from texloom.stages.synthesis.inverse.energy import ExactEnergy

_FINALIST_SAMPLES = 8  # times as many samples judge the finalists
_GRID = 32  # neighbourhoods evaluated along a crop's shorter side, at least
_BLOCK = 32  # samples whose distances are held at a time
_MIN_SEPARATION = 4  # grid steps between finalists


class BestCropParams(SummaryParams):
    """Size of the crop, and how crops are judged."""

    neighbourhood: OddSize = 7
    """side of the neighbourhoods that are compared, px"""
    samples: int = Field(512, ge=16, le=16384)
    """neighbourhoods of the texture by which all crops are judged"""
    finalists: int = Field(6, ge=1, le=64)
    """number of best crops that are judged again by eight times as many neighbourhoods"""


@stage(version=1, check=size_check("best_crop", "neighbourhood"))
def best_crop(
    texture: Image,
    features: Float32[np.ndarray, "h w c"],
    params: BestCropParams,
    control: Image | None = None,
    sides: list[int] | None = None,
) -> Copied:
    """Find the crop of lowest inverse energy.

    Crops on a grid over the whole texture are compared, a thirtieth of a side apart: for each sampled neighbourhood
    of the texture, the distance to the nearest one on the grid inside the crop. The forward term of a crop is 0.

    Parameters
    ----------
    texture : the large texture.
    features : planes in which neighbourhoods are compared, CIELAB units; see `control_features`.
    control : control map cropped with the texture; of any size of the same aspect ratio.
    sides : height and width of a compaction, px, used where ``params.size`` is null.

    Raises
    ------
    InputError
        no size is given, or it exceeds the texture's, or does not hold a neighbourhood.

    References
    ----------
    [Wei2008]_ Figure 2 compares with crops by hand; the inverse term is that of equation (1).
    """
    require_features("best_crop", features, texture)
    height, width = wanted_size("best_crop", params.size, texture, sides, params.neighbourhood)
    judge = ExactEnergy(features, params.neighbourhood, params.samples)
    step = max(1, (min(height, width) - params.neighbourhood + 1) // _GRID)
    sums = _distance_sums(judge, height - params.neighbourhood + 1, width - params.neighbourhood + 1, step)
    judge.samples *= _FINALIST_SAMPLES
    rows, columns = _lowest(sums, params.finalists, _MIN_SEPARATION)
    energies = [
        judge.inverse_of(features[row : row + height, column : column + width])
        for row, column in zip(step * rows, step * columns, strict=True)
    ]
    best = int(np.argmin(energies))
    down, across = step * rows[best] + np.arange(height), step * columns[best] + np.arange(width)
    return Copied.of(texture, control, np.stack(np.meshgrid(down, across, indexing="ij"), axis=2))


def _distance_sums(judge: ExactEnergy, down: int, across: int, step: int) -> np.ndarray:
    """For crops of ``down`` x ``across`` neighbourhoods the sum of the samples' minimum distances.

    Crops and the neighbourhoods in them lie on a grid of ``step`` px. Squared, in units of the judge's components.
    """
    import cv2

    grid = judge.vectors.reshape(*judge.places, -1)[::step, ::step]
    shape = grid.shape[:2]
    vectors = grid.reshape(shape[0] * shape[1], -1).astype(np.float32)
    lengths = (vectors**2).sum(axis=1)
    samples = judge.vectors[judge.sampled(*judge.places, judge.samples)].astype(np.float32)
    box = np.ones((max(1, down // step), max(1, across // step)), np.uint8)
    rows, columns = (judge.places[0] - down) // step + 1, (judge.places[1] - across) // step + 1
    total = np.zeros((rows, columns))
    for first, last in spans(len(samples), -(-len(samples) // _BLOCK)):
        products = samples[first:last] @ vectors.T

        def minimum_distances(number: int, products: np.ndarray = products, first: int = first) -> np.ndarray:
            sample = samples[number]
            # Integers below 2^24, so that sums are exact in any order.
            distances = (lengths - 2 * products[number - first] + sample @ sample).reshape(shape)
            return np.asarray(cv2.erode(distances, box, anchor=(0, 0))[:rows, :columns])

        for distances in run_all(minimum_distances, [(number,) for number in range(first, last)]):
            total += distances
    return total


def _lowest(values: np.ndarray, count: int, min_separation: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of up to ``count`` lowest values, at least ``min_separation`` apart along one axis."""
    remaining = values.copy()
    lowest: list[tuple[int, int]] = []
    while len(lowest) < count and np.isfinite(remaining).any():
        row, column = divmod(int(remaining.argmin()), remaining.shape[1])
        lowest.append((row, column))
        remaining[
            max(0, row - min_separation + 1) : row + min_separation,
            max(0, column - min_separation + 1) : column + min_separation,
        ] = np.inf
    places = np.array(lowest)
    return places[:, 0], places[:, 1]
