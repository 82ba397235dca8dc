"""Measures of patches: sliced Wasserstein distance and nearest neighbours."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int64

from texloom.stages.common.patch_distance import (
    SIDE,
    Whole,
    patch_windows,
    principal_directions,
    product,
    sample_patches,
    smoothed,
)
from texloom.stages.evaluation._measures.pictures import (
    Picture,
    UnmeasurableError,
    any_true,
    channel_variances,
    require_side,
    require_variation,
)
from texloom.stages.evaluation._measures.pixels import halved, quantiles
from texloom.stages.evaluation._measures.table import Figures
from texloom.stages.evaluation._measures.task import GIVEN, Task

_PATCHES = 8192  # of the sliced distance; their sampling noise is a fifth of the distance between two crops
_PROJECTIONS = 64
_MAX_INDEXED = 1 << 16  # patches
_CHUNK = 1024


def sliced_wasserstein(one: Picture, other: Picture, levels: int = 4) -> list[float]:
    """Sliced Wasserstein distance of the 7x7 patches of two pictures at full, half, quarter ... size.

    Each is the mean over random projections of the distance between the projections' distributions, CIELAB units.
    Levels at which a side is shorter than two patches, or masks leave no patch, are omitted.

    References
    ----------
    [Elnekave2022]_ section 3.
    """
    directions = np.random.default_rng(1).standard_normal((SIDE * SIDE * 3, _PROJECTIONS)).astype(np.float32)
    directions /= np.linalg.norm(directions, axis=0)
    pair = [one, other]
    distances = []
    for _ in range(levels):
        if min(picture.shorter for picture in pair) < 2 * SIDE:
            break
        wholes = [picture.windows(SIDE, SIDE) for picture in pair]
        if not all(map(any_true, wholes)):
            break
        first, second = (
            quantiles(product(sample_patches(patch_windows(picture.lab, 1), _PATCHES, 0, whole), directions))
            for picture, whole in zip(pair, wholes, strict=True)
        )
        distances.append(float(np.abs(first - second).mean()))
        pair = [_half_size(picture) for picture in pair]
    return distances


def _half_size(picture: Picture) -> Picture:
    import cv2

    valid = None if picture.valid is None else halved(picture.valid)
    return Picture(cv2.pyrDown(picture.lab), picture.tone[::2, ::2], valid)


class PatchIndex(NamedTuple):
    """Patches of a picture at one scale, by their leading principal components."""

    lab: Float32[np.ndarray, "h w 3"]
    """smoothed for the scale"""
    rows: Int64[np.ndarray, "p"]
    """of the upper left samples"""
    components: Float32[np.ndarray, "p q d"]
    """of the patch whose upper left sample is pixel (rows[p], q)"""
    step: int
    """pixels between samples"""
    whole: Whole | None = None
    """true for patches that count; None where all do"""


def whole_patches(picture: Picture, step: int) -> Whole | None:
    """True for each patch, samples ``step`` px apart, that counts; see `Picture.windows`.

    `UnmeasurableError` where none does.
    """
    reach = (SIDE - 1) * step + 1
    whole = picture.windows(reach, reach)
    if not any_true(whole):
        raise UnmeasurableError(f"masks leave no patch of {reach} px")
    return whole


def index_patches(
    lab: Float32[np.ndarray, "h w 3"],
    step: int,
    directions: Float32[np.ndarray, "e d"],
    most: int = _MAX_INDEXED,
    whole: Whole | None = None,
) -> PatchIndex:
    """Project the patches of a smoothed picture; where there are more than ``most``, those of random rows.

    ``whole``: patches that count; None where all do.
    """
    windows = patch_windows(lab, step)
    height, width = windows.shape[:2]
    useful = np.arange(height) if whole is None else np.flatnonzero(whole.any(axis=1))
    rows = np.sort(np.random.default_rng(3).permutation(useful)[: max(1, most // width)])
    components = np.empty((len(rows), width, directions.shape[1]), np.float32)
    for index, row in enumerate(rows):
        components[index] = product(windows[row].reshape(width, -1), directions)
    return PatchIndex(lab, rows, components, step, None if whole is None else whole[rows])


def nearest_distance(queries: PatchIndex, targets: PatchIndex, count: int = 256) -> float:
    """Mean squared distance of ``count`` random patches of ``queries`` to their nearest patches of ``targets``.

    The nearest indexed patch is that by principal components; its distance is exact, in squared CIELAB units, mean
    over samples and sum over channels.
    """
    places = np.random.default_rng(4).permutation(_counted(queries))
    rows, columns = np.divmod(places[:count], queries.components.shape[1])
    wanted = queries.components[rows, columns]
    counted = _counted(targets)
    factors = np.ascontiguousarray(np.column_stack([-2 * wanted, np.ones(len(wanted), np.float32)]).T)
    searched = targets.components.reshape(-1, targets.components.shape[2])
    if targets.whole is not None:
        searched = searched[counted]
    best = np.full(len(wanted), np.inf, np.float32)
    nearest = np.zeros(len(wanted), np.intp)
    for start in range(0, len(searched), _CHUNK):
        chunk = searched[start : start + _CHUNK]
        # |a - b|^2 less |b|^2, which is the same for all
        distances = product(np.column_stack([chunk, (chunk * chunk).sum(axis=1)]), factors)
        least = distances.min(axis=0)
        better = np.flatnonzero(least < best)
        best[better], nearest[better] = least[better], distances[:, better].argmin(axis=0) + start
    row, column = np.divmod(counted[nearest], targets.components.shape[1])
    ours = patch_windows(queries.lab, queries.step)[queries.rows[rows], columns].reshape(len(wanted), -1)
    theirs = patch_windows(targets.lab, targets.step)[targets.rows[row], column].reshape(len(wanted), -1)
    return float(((ours - theirs) ** 2).sum(axis=1).mean(dtype=np.float64)) / SIDE**2


def _counted(index: PatchIndex) -> np.ndarray:
    """Flat indices of the patches that count."""
    if index.whole is not None:
        return np.flatnonzero(index.whole)
    return np.arange(index.components.shape[0] * index.components.shape[1])


def patch_distribution(task: Task) -> Figures:
    """Distance between the distributions of patches."""
    require_variation(task.exemplar)
    require_side(4 * SIDE, task.exemplar, task.result)
    task.require_all_made()
    deviation = float(np.sqrt(task.exemplar.variances.mean()))

    def between(one: Picture, other: Picture, most: int = 4) -> list[float]:
        distances = sliced_wasserstein(one, other, most)
        if not distances:
            raise UnmeasurableError(f"masks leave no patch of {SIDE} px")
        return distances

    levels = [level / deviation for level in between(task.exemplar, task.result)]

    ceiling = float(np.mean(between(task.exemplar, task.shuffled, len(levels)))) / deviation
    return Figures(float(np.mean(levels)), 0.0, ceiling, {"levels": levels})


def coherence_and_completeness(task: Task) -> tuple[Figures, Figures | str]:
    """Distances to the nearest patches in both directions, which share their index."""
    require_variation(task.exemplar)
    require_side(4 * SIDE, task.exemplar, task.result)
    steps = [step for step in (1, 4) if min(task.exemplar.shorter, task.result.shorter) >= 4 * SIDE * step]
    variance = float(task.exemplar.variances.sum())
    mean = task.exemplar.colors.mean(axis=0)
    counted = task.exemplar.counted
    rows = []
    for step in steps:
        labs = [smoothed(picture.lab - mean, step) for picture in (task.exemplar, task.result, task.shuffled)]
        wholes = [whole_patches(picture, step) for picture in (task.exemplar, task.result)]
        directions = principal_directions(labs[0], step, wholes[0])
        exemplar, result = (
            index_patches(lab, step, directions, whole=whole) for lab, whole in zip(labs[:2], wholes, strict=True)
        )
        shuffled = index_patches(labs[2], step, directions, 8192)
        rows.append(
            [
                nearest_distance(result, exemplar),
                nearest_distance(exemplar, result),
                nearest_distance(shuffled, exemplar, 128),
                # a plain picture's distance
                float(channel_variances(labs[0] if counted is None else labs[0][counted]).sum()),
            ]
        )
    levels = np.array(rows) / variance
    coherence, completeness, of_shuffled, of_plain = (float(mean) for mean in levels.mean(axis=0))
    of_result = Figures(coherence, 0.0, of_shuffled, {"levels": levels[:, 0].tolist()})
    if task.result.made is not None:
        return of_result, GIVEN
    return of_result, Figures(completeness, 0.0, of_plain, {"levels": levels[:, 1].tolist()})
