"""What no summary of a size can be expected to beat: as many separate neighbourhoods of the texture."""

import numpy as np

from texloom.stages.analysis.similarity.tsvq import Leaf, Nodes, cut
from texloom.stages.synthesis.inverse.energy import ExactEnergy
from texloom.stages.synthesis.inverse.level import nearest


def patch_energy(exact: ExactEnergy, nodes: Nodes, leaf: Leaf, count: int, rounds: int = 0) -> float:
    """Inverse energy of ``count`` whole neighbourhoods of the texture, chosen to represent all of them.

    A compaction of as many pixels has as many neighbourhoods, but they overlap, so that this is a bound for those
    whose neighbourhoods are real ones; those across joints may go below it. Squared CIELAB units a pixel.

    Parameters
    ----------
    nodes, leaf : the clusters of the texture, see `tsvq`, of which the choice is a cut.
    rounds : of k-medoids, which lower it by up to a tenth: each centre becomes the member nearest to the mean.
    """
    chosen = _medoids(exact, nodes, leaf, count)
    for _ in range(rounds):
        owner, spread = _spread(exact, chosen)
        order = np.lexsort((spread, owner))
        first = order[np.r_[True, np.diff(owner[order]) > 0]]
        chosen[owner[first]] = np.flatnonzero(exact.valid)[first]
    return exact.inverse_of_places(chosen)


def mean_energy(exact: ExactEnergy, nodes: Nodes, leaf: Leaf, count: int) -> float:
    """The same of the means of ``count`` clusters, which are no real neighbourhoods; by components alone."""
    spread = _spread(exact, _medoids(exact, nodes, leaf, count))[1]
    return float(spread.mean()) / exact.scale


def way(energy: float, crop: float, patches: float) -> float:
    """Share of the way from the best crop to the bound by real neighbourhoods: 0 the crop's energy, 1 the bound."""
    return (crop - energy) / max(crop - patches, 1e-9)


def _medoids(exact: ExactEnergy, nodes: Nodes, leaf: Leaf, count: int) -> np.ndarray:
    """Numbers of the centres of ``count`` clusters; where there are fewer, of what lies farthest from them too."""
    known = np.flatnonzero(exact.valid)
    own = np.unique(cut(nodes, count)[leaf.ravel()[known]])
    chosen = np.unique(nodes[own, 2].astype(np.int64) * exact.places[1] + nodes[own, 3])
    missing = min(count, known.size) - chosen.size
    if missing > 0:
        vectors = exact.vectors[known].astype(np.int32)
        difference = vectors - exact.vectors[chosen][nearest(exact.vectors[known], exact.vectors[chosen])]
        farthest = np.argsort(-np.square(difference).sum(axis=1), kind="stable")
        chosen = np.concatenate([chosen, known[farthest[:missing]]])
    return chosen


def _spread(exact: ExactEnergy, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each neighbourhood the nearest of ``chosen``, and its squared distance to the mean of its cluster."""
    vectors = exact.vectors[exact.valid.ravel()]
    owner = nearest(vectors, exact.vectors[chosen])
    sums = [np.bincount(owner, column, chosen.size) for column in vectors.T]
    counts = np.maximum(np.bincount(owner, minlength=chosen.size), 1)
    means = np.stack(sums, axis=1) / counts[:, None]
    return owner, ((vectors - means[owner]) ** 2).sum(axis=1)
