"""Crops of a texture that represent it best."""

import numpy as np

from texloom.stages.common.similarity.neighbourhoods import whole
from texloom.stages.kernels.core.threads import run_all, spans
from texloom.stages.numerics.matrices import matrix_product, row_product
from texloom.stages.synthesis.inverse.energy import ExactEnergy

_FINALIST_SAMPLES = 8  # times as many samples judge the finalists
_BLOCK = 32  # samples whose distances are held at a time
_MIN_SEPARATION = 4  # grid steps between finalists


def best_corner(
    judge: ExactEnergy, size: tuple[int, int], finalists: int, grid: int = 32
) -> tuple[int, int] | None:
    """Row and column of the crop of lowest inverse energy; None where no texture of an atlas holds one.

    Crops on a grid over the whole texture are compared: for each sampled neighbourhood
    of the texture, the distance to the nearest one on the grid inside the crop. The best are judged again by eight
    times as many neighbourhoods, and all places in the crop.

    Parameters
    ----------
    size : height and width of a crop, px.
    finalists : number of crops that are judged again.
    grid : neighbourhoods evaluated along a crop's shorter side, at least; also how many crops begin along it.
    """
    height, width = size
    down, across = height - judge.size + 1, width - judge.size + 1
    step = max(1, (min(size) - judge.size + 1) // grid)
    sums = _distance_sums(judge, down, across, step)
    sums[~whole(judge.valid, (down, across))[::step, ::step]] = np.inf
    rows, columns = _lowest(sums, finalists, _MIN_SEPARATION)
    if not rows.size:
        return None
    samples = judge.samples
    judge.samples = _FINALIST_SAMPLES * samples
    planes = judge.pixels.reshape(len(judge.pixels), -1, judge.channels)
    energies = [
        judge.inverse_of_values(
            np.ascontiguousarray(planes[row : row + height, column : column + width].reshape(height, -1))
        )
        for row, column in zip(step * rows, step * columns, strict=True)
    ]
    judge.samples = samples
    best = int(np.argmin(energies))
    return int(step * rows[best]), int(step * columns[best])


def _distance_sums(judge: ExactEnergy, down: int, across: int, step: int) -> np.ndarray:
    """For crops of ``down`` x ``across`` neighbourhoods the sum of the samples' minimum distances.

    Crops and the neighbourhoods in them lie on a grid of ``step`` px. Squared, in units of the judge's components.
    """
    import cv2

    shape = (-(-judge.places[0] // step), -(-judge.places[1] // step))
    vectors = judge.grid(step).astype(np.float32)
    lengths = (vectors**2).sum(axis=1)
    samples = judge.components.vectors_at(judge.pixels, judge.samples_of_texture()).astype(np.float32)
    box = np.ones((max(1, down // step), max(1, across // step)), np.uint8)
    rows, columns = (judge.places[0] - down) // step + 1, (judge.places[1] - across) // step + 1
    total = np.zeros((rows, columns))
    for first, last in spans(len(samples), -(-len(samples) // _BLOCK)):
        products = row_product(samples[first:last], vectors.T)

        def minimum_distances(number: int, products: np.ndarray = products, first: int = first) -> np.ndarray:
            sample = samples[number]
            distances = (lengths - 2 * products[number - first] + matrix_product(sample, sample)).reshape(shape)
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
    places = np.array(lowest, np.int64).reshape(-1, 2)
    return places[:, 0], places[:, 1]
