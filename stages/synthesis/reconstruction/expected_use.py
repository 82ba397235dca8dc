"""Expected use of each exemplar pixel under control."""

import numpy as np
from jaxtyping import Float32

from texloom.stages.kernels.core.loading import loaded
from texloom.stages.synthesis.control_maps.correlation import median_cells

_MAX_SAMPLES = 2**16  # target pixels that demand is estimated from
_MIN_USE = 0.05  # of a pixel, as a share of even use


def expected_use(
    own: Float32[np.ndarray, "h w k"],
    wanted: Float32[np.ndarray, "H W k"],
    window: int,
    use: Float32[np.ndarray, "h w"] | None = None,
) -> Float32[np.ndarray, "h w"]:
    """Target pixels that each exemplar pixel should serve, mean over ``window`` px around it.

    Exemplar pixels of similar control share the target pixels of such control evenly. So the mixture of textures
    under every value of control stays the exemplar's, whatever the distribution of the values in the target.

    Parameters
    ----------
    own, wanted : control of the exemplar and of the target, in the same units; without channels all are equal.
    use : how often each exemplar pixel occurs in what the exemplar stands for, relative to the others of its
        control; none for evenly.
    """
    ndimage = loaded("scipy.ndimage")
    pixels, targets = own.shape[0] * own.shape[1], wanted.shape[0] * wanted.shape[1]
    even = targets / pixels
    weights = np.ones(pixels) if use is None else np.maximum(use.ravel().astype(np.float64), _MIN_USE)
    if own.shape[2] == 0:
        shares = (even * weights / weights.mean()).reshape(own.shape[:2])
        return np.asarray(ndimage.uniform_filter(shares, window, mode="nearest"), np.float32)
    step = max(1, int(np.sqrt(targets / _MAX_SAMPLES)))
    some = wanted[::step, ::step].reshape(-1, wanted.shape[2])
    cells = median_cells(np.concatenate([own.reshape(pixels, -1), some]))
    count = int(cells.max()) + 1
    supply = np.bincount(cells[:pixels], weights, minlength=count)
    demand = np.bincount(cells[pixels:], minlength=count) * (targets / len(some))
    ratio = np.maximum(demand / np.maximum(supply, _MIN_USE), _MIN_USE * even)
    shares = (weights * ratio[cells[:pixels]]).reshape(own.shape[:2])
    return np.asarray(ndimage.uniform_filter(shares, window, mode="nearest"), np.float32)
