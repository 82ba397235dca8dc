"""The lattice of a regular exemplar: the two displacements by which it repeats, if it does."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.arrays import Channels, Image, ScalarMap, Vectors
from texloom.stages.color import lab_from_linear
from texloom.stages.common.lattice_cells import reduced
from texloom.stages.declare import Params, stage
from texloom.stages.masks import usable_pixels

_SMALLEST_ANGLE = np.pi / 16
_CANDIDATES = 200
_PENALTY = 3.0  # of a lattice point without offsets, times the mean density
_ALMOST = 0.8  # share of the confidence that a finer lattice must keep
_RISE = 0.5  # least rise of the correlation towards a point of a finer lattice, as a share of that to known points
_NEAR = 2  # px around a lattice point in which the best correlation counts
_NOTHING = 1e-3  # density that counts as none
_WITHIN = 0.45  # of the picture's sides; farther on, displaced pictures overlap too little
_SHARES = np.arange(-4, 4) / 8  # of the generators, by which a lattice is displaced to compare it
_AWAY = 0.2  # of a generator, from which on a displacement counts
_POINTS = 4  # by which a lattice can be significant


class LatticeParams(Params):
    """What makes a good lattice; the authors' code's values."""

    beta: float = Field(0.1, gt=0, le=10)
    """weight of recall against precision in the F-measure; small prefers sparse ones all of whose points are hit"""
    shortest: float = Field(10.0, ge=2)
    """least length of a generator, px"""
    confidence: float = Field(0.4, ge=-1, le=1)
    """correlation of the exemplar with itself, displaced by the generators, from which a lattice is trusted"""
    significance: float = Field(5.5, ge=0, le=100)
    """significance from which a lattice of less confidence is trusted too; see `Lattice`"""


@dataclasses.dataclass(frozen=True)
class Lattice:
    """The lattice, or none."""

    generators: Vectors
    """two displacements, px, the shorter first; no rows where the exemplar is not regular"""
    best: Annotated[Float32[np.ndarray, "tried 2"], Channels(("row", "column"))]
    """the two best displacements, whether they were trusted or not"""
    confidence: float
    """mean correlation of lightness at the nearest lattice points, -1..1"""
    significance: float
    """by how many standard errors the correlation at all lattice points exceeds that at points between them, the
    geometric mean of what it exceeds their average and the best of them by; 0 if it does not, -1 of too few points
    to tell"""
    score: float
    """F-measure of the best lattice, 0..1"""


def _peaks(density: ScalarMap, shortest: float) -> np.ndarray:
    """The highest local maxima in the lower half plane, (n, 2) offsets."""
    import cv2

    height, width = density.shape
    highest = cv2.dilate(density, np.ones((7, 7), np.uint8))
    row, column = np.nonzero((density >= highest) & (density > 0.02 * density.max()))
    offsets = np.stack([row - height // 2, column - width // 2], axis=1)
    lower = (offsets[:, 0] > 0) | ((offsets[:, 0] == 0) & (offsets[:, 1] > 0))
    lower &= np.hypot(offsets[:, 0], offsets[:, 1]) >= shortest
    heights = density[row, column][lower]
    return np.asarray(offsets[lower][np.argsort(-heights, kind="stable")[:_CANDIDATES]], np.float64)


def _best_pair(density: ScalarMap, params: LatticeParams) -> tuple[np.ndarray, float]:
    """The pair of peaks with the highest F-measure, and that measure; no rows without candidates."""
    import cv2

    from texloom.stages.kernels.lattice.score import lattice_sums

    spread = max(1.7, 3.0 * min(density.shape) / 512)
    reach = max(2, round(2 * spread))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    kept = np.where(density > _NOTHING, density, np.float32(0))
    total = float(kept.sum())
    peaks = _peaks(density, params.shortest)
    one, other = np.triu_indices(len(peaks), 1)
    first, second = peaks[one], peaks[other]
    lengths = np.hypot(*first.T) * np.hypot(*second.T)
    sine = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / np.maximum(lengths, 1e-9)
    wide = sine >= np.sin(_SMALLEST_ANGLE)
    first, second = first[wide], second[wide]
    if not len(first) or not total:
        return np.zeros((0, 2)), 0.0
    # The highest value near a lattice point, so that uneven spacing is forgiven; and the mass around it, since
    # points alone can never collect more than a fraction of a smooth density.
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
    """Least squares fit of the generators to the density's peaks near lattice points, from the nearest outwards."""
    middle = np.array(density.shape) // 2
    for rings in (1, 2, 3):
        around = range(-rings, rings + 1)
        steps = np.array([(i, j) for i in around for j in around if (i, j) != (0, 0)])
        reach = max(2, int(min(4 + rings, np.hypot(*generators.T).min() / 4)))
        found, weights, used = [], [], []
        for step in steps:
            place = np.rint(step @ generators).astype(int) + middle
            low, high = place - reach, place + reach + 1
            if (low < 0).any() or (high > density.shape).any():
                continue
            window = density[low[0] : high[0], low[1] : high[1]]
            if window.max() <= _NOTHING:
                continue
            window = window.astype(np.float64) ** 2  # the peak counts, not its surroundings
            grid = np.moveaxis(np.mgrid[low[0] : high[0], low[1] : high[1]], 0, -1) - middle
            found.append((window[..., None] * grid).sum(axis=(0, 1)) / window.sum())
            weights.append(np.sqrt(window.max()))
            used.append(step)
        if len(used) < 2 or np.linalg.matrix_rank(np.array(used)) < 2:
            break
        weight = np.sqrt(np.array(weights))[:, None]
        generators = np.linalg.lstsq(np.array(used) * weight, np.array(found) * weight, rcond=None)[0]
    return generators


