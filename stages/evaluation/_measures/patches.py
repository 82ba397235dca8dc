"""Measures of patches: sliced Wasserstein distance and nearest neighbours."""

import contextlib
import functools
from collections.abc import Callable, Iterator
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float32, Int64

from texloom.stages.common.similarity.patch_distance import (
    SIDE,
    Patches,
    Places,
    Whole,
    few_patches,
    nearest_rows,
    principal_directions,
    random_corners,
    with_squares,
)
from texloom.stages.evaluation._measures.pictures import (
    MeasuredPicture,
    UnmeasurableError,
    any_true,
    channel_variances,
    halves,
    require_side,
    require_variation,
)
from texloom.stages.evaluation._measures.pixels import halved, quantiles
from texloom.stages.evaluation._measures.table import Figures
from texloom.stages.evaluation._measures.task import GIVEN, Task, sampling
from texloom.stages.numerics.matrices import row_product
from texloom.stages.vocabulary.arrays import Correspondence, Mask

_PATCHES = 8192  # of the sliced distance; their sampling noise is a fifth of the distance between two crops
_PROJECTIONS = 64
_MAX_INDEXED = 1 << 16  # patches
_AT_ONCE = 2048  # patches that are described at once, about: few enough for the processor's cache

Copies: TypeAlias = Iterator[tuple[np.ndarray, Places]]
"""numbers of patches, and the corners of others that may be alike"""


def projected(picture: MeasuredPicture, levels: int = 4) -> list[Float32[np.ndarray, "q p"]]:
    """Quantiles of random projections of the 7x7 patches of a picture at full, half, quarter ... size.

    It ends where a side is shorter than two patches, or masks leave no patch.
    """
    directions = np.random.default_rng(1).standard_normal((SIDE * SIDE * 3, _PROJECTIONS)).astype(np.float32)
    directions /= np.linalg.norm(directions, axis=0)
    known: list[np.ndarray] = []
    while len(known) < levels and picture.shorter >= 2 * SIDE:
        whole = picture.windows(SIDE, SIDE)
        if not any_true(whole):
            break
        shape = (picture.tone.shape[0] - SIDE + 1, picture.tone.shape[1] - SIDE + 1)
        patches = few_patches(picture.compared, *random_corners(shape, _PATCHES, 0, whole))
        known.append(quantiles(row_product(patches, directions[: patches.shape[1]])))
        picture = _half_size(picture)
    return known


def sliced_wasserstein(one: list[np.ndarray], other: list[np.ndarray]) -> list[float]:
    """Sliced Wasserstein distance of the patches of two pictures at each size that both have, CIELAB units.

    Each is the mean over what is `projected` of the distance between the projections' distributions.

    References
    ----------
    [Elnekave2022]_ section 3.
    """
    return [float(np.abs(first - second).mean()) for first, second in zip(one, other, strict=False)]


def _half_size(picture: MeasuredPicture) -> MeasuredPicture:
    import cv2

    valid = None if picture.valid is None else halved(picture.valid)
    return MeasuredPicture(cv2.pyrDown(picture.lab), picture.tone[::2, ::2], valid, is_grey=picture.is_grey)


class PatchIndex(NamedTuple):
    """Patches of a picture at one scale, by their leading principal components."""

    patches: Patches
    """of the picture, smoothed for the scale"""
    rows: Int64[np.ndarray, "p"]
    """of the upper left samples"""
    components: Float32[np.ndarray, "p q d"]
    """of the patch whose upper left sample is pixel (rows[p], q)"""
    searched: Float32[np.ndarray, "n e"]
    """the components of those that count, see `with_squares`"""
    whole: Whole | None = None
    """true for patches that count; None where all do"""


def whole_patches(picture: MeasuredPicture, step: int) -> Whole | None:
    """True for each patch, samples ``step`` px apart, that counts; see `MeasuredPicture.windows`.

    `UnmeasurableError` where none does.
    """
    reach = (SIDE - 1) * step + 1
    whole = picture.windows(reach, reach)
    if not any_true(whole):
        raise UnmeasurableError(f"masks leave no patch of {reach} px")
    return whole


