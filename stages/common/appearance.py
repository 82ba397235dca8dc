"""Appearance vectors and similarity sets of one level of an exemplar.

Vectors are integers. A *place* is a pixel's index, row * width + column. The equivalent for distorted textures is
`texloom.stages.common.distorted_appearance`.
"""

from typing import TypeAlias

import numpy as np
from jaxtyping import Float32, Int16, Int32

from texloom.stages.arrays import Mask
from texloom.stages.common.components import components
from texloom.stages.kernels.core.threads import run_spans, spans

COMPONENTS = 8
"""dimensions of an appearance vector, and of a projected neighbourhood"""

NEIGHBOURS = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))
"""offsets of the appearances of a neighbourhood, in steps"""

BASIS_LENGTH = 2048
"""length of a basis vector; products with appearances are exact in single precision"""

MAX_LENGTH = 2000
"""of an appearance: sums of eight stay within 16000, and their differences within 16 bits"""

FAR = 16000
"""longer than any neighbourhood's vector"""

Appearance: TypeAlias = Int16[np.ndarray, "h w 8"]
Basis: TypeAlias = Int16[np.ndarray, "64 8"]
Candidates: TypeAlias = Int32[np.ndarray, "h w k"]
Analysis: TypeAlias = tuple[Appearance, Basis, Candidates]
"""of one level: appearances, the basis of neighbourhoods, similarity sets"""

_RADIUS = 2  # samples of a window on each side of its centre
_SAMPLE_SIZE = 10_000  # windows from which the components are computed
_BLOCK_SIZE = 2**14  # windows projected at a time
_CLUSTER_SIZE = 40  # of the clusters in which sets are initially searched
_ROUNDS = 3  # of propagation between neighbours
_MAX_SEARCHED = 2**14  # whole neighbourhoods that may replace an incomplete one
_PIECES = 16


def blurred_levels(
    planes: Float32[np.ndarray, "h w c"], levels: int, toroidal: bool
) -> Float32[np.ndarray, "levels h w c"]:
    """Gaussian stack of ``planes`` for samples 2**level px apart; mirrored at borders, or toroidal."""
    from scipy.ndimage import gaussian_filter

    stack = [planes]
    for level in range(1, levels):
        # Relative to the previous level, since variances add up.
        sigma = 0.6 * np.sqrt(4.0**level - 4.0 ** (level - 1))
        blurred = gaussian_filter(stack[-1], (sigma, sigma, 0), mode="wrap" if toroidal else "reflect", truncate=3)
        stack.append(blurred)
    return np.stack(stack)


def whole(valid: Mask, level: int, toroidal: bool) -> Mask:
    """The pixels whose neighbourhood, three steps in each direction, is valid."""
    reach = (_RADIUS + 1) * 2**level
    padded = np.pad(valid, reach, "wrap") if toroidal else np.pad(valid, reach)
    return np.logical_and.reduce(
        [_shifted(padded, valid.shape, (r, c)) for r in (-reach, 0, reach) for c in (-reach, 0, reach)]
    )


