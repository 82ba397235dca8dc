"""Appearance vectors and similarity sets of one level of an exemplar.

Vectors are integers. A *place* is a pixel's index, row * width + column. The equivalent for distorted textures is
`texloom.stages.common.similarity.distorted_appearance`.
"""

from typing import TypeAlias

import numpy as np
from jaxtyping import Float32, Int16, Int32, Shaped

from texloom.stages.common.similarity.components import components
from texloom.stages.common.similarity.similarity_sets import similarity_sets
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.kernels.core.threads import run_spans, spans
from texloom.stages.kernels.core.vector_size import DIMENSIONS
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.vocabulary.arrays import Mask

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
_SIDE = 2 * _RADIUS + 1
_SAMPLE_SIZE = 4096  # windows from which the components are computed
_GOLDEN_RATIO = (np.sqrt(5) - 1) / 2  # its multiples, modulo 1, are spread evenly
_CLUSTER_SIZE = 40  # of the clusters in which sets are initially searched
_ROUNDS = 3  # of propagation between neighbours
_MAX_SEARCHED = 2**14  # whole neighbourhoods that may replace an incomplete one
_PIECES = 16


def blurred_levels(
    planes: Float32[np.ndarray, "h w c"], levels: int, toroidal: bool
) -> Float32[np.ndarray, "levels h w c"]:
    """Gaussian stack of ``planes`` for samples 2**level px apart; mirrored at borders, or toroidal."""
    ndimage = loaded("scipy.ndimage")
    stack = [planes]
    for level in range(1, levels):
        # Relative to the previous level, since variances add up.
        sigma = 0.6 * np.sqrt(4.0**level - 4.0 ** (level - 1))
        blurred = ndimage.gaussian_filter(
            stack[-1], (sigma, sigma, 0), mode="wrap" if toroidal else "reflect", truncate=3
        )
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
    """Rows and columns of evenly spread pixels of ``complete``, whatever its width."""
    places = np.flatnonzero(complete)
    if places.size > _SAMPLE_SIZE:
        shares = np.sort(np.arange(1, _SAMPLE_SIZE + 1) * _GOLDEN_RATIO % 1)
        places = places[(shares * places.size).astype(np.int64)]
    rows, columns = np.divmod(places, complete.shape[1])
    return rows, columns


def _around(
    planes: np.ndarray, rows: np.ndarray, columns: np.ndarray, offsets: list[tuple[int, int]]
) -> Shaped[np.ndarray, "n values"]:
    """The values at ``offsets`` from pixels of ``planes``, (h, w, c), side by side."""
    width, channels = planes.shape[1:]
    shifts = np.array([down * width + across for down, across in offsets])
    pixels = (rows * width + columns)[:, None] + shifts
    # for rows this short several times as fast as indexing
    return planes.reshape(-1, channels).take(pixels.ravel(), axis=0).reshape(rows.size, -1)


def appearances(planes: Float32[np.ndarray, "h w c"], complete: Mask, level: int, toroidal: bool) -> Appearance:
    """Principal components of the window of 5x5 samples around every pixel, from those of ``complete`` pixels."""
    from texloom.stages.kernels.per_pixel.flat_windows import project_windows

    height, width, _ = planes.shape
    step = 2**level
    margin = _RADIUS * step
    padded = np.pad(planes, ((margin, margin), (margin, margin), (0, 0)), "wrap" if toroidal else "reflect")
    rows, columns = _sample(complete)
    offsets = [(step * down, step * across) for down in range(_SIDE) for across in range(_SIDE)]
    mean, basis = components(_around(padded, rows, columns, offsets), COMPONENTS)
    projection = np.empty((height, width, COMPONENTS), np.float32)
    middle, axes = matrix_product(mean, basis).astype(np.float32), basis.astype(np.float32)
    shared = (np.ascontiguousarray(np.moveaxis(padded, 2, 0)), step, middle, axes, projection)
    run_spans(project_windows, shared, height, _PIECES)
    longest = float(np.sqrt((projection**2).sum(axis=2).max()))
    projection *= np.float32(MAX_LENGTH / max(longest, 1e-6))
    return projection.astype(np.int16)


def _bordered(appearance: Appearance, margin: int, toroidal: bool) -> Int16[np.ndarray, "down across 8"]:
    """Appearances continued beyond the borders: those at the border, unless toroidal."""
    return np.pad(appearance, ((margin, margin), (margin, margin), (0, 0)), "wrap" if toroidal else "edge")


def neighbour_basis(appearance: Appearance, complete: Mask, level: int, toroidal: bool) -> Basis:
    """Principal components of the appearances one step away in eight directions of ``complete`` pixels."""
    step = 2**level
    padded, (rows, columns) = _bordered(appearance, step, toroidal), _sample(complete)
    offsets = [(step * (1 + down), step * (1 + across)) for down, across in NEIGHBOURS]
    sample = _around(padded, rows, columns, offsets)
    return np.rint(components(sample, COMPONENTS)[1] * BASIS_LENGTH).astype(np.int16)