def index_patches(
    patches: Patches,
    directions: Float32[np.ndarray, "e d"],
    most: int = _MAX_INDEXED,
    whole: Whole | None = None,
) -> PatchIndex:
    """Project the patches of a smoothed picture; where there are more than ``most``, those of random rows.

    ``whole``: patches that count; None where all do.
    """
    height, width = patches.shape
    useful = np.arange(height) if whole is None else np.flatnonzero(whole.any(axis=1))
    rows = np.sort(np.random.default_rng(3).permutation(useful)[: max(1, most // width)])
    columns = np.arange(width)
    parts = np.array_split(rows, -(-rows.size // max(1, _AT_ONCE // width)))
    components = np.concatenate(
        [row_product(patches.at(part.repeat(width), np.tile(columns, part.size)), directions) for part in parts]
    ).reshape(rows.size, width, -1)
    counted = components.reshape(-1, directions.shape[1]) if whole is None else components[whole[rows]]
    return PatchIndex(patches, rows, components, with_squares(counted), None if whole is None else whole[rows])


def nearest_distance(
    queries: PatchIndex,
    targets: PatchIndex,
    count: int = 256,
    copies: Callable[[Places], Copies] | None = None,
) -> float:
    """Mean squared distance of ``count`` random patches of ``queries`` to their nearest patches of ``targets``.

    The nearest indexed patch is that by principal components; its distance is exact, in squared CIELAB units, mean
    over samples and sum over channels. ``copies`` names patches of the targets to compare as well, see
    `copied_patches`.
    """
    places = np.random.default_rng(4).permutation(_counted(queries))
    rows, columns = np.divmod(places[:count], queries.components.shape[1])
    nearest = nearest_rows(targets.searched, queries.components[rows, columns])
    row, column = np.divmod(_counted(targets)[nearest], targets.components.shape[1])
    rows = queries.rows[rows]
    ours = queries.patches.at(rows, columns)
    distances = ((ours - targets.patches.at(targets.rows[row], column)) ** 2).sum(axis=1)
    for number, corners in copies(np.column_stack([rows, columns])) if copies else ():
        tried = ((ours[number] - targets.patches.at(*corners.T)) ** 2).sum(axis=1)
        np.minimum.at(distances, number, tried)
    return float(distances.mean(dtype=np.float64)) / SIDE**2


def copied_patches(match: Correspondence, width: int, step: int, whole: Whole | None, patches: Places) -> Copies:
    """Where the result shows the middle or a corner of some patches of the exemplar, by the source map ``match``.

    For each of these five samples: numbers of the patches, and the corners of the result's patches that show the
    sample in the same place; of very many some are left out. ``patches``: corners in the exemplar, ``width`` px
    wide, of patches of samples ``step`` px apart; ``whole``: patches of the result that count, None where all do.
    """
    reach = (SIDE - 1) * step
    offsets = [(reach // 2, reach // 2), (0, 0), (0, reach), (reach, 0), (reach, reach)]
    samples = [(patches + offset) @ (width, 1) for offset in offsets]
    sources = match[..., 0] * np.uint32(width) + match[..., 1]
    last = max(int(sources.max()), int(np.max(samples)))
    shown = np.zeros(last + 1, bool)
    shown[np.concatenate(samples)] = True
    places = np.argwhere(shown[sources])
    places = places[:: 1 + len(places) // _MAX_INDEXED]
    of_places = sources[places[:, 0], places[:, 1]]
    for offset, of_patches in zip(offsets, samples, strict=True):
        number = np.full(last + 1, -1, np.int32)
        number[of_patches] = np.arange(len(of_patches))
        numbers = number[of_places]
        corners = places - offset
        counted = (numbers >= 0) & (corners >= 0).all(axis=1) & (corners + reach < match.shape[:2]).all(axis=1)
        if whole is not None:
            counted[counted] = whole[*corners[counted].T]
        yield numbers[counted], corners[counted]


def _variance(patches: Patches, channels: int, counted: Mask | None) -> float:
    """Sum of the variances of the channels."""
    total = 0.0
    for channel in range(channels):
        plane = patches.plane(channel)
        total += float(channel_variances((plane if counted is None else plane[counted])[..., None]).sum())
    return total


def _counted(index: PatchIndex) -> np.ndarray:
    """Flat indices of the patches that count."""
    if index.whole is not None:
        return np.flatnonzero(index.whole)
    return np.arange(index.components.shape[0] * index.components.shape[1])


def _between_halves(index: PatchIndex) -> float:
    """Mean distance of some patches of the lower half of a picture to the nearest of its upper half.

    0 where the halves are too low, or masks leave one of them no patch.
    """
    reach = (SIDE - 1) * index.patches.step + 1
    middle = (index.patches.shape[0] + reach) // 2
    parts = [
        PatchIndex(
            index.patches,
            index.rows[chosen],
            index.components[chosen],
            with_squares(
                index.components[chosen][... if index.whole is None else index.whole[chosen]].reshape(
                    -1, index.components.shape[2]
                )
            ),
            None if index.whole is None else index.whole[chosen],
        )
        for chosen in (index.rows >= middle, index.rows < middle - reach)
    ]
    lower, upper = parts
    return nearest_distance(lower, upper, 128) if len(_counted(lower)) and len(_counted(upper)) else 0.0


def patch_distribution(task: Task) -> Figures:
    """Distance between the distributions of patches."""
    require_variation(task.exemplar)
    require_side(4 * SIDE, task.exemplar, task.result)
    task.require_all_made()
    deviation = float(np.sqrt(task.exemplar.variances.mean()))

    exemplar = projected(task.exemplar)
    levels = [level / deviation for level in sliced_wasserstein(exemplar, projected(task.result, len(exemplar)))]
    worst = sliced_wasserstein(exemplar, projected(task.shuffled, len(levels)))
    if not (levels and worst):
        raise UnmeasurableError(f"masks leave no patch of {SIDE} px")
    between = 0.0
    with contextlib.suppress(UnmeasurableError):
        left, right = (projected(half) for half in halves(task.exemplar)[0])
        between = float(np.mean(sliced_wasserstein(left, right) or [0.0])) / deviation
    ceiling = float(np.mean(worst)) / deviation
    return Figures(float(np.mean(levels)), sampling(task, between), ceiling, {"levels": levels})


def coherence_and_completeness(task: Task) -> tuple[Figures, Figures | str]:
    """Distances to the nearest patches in both directions, which share their index."""
    require_variation(task.exemplar)
    require_side(4 * SIDE, task.exemplar, task.result)
    steps = [step for step in (1, 4) if min(task.exemplar.shorter, task.result.shorter) >= 4 * SIDE * step]
    variance = float(task.exemplar.variances.sum())
    mean = task.exemplar.colors.mean(axis=0)[: task.exemplar.compared.shape[2]]
    rows = [_distances(task, step, mean) for step in steps]
    levels = np.array(rows) / variance
    coherence, completeness, of_shuffled, floor, of_plain = (float(mean) for mean in levels.mean(axis=0))
    of_result = Figures(coherence, floor, of_shuffled, {"levels": levels[:, 0].tolist()})
    if task.result.made is not None:
        return of_result, GIVEN
    return of_result, Figures(completeness, floor, of_plain, {"levels": levels[:, 1].tolist()})


def _distances(task: Task, step: int, mean: np.ndarray) -> list[float]:
    """Distances of patches of samples ``step`` px apart; each step has copies of the pictures.

    Of the result to the exemplar, the reverse, of shuffled squares to the exemplar, between the exemplar's halves,
    and of a plain picture.
    """
    wholes = [whole_patches(picture, step) for picture in (task.exemplar, task.result)]
    pictures = (task.exemplar, task.result, task.shuffled)
    patches = [Patches(picture.compared, step, mean) for picture in pictures]
    directions = principal_directions(patches[0], wholes[0])
    exemplar, result = (
        index_patches(one, directions, whole=whole) for one, whole in zip(patches, wholes, strict=False)
    )
    shuffled = index_patches(patches[2], directions, 8192)
    copies = None
    if task.match is not None:
        copies = functools.partial(copied_patches, task.match, task.source_shape[1], step, wholes[1])
    return [
        nearest_distance(result, exemplar),
        nearest_distance(exemplar, result, copies=copies),
        nearest_distance(shuffled, exemplar, 128),
        _between_halves(exemplar),
        _variance(patches[0], len(mean), task.exemplar.counted),
    ]
