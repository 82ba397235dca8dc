"""Where a compaction begins: pieces of the texture that overlap, joined along cheapest cuts."""

from collections.abc import Callable
from typing import Literal

import numpy as np
from jaxtyping import Float32, Float64, Int64, Integer

from texloom.stages.analysis.tsvq import cut
from texloom.stages.common.neighbourhoods import UNIT, product, whole
from texloom.stages.declare import InputError
from texloom.stages.kernels.core.threads import run_all, spans
from texloom.stages.synthesis._seams.cuts import Strips, laid_over
from texloom.stages.synthesis.inverse.level import Level, Source

_PIECES = 600  # pieces of texture to choose from
_KINDS = 48  # of neighbourhoods whose shares in the texture are kept
_CLUSTERS = 512  # kinds of neighbourhoods that the pieces should hold
_BEGINNINGS = 16  # pieces that the choice begins with in turn, as the best next one is seldom best for all


def start(
    level: Level,
    size: tuple[int, int],
    block: int,
    how: Literal["cover", "random"],
    seams: float,
    proportion: float,
    wrap: bool,
    rng: np.random.Generator,
) -> Source:
    """Lay pieces of the texture row by row, each over a quarter of those above it and to its left.

    Parameters
    ----------
    size : height and width of the compaction, px.
    block : longest side of a piece, px.
    how : `random` takes any pieces; `cover` takes the one that lowers the energy most, as far as can be told from
        what the pieces so far hold of the texture's clusters and from how the new one meets them, and does so
        several times, with another first piece each; the choice of least energy is laid.
    seams : price of what is visible where pieces meet.
    proportion : price of what there is more of than in the texture, times the texture's variance and the share of
        the whole that it takes; `cover` only.
    wrap : whether the compaction is a torus.
    """
    from texloom.stages.kernels.compaction.solver import seam_sum

    block = min(block, level.height, level.width, *size)
    (rows, height), (columns, width) = (begins(side, block, wrap) for side in size)
    possible = np.flatnonzero(whole(level.inside, (height, width)))
    if not possible.size:
        raise InputError(f"compact: no texture is {block} px high and wide; lower block")
    drawn = possible[rng.integers(0, possible.size, max(_PIECES, 2 * rows.size * columns.size))]
    candidates = np.stack(np.divmod(drawn, level.width - width + 1), axis=1)
    planes = level.pixels.reshape(level.height, level.width, level.channels).astype(np.float32)
    pieces = candidates.astype(np.int32)[:, :, None, None] + np.indices((height, width), np.int32)
    if how == "random" or min(height, width) < level.size:
        return lay(planes, pieces, rows, columns, size, lambda number, _: number, wrap)
    spread = float(planes[level.inside].var(axis=0, dtype=np.float64).sum()) / UNIT**2
    cover = _Cover(level, candidates, (height, width), rows.size * columns.size, proportion * spread)
    price = seams / (2 * size[0] * size[1])
    firsts = [None, *rng.integers(0, len(candidates), _BEGINNINGS - 1).tolist()]

    def laid(first: int | None) -> tuple[float, Source]:
        choice = _Choice(cover, first)
        source = lay(planes, pieces, rows, columns, size, lambda _, joints: choice.take(price * joints), wrap)
        visible = seam_sum(level.pixels, level.channels, wrap, source) / UNIT**2
        return choice.energy() + price * visible, source

    return min(run_all(laid, [(first,) for first in firsts]), key=lambda found: found[0])[1]


def lay(
    planes: Float32[np.ndarray, "h w c"],
    pieces: Integer[np.ndarray, "n 2 p q"],
    rows: np.ndarray,
    columns: np.ndarray,
    size: tuple[int, int],
    choose: Callable[[int, np.ndarray], int],
    wrap: bool = False,
) -> Source:
    """Lay a piece at every one of ``rows`` x ``columns``, each cut along where it differs least from those before.

    Parameters
    ----------
    planes : the texture, in fixed-point steps.
    pieces : the texture pixels of each piece that may be laid.
    rows, columns : where pieces begin, (r,) and (s,) whole numbers; see `begins`.
    size : height and width of the whole.
    choose : given the number of a place, row by row, and what would be visible along the joints of each piece laid
        there, squared CIELAB units, the number of the piece to lay.
    wrap : whether the last pieces of a row or column meet the first ones across the border.
    """
    height, width = pieces.shape[2:]
    planes, pieces = np.ascontiguousarray(planes), np.ascontiguousarray(pieces, np.int32)
    source = np.zeros((2, *size), np.int32)
    for number, (row, column) in enumerate((int(row), int(column)) for row in rows for column in columns):
        above, left = number // columns.size, number % columns.size
        strips = Strips(
            top=int(rows[above - 1]) + height - row if above else 0,
            left=int(columns[left - 1]) + width - column if left else 0,
            bottom=row + height - size[0] if wrap and above == rows.size - 1 and above else 0,
            right=column + width - size[1] if wrap and left == columns.size - 1 and left else 0,
        )
        there = np.ix_(np.arange(row, row + height) % size[0], np.arange(column, column + width) % size[1])
        stands = planes[source[0][there], source[1][there]]
        own = pieces[choose(number, _joints(planes, pieces, stands, strips))]
        errors = ((planes[own[0], own[1]] - stands) ** 2).sum(axis=2) * strips.mask((height, width))
        new = laid_over(np.asarray(errors, np.float32), strips)
        for axis in range(2):
            source[axis][there] = np.where(new, own[axis], source[axis][there])
    return source


