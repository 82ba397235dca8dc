"""Similarity sets of vectors on a grid, by clusters and propagation."""

import numpy as np
from jaxtyping import Int16, Int32

from texloom.stages.kernels.core.threads import run_all, run_spans

_PIECES = 16  # of work that threads share; any number gives the same result


def similarity_sets(
    vectors: Int16[np.ndarray, "n 32"],
    shape: tuple[int, int],
    members: np.ndarray,
    begin: np.ndarray,
    cluster_spans: list[tuple[int, int]],
    k: int,
    min_separation: int,
    most: int,
    rounds: int,
    lone: np.ndarray | None = None,
) -> Int32[np.ndarray, "n k"]:
    """For every place of a grid the most similar ones, itself first and the nearest next; -1 where there is none.

    The members of clusters are compared with each other, then every place tries the shifted sets of adjacent ones
    [Tong2002]_.

    Parameters
    ----------
    vectors : one a place, row by row; squared distances fit 31 bits.
    shape : places down and across.
    members, begin : places by cluster, and where each cluster begins.
    cluster_spans : (first, last) clusters for each call of a thread.
    min_separation : least distance of two members of a set along a row or a column, px.
    most : members of a cluster that each is compared with.
    rounds : of propagation.
    lone : places in no cluster whose sets begin with themselves; other such places have none.
    """
    from texloom.stages.kernels.compaction.tree import HALF
    from texloom.stages.kernels.kcoherence.candidates import NONE, cluster_candidates, propagate_candidates

    down, across = shape
    bits = across.bit_length()
    if down.bit_length() + bits > 31:
        raise ValueError(f"similarity sets of {down}x{across} places; 2^31 are possible")
    halves = np.ascontiguousarray(vectors).reshape(-1, HALF)
    candidates = np.full((len(vectors), k), -1, np.int32)
    distance = np.full((len(vectors), k), NONE, np.int32)
    if lone is not None:
        candidates[lone, 0], distance[lone, 0] = (lone // across) << bits | lone % across, 0
    fixed = (halves, members, begin, across, bits, min_separation, most, candidates, distance)
    run_all(cluster_candidates, [(*fixed, *span) for span in cluster_spans])
    for _ in range(rounds):
        known = candidates.copy()
        run_spans(
            propagate_candidates, (halves, down, across, bits, min_separation, known, candidates, distance),
            down, _PIECES,
        )  # fmt: skip
    places = (candidates >> bits) * np.int32(across) + (candidates & np.int32((1 << bits) - 1))
    return np.where(candidates < 0, np.int32(-1), places)
