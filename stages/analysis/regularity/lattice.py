"""The lattice of a regular exemplar: its two generators, if it has any."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.analysis.regularity.density import offset_deviation
from texloom.stages.common.grids.working_size import working_image
from texloom.stages.common.regularity.lattice_cells import reduced
from texloom.stages.kernels.core.elementary_functions import sin, squared_size
from texloom.stages.numerics.filters import gaussian_blur, gradients
from texloom.stages.numerics.matrices import determinant, inverse_of, least_squares, matrix_product, rank
from texloom.stages.vocabulary.arrays import Channels, Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.masks import valid_pixels

_MIN_ANGLE = np.pi / 16  # between generators
_MAX_CANDIDATES = 200  # peaks of the density
_PENALTY = 3.0  # for a lattice point without offsets, in units of the mean density
_MIN_KEPT_CONFIDENCE = 0.8  # share of the confidence that a finer lattice must keep
_MIN_RISE = 0.5  # of the correlation towards a point of a finer lattice, as a share of that to known points
SEARCH_RADIUS = 2
"""px around a lattice point in which the largest correlation is used"""
_MIN_DENSITY = 1e-3  # smaller densities count as 0
_MAX_SHIFT = 0.45  # of the image's sides; images shifted further overlap too little
_CELL_SHIFTS = np.arange(-4, 4) / 8  # of the generators; a lattice is compared with itself shifted by these
_MIN_CELL_SHIFT = 0.2  # smaller shifts are not compared
MIN_POINTS = 4
"""of a lattice that differ from others significantly"""
_GRADIENT_SIGMA = 1.0  # px of the blur before gradients are taken
_GRADIENT_REACH = 4  # px around a pixel that its gradient depends on


class LatticeParams(Params):
    """How lattices are scored and accepted; defaults as in the authors' code."""

    beta: float = Field(0.1, gt=0, le=10)
    """weight of recall relative to precision in the F-measure; small values prefer sparse lattices whose points all
    have offsets"""
    min_length: float = Field(10.0, ge=2)
    """minimum length of a generator, px"""
    confidence: float = Field(0.4, ge=-1, le=1)
    """minimum correlation of the exemplar with itself, shifted by the generators, to accept a lattice"""
    significance: float = Field(5.5, ge=0, le=100)
    """minimum significance to accept a lattice of less confidence; see `Lattice`"""

    def reduced(self, step: int) -> "LatticeParams":
        """The same for a picture whose pixels are ``step`` px of the exemplar."""
        return self.model_copy(update={"min_length": self.min_length / step})


@dataclasses.dataclass(frozen=True)
class Lattice:
    """The lattice, if one was accepted."""

    generators: Vectors
    """the two generators, px, the shorter first; no rows where the exemplar is not regular"""
    best: Annotated[Float32[np.ndarray, "tried 2"], Channels(("row", "column"))]
    """the two best generators, accepted or not"""
    confidence: float
    """mean correlation of lightness at the nearest lattice points, -1..1"""
    significance: float
    """number of standard errors by which the mean correlation at all lattice points exceeds that of the lattice
    shifted by parts of a cell: the geometric mean of its excess over their average and over their maximum; 0 where
    there is no excess, -1 with too few points"""
    score: float
    """F-measure of the best lattice, 0..1"""


