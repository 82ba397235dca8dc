"""Tree-structured vector quantisation of a texture's neighbourhoods, for any number of clusters."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int16, Int32
from pydantic import Field

from texloom.stages.common.grids.size_checks import check_row_length
from texloom.stages.common.similarity.neighbourhoods import (
    UNIT,
    Components,
    Rectangles,
    fixed_point,
    inside_of,
    whole,
)
from texloom.stages.kernels.core.threads import run_all, run_spans
from texloom.stages.vocabulary.arrays import Channels
from texloom.stages.vocabulary.declare import InputError, OddSize, Params, stage
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.sizes import format_size

_PIECES = 16  # of work for threads; the tree does not depend on it
_GROWTH = 0.9  # of the work; the rest assigns neighbourhoods to leaves

Nodes: TypeAlias = Annotated[
    Int32[np.ndarray, "nodes 6"], Channels(("parent", "child", "row", "column", "count", "fold"))
]
"""one node a row, a parent before its children, the root first: the parent (-1 for the root); the left child, which
the right child follows (-1 for a leaf); the centre, a neighbourhood by its top-left pixel; the number of members;
the number of leaves of the whole tree just before this node is folded into a leaf (0 for a leaf)"""

Leaf: TypeAlias = Int32[np.ndarray, "p q"]
"""for every whole neighbourhood, by its top-left pixel, its leaf; -1 where there is none"""


class TsvqParams(Params):
    """Size of the neighbourhoods and of the tree."""

    neighbourhood: OddSize = Field(7, ge=3, le=15)
    """side of a neighbourhood, px"""
    error: float = Field(0.05, gt=0, lt=1)
    """maximum root mean squared distance of a leaf's members to their mean, as a share of the largest distance"""
    max_samples: int = Field(200_000, ge=1000, le=2_000_000)
    """maximum number of neighbourhoods from which the tree is grown, evenly spaced; the others are assigned to its
    leaves"""
    steps: int = Field(8, ge=1, le=100)
    """maximum number of k-means iterations per split"""


@dataclasses.dataclass(frozen=True)
class Tsvq:
    """The tree."""

    nodes: Nodes
    """structure of the tree and the centre of every node, one node a row"""
    distortion: Float64[np.ndarray, " nodes"]
    """of every node the sum of squared distances of its members to their mean, squared CIELAB units"""
    leaf: Leaf
    """the leaf of each neighbourhood"""
    clusters: int
    """number of leaves"""


def check_channels(params: TsvqParams, known: Mapping[str, Any]) -> None:
    """There must not be too many channels to compare neighbourhoods exactly."""
    features = known.get("features")
    if features is not None:
        check_row_length("tsvq", features.shape[2], params.neighbourhood)


@stage(version=2, check=check_channels)
def tsvq(features: Float32[np.ndarray, "h w c"], params: TsvqParams, rectangles: Rectangles | None = None) -> Tsvq:
    """Cluster all neighbourhoods of a texture by splitting clusters in two until their error is small.

    The centre of a cluster is its medoid, the member nearest to the mean. The order in which nodes are folded is
    stored, so that the same tree provides any number of clusters, see `cut`.

    Parameters
    ----------
    features : the planes that neighbourhoods are compared by, CIELAB units.
    rectangles : of the textures in an atlas; see `atlas`.

    Raises
    ------
    InputError
        the texture does not contain a whole neighbourhood, or is constant; there are too many channels.

    Notes
    -----
    Distances are those of the first 32 principal components. The largest distance is approximated by moving to the
    farthest neighbourhood while the distance grows.

    References
    ----------
    [Wei2000]_ section 4 for the tree; [Wei2008]_ section 4.2 for its centres, and section 5 for the error;
    [Gersho1992]_ chapter 17 for the order of folding.
    """
    size = params.neighbourhood
    height, width, channels = features.shape
    if size > min(height, width):
        raise InputError(
            f"tsvq: neighbourhood={size} px does not fit in a texture of {format_size((height, width))}; "
            "lower neighbourhood"
        )
    check_row_length("tsvq", channels, size)
    pixels = fixed_point(features)
    components = Components.of(pixels, channels, size)
    known = whole(inside_of(rectangles, height, width), size)
    tree = grow(components.vectors(pixels), known, components.unit, params, _tell)
    report(Progress(1.0))
    return tree


def _tell(done: float) -> None:
    report(Progress(_GROWTH * done))


