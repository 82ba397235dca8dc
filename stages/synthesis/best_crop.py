"""The crop of a texture that summarises it best: what a compaction has to beat."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.arrays import Image
from texloom.stages.declare import OddSize, Params, stage
from texloom.stages.kernels.core.threads import run_all, spans
from texloom.stages.synthesis._compaction.summary import Copied, require_features, wanted_size
from texloom.stages.synthesis.inverse.energy import ExactEnergy

_THOROUGH = 8  # times as many samples judge the finalists
_FINENESS = 32  # neighbourhoods along a crop's shorter side that are looked at, at least
_BLOCK = 32  # samples whose distances are held at a time


class BestCropParams(Params):
    """How large, and how it is judged."""

    size: tuple[int, int] | None = None
    """height and width of the crop, px; null: ``sides``"""
    neighbourhood: OddSize = 7
    """side of the neighbourhoods that are compared, px"""
    samples: int = Field(512, ge=16, le=16384)
    """neighbourhoods of the texture by which all crops are judged"""
    finalists: int = Field(6, ge=1, le=64)
    """best crops that are judged once more, by eight times as many"""


def check_crop(params: BestCropParams, known: Mapping[str, Any]) -> None:
    """The crop must fit in the texture."""
    texture = known.get("texture")
    if texture is not None and params.size is not None:
        wanted_size("best_crop", params.size, texture, None, params.neighbourhood)


@stage(version=1, check=check_crop)
def best_crop(
    texture: Image,
    features: Float32[np.ndarray, "h w c"],
    params: BestCropParams,
    control: Image | None = None,
    sides: list[int] | None = None,
) -> Copied:
    """Find the crop in which all that the texture has is found best.

    Crops all over the texture are looked at, each a thirtieth of its side from the next: for a sampled
    neighbourhood the distance to every place, and of that the least inside each crop. A crop has nothing foreign,
    so its forward term is 0 and the inverse one decides.

    Parameters
    ----------
    features : what neighbourhoods are compared by, CIELAB units; see `control_features`.
    control : cropped with the texture; of any size of the same aspect ratio.
    sides : height and width of a compaction, px, that the crop is to have too.

    Raises
    ------
    InputError
        no size is known, or it is beyond the texture's, or does not hold a neighbourhood.

    References
    ----------
    [Wei2008]_ Figure 2 compares with crops by hand; the inverse term is that of equation (1).
    """
    require_features("best_crop", features, texture)
    height, width = wanted_size("best_crop", params.size, texture, sides, params.neighbourhood)
    judge = ExactEnergy(features, params.neighbourhood, params.samples)
    step = max(1, (min(height, width) - params.neighbourhood + 1) // _FINENESS)
    missing = _missing(judge, height - params.neighbourhood + 1, width - params.neighbourhood + 1, step)
    judge.samples *= _THOROUGH
    rows, columns = _lowest(missing, params.finalists, 4)
    energies = [
        judge.inverse_of(features[row : row + height, column : column + width])
        for row, column in zip(step * rows, step * columns, strict=True)
    ]
    best = int(np.argmin(energies))
    down, across = step * rows[best] + np.arange(height), step * columns[best] + np.arange(width)
    return Copied.of(texture, control, np.stack(np.meshgrid(down, across, indexing="ij"), axis=2))


def _missing(judge: ExactEnergy, down: int, across: int, step: int) -> np.ndarray:
    """For crops that hold ``down`` x ``across`` neighbourhoods the sum of the samples' least distances.

    Every ``step`` px a crop begins and a neighbourhood is looked at. Squared, in the judge's components.
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

        def least(number: int, products: np.ndarray = products, first: int = first) -> np.ndarray:
            sample = samples[number]
            # whole numbers below 2^24, and so exact in any order
            far = (lengths - 2 * products[number - first] + sample @ sample).reshape(shape)
            return np.asarray(cv2.erode(far, box, anchor=(0, 0))[:rows, :columns])

        for found in run_all(least, [(number,) for number in range(first, last)]):
            total += found
    return total


def _lowest(values: np.ndarray, count: int, min_separation: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of up to ``count`` lowest values, at least ``min_separation`` apart along one axis."""
    left = values.copy()
    found: list[tuple[int, int]] = []
    while len(found) < count and np.isfinite(left).any():
        row, column = divmod(int(left.argmin()), left.shape[1])
        found.append((row, column))
        left[
            max(0, row - min_separation + 1) : row + min_separation,
            max(0, column - min_separation + 1) : column + min_separation,
        ] = np.inf
    places = np.array(found)
    return places[:, 0], places[:, 1]