def _shifted(padded: np.ndarray, shape: tuple[int, ...], offset: tuple[int, int]) -> np.ndarray:
    """The values ``offset`` away from each pixel of ``shape``, whose padding is the same on every side."""
    top, left = ((side - size) // 2 + move for side, size, move in zip(padded.shape, shape, offset, strict=False))
    return padded[top : top + shape[0], left : left + shape[1]]


def _sample(complete: Mask) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of evenly spaced pixels of ``complete``."""
    rows, columns = np.nonzero(complete)
    step = max(1, rows.size // _SAMPLE_SIZE)
    return rows[::step], columns[::step]


def appearances(planes: Float32[np.ndarray, "h w c"], complete: Mask, level: int, toroidal: bool) -> Appearance:
    """Principal components of the window of 5x5 samples around every pixel, from those of ``complete`` pixels."""
    height, width, _ = planes.shape
    reach = range(-_RADIUS, _RADIUS + 1)
    margin = _RADIUS * 2**level
    padded = np.pad(planes, ((margin, margin), (margin, margin), (0, 0)), "wrap" if toroidal else "reflect")
    parts = [
        _shifted(padded, planes.shape, (row * 2**level, column * 2**level)) for row in reach for column in reach
    ]
    rows, columns = _sample(complete)
    mean, basis = components(np.concatenate([part[rows, columns] for part in parts], axis=1), COMPONENTS)
    projection = np.empty((height, width, COMPONENTS))
    for first, last in spans(height, -(-height * width // _BLOCK_SIZE)):
        # In double precision, so that the result does not depend on a library's order of summation.
        block = np.concatenate([part[first:last] for part in parts], axis=2, dtype=np.float64)
        projection[first:last] = (block - mean) @ basis
    longest = float(np.sqrt((projection**2).sum(axis=2).max()))
    return np.asarray(np.trunc(projection * (MAX_LENGTH / max(longest, 1e-6))), np.int16)


def neighbour_appearances(appearance: Appearance, level: int, toroidal: bool) -> Int16[np.ndarray, "h w 64"]:
    """The appearances one step away in eight directions; clamped at the border unless toroidal."""
    step = 2**level
    padded = np.pad(appearance, ((step, step), (step, step), (0, 0)), "wrap" if toroidal else "edge")
    parts = [_shifted(padded, appearance.shape, (step * row, step * column)) for row, column in NEIGHBOURS]
    return np.concatenate(parts, axis=2)


def projected(vectors: Int16[np.ndarray, "... n"], basis: Int16[np.ndarray, "n 8"]) -> Int16[np.ndarray, "... 8"]:
    """Appearances projected on ``basis``."""
    return np.rint((vectors.astype(np.float32) @ basis.astype(np.float32)) / np.float32(BASIS_LENGTH)).astype(
        np.int16
    )


def neighbourhoods(around: Int16[np.ndarray, "h w 64"], basis: Basis) -> Appearance:
    """The vectors that places are compared by: the sum of the projected appearances of their neighbours."""
    total = np.zeros((*around.shape[:2], COMPONENTS), np.int16)
    for side in range(len(NEIGHBOURS)):
        part = slice(COMPONENTS * side, COMPONENTS * (side + 1))
        total += projected(around[..., part], basis[part])
    return total


def analyse(
    planes: Float32[np.ndarray, "h w c"], valid: Mask, level: int, toroidal: bool, k: int, min_separation: int
) -> Analysis | None:
    """Appearance, basis and similarity sets of one level; None where no neighbourhood is whole.

    Parameters
    ----------
    valid : the pixels that may be used.
    min_separation : minimum distance between the members of a set, px.
    """
    complete = whole(valid, level, toroidal)
    if not complete.any():
        return None
    appearance = appearances(planes, complete, level, toroidal)
    around = neighbour_appearances(appearance, level, toroidal)
    basis = np.rint(components(around[_sample(complete)], COMPONENTS)[1] * BASIS_LENGTH).astype(np.int16)
    return appearance, basis, similar_places(neighbourhoods(around, basis), complete, 2**level, k, min_separation)


def similar_places(vectors: Appearance, complete: Mask, step: int, k: int, min_separation: int) -> Candidates:
    """The ``k`` most similar places of every place: itself if complete, else the nearest complete one; then others.

    Members of small clusters are compared with each other; then every place tries the shifted sets of its
    neighbours. Of the incomplete places only one a step is searched for, and the others follow it.
    """
    height, width = complete.shape
    candidates = similar_sets(vectors, complete, k, min_separation).reshape(height, width, k)
    if not complete.all():
        nearest = _nearest_complete(vectors, complete, step)
        candidates[~complete] = candidates.reshape(-1, k)[nearest[~complete]]
    return np.ascontiguousarray(candidates, np.int32)


def similar_sets(vectors: Appearance, complete: Mask, k: int, min_separation: int) -> Int32[np.ndarray, "places k"]:
    """Similarity sets of the complete places; the sets of others hold only themselves."""
    from texloom.stages.kernels.compaction.tree import HALF
    from texloom.stages.kernels.kcoherence.candidates import cluster_candidates, propagate_candidates

    height, width = complete.shape
    places = np.arange(height * width, dtype=np.int32)
    candidates = np.repeat(places[:, None], max(2, k), axis=1)
    if k > 1:
        wide = np.zeros((height * width, 2 * HALF), np.int16)
        wide[:, :COMPONENTS] = vectors.reshape(-1, COMPONENTS)
        outside = ~complete.ravel()
        wide[outside] = 0
        wide[outside, COMPONENTS] = FAR
        halves = wide.reshape(-1, HALF)
        inside = places[~outside]
        members, begin = _clusters(vectors.reshape(-1, COMPONENTS)[inside])
        distance = np.full(candidates.shape, 2**62, np.int64)
        candidates[:, 1:] = -1
        distance[:, 0] = 0
        members = inside[members].astype(np.int64)
        shared = (halves, members, begin, width, max(1, min_separation), _CLUSTER_SIZE, candidates, distance)
        run_spans(cluster_candidates, shared, begin.size - 1, _PIECES)
        for _ in range(_ROUNDS):
            fixed = (halves, height, width, max(1, min_separation), candidates.copy(), candidates, distance)
            run_spans(propagate_candidates, fixed, height, _PIECES)
        candidates = np.where((candidates < 0) | outside[candidates], places[:, None], candidates)
    return np.ascontiguousarray(candidates[:, :k], np.int32)


def _clusters(vectors: Int16[np.ndarray, "n 8"]) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the vectors, sorted by cluster, and where each cluster begins.

    Clusters are quantiles by the first component, quantiles of those by the second, and so on.
    """
    count = len(vectors)
    parts = max(1, int(np.ceil((count / _CLUSTER_SIZE) ** 0.25)))
    cell = np.zeros(count, np.int64)
    order = np.arange(count)
    for component in range(4):
        order = np.lexsort((vectors[:, component], cell))
        sizes = np.bincount(cell)
        begin = np.cumsum(sizes) - sizes
        rank = np.empty(count, np.int64)
        rank[order] = np.arange(count) - begin[cell[order]]
        cell = cell * parts + rank * parts // sizes[cell]
    order = np.argsort(cell, kind="stable")
    return order, np.concatenate([np.flatnonzero(np.diff(cell[order], prepend=-1)), [count]])


def _nearest_complete(vectors: Appearance, complete: Mask, step: int) -> Int32[np.ndarray, "h w"]:
    """The complete place with the nearest vector for every incomplete place; complete places are unchanged."""
    from scipy.spatial import KDTree

    from texloom.stages.kernels.core.threads import thread_count

    height, width = complete.shape
    inside = np.flatnonzero(complete)
    inside = inside[:: max(1, inside.size // _MAX_SEARCHED)]
    rows, columns = np.nonzero(~complete)
    queried = np.unique(rows // step * step * width + columns // step * step)
    tree = KDTree(vectors.reshape(-1, COMPONENTS)[inside])
    jump = np.zeros(height * width, np.int64)
    jump[queried] = inside[tree.query(vectors.reshape(-1, COMPONENTS)[queried], workers=thread_count())[1]]
    own_rows, own_columns = np.indices((height, width))
    near_rows, near_columns = own_rows // step * step, own_columns // step * step
    target = jump[near_rows * width + near_columns]
    # Continues from the jump's target where that is complete.
    to_rows = np.clip(target // width + own_rows - near_rows, 0, height - 1)
    to_columns = np.clip(target % width + own_columns - near_columns, 0, width - 1)
    nearest = np.where(complete[to_rows, to_columns], to_rows * width + to_columns, target)
    return np.where(complete, own_rows * width + own_columns, nearest).astype(np.int32)
