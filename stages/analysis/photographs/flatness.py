"""Signs that what is seen from the front is no flat surface: how directions and light change across it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from texloom.stages.analysis.photographs.reduced_surface import reduced_surface, without_rim
from texloom.stages.kernels.core.elementary_functions import log
from texloom.stages.numerics.filters import gaussian_blur, gradients
from texloom.stages.numerics.matrices import matrix_product, solve
from texloom.stages.vocabulary.arrays import Image, Mask

_SIDE = 480  # px of the longer side, at which it is judged
_CELLS = 16  # along it
_FINEST = 1.0  # px: standard deviation by which noise is removed
_MIN_SHOWN = 0.3  # share of a cell that has to be shown for it to count
_MIN_CELLS = 40  # that count
_NOISE = 0.15  # CIELAB for a px, added to mean gradients
_BLACK = 16.0  # CIELAB, added to lightness: darker is noise
_CENTRES = 9  # places along each side that directions may turn about
_TURNS, _TURNS_CLEARLY = 0.3, 0.6  # agreement with directions around a point; clean exemplars have .23 or less
_OVER_CONSTANT = 2.0  # times the agreement with one direction
_DEGREE = 4  # of polynomials: up to 2 are trends, 3 and 4 how much the surface varies of itself
_RIDGE = 0.01
_SHEARED, _SQUEEZED = 0.05, 0.05  # trends of directions by perspective
_MIN_ERRORS, _EACH = 5.0, 2.0  # both by their noise, and either
_DARKER, _FINER, _DARKER_ERRORS = 0.05, 0.1, 2.5  # from the middle to both sides
_DIM, _PLAIN = 0.01, 0.003  # added to light and its contrast: less is noise
_FOLDS, _LIKE_SHADE, _PER_LIGHT = 0.35, 0.75, 0.5  # deviation of light, correlation and slope of contrast by it
_ALONG, _ACROSS = 0.45, 0.1  # correlation of light two cells further, along folds and across


@dataclass(frozen=True)
class Flatness:
    """What speaks against a flat surface seen from the front."""

    turning: float
    """agreement of its lines with lines to and around one point, 0..1; 0: not clearly"""
    keystone: float
    """by how many times its own variation directions change from side to side as in perspective; 0: not clearly"""
    falling: float
    """by how much the logarithm of lightness falls from the middle to two opposite sides, to which the texture is
    squeezed too; 0: not clearly"""
    folding: float
    """deviation of the logarithm of light that changes as in folds; 0: not clearly"""

    @property
    def is_curved(self) -> bool:
        """Whether it is none without a doubt."""
        return self.turning >= _TURNS_CLEARLY

    @property
    def reason(self) -> str:
        """In words; empty without any."""
        if self.turning:
            return "its lines turn around a point, as in a dome"
        if self.falling:
            return "it becomes darker and finer to both sides, as a column does"
        if self.folding:
            return "light and the contrast of its texture change together in bands, as in folds of cloth"
        return "directions in it change from side to side, as in perspective" if self.keystone else ""


def flatness(image: Image, usable: Mask) -> Flatness:
    """The signs, by means over cells.

    Directions of gradients are averaged as doubled and fourfold angles, weighted by their length;
    fourfold angles are the same for lines and for what is at right angles to them, as rows and columns of coffers.
    Around a point they turn four times; perspective shears and squeezes what is seen, so that doubled angles change
    linearly to the sides [Witkin1981]_. A trend counts where it is larger than what the polynomials of the next
    degrees find. Shade multiplies light and contrast of a texture alike, which other materials and joints do not:
    where both change together, far along one direction and soon along another, they are folds.

    Parameters
    ----------
    image : the surface from the front.
    usable : where it counts.

    References
    ----------
    [Witkin1981]_ shape from the directions of texture; the measures are ours.
    """
    lab, shown = reduced_surface(image, usable, _SIDE)
    none = Flatness(0.0, 0.0, 0.0, 0.0)
    cell = max(shown.shape) // _CELLS
    if min(shown.shape) < 4 * max(cell, 4):
        return none
    inner = without_rim(shown, 2)
    lightness = np.where(inner, lab[..., 0], lab[shown][:, 0].mean()).astype(np.float32)
    # Light that falls off has a slope of its own.
    texture = gaussian_blur(lightness, _FINEST) - gaussian_blur(lightness, cell / 2)
    down, across = (np.asarray(slope, np.float64) / 32 for slope in gradients(texture))
    square = down * down + across * across
    length = np.sqrt(square)
    double = np.stack([across * across - down * down, 2 * across * down], axis=2)
    fourfold = _doubled(double) / np.maximum(length * square, 1e-9)[..., None]

    weight = _cell_means(inner.astype(np.float64), cell)
    weight = np.where(weight >= _MIN_SHOWN, weight, 0)
    if np.count_nonzero(weight) < _MIN_CELLS:
        return none

    def averaged(plane: np.ndarray) -> np.ndarray:
        counted = plane * (inner if plane.ndim == 2 else inner[..., None])
        mean = _cell_means(counted, cell)
        return np.asarray(mean / np.maximum(weight if plane.ndim == 2 else weight[..., None], 1e-6))

    around = averaged(fourfold) / (averaged(length) + _NOISE)[..., None]
    two = averaged(double) / (averaged(square) + _NOISE**2)[..., None]
    light = log(np.maximum(averaged(lightness.astype(np.float64)), 0) + _BLACK)
    trends, noise = _trends(np.concatenate([two, light[..., None]], axis=2), weight)
    linear = _luminance(lightness).astype(np.float64)
    detail = linear - gaussian_blur(linear, cell / 2)
    shade = log(np.maximum(averaged(linear), 0) + _DIM)
    contrast = log(np.sqrt(np.maximum(averaged(detail * detail), 0)) + _PLAIN)
    return Flatness(
        _turning(around, weight),
        _keystone(trends, noise),
        _falling(trends, noise),
        _folding(shade, contrast, weight > 0),
    )


def _doubled(vectors: np.ndarray) -> np.ndarray:
    """Vectors at twice their angle, of squared length."""
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([x * x - y * y, 2 * x * y], axis=-1)


def _cell_means(plane: np.ndarray, cell: int) -> np.ndarray:
    """Means of square cells of the middle of a plane."""
    counts = [side // cell for side in plane.shape[:2]]
    first = [(side - count * cell) // 2 for side, count in zip(plane.shape[:2], counts, strict=True)]
    middle = plane[first[0] : first[0] + counts[0] * cell, first[1] : first[1] + counts[1] * cell]
    return np.asarray(middle.reshape(counts[0], cell, counts[1], cell, *plane.shape[2:]).mean(axis=(1, 3)))


def _turning(around: Float64[np.ndarray, "m n 2"], weight: Float64[np.ndarray, "m n"]) -> float:
    """Agreement of fourfold angles with those around the best point."""
    energy = float(np.sqrt((weight * np.square(around).sum(axis=2)).sum() * weight.sum()))
    if energy < 1e-9:
        return 0.0
    constant = float(np.hypot(*(weight[..., None] * around).sum(axis=(0, 1)))) / energy
    rows, columns = (np.arange(side, dtype=np.float64) for side in weight.shape)
    best = 0.0
    for row in np.linspace(0, len(rows) - 1, _CENTRES):
        for column in np.linspace(0, len(columns) - 1, _CENTRES):
            away = np.stack(np.meshgrid(columns - column, rows - row), axis=2)
            turned = _doubled(_doubled(away))
            turned /= np.maximum(np.hypot(turned[..., 0], turned[..., 1]), 1e-12)[..., None]
            best = max(best, abs(float((weight[..., None] * around * turned).sum())) / energy)
    return best if best >= max(_TURNS, _OVER_CONSTANT * constant) else 0.0


def _trends(
    planes: Float64[np.ndarray, "m n k"], weight: Float64[np.ndarray, "m n"]
) -> tuple[dict[tuple[int, int], np.ndarray], Float64[np.ndarray, "k"]]:  # type: ignore[name-defined]
    """Coefficients of the first two degrees along rows and columns, of each plane, and the usual of the next."""
    mean = (weight[..., None] * planes).sum(axis=(0, 1)) / weight.sum()
    sides = [_legendre(np.linspace(-1, 1, side)) for side in weight.shape]
    powers = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    terms = np.stack([np.outer(sides[0][i], sides[1][j]).ravel() for i, j in powers], axis=1)
    weighted = terms * weight.ravel()[:, None]
    normal = matrix_product(weighted.T, terms) + _RIDGE * weight.sum() * np.eye(len(powers))
    values = (planes - mean).reshape(-1, planes.shape[2])
    found = np.stack([solve(normal, matrix_product(weighted.T, value)) for value in values.T], axis=1)
    higher = [index for index, power in enumerate(powers) if sum(power) > 2]
    noise = np.sqrt(np.square(found[higher]).mean(axis=0))
    return {power: row for power, row in zip(powers, found, strict=True) if sum(power) <= 2}, noise


def _legendre(at: np.ndarray) -> list[np.ndarray]:
    """Polynomials up to `_DEGREE` of mean square 1."""
    found = [np.ones_like(at), at]
    for degree in range(1, _DEGREE):
        found.append(((2 * degree + 1) * at * found[-1] - degree * found[-2]) / (degree + 1))
    return [plane / np.sqrt(np.square(plane).mean()) for plane in found]


def _keystone(trends: dict[tuple[int, int], np.ndarray], noise: np.ndarray) -> float:
    """Times the noise of shear along one axis and squeeze along the other."""
    best = 0.0
    for sheared, squeezed in (((1, 0), (0, 1)), ((0, 1), (1, 0))):
        shear, squeeze = abs(float(trends[sheared][1])), abs(float(trends[squeezed][0]))
        own = shear / (float(noise[1]) + 1e-3), squeeze / (float(noise[0]) + 1e-3)
        times = float(np.hypot(*own))
        if shear >= _SHEARED and squeeze >= _SQUEEZED and min(own) >= _EACH and times >= _MIN_ERRORS:
            best = max(best, times)
    return best


def _falling(trends: dict[tuple[int, int], np.ndarray], noise: np.ndarray) -> float:
    """Of lightness along the axis along which the texture is squeezed."""
    best = 0.0
    for axis, sign in (((2, 0), -1), ((0, 2), 1)):
        darker, finer = -float(trends[axis][2]), sign * float(trends[axis][0])
        if darker >= max(_DARKER, _DARKER_ERRORS * float(noise[2])) and finer >= _FINER:
            best = max(best, darker)
    return best


def _luminance(lightness: np.ndarray) -> np.ndarray:
    """Linear light of CIELAB lightness."""
    above = (lightness + 16) / 116
    return np.asarray(np.where(lightness > 8, above * above * above, lightness * np.float32(27 / 24389)))


def _folding(shade: Float64[np.ndarray, "m n"], contrast: Float64[np.ndarray, "m n"], shown: Mask) -> float:
    """Deviation of ``shade``, the logarithm of light, if that of the contrast and its directions fit folds."""
    light, texture = (np.where(shown, plane - plane[shown].mean(), 0) for plane in (shade, contrast))
    power = float(np.square(light).sum())
    deviation = float(np.sqrt(power / np.count_nonzero(shown)))
    if deviation < _FOLDS:
        return 0.0
    both = float((light * texture).sum())
    like = both / float(np.sqrt(power * np.square(texture).sum()) + 1e-12)
    if like < _LIKE_SHADE or both < _PER_LIGHT * power:
        return 0.0
    kept = [_correlation(light, shown, *step) / deviation**2 for step in ((0, 2), (2, 2), (2, 0), (2, -2))]
    return deviation if max(kept) >= _ALONG and min(kept) <= _ACROSS else 0.0


def _correlation(plane: Float64[np.ndarray, "m n"], shown: Mask, down: int, across: int) -> float:
    """Mean product of the values of pixels and those of others so many rows and columns further."""
    rows, columns = plane.shape
    before = np.s_[: rows - down, max(0, -across) : columns - max(0, across)]
    after = np.s_[down:, max(0, across) : columns - max(0, -across)]
    pairs = shown[before] & shown[after]
    return float((plane[before] * plane[after])[pairs].mean()) if pairs.any() else 0.0