def _peaks(density: ScalarMap, min_length: float) -> np.ndarray:
    """The highest local maxima in the lower half plane, (n, 2) offsets."""
    import cv2

    height, width = density.shape
    maximum = cv2.dilate(density, np.ones((7, 7), np.uint8))
    row, column = np.nonzero((density >= maximum) & (density > 0.02 * density.max()))
    offsets = np.stack([row - height // 2, column - width // 2], axis=1)
    lower = (offsets[:, 0] > 0) | ((offsets[:, 0] == 0) & (offsets[:, 1] > 0))
    lower &= np.hypot(offsets[:, 0], offsets[:, 1]) >= min_length
    heights = density[row, column][lower]
    return np.asarray(offsets[lower][np.argsort(-heights, kind="stable")[:_MAX_CANDIDATES]], np.float64)


def _best_pair(density: ScalarMap, params: LatticeParams) -> tuple[np.ndarray, float]:
    """The pair of peaks with the largest F-measure, and that measure; no rows without candidates."""
    import cv2

    from texloom.stages.kernels.lattice.score import lattice_sums

    radius = max(2, round(2 * offset_deviation(min(density.shape))))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    kept = np.where(density > _MIN_DENSITY, density, np.float32(0))
    total = float(kept.sum())
    peaks = _peaks(density, params.min_length)
    first, second = (peaks[index] for index in np.triu_indices(len(peaks), 1))
    lengths = np.hypot(*first.T) * np.hypot(*second.T)
    sine = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / np.maximum(lengths, 1e-9)
    wide = sine >= sin(_MIN_ANGLE)
    first, second = first[wide], second[wide]
    if not len(first) or not total:
        return np.zeros((0, 2)), 0.0
    # The maximum near a lattice point tolerates uneven spacing. The mass around it is summed because points alone
    # collect only a fraction of a smooth density.
    near = cv2.dilate(kept, disc)
    mass = cv2.filter2D(kept, cv2.CV_32F, disc.astype(np.float32), borderType=cv2.BORDER_CONSTANT)
    sums = np.empty((len(first), 3))
    penalty = _PENALTY * float(kept[kept > 0].mean())
    lattice_sums(near, mass, penalty, first, second, sums)
    precision = np.maximum(sums[:, 0], 0) / np.maximum(sums[:, 1], 1)
    recall = np.minimum(1, 2 * sums[:, 2] / total) * (sums[:, 0] > 0)
    weight = params.beta**2
    measure = (1 + weight) * precision * recall / np.maximum(weight * precision + recall, 1e-12)
    best = int(np.argmax(measure))
    return np.stack([first[best], second[best]]), float(measure[best])


def _refined(generators: np.ndarray, density: ScalarMap) -> np.ndarray:
    """Least squares fit of the generators to the peaks near lattice points, from the nearest points outwards."""
    middle = np.array(density.shape) // 2
    for rings in (1, 2, 3):
        around = range(-rings, rings + 1)
        steps = np.array([(i, j) for i in around for j in around if (i, j) != (0, 0)])
        reach = max(2, int(min(4 + rings, np.hypot(*generators.T).min() / 4)))
        centroids, weights, used = [], [], []
        for step in steps:
            position = np.rint(matrix_product(step, generators)).astype(int) + middle
            low, high = position - reach, position + reach + 1
            if (low < 0).any() or (high > density.shape).any():
                continue
            window = density[low[0] : high[0], low[1] : high[1]]
            if window.max() <= _MIN_DENSITY:
                continue
            window = window.astype(np.float64) ** 2  # emphasises the peak over its surroundings
            grid = np.moveaxis(np.mgrid[low[0] : high[0], low[1] : high[1]], 0, -1) - middle
            centroids.append((window[..., None] * grid).sum(axis=(0, 1)) / window.sum())
            weights.append(np.sqrt(window.max()))
            used.append(step)
        if len(used) < 2 or rank(np.array(used)) < 2:
            break
        weight = np.sqrt(np.array(weights))[:, None]
        generators = least_squares(np.array(used) * weight, np.array(centroids) * weight)
    return generators


def valid_lightness(image: Image) -> ScalarMap:
    """CIELAB lightness, 0..100; excluded pixels have the mean of the others, which correlates with nothing."""
    lightness = lab_from_linear(image.color)[..., 0]
    valid = valid_pixels(image)
    if valid is not None:
        lightness[~valid] = lightness[valid].mean()
    return lightness


def gradient_magnitude(lightness: ScalarMap, valid: Mask | None) -> ScalarMap:
    """Length of the gradient of slightly blurred lightness; its mean near excluded pixels, which correlates with
    nothing.

    Parameters
    ----------
    valid : false for excluded pixels; none where all are valid.
    """
    import cv2

    smooth = gaussian_blur(lightness, _GRADIENT_SIGMA)
    magnitude = np.hypot(*gradients(smooth, (1, 2, 1)))
    if valid is not None:
        side = 2 * _GRADIENT_REACH + 1
        inside = cv2.erode(valid.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
        magnitude[~inside] = magnitude[inside].mean() if inside.any() else 0
    return np.asarray(magnitude, np.float32)


def detail(plane: ScalarMap) -> ScalarMap:
    """A plane without noise, and without shading at the scale of an eighth of the image; its mean is 0."""

    unit = min(plane.shape) / 512
    fine = gaussian_blur(plane, max(1.0, 2.0 * unit))
    fine = fine - gaussian_blur(fine, 64 * unit)
    return np.asarray(fine - fine.mean())


def self_correlation(fine: ScalarMap) -> ScalarMap:
    """Autocorrelation of a plane at every displacement up to half its sides; (0, 0) is the centre.

    Parameters
    ----------
    fine : without shading, which would raise all correlations, see `detail`.
    """
    height, width = fine.shape
    shape = (2 * height, 2 * width)
    rows, columns = np.arange(height) - height // 2, np.arange(width) - width // 2
    overlap = np.outer(height - np.abs(rows), width - np.abs(columns))
    product = np.fft.irfft2(squared_size(np.fft.rfft2(fine, shape)), shape)
    mean = product[rows[:, None], columns[None, :]] / np.maximum(overlap, 1)
    return np.asarray(mean / max(float((fine**2).mean()), 1e-12), np.float32)


def _at(correlation: ScalarMap, offset: np.ndarray) -> float | None:
    """Maximum correlation near ``offset``; None outside the correlation's range."""
    row, column = np.rint(offset).astype(int) + np.array(correlation.shape) // 2
    if not (0 <= row < correlation.shape[0] and 0 <= column < correlation.shape[1]):
        return None
    radius = SEARCH_RADIUS
    window = correlation[max(0, row - radius) : row + radius + 1, max(0, column - radius) : column + radius + 1]
    return float(window.max())


def mean_around(correlation: ScalarMap, generators: np.ndarray) -> float:
    """Mean correlation at the nearest lattice points; -1 where all are out of range."""
    a, b = reduced(generators)
    values = [_at(correlation, offset) for offset in (a, b, a + b, a - b)]
    return float(np.mean([value for value in values if value is not None] or [-1.0]))


def steps_in_range(correlation: ScalarMap, frame: np.ndarray) -> np.ndarray:
    """The steps (n, 2) of a lattice in a half plane at which images shifted by them overlap enough."""
    reach = np.floor(_MAX_SHIFT * 2 * (np.array(correlation.shape) // 2)).astype(int)
    limit = np.ceil(np.abs(matrix_product(reach, np.abs(inverse_of(frame))))).astype(int)
    rows, columns = range(-limit[0], limit[0] + 1), range(limit[1] + 1)
    steps = np.array([(i, j) for i in rows for j in columns if (j, i) > (0, 0)]).reshape(-1, 2)
    return np.asarray(steps[(np.abs(matrix_product(steps, frame)) <= reach).all(axis=1)])


def significance(correlation: ScalarMap, generators: np.ndarray) -> float:
    """How clearly a lattice stands out from itself shifted by parts of a cell; see `Lattice`.

    Elements of different colours, or under uneven light, correlate weakly but at many points. A texture that only
    resembles its immediate surroundings loses correlation with distance; one that repeats along a line, as stripes
    do, correlates between lattice points too.
    """
    import cv2

    middle = np.array(correlation.shape) // 2
    frame = reduced(generators)
    steps = steps_in_range(correlation, frame)
    if len(steps) < MIN_POINTS or rank(steps) < 2:
        return -1.0
    near = cv2.dilate(correlation, np.ones((2 * SEARCH_RADIUS + 1, 2 * SEARCH_RADIUS + 1), np.uint8))

    def mean(shift: np.ndarray) -> float | None:
        offsets = np.rint(matrix_product(steps + shift, frame)).astype(int)
        row, column = (offsets[(np.abs(offsets) < middle).all(axis=1)] + middle).T
        return float(near[row, column].mean()) if row.size else None

    level = mean(np.zeros(2))
    shifts = [np.array([i, j]) for i in _CELL_SHIFTS for j in _CELL_SHIFTS]
    means = [mean(shift) for shift in shifts if np.abs(shift).max() > _MIN_CELL_SHIFT]
    shifted = [value for value in means if value is not None]
    error = float(correlation.std()) / np.sqrt(len(steps))
    if level is None or not shifted or level <= max(shifted) or error <= 0:
        return 0.0
    return float(np.sqrt((level - np.mean(shifted)) * (level - max(shifted))) / error)


def _are_separate_peaks(correlation: ScalarMap, generators: np.ndarray, level: float) -> bool:
    """Whether the correlation dips between the origin and each of the nearest lattice points.

    Along a line, such as a joint between bricks, every small displacement correlates.

    Parameters
    ----------
    level : correlation at known lattice points.
    """
    a, b = generators
    for offset in (a, b, a + b, a - b):
        value = _at(correlation, offset)
        if value is None:
            continue
        length = np.hypot(*offset)
        # Up to the window that `_at` searches.
        steps = np.arange(max(1, length - SEARCH_RADIUS))[:, None] / length * offset
        rows, columns = (np.rint(steps).astype(int) + np.array(correlation.shape) // 2).T
        lowest = float(correlation[rows, columns].min())
        if value - lowest <= max(0.0, _MIN_RISE * (level - lowest)):
            return False
    return True


def _new_point_correlation(correlation: ScalarMap, finer: np.ndarray, coarse: np.ndarray, index: int) -> float:
    """Correlation at the points near the origin that ``finer`` adds to ``coarse``; -1 where all are out of range.

    Points that differ by a step of ``coarse``, or by sign, should be equal and are averaged; the result is the
    smallest of these averages.
    """
    cosets: dict[tuple[int, ...], list[float]] = {}
    for step in ((i, j) for i in range(3) for j in range(-2, 3) if (i, j) > (0, 0)):
        offset = matrix_product(np.array(step), finer)
        coset = np.rint(matrix_product(offset, inverse_of(coarse)) * index).astype(int)
        value = _at(correlation, offset)
        if (coset % index).any() and value is not None:
            cosets.setdefault(min(tuple(coset % index), tuple(-coset % index)), []).append(value)
    return min((float(np.mean(values)) for values in cosets.values()), default=-1.0)


def _densest(generators: np.ndarray, correlation: ScalarMap, min_length: float) -> np.ndarray:
    """The finest lattice that contains this one and whose additional points correlate almost as well.

    Matched features prefer sparse lattices: every second brick may match best.
    """
    while True:
        a, b = generators
        level = mean_around(correlation, generators)
        candidates = []
        for index in (2, 3, 5, 7):  # every finer lattice is reached by steps of a prime index
            finer = [(a / index, b), *(((k * a + b) / index, a) for k in range(index))]
            for pair in (reduced(np.array(pair)) for pair in finer):
                sine = abs(determinant(pair)) / np.prod(np.hypot(*pair.T))
                wide = np.hypot(*pair[0]) >= min_length and sine >= sin(_MIN_ANGLE)
                if wide and _are_separate_peaks(correlation, pair, level):
                    candidates.append((_new_point_correlation(correlation, pair, generators, index), pair))
        if not candidates:
            return generators
        worst, pair = max(candidates, key=lambda entry: entry[0])
        if worst < _MIN_KEPT_CONFIDENCE * level:
            return generators
        generators = pair


@stage(version=2)
def lattice(image: Image, density: ScalarMap, params: LatticeParams) -> Lattice:
    """Find the generators whose lattice explains the offsets best, and verify them in the image.

    Candidates are the highest peaks of the density. Every pair is scored; the best is fitted to the peaks near its
    lattice points and reduced. The paper has no test for irregular exemplars; confidence and significance are ours.

    Parameters
    ----------
    image : the exemplar.
    density : see `offset_statistics`.

    Raises
    ------
    InputError
        all pixels are excluded.

    References
    ----------
    [Kaspar2015]_ section 3.3; constants and the penalty for empty lattice points are from its authors' code.
    """
    small, step = working_image(image)
    found = lattice_of(self_correlation(detail(valid_lightness(small))), density, params.reduced(step))
    return dataclasses.replace(
        found, generators=found.generators * np.float32(step), best=found.best * np.float32(step)
    )


def lattice_of(
    correlation: Float32[np.ndarray, "rows columns"], density: ScalarMap, params: LatticeParams
) -> Lattice:
    """The lattice of an image with this autocorrelation, see `self_correlation` and `lattice`."""
    none = np.zeros((0, 2), np.float32)
    generators, score = _best_pair(density, params)
    if not len(generators):
        return Lattice(none, none, 0.0, 0.0, 0.0)
    generators = reduced(_refined(reduced(generators), density))
    confidence = mean_around(correlation, generators)
    if confidence >= params.confidence:
        generators = reduced(_refined(_densest(generators, correlation, params.min_length), density))
        confidence = mean_around(correlation, generators)
    best = generators.astype(np.float32)
    excess = significance(correlation, generators)
    accepted = confidence >= params.confidence or excess >= params.significance
    return Lattice(best if accepted else none, best, confidence, excess, score)
