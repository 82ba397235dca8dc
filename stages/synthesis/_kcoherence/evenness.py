"""How often each place of an exemplar should be used where control says what is wanted."""

import numpy as np
from jaxtyping import Float32

from texloom.stages.synthesis._kcoherence.correlation import kinds

_MOST = 2**16  # target pixels that are asked what they want
_SELDOM = 0.05  # least use that is expected of a place, as a share of even use


def expected_use(
    own: Float32[np.ndarray, "h w k"], wanted: Float32[np.ndarray, "H W k"], window: int
) -> Float32[np.ndarray, "h w"]:
    """Target pixels that each exemplar pixel should serve, mean over ``window`` px around it.

    Exemplar pixels of like control share evenly in the target pixels that want such control. So the mixture of
    textures under every value of control stays the exemplar's, while the values themselves may be asked for more
    or less often than the exemplar has them.

    Parameters
    ----------
    own, wanted : control of the exemplar and of the target, in one unit; without a channel all are alike.
    """
    from scipy.ndimage import uniform_filter

    pixels, targets = own.shape[0] * own.shape[1], wanted.shape[0] * wanted.shape[1]
    even = targets / pixels
    if own.shape[2] == 0:
        return np.full(own.shape[:2], even, np.float32)
    step = max(1, int(np.sqrt(targets / _MOST)))
    some = wanted[::step, ::step].reshape(-1, wanted.shape[2])
    found = kinds(np.concatenate([own.reshape(pixels, -1), some]))
    count = int(found.max()) + 1
    supply = np.bincount(found[:pixels], minlength=count)
    demand = np.bincount(found[pixels:], minlength=count) * (targets / len(some))
    ratio = np.maximum(demand / np.maximum(supply, 1), _SELDOM * even)
    shares = ratio[found[:pixels]].reshape(own.shape[:2])
    return np.asarray(uniform_filter(shares, window, mode="nearest"), np.float32)
