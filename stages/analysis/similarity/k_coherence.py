"""k-coherence: for each neighbourhood of a texture, the most similar other neighbourhoods."""

import dataclasses
from typing import TypeAlias

import numpy as np
from jaxtyping import Float32, Int16, Int32
from pydantic import Field

from texloom.stages.analysis.similarity.tsvq import Leaf, Nodes, balanced
from texloom.stages.common.similarity.neighbourhoods import Components, fixed_point
from texloom.stages.common.similarity.similarity_sets import similarity_sets
from texloom.stages.vocabulary.declare import Params, stage

_CLUSTER_SIZE = 48  # maximum size of the clusters in which sets are initially searched

Candidates: TypeAlias = Int32[np.ndarray, "p q k"]
"""for every whole neighbourhood, by its top-left pixel, the most similar ones, itself first and the nearest next; a
neighbourhood is row * q + column, -1 where there is none"""


class KCoherenceParams(Params):
    """Size of the similarity sets, and effort of the search."""

    k: int = Field(5, ge=1, le=32)
    """size of a similarity set, including the neighbourhood itself"""
    rounds: int = Field(2, ge=0, le=10)
    """propagation rounds between adjacent neighbourhoods"""


@dataclasses.dataclass(frozen=True)
class KCoherence:
    """Similarity sets."""

    candidates: Candidates
    """for every neighbourhood the most similar ones, the nearest first"""


@stage(version=1)
def k_coherence(
    features: Float32[np.ndarray, "h w c"], nodes: Nodes, leaf: Leaf, params: KCoherenceParams
) -> KCoherence:
    """Find the similarity set of each neighbourhood; its members are half a neighbourhood or more apart.

    The search is approximate: the members of small clusters are compared with each other, then every neighbourhood
    tries the shifted sets of adjacent ones.

    Parameters
    ----------
    features : the planes that neighbourhoods are compared by, CIELAB units.
    nodes, leaf : the tree of its neighbourhoods, see `tsvq`.

    Raises
    ------
    ValueError
        ``leaf`` does not match ``features``.

    References
    ----------
    [Tong2002]_ section 4; [Wei2008]_ section 4.2.
    """
    height, width, channels = features.shape
    size = height - leaf.shape[0] + 1
    if size < 1 or leaf.shape[1] != width - size + 1:
        raise ValueError(f"leaf of shape {leaf.shape} for features of shape {features.shape}")
    pixels = fixed_point(features)
    vectors = Components.of(pixels, channels, size).vectors(pixels)
    return KCoherence(similar_places(vectors, nodes, leaf, size // 2, params))


def similar_places(
    vectors: Int16[np.ndarray, "n 32"], nodes: Nodes, leaf: Leaf, min_separation: int, params: KCoherenceParams
) -> Candidates:
    """The similarity sets of ``vectors``, one a neighbourhood; members are ``min_separation`` px apart or more."""
    cluster = _small_clusters(nodes, leaf.ravel())
    inside = np.flatnonzero(cluster >= 0)
    members = inside[np.argsort(cluster[inside], kind="stable")]
    sizes = np.bincount(cluster[inside], minlength=1)
    begin = np.concatenate([[0], np.cumsum(sizes)])
    separation = max(1, min_separation)
    sets = similarity_sets(
        vectors, leaf.shape, members, begin, balanced(sizes), params.k, separation, _CLUSTER_SIZE, params.rounds
    )
    return sets.reshape(*leaf.shape, params.k)


def _small_clusters(nodes: Nodes, leaf: np.ndarray) -> np.ndarray:
    """For every neighbourhood its highest node with at most `_CLUSTER_SIZE` members, or its leaf; else -1."""
    members = np.bincount(leaf[leaf >= 0], minlength=len(nodes))
    for node in range(len(nodes) - 1, 0, -1):
        members[nodes[node, 0]] += members[node]
    owner = np.arange(len(nodes))
    for node in range(1, len(nodes)):
        parent = nodes[node, 0]
        if members[parent] <= _CLUSTER_SIZE:
            owner[node] = owner[parent]
    return np.where(leaf >= 0, owner[leaf], -1)