def begins(side: int, block: int, wrap: bool = False) -> tuple[np.ndarray, int]:
    """Where pieces begin that fill a side and overlap by a quarter of ``block``; and how long they are.

    With ``wrap`` the last one goes on over the first.
    """
    overlap = block // 4
    if wrap and side > block:
        count = max(2, -(-side // (block - overlap)))
        return np.arange(count) * side // count, -(-side // count) + overlap
    count = max(1, -(-(side - overlap) // (block - overlap)))
    length = -(-(side - overlap) // count) + overlap
    return np.rint(np.linspace(0, side - length, count)).astype(np.int64), length


class _Cover:
    """What the pieces that may be taken hold, and what that lowers the energy by.

    Parameters
    ----------
    count : pieces that will be taken.
    dear : price of what the pieces have more of than the texture, as a share of the whole; squared CIELAB units.
    """

    def __init__(self, level: Level, candidates: np.ndarray, shape: tuple[int, int], count: int, dear: float):
        self.gaps, self.dear = _gaps(level, candidates, shape), dear
        self.wanted, own = _kinds(level, candidates, shape)
        self.own = own / count


class _Choice:
    """Pieces one after the other, each the one that lowers the energy most, given those that are taken already.

    Parameters
    ----------
    first : the piece to take first; the best one where it is none.
    """

    def __init__(self, cover: _Cover, first: int | None):
        self.cover, self.first = cover, first
        self.missing, self.more = np.array(np.inf), -cover.wanted

    def take(self, joints: np.ndarray) -> int:
        """Choose one; ``joints``, (pieces,), is what each would cost where it meets others."""
        if self.first is None:
            held, more = np.minimum(self.cover.gaps, self.missing), self.more + self.cover.own
            energy = held.sum(axis=1) + joints + self.cover.dear * np.maximum(more, 0).sum(axis=1)
            best = int(energy.argmin())
        else:
            best, self.first = self.first, None
        self.missing = np.minimum(self.cover.gaps[best], self.missing)
        self.more = self.more + self.cover.own[best]
        return best

    def energy(self) -> float:
        """That of what is taken, without what is visible where pieces meet; squared CIELAB units."""
        return float(self.missing.sum() + self.cover.dear * np.maximum(self.more, 0).sum())


def _kinds(
    level: Level, candidates: Int64[np.ndarray, "pieces 2"], shape: tuple[int, int]
) -> tuple[np.ndarray, Float64[np.ndarray, "pieces kinds"]]:
    """Shares of a few kinds of neighbourhoods in the texture, (kinds,), and in each piece."""
    known = level.tree.leaf >= 0
    owner = cut(level.tree.nodes, _KINDS)[np.where(known, level.tree.leaf, 0)]
    names, numbers = np.unique(owner, return_inverse=True)
    kind = numbers.reshape(known.shape)
    wanted = np.bincount(kind[known], minlength=names.size) / known.sum()
    down, across = (side - level.size + 1 for side in shape)
    own = np.empty((len(candidates), names.size))
    for number, (row, column) in enumerate(candidates):
        there = kind[row : row + down, column : column + across]
        own[number] = np.bincount(there.ravel(), minlength=names.size) / there.size
    return wanted, own


def _gaps(
    level: Level, candidates: Int64[np.ndarray, "pieces 2"], shape: tuple[int, int]
) -> Float64[np.ndarray, "pieces clusters"]:
    """What the inverse term would be for the members of each cluster, had the compaction only one of the pieces."""
    centres, cluster = level.centres(_CLUSTERS)
    known = cluster[level.counted]
    share = np.bincount(known, minlength=len(centres)) / known.size
    vectors = centres.astype(np.float32)
    lengths = (vectors**2).sum(axis=1)
    steps = [
        np.unique(np.linspace(0, side - level.size, min(5, side - level.size + 1)).astype(int)) for side in shape
    ]
    every, gaps = level.vectors, np.empty((len(candidates), len(centres)))

    def measure(first: int, last: int) -> None:
        places = candidates[first:last, None, None] + np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1)
        numbers = (places[..., 0] * level.places[1] + places[..., 1]).reshape(-1)
        held = every[numbers].astype(np.float32)
        far = lengths + (held**2).sum(axis=1)[:, None] - 2 * product(held, vectors.T)
        gaps[first:last] = far.reshape(last - first, -1, len(centres)).min(axis=1)

    run_all(measure, spans(len(candidates), 16))
    return gaps * (share / (level.components.unit * UNIT * level.size) ** 2)


def _joints(planes: np.ndarray, pieces: np.ndarray, stands: np.ndarray, strips: Strips) -> np.ndarray:
    """What is visible along the joints of each piece with what ``stands``, squared CIELAB units."""
    from texloom.stages.kernels.compaction.joint_cost import weighted_differences

    height, across = stands.shape[:2]
    weights = np.zeros((height, across))
    for width, part in (
        (strips.top, np.s_[: strips.top, :]),
        (strips.left, np.s_[:, : strips.left]),
        (strips.bottom, np.s_[height - strips.bottom :, :]),
        (strips.right, np.s_[:, across - strips.right :]),
    ):
        if width:
            # one pixel across the strip is cut through, and seen from both sides
            weights[part] += 2 / width
    total = np.empty(len(pieces))
    weighted_differences(planes, pieces, stands, weights, total)
    return total / UNIT**2
