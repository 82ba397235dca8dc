"""Values of control that a smooth target asks for far more often than an exemplar has them."""

import numpy as np
from jaxtyping import Float32, Float64

_OVERUSE = 2.0  # times even use that the exemplar's pixels of a value may serve those of the target
_LEVELS = 512  # of the values of a channel
_SAME = 1e-3  # difference of ranks that is none


def evenly_demanded(
    own: Float32[np.ndarray, "h w k"], wanted: Float32[np.ndarray, "H W k"]
) -> Float32[np.ndarray, "H W k"]:
    """The target's control, moved by as little as makes the exemplar's pixels suffice, each channel for itself.

    Where a map asks for an extreme over large regions, the few pixels of the exemplar that have it would repeat in
    rows. Values keep their order. A value has a rank in the target, the share of its pixels below, and one in the
    exemplar; where the latter rises more slowly than 1 / `_OVERUSE` of the former, the ranks in the exemplar are
    spread until it does, such that the sum of squares by which they change is least (isotonic regression).

    Parameters
    ----------
    own, wanted : control of the exemplar and of the target, in the same units.
    """
    if not own.shape[2]:
        return wanted
    return np.stack([_spread(own[..., k], wanted[..., k]) for k in range(own.shape[2])], axis=2)


def _spread(own: Float32[np.ndarray, "h w"], wanted: Float32[np.ndarray, "H W"]) -> Float32[np.ndarray, "H W"]:
    from scipy.optimize import isotonic_regression

    counts, edges = np.histogram(wanted, _LEVELS)
    values = ((edges[1:] + edges[:-1]) / 2)[counts > 0]
    counts = counts[counts > 0]
    sorted_own = np.sort(own, axis=None)
    supply = np.searchsorted(sorted_own, values) / own.size
    least: Float64[np.ndarray, "n"] = (counts.cumsum() - counts / 2) / wanted.size / _OVERUSE
    above = isotonic_regression(supply - least, weights=counts).x
    ranks = least + above.clip(0, 1 - 1 / _OVERUSE)
    moved = np.where(np.abs(ranks - supply) > _SAME, np.quantile(sorted_own, ranks), values)
    return np.asarray(np.interp(wanted, values, moved), np.float32)