def neighbourhoods(appearance: Appearance, basis: Basis, level: int, toroidal: bool) -> Appearance:
    """The vectors that places are compared by: the sum of the projected appearances of their neighbours."""
    from texloom.stages.kernels.core.short_vectors import paired
    from texloom.stages.kernels.per_pixel.correction import describe

    step = 2**level
    padded = _bordered(appearance, step, toroidal)
    vectors = np.zeros_like(padded)
    run_spans(describe, (padded, paired(basis), step, step, vectors), len(appearance), _PIECES)
    return np.ascontiguousarray(vectors[step:-step, step:-step])


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
    basis = neighbour_basis(appearance, complete, level, toroidal)
    if k == 1 and complete.all():
        return appearance, basis, np.arange(complete.size, dtype=np.int32).reshape(*complete.shape, 1)
    vectors = neighbourhoods(appearance, basis, level, toroidal)
    return appearance, basis, similar_places(vectors, complete, 2**level, k, min_separation)


def similar_places(vectors: Appearance, complete: Mask, step: int, k: int, min_separation: int) -> Candidates:
    """The ``k`` most similar places of every place: itself if complete, else the nearest complete one; then others.

    Members of small clusters are compared with each other; then every place tries the shifted sets of its
    neighbours. Only one place every half a step is searched for, of the incomplete ones one a step, and the others
    follow it.
    """
    height, width = complete.shape
    places = np.arange(height * width, dtype=np.int32).reshape(height, width)
    every = max(1, step // 2)
    grid = np.s_[::every, ::every]
    searched = places[grid]
    sets = similar_sets(np.ascontiguousarray(vectors[grid]), complete[grid], k, max(1, min_separation // every))
    candidates = np.repeat(places[..., None], k, axis=2)
    for which in range(1, k):
        others = searched.ravel()[sets[:, which]].reshape(searched.shape)
        candidates[..., which] = _followed(others, every, complete)
    if not complete.all():
        nearest = _nearest_complete(vectors, complete, step)
        candidates[~complete] = candidates.reshape(-1, k)[nearest[~complete]]
    return candidates


def similar_sets(vectors: Appearance, complete: Mask, k: int, min_separation: int) -> Int32[np.ndarray, "places k"]:
    """Similarity sets of the complete places; the sets of others hold only themselves."""
    height, width = complete.shape
    places = np.arange(height * width, dtype=np.int32)
    if k == 1:
        return places[:, None]
    wide = np.zeros((height * width, DIMENSIONS), np.int16)
    wide[:, :COMPONENTS] = vectors.reshape(-1, COMPONENTS)
    outside = ~complete.ravel()
    wide[outside] = 0
    wide[outside, COMPONENTS] = FAR
    inside = places[~outside]
    members, begin = _clusters(vectors.reshape(-1, COMPONENTS)[inside])
    sets = similarity_sets(
        wide, (height, width), inside[members].astype(np.int64), begin, spans(begin.size - 1, _PIECES),
        k, max(1, min_separation), _CLUSTER_SIZE, _ROUNDS, places[outside],
    )  # fmt: skip
    return np.where((sets < 0) | outside[sets], places[:, None], sets)


def _clusters(vectors: Int16[np.ndarray, "n 8"]) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the vectors, sorted by cluster, and where each cluster begins.

    Clusters are quantiles by the first component, quantiles of those by the second, and so on.
    """
    count = len(vectors)
    parts = max(1, int(np.ceil((count / _CLUSTER_SIZE) ** 0.25)))
    cell = np.zeros(count, np.uint16)  # of 2.6 million vectors at most; numbers of 16 bits are sorted faster
    for component in range(4):
        order = np.argsort(vectors[:, component], kind="stable")
        order = order[np.argsort(cell[order], kind="stable")]
        sizes = np.bincount(cell)
        begin = np.cumsum(sizes) - sizes
        rank = np.empty(count, np.int64)
        rank[order] = np.arange(count) - begin[cell[order]]
        cell = (cell.astype(np.int64) * parts + rank * parts // sizes[cell]).astype(np.uint16)
    order = np.argsort(cell, kind="stable")
    return order, np.concatenate([np.flatnonzero(np.diff(cell[order].astype(np.int64), prepend=-1)), [count]])


def _nearest_complete(vectors: Appearance, complete: Mask, step: int) -> Int32[np.ndarray, "h w"]:
    """The complete place with the nearest vector for every incomplete one; of little meaning for complete ones."""
    spatial = loaded("scipy.spatial")
    from texloom.stages.kernels.core.threads import thread_count

    inside = np.flatnonzero(complete)
    inside = inside[:: max(1, inside.size // _MAX_SEARCHED)]
    cells = np.zeros((-(-complete.shape[0] // step), -(-complete.shape[1] // step)), bool)
    rows, columns = np.nonzero(~complete)
    cells[rows // step, columns // step] = True
    tree = spatial.KDTree(vectors.reshape(-1, COMPONENTS)[inside])
    targets = np.zeros(cells.shape, np.int64)
    targets[cells] = inside[tree.query(vectors[::step, ::step][cells], workers=thread_count())[1]]
    return _followed(targets, step, complete)


def _followed(targets: np.ndarray, every: int, complete: Mask) -> Int32[np.ndarray, "h w"]:
    """Targets of all places: those of every ``every``-th one, continued from there where that is complete."""
    height, width = complete.shape
    rows, columns = np.indices((height, width), dtype=np.int32)
    target = targets[rows // every, columns // every].astype(np.int32)
    # Beyond the border of a texture that is not toroidal comes the other one, where nothing is complete.
    to_rows = (target // width + rows % every) % height
    to_columns = (target % width + columns % every) % width
    return np.where(complete[to_rows, to_columns], to_rows * width + to_columns, target).astype(np.int32)
