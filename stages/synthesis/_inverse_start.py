"""Where a compaction begins: pieces of the texture, side by side."""

from typing import Literal

import numpy as np

from stages.kernels.threads import run_all, spans
from stages.synthesis._inverse import Level, Source

_PIECES = 600  # pieces of texture to choose from
_CLUSTERS = 512  # kinds of neighbourhoods that the pieces should hold


def start(
    level: Level, size: tuple[int, int], block: int, how: Literal["cover", "random"], rng: np.random.Generator
) -> Source:
    """Lay square pieces of the texture side by side.

    Parameters
    ----------
    size : height and width of the compaction, px.
    block : side of a piece, px; those at the right and lower border may be cut off.
    how : `random` takes any pieces; `cover` takes those that together hold most of what the texture has, and lays
        next the one that fits best to those above and to the left.
    """
    block = min(block, level.height, level.width)
    down, across = -(-size[0] // block), -(-size[1] // block)
    wanted = down * across
    room = (level.height - block + 1, level.width - block + 1)
    if how == "random" or block < level.size:
        pieces = rng.integers(0, room, (wanted, 2))
        order = np.arange(wanted)
    else:
        candidates = rng.integers(0, room, (max(_PIECES, 2 * wanted), 2))
        pieces = candidates[_covering(level, candidates, block, wanted)]
        order = _fitted(level, pieces, block, across)
    source = np.empty((2, down * block, across * block), np.int32)
    inside = np.indices((block, block))
    for cell, piece in enumerate(order):
        row, column = divmod(cell, across)
        there = (slice(row * block, (row + 1) * block), slice(column * block, (column + 1) * block))
        source[:, *there] = pieces[piece][:, None, None] + inside
    return np.ascontiguousarray(source[:, : size[0], : size[1]])


def _covering(level: Level, candidates: np.ndarray, block: int, wanted: int) -> np.ndarray:
    """One after the other the piece that brings all clusters nearest to what the pieces hold; (wanted,) numbers."""
    centres, cluster = level.centres(_CLUSTERS)
    share = np.bincount(cluster.ravel(), minlength=centres.size) / cluster.size
    vectors = level.vectors[centres].astype(np.float32)
    lengths = (vectors**2).sum(axis=1)
    steps = np.unique(np.linspace(0, block - level.size, min(5, block - level.size + 1)).astype(int))
    gaps = np.empty((len(candidates), centres.size))

    def measure(first: int, last: int) -> None:
        places = candidates[first:last, None, None] + np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1)
        numbers = (places[..., 0] * level.places[1] + places[..., 1]).reshape(-1)
        held = level.vectors[numbers].astype(np.float32)
        far = lengths + (held**2).sum(axis=1)[:, None] - 2 * (held @ vectors.T)
        gaps[first:last] = far.reshape(last - first, -1, centres.size).min(axis=1)

    run_all(measure, spans(len(candidates), 16))
    left = np.full(centres.size, np.inf)
    chosen: list[int] = []
    for _ in range(wanted):
        totals = np.minimum(gaps, left) @ share
        totals[chosen] = np.inf
        chosen.append(int(totals.argmin()))
        left = np.minimum(left, gaps[chosen[-1]])
    return np.array(chosen)


def _fitted(level: Level, pieces: np.ndarray, block: int, across: int) -> np.ndarray:
    """An order of the pieces, row by row, in which borders look like what they meet."""
    planes = level.pixels.reshape(level.height, level.width, level.channels).astype(np.float64)
    cut = np.stack([planes[row : row + block, column : column + block] for row, column in pieces])
    left = list(range(len(pieces)))
    order: list[int] = []
    while left:
        errors = np.zeros(len(left))
        if len(order) % across:
            errors += ((cut[left, :, 0] - cut[order[-1], :, -1]) ** 2).sum(axis=(1, 2))
        if len(order) >= across:
            errors += ((cut[left, 0] - cut[order[-across], -1]) ** 2).sum(axis=(1, 2))
        order.append(left.pop(int(errors.argmin())))
    return np.array(order)
