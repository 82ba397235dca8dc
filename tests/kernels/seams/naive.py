"""Slow readable twins of the kernels of seams."""

import math

import numpy as np

from texloom.stages.vocabulary.facts import Wraps


def cheapest_cut(errors: np.ndarray) -> float:
    """Least sum over all paths from the first row to the last that move a column a row at most: tries all."""

    def from_here(row: int, column: int) -> float:
        if not 0 <= column < errors.shape[1]:
            return math.inf
        own = float(errors[row, column])
        if row == errors.shape[0] - 1:
            return own
        return own + min(from_here(row + 1, column + step) for step in (-1, 0, 1))

    return min(from_here(0, column) for column in range(errors.shape[1]))


def overlap_errors(features: np.ndarray, template: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Mean squared difference of ``template`` where ``mask`` is true, at every place of ``features``."""
    height, width = mask.shape
    found = np.empty((features.shape[0] - height + 1, features.shape[1] - width + 1))
    for y, x in np.ndindex(found.shape):
        difference = features[y : y + height, x : x + width].astype(np.float64) - template
        found[y, x] = (difference[mask] ** 2).sum() / mask.sum()
    return found


def gradient_energy(pixels: np.ndarray) -> np.ndarray:
    """Absolute differences between a pixel's neighbours, across and down, summed over channels."""
    padded = np.pad(pixels.astype(np.int64), ((1, 1), (1, 1), (0, 0)), mode="edge")
    across = np.abs(padded[1:-1, 2:] - padded[1:-1, :-2])
    down = np.abs(padded[2:, 1:-1] - padded[:-2, 1:-1])
    return np.asarray((across + down).sum(axis=2))


def loop_cost(errors: np.ndarray, inside: np.ndarray) -> float:
    """What it costs to part ``inside`` from the rest: both errors of each pair, nothing beside a negative."""
    total = 0.0
    for y, x in np.ndindex(*errors.shape):
        for other in ((y + 1, x), (y, x + 1)):
            if other[0] < errors.shape[0] and other[1] < errors.shape[1] and inside[y, x] != inside[other]:
                total += (
                    float(errors[y, x]) + float(errors[other]) if min(errors[y, x], errors[other]) >= 0 else 0.0
                )
    return total


def refined_position(
    features: np.ndarray,
    template: np.ndarray,
    mask: np.ndarray,
    free: np.ndarray,
    place: tuple[int, int],
    reach: int,
) -> tuple[int, int]:
    """The free place within ``reach`` that differs least at every ``reach``-th pixel; itself if none is free."""
    sparse = np.s_[::reach, ::reach]
    errors = []
    for row, column in np.ndindex(free.shape):
        if free[row, column] and max(abs(row - place[0]), abs(column - place[1])) <= reach:
            window = features[row : row + mask.shape[0], column : column + mask.shape[1]]
            difference = (window.astype(float) - template)[sparse][mask[sparse]]
            errors.append((float((difference**2).sum()), (row, column)))
    return min(errors)[1] if errors else place


def seam_costs(features: np.ndarray, slopes: np.ndarray, match: np.ndarray, wrap: Wraps) -> np.ndarray:
    """Cost of the seams below and to the right of every pixel, (H, W)."""
    height, width = match.shape[:2]
    costs = np.zeros((height, width))

    def differ(one: np.ndarray, other: np.ndarray) -> float:
        a, b = (tuple(np.clip(place, 0, np.array(slopes.shape) - 1)) for place in (one, other))
        return float(np.linalg.norm(features[a] - features[b]) ** 3 / (1 + slopes[a] + slopes[b]))

    for y, x in np.ndindex(height, width):
        for step in np.array([(1, 0), (0, 1)]):
            beside = (y + step[0], x + step[1])
            if (beside[0] == height and not wrap.down) or (beside[1] == width and not wrap.across):
                continue
            one, other = match[y, x].astype(int), match[beside[0] % height, beside[1] % width].astype(int)
            if (one + step != other).any():
                costs[y, x] += differ(one, other - step) + differ(one + step, other)
    return costs


def template_spectrum(template: np.ndarray, exemplar: np.ndarray) -> np.ndarray:
    """Products of spectra of what is compared and squares, less twice those of each channel."""
    products = np.conj(template.astype(complex)) * exemplar
    return np.asarray(products[-1] - 2 * products[:-1].sum(axis=0))


def guide_difference(means: np.ndarray, squares: np.ndarray, wanted: np.ndarray, square: float) -> np.ndarray:
    """Mean of squared differences, from means of values and of their squares, at least 0."""
    return np.maximum(squares - 2 * np.tensordot(wanted, means, 1) + square, 0)