def usable_lightness(image: Image) -> ScalarMap:
    """CIELAB lightness, 0..100; masked pixels have the mean of the others, which correlates with nothing."""
    lightness = lab_from_linear(image.color)[..., 0]
    usable = usable_pixels(image)
    if usable is not None:
        lightness[~usable] = lightness[usable].mean()
    return lightness


def self_correlation(lightness: ScalarMap) -> ScalarMap:
    """Correlation of ``lightness`` with itself at every displacement up to half its sides; (0, 0) is the middle.

    Shading that changes over an eighth of the picture is taken out first: it would make everything look alike.
    """
    import cv2

    height, width = lightness.shape
    unit = min(height, width) / 512
    fine = cv2.GaussianBlur(lightness, (0, 0), max(1.0, 2.0 * unit))
    fine = fine - cv2.GaussianBlur(fine, (0, 0), 64 * unit)
    fine = fine - fine.mean()
    shape = (2 * height, 2 * width)
    rows, columns = np.arange(height) - height // 2, np.arange(width) - width // 2
    overlap = np.outer(height - np.abs(rows), width - np.abs(columns))
    product = np.fft.irfft2(np.abs(np.fft.rfft2(fine, shape)) ** 2, shape)
    mean = product[rows[:, None], columns[None, :]] / np.maximum(overlap, 1)
    return np.asarray(mean / max(float((fine**2).mean()), 1e-12), np.float32)


def _at(correlation: ScalarMap, offset: np.ndarray) -> float | None:
    """Best correlation near ``offset``; none beyond reach."""
    row, column = np.rint(offset).astype(int) + np.array(correlation.shape) // 2
    if not (0 <= row < correlation.shape[0] and 0 <= column < correlation.shape[1]):
        return None
    return float(
        correlation[max(0, row - _NEAR) : row + _NEAR + 1, max(0, column - _NEAR) : column + _NEAR + 1].max()
    )


def _around(correlation: ScalarMap, generators: np.ndarray) -> list[float]:
    """Correlation at each of the nearest lattice points; -1 beyond reach of both generators."""
    a, b = reduced(generators)
    values = [_at(correlation, offset) for offset in (a, b, a + b, a - b)]
    return [value for value in values if value is not None] or [-1.0]


def significance(correlation: ScalarMap, generators: np.ndarray) -> float:
    """How clearly a lattice stands out from itself displaced by parts of a cell; see `Lattice`.

    Elements of different colours, or under uneven light, correlate weakly, but at many points. What resembles its
    own neighbourhood alone loses that over distance; and what repeats along a line does so between points, too.
    """
    import cv2

    middle = np.array(correlation.shape) // 2
    reach = np.floor(_WITHIN * 2 * middle).astype(int)
    frame = reduced(generators)
    most = np.ceil(np.abs(reach @ np.abs(np.linalg.inv(frame)))).astype(int)
    steps = np.array([(i, j) for i in range(-most[0], most[0] + 1) for j in range(most[1] + 1) if (j, i) > (0, 0)])
    steps = steps[(np.abs(steps @ frame) <= reach).all(axis=1)]
    if len(steps) < _POINTS or np.linalg.matrix_rank(steps) < 2:
        return -1.0
    near = cv2.dilate(correlation, np.ones((2 * _NEAR + 1, 2 * _NEAR + 1), np.uint8))

    def mean(share: np.ndarray) -> float:
        places = np.rint((steps + share) @ frame).astype(int)
        row, column = (places[(np.abs(places) < middle).all(axis=1)] + middle).T
        return float(near[row, column].mean())

    level = mean(np.zeros(2))
    displaced = [mean(np.array([i, j])) for i in _SHARES for j in _SHARES if max(abs(i), abs(j)) > _AWAY]
    error = float(correlation.std()) / np.sqrt(len(steps))
    if level <= max(displaced) or error <= 0:
        return 0.0
    return float(np.sqrt((level - np.mean(displaced)) * (level - max(displaced))) / error)


