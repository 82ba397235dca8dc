"""The start of a compaction: overlapping blocks of the texture, joined along minimum cuts."""

from collections.abc import Callable
from itertools import product
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float32, Float64, Int64, Integer

from texloom.stages.analysis.similarity.tsvq import cut
from texloom.stages.common.similarity.neighbourhoods import UNIT, whole
from texloom.stages.kernels.core.threads import run_all, spans
from texloom.stages.numerics.matrices import row_product
from texloom.stages.synthesis.inverse.crops import best_corner
from texloom.stages.synthesis.inverse.energy import ExactEnergy
from texloom.stages.synthesis.inverse.level import Source, TextureLevel
from texloom.stages.synthesis.stitching.cuts import Strips, laid_over
from texloom.stages.vocabulary.declare import InputError

_CANDIDATES = 600  # minimum number of candidate blocks
_KINDS = 48  # clusters whose shares of the texture are preserved
_CLUSTERS = 512  # clusters that the blocks should cover
QUICK = (256, 2, 16)
"""effort of a quick search of the best crop: samples, finalists and grid of `best_corner`"""

_RESTARTS = 16  # greedy choices, each from another first block: the best next block is seldom best for the whole


def starts(
    level: TextureLevel,
    size: tuple[int, int],
    block: int,
    method: Literal["best", "cover", "random"],
    seams: float,
    proportion: float,
    wrap: bool,
    rng: np.random.Generator,
) -> list[Source]:
    """The arrangements that a compaction may start from; see `laid_blocks`, and for `best` the best crop too."""
    laid = laid_blocks(
        level, size, block, "random" if method == "random" else "cover", seams, proportion, wrap, rng
    )
    cropped = crop(level, size, wrap) if method == "best" else None
    return [laid] if cropped is None else [laid, cropped]