def grow(
    vectors: Int16[np.ndarray, "n 32"],
    known: Bool[np.ndarray, "p q"],
    unit: float,
    params: TsvqParams,
    tell: Callable[[float], None] = lambda _: None,
) -> Tsvq:
    """Grow the tree of ``vectors``, one a neighbourhood, row by row.

    Parameters
    ----------
    known : the neighbourhoods to cluster.
    unit : the vectors' length for one fixed-point step, see `Components`.
    tell : receives the share of the neighbourhoods whose clusters are final, 0..1.
    """
    from texloom.stages.kernels.compaction.tree import HALF, drop_vectors, fold_sizes, split_nodes

    shape, inside = (known.shape[0], known.shape[1]), known.ravel()
    if not inside.any():
        raise InputError(f"tsvq: no texture contains a whole neighbourhood of {params.neighbourhood} px")
    bound = params.error * largest_distance(vectors if inside.all() else vectors[inside])
    if bound == 0:
        raise InputError("tsvq: the texture is constant; there is nothing to cluster")
    halves = np.ascontiguousarray(vectors).reshape(-1, HALF)
    step = max(1, math.ceil(math.sqrt(shape[0] * shape[1] / params.max_samples)))
    order = np.arange(inside.size).reshape(shape)[::step, ::step].ravel()
    order = order[inside[order]] if inside[order].any() else np.flatnonzero(inside)
    scratch = np.empty(order.size, np.int64)

    parent, begin, count = np.array([-1]), np.array([0]), np.array([order.size])
    table: list[np.ndarray] = []
    means_of: list[np.ndarray] = []
    distortions: list[np.ndarray] = []
    total = 0
    while begin.size:
        means = np.zeros((4 * begin.size, HALF), np.int16)
        medoid, left = np.zeros(begin.size, np.int64), np.zeros(begin.size, np.int64)
        distortion = np.zeros(begin.size)
        shared = (halves, order, scratch, begin, count, bound, params.steps, means, medoid, distortion, left)
        run_all(split_nodes, [(*shared, *span) for span in balanced(count)])
        inner = np.flatnonzero(left)
        child = np.full(begin.size, -1)
        child[inner] = total + begin.size + 2 * np.arange(inner.size)
        row, column = np.divmod(medoid, shape[1])
        table.append(np.stack([parent, child, row, column, count, np.zeros_like(count)], axis=1))
        means_of.append(means)
        distortions.append(distortion)
        parent = np.repeat(total + inner, 2)
        total += begin.size
        first, second = left[inner], count[inner] - left[inner]
        begin = np.stack([begin[inner], begin[inner] + first], axis=1).ravel()
        count = np.stack([first, second], axis=1).ravel()
        tell(1 - int(count.sum()) / order.size)

    nodes = np.concatenate(table).astype(np.int32)
    distortion = np.concatenate(distortions)
    fold, child = np.empty(total, np.int32), np.ascontiguousarray(nodes[:, 1])
    fold_sizes(np.ascontiguousarray(nodes[:, 0]), child, distortion, fold)
    nodes[:, 5] = fold
    leaf = np.empty(shape[0] * shape[1], np.int32)
    means = np.concatenate(means_of)
    run_spans(drop_vectors, (halves, child, means, leaf), leaf.size, _PIECES)
    leaf[~inside] = -1
    return Tsvq(nodes, distortion / (unit * UNIT) ** 2, leaf.reshape(shape), int((child < 0).sum()))


def balanced(count: np.ndarray) -> list[tuple[int, int]]:
    """Ranges of clusters, for threads, with about the same number of members."""
    done = np.cumsum(count)
    edges = np.searchsorted(done, done[-1] * np.arange(_PIECES + 1) / _PIECES)
    return list(itertools.pairwise(sorted({0, *edges.tolist(), count.size})))


def cut(nodes: Nodes, clusters: int) -> np.ndarray:
    """Fold the tree to at most ``clusters`` leaves with the least total distortion.

    Returns
    -------
    (n,) int32: for every node its leaf in the folded tree; a node above the leaves is its own.
    """
    from texloom.stages.kernels.compaction.tree import folded_into

    owner = np.empty(len(nodes), np.int32)
    folded_into(np.ascontiguousarray(nodes[:, 0]), np.ascontiguousarray(nodes[:, 5]), clusters, owner)
    return owner


def largest_distance(vectors: Int16[np.ndarray, "n 32"]) -> float:
    """Approximate largest distance between two vectors; at least half of the true one."""
    from texloom.stages.kernels.compaction.tree import HALF, farthest_vector

    halves = np.ascontiguousarray(vectors).reshape(-1, HALF)
    at, largest = 0, -1
    while True:
        at, squared = farthest_vector(halves, at)
        if squared <= largest:
            return math.sqrt(largest)
        largest = squared