def _stands_out(correlation: ScalarMap, generators: np.ndarray, level: float) -> bool:
    """Whether the picture is less like itself on the way to each of the nearest lattice points than there.

    Along a line, as a joint between bricks, any small step looks like one of a lattice.

    Parameters
    ----------
    level : correlation at points that are known to be of the lattice.
    """
    a, b = generators
    for offset in (a, b, a + b, a - b):
        value = _at(correlation, offset)
        if value is None:
            continue
        length = np.hypot(*offset)
        steps = np.arange(max(1, length - _NEAR))[:, None] / length * offset  # up to where `_at` begins to look
        rows, columns = (np.rint(steps).astype(int) + np.array(correlation.shape) // 2).T
        lowest = float(correlation[rows, columns].min())
        if value - lowest <= max(0.0, _RISE * (level - lowest)):
            return False
    return True


def _added(correlation: ScalarMap, finer: np.ndarray, coarse: np.ndarray, index: int) -> float:
    """Mean correlation at the points near the origin that ``finer`` has and ``coarse`` has not; -1 beyond reach.

    Points that differ by a step of ``coarse``, or by their sign, should be alike and are averaged; of those that
    need not be alike the worst counts.
    """
    cosets: dict[tuple[int, ...], list[float]] = {}
    for step in ((i, j) for i in range(3) for j in range(-2, 3) if (i, j) > (0, 0)):
        offset = np.array(step) @ finer
        place = np.rint(offset @ np.linalg.inv(coarse) * index).astype(int)
        value = _at(correlation, offset)
        if (place % index).any() and value is not None:
            cosets.setdefault(min(tuple(place % index), tuple(-place % index)), []).append(value)
    return min((float(np.mean(values)) for values in cosets.values()), default=-1.0)


def _densest(generators: np.ndarray, correlation: ScalarMap, shortest: float) -> np.ndarray:
    """The finest lattice of which this one is a part, as long as its new points are almost as well correlated.

    Matched features prefer sparse lattices: every second brick may look most alike.
    """
    while True:
        a, b = generators
        level = float(np.mean(_around(correlation, generators)))
        kept = []
        for index in (2, 3, 5, 7):  # every finer lattice is reached by steps of a prime index
            finer = [(a / index, b), *(((k * a + b) / index, a) for k in range(index))]
            for pair in (reduced(np.array(pair)) for pair in finer):
                sine = abs(np.linalg.det(pair)) / np.prod(np.hypot(*pair.T))
                wide = np.hypot(*pair[0]) >= shortest and sine >= np.sin(_SMALLEST_ANGLE)
                if wide and _stands_out(correlation, pair, level):
                    kept.append((_added(correlation, pair, generators, index), pair))
        if not kept:
            return generators
        worst, pair = max(kept, key=lambda entry: entry[0])
        if worst < _ALMOST * level:
            return generators
        generators = pair


@stage(version=2)
def lattice(image: Image, density: ScalarMap, params: LatticeParams) -> Lattice:
    """Find the pair of generators whose lattice explains the offsets best, and ask the picture whether to trust it.

    Candidates are the highest peaks of the density; every pair is scored, the best is fitted to the peaks around it
    and reduced. The paper has no test for irregular exemplars; confidence and significance are ours.

    Parameters
    ----------
    density : see `offset_statistics`.

    References
    ----------
    [Kaspar2015]_ section 4.1; constants and the penalty of empty lattice points from its authors' code.
    """
    return lattice_of(self_correlation(usable_lightness(image)), density, params)


def lattice_of(
    correlation: Float32[np.ndarray, "rows columns"], density: ScalarMap, params: LatticeParams
) -> Lattice:
    """The lattice of what correlates with itself as `self_correlation` says; see `lattice`."""
    none = np.zeros((0, 2), np.float32)
    generators, score = _best_pair(density, params)
    if not len(generators):
        return Lattice(none, none, 0.0, 0.0, 0.0)
    generators = reduced(_refined(reduced(generators), density))
    confidence = float(np.mean(_around(correlation, generators)))
    if confidence >= params.confidence:
        generators = reduced(_refined(_densest(generators, correlation, params.shortest), density))
        confidence = float(np.mean(_around(correlation, generators)))
    best = generators.astype(np.float32)
    clear = significance(correlation, generators)
    trusted = confidence >= params.confidence or clear >= params.significance
    return Lattice(best if trusted else none, best, confidence, clear, score)