def crop(
    level: TextureLevel, size: tuple[int, int], wrap: bool, effort: tuple[int, int, int] = QUICK
) -> Source | None:
    """The crop of lowest inverse energy; None where there is none of that size in a single texture.

    With ``wrap`` the crop is larger by a margin, and cut where its ends meet. For the rest see `best_corner`.
    """
    blocks = [
        block_starts(side, -(-2 * side // 3), wrap) if wrap else (np.zeros(1, np.int64), side) for side in size
    ]
    whole_size = (int(blocks[0][0][-1]) + blocks[0][1], int(blocks[1][0][-1]) + blocks[1][1])
    if whole_size[0] > level.height or whole_size[1] > level.width:
        return None
    samples, finalists, grid = effort
    corner = best_corner(ExactEnergy.of_level(level, samples), size, finalists, grid)
    if corner is None:
        return None
    corner = (min(corner[0], level.height - whole_size[0]), min(corner[1], level.width - whole_size[1]))
    if not level.inside[corner[0] : corner[0] + whole_size[0], corner[1] : corner[1] + whole_size[1]].all():
        return None
    (rows, height), (columns, width) = blocks
    corners = np.array(list(product((rows + corner[0]).tolist(), (columns + corner[1]).tolist())), np.int32)
    parts = corners[:, :, None, None] + np.indices((height, width), np.int32)
    planes = level.pixels.reshape(level.height, level.width, level.channels).astype(np.float32)
    return lay(planes, parts, rows, columns, size, lambda number, _: number, wrap)


def laid_blocks(
    level: TextureLevel,
    size: tuple[int, int],
    block: int,
    method: Literal["cover", "random"],
    seams: float,
    proportion: float,
    wrap: bool,
    rng: np.random.Generator,
) -> Source:
    """Lay blocks of the texture row by row; each overlaps those above and to its left by a quarter.

    Parameters
    ----------
    size : height and width of the compaction, px.
    block : longest side of a block, px.
    method : `random` takes any blocks; `cover` greedily takes the block that lowers the energy most, estimated from
        the texture's clusters covered so far and the joints with its neighbours. This is repeated from several
        first blocks, and the arrangement of least energy is taken.
    seams : weight of the seam cost along joints.
    proportion : weight, times the texture's variance, of clusters' shares in excess of the texture's; `cover` only.
    wrap : whether the compaction is a torus.

    Raises
    ------
    InputError
        the textures of an atlas do not hold a block.
    """
    from texloom.stages.kernels.compaction.solver import seam_sum

    block = min(block, level.height, level.width, *size)
    (rows, height), (columns, width) = (block_starts(side, block, wrap) for side in size)
    possible = np.flatnonzero(whole(level.inside, (height, width)))
    if not possible.size:
        raise InputError(f"compact: no texture is {block} px high and wide; lower block")
    drawn = possible[rng.integers(0, possible.size, max(_CANDIDATES, 2 * rows.size * columns.size))]
    candidates = np.stack(np.divmod(drawn, level.width - width + 1), axis=1)
    planes = level.pixels.reshape(level.height, level.width, level.channels).astype(np.float32)
    blocks = candidates.astype(np.int32)[:, :, None, None] + np.indices((height, width), np.int32)
    if method == "random" or min(height, width) < level.size:
        return lay(planes, blocks, rows, columns, size, lambda number, _: number, wrap)
    variance = float(planes[level.inside].var(axis=0, dtype=np.float64).sum()) / UNIT**2
    texture_shares, block_shares = _cluster_shares(level, candidates, (height, width))
    coverage = _ClusterCoverage(
        distances=_distances(level, candidates, (height, width)),
        texture_shares=texture_shares,
        block_shares=block_shares / (rows.size * columns.size),
        excess_weight=proportion * variance,
    )
    seam_weight = seams / (2 * size[0] * size[1])
    firsts = [None, *rng.integers(0, len(candidates), _RESTARTS - 1).tolist()]

    def arrange(first: int | None) -> tuple[float, Source]:
        choice = _GreedyChoice(coverage, first)
        source = lay(planes, blocks, rows, columns, size, lambda _, joints: choice.take(seam_weight * joints), wrap)
        visible = seam_sum(level.pixels, level.channels, wrap, source) / UNIT**2
        return choice.energy() + seam_weight * visible, source

    return min(run_all(arrange, [(first,) for first in firsts]), key=lambda arranged: arranged[0])[1]


def lay(
    planes: Float32[np.ndarray, "h w c"],
    blocks: Integer[np.ndarray, "n 2 p q"],
    rows: np.ndarray,
    columns: np.ndarray,
    size: tuple[int, int],
    choose: Callable[[int, np.ndarray], int],
    wrap: bool = False,
) -> Source:
    """Lay a block at each of ``rows`` x ``columns``, joined to those before it along minimum boundary cuts.

    Parameters
    ----------
    planes : the texture, in fixed-point steps.
    blocks : texture pixels of each candidate block.
    rows, columns : first rows and columns of the blocks; see `block_starts`.
    size : height and width of the whole, px.
    choose : index of the block to lay, given the number of the place, row by row, and for each candidate the
        squared differences along its joints there, squared CIELAB units.
    wrap : whether the last blocks of a row or column meet the first ones across the border.
    """
    height, width = blocks.shape[2:]
    planes, blocks = np.ascontiguousarray(planes), np.ascontiguousarray(blocks, np.int32)
    source = np.zeros((2, *size), np.int32)
    corners = product(enumerate(rows.tolist()), enumerate(columns.tolist()))
    for number, ((i, row), (j, column)) in enumerate(corners):
        strips = Strips(
            top=int(rows[i - 1]) + height - row if i else 0,
            left=int(columns[j - 1]) + width - column if j else 0,
            bottom=row + height - size[0] if wrap and 0 < i == rows.size - 1 else 0,
            right=column + width - size[1] if wrap and 0 < j == columns.size - 1 else 0,
        )
        into = np.ix_(np.arange(row, row + height) % size[0], np.arange(column, column + width) % size[1])
        existing = planes[source[0][into], source[1][into]]
        own = blocks[choose(number, _joints(planes, blocks, existing, strips))]
        errors = ((planes[own[0], own[1]] - existing) ** 2).sum(axis=2) * strips.mask((height, width))
        new = laid_over(np.asarray(errors, np.float32), strips)
        for axis in range(2):
            source[axis][into] = np.where(new, own[axis], source[axis][into])
    return source


def block_starts(side: int, block: int, wrap: bool = False) -> tuple[np.ndarray, int]:
    """First pixels of blocks that cover a side and overlap by a quarter of ``block``, and the blocks' length.

    With ``wrap`` the last block overlaps the first.
    """
    overlap = block // 4
    if wrap and side > block:
        count = max(2, -(-side // (block - overlap)))
        return np.arange(count) * side // count, -(-side // count) + overlap
    count = max(1, -(-(side - overlap) // (block - overlap)))
    length = -(-(side - overlap) // count) + overlap
    return np.rint(np.linspace(0, side - length, count)).astype(np.int64), length


class _ClusterCoverage(NamedTuple):
    """Clusters of the texture that each candidate block covers; see `_distances` and `_cluster_shares`."""

    distances: Float64[np.ndarray, "clusters blocks"]
    texture_shares: Float64[np.ndarray, " kinds"]
    block_shares: Float64[np.ndarray, "blocks kinds"]
    """divided by the number of blocks that will be taken"""
    excess_weight: float
    """cost of a cluster's share of the blocks in excess of its share of the texture, squared CIELAB units"""


class _GreedyChoice:
    """Takes blocks one by one, each the one that lowers the energy most.

    Parameters
    ----------
    first : the block to take first; none takes the best.
    """

    def __init__(self, coverage: _ClusterCoverage, first: int | None):
        self.coverage, self.first = coverage, first
        self.missing, self.excess = np.full(len(coverage.distances), np.inf), -coverage.texture_shares

    def take(self, joints: np.ndarray) -> int:
        """Choose a block; ``joints`` is the (blocks,) cost of each one's joints with its neighbours."""
        from texloom.stages.kernels.compaction.coverage import missing_sums

        coverage = self.coverage
        if self.first is None:
            energy = np.empty(len(joints))
            missing_sums(coverage.distances, self.missing, energy)
            energy += joints
            if coverage.excess_weight:
                excess = np.maximum(self.excess + coverage.block_shares, 0)
                energy += coverage.excess_weight * excess.sum(axis=1)
            best = int(energy.argmin())
        else:
            best, self.first = self.first, None
        self.missing = np.minimum(coverage.distances[:, best], self.missing)
        self.excess = self.excess + coverage.block_shares[best]
        return best

    def energy(self) -> float:
        """Energy of the blocks taken, without their joints; squared CIELAB units."""
        return float(self.missing.sum() + self.coverage.excess_weight * np.maximum(self.excess, 0).sum())


def _cluster_shares(
    level: TextureLevel, candidates: Int64[np.ndarray, "blocks 2"], shape: tuple[int, int]
) -> tuple[np.ndarray, Float64[np.ndarray, "blocks kinds"]]:
    """Shares of `_KINDS` clusters in the texture, (kinds,), and in each block."""
    valid = level.tree.leaf >= 0
    owner = cut(level.tree.nodes, _KINDS)[np.where(valid, level.tree.leaf, 0)]
    names, numbers = np.unique(owner, return_inverse=True)
    kind = numbers.reshape(valid.shape)
    texture_shares = np.bincount(kind[valid], minlength=names.size) / valid.sum()
    down, across = (side - level.size + 1 for side in shape)
    block_shares = np.empty((len(candidates), names.size))
    for number, (row, column) in enumerate(candidates):
        inside = kind[row : row + down, column : column + across]
        block_shares[number] = np.bincount(inside.ravel(), minlength=names.size) / inside.size
    return texture_shares, block_shares


def _distances(
    level: TextureLevel, candidates: Int64[np.ndarray, "blocks 2"], shape: tuple[int, int]
) -> Float64[np.ndarray, "clusters blocks"]:
    """Share of each cluster in the inverse term if the compaction consisted of one block alone."""
    centres, cluster = level.centres(_CLUSTERS)
    counted = cluster[level.counted]
    share = np.bincount(counted, minlength=len(centres)) / counted.size
    centre_vectors = centres.astype(np.float32)
    lengths = (centre_vectors**2).sum(axis=1)
    steps = [
        np.unique(np.linspace(0, side - level.size, min(5, side - level.size + 1)).astype(int)) for side in shape
    ]
    vectors, distances = level.vectors, np.empty((len(candidates), len(centres)))

    def measure(first: int, last: int) -> None:
        places = candidates[first:last, None, None] + np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1)
        numbers = (places[..., 0] * level.places[1] + places[..., 1]).reshape(-1)
        block = vectors[numbers].astype(np.float32)
        squared = lengths + (block**2).sum(axis=1)[:, None] - 2 * row_product(block, centre_vectors.T)
        distances[first:last] = squared.reshape(last - first, -1, len(centres)).min(axis=1)

    run_all(measure, spans(len(candidates), 16))
    return np.ascontiguousarray((distances * (share / (level.components.unit * UNIT * level.size) ** 2)).T)


def _joints(planes: np.ndarray, blocks: np.ndarray, existing: np.ndarray, strips: Strips) -> np.ndarray:
    """Expected seam cost of each block with the pixels laid before it, squared CIELAB units."""
    from texloom.stages.kernels.compaction.joint_cost import weighted_differences

    height, across = existing.shape[:2]
    weights = np.zeros((height, across))
    for width, part in (
        (strips.top, np.s_[: strips.top, :]),
        (strips.left, np.s_[:, : strips.left]),
        (strips.bottom, np.s_[height - strips.bottom :, :]),
        (strips.right, np.s_[:, across - strips.right :]),
    ):
        if width:
            # A cut passes one pixel across the strip, whose difference counts on both sides.
            weights[part] += 2 / width
    total = np.empty(len(blocks))
    weighted_differences(planes, blocks, existing, weights, total)
    return total / UNIT**2
