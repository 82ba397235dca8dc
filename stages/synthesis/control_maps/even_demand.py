"""Values of control that a target asks for far more often than an exemplar has them."""

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.kernels.core.loading import loaded

_OVERUSE = 2.0  # times even use that the exemplar's pixels of a value may serve those of the target
_LEVELS = 512  # of the values of a channel
_SAME = 1e-3  # difference of ranks that is none
_EVEN = 0.02  # share of the target that is an even region, where so many pixels have one value


def evenly_demanded(
    own: Float32[np.ndarray, "h w k"],
    wanted: Float32[np.ndarray, "H W k"],
    farthest: float,
    use: Float32[np.ndarray, "h w"] | None = None,
) -> tuple[Float32[np.ndarray, "h w k"], Float32[np.ndarray, "H W k"]]:
    """Control moved by as little as makes the exemplar's pixels suffice, each channel for itself.

    Where a map asks for an extreme over large regions, the few pixels of the exemplar that have it would repeat in
    rows. Values keep their order. A value has a rank in the target, the share of its pixels below, and one in the
    exemplar; where the latter rises more slowly than 1 / `_OVERUSE` of the former, the ranks in the exemplar are
    spread until it does, such that the sum of squares by which they change is least (isotonic regression). The one
    value of an even region becomes that of as many of the exemplar's pixels as it takes.

    Parameters
    ----------
    own, wanted : control of the exemplar and of the target, in the same units.
    farthest : that a value may move; values farther away are another material's, however few pixels have this one.
    use : how often each pixel of the exemplar may be used, relative to the others; none: all alike.

    Returns
    -------
    control of the exemplar, and that of the target.
    """
    if not own.shape[2]:
        return own, wanted
    planes = [_spread(own[..., k], wanted[..., k], farthest, use) for k in range(own.shape[2])]
    both = [np.stack(parts, axis=2) for parts in zip(*planes, strict=True)]
    return both[0], both[1]


def _spread(
    own: Float32[np.ndarray, "h w"],
    wanted: Float32[np.ndarray, "H W"],
    farthest: float,
    use: Float32[np.ndarray, "h w"] | None,
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "H W"]]:
    optimize = loaded("scipy.optimize")

    def at(ranks: Float64[np.ndarray, "*_"]) -> Float64[np.ndarray, "*_"]:
        if use is None:
            return np.asarray(np.quantile(sorted_own, ranks), np.float64)
        return np.interp(ranks, (sums[1:] + sums[:-1]) / 2, sorted_own)

    counts, edges = np.histogram(wanted, _LEVELS)
    values = np.histogram(wanted, edges, weights=wanted.astype(np.float64))[0][counts > 0] / counts[counts > 0]
    shares = counts[counts > 0] / wanted.size
    order = np.argsort(own, axis=None, kind="stable")
    sorted_own = own.ravel()[order]
    sums = np.append(0, np.ones(own.size) if use is None else use.ravel()[order].astype(np.float64)).cumsum()
    sums /= sums[-1]
    below = sums[np.searchsorted(sorted_own, np.append(edges[:-1], np.nextafter(edges[-1], np.inf)))]
    supply = ((below[1:] + below[:-1]) / 2)[counts > 0]
    least: Float64[np.ndarray, "n"] = (shares.cumsum() - shares / 2) / _OVERUSE
    above = optimize.isotonic_regression(supply - least, weights=shares).x
    ranks = least + above.clip(0, 1 - 1 / _OVERUSE)
    moved = np.where(np.abs(ranks - supply) > _SAME, at(ranks), values)
    moved = moved.clip(values - farthest, values + farthest)
    alike = own.copy()
    for region in np.flatnonzero(shares > _EVEN):
        half = shares[region] / _OVERUSE / 2
        low, high = at(np.clip([ranks[region] - half, ranks[region] + half], 0, 1))
        served = (own >= low) & (own <= high) & (np.abs(own - moved[region]) <= farthest)
        alike[served] = moved[region]
    return alike, np.asarray(wanted + np.interp(wanted, values, moved - values), np.float32)
