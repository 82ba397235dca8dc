"""Pull-push interpolation of the gaps of a field."""

import numpy as np
from jaxtyping import Float32


def pull_push(
    values: Float32[np.ndarray, "h w c"], weight: Float32[np.ndarray, "h w"]
) -> Float32[np.ndarray, "h w c"]:
    """``values`` where ``weight`` is 1, interpolated smoothly elsewhere [Gortler1996]_.

    Parameters
    ----------
    weight : 0..1, with at least one 1.
    """
    import cv2

    height, width = weight.shape
    if height * width == 1 or weight.min() >= 1:
        return values
    summed = _pulled(values * weight[..., None])
    amount = _pulled(weight[..., None])[..., 0]
    coarse = summed / np.maximum(amount, 1e-12)[..., None]
    coarse = pull_push(coarse, np.minimum(amount, 1).astype(np.float32))
    filled = np.empty(values.shape, np.float32)
    for k in range(coarse.shape[2]):  # plane by plane, as several are large together
        sides = (2 * coarse.shape[1], 2 * coarse.shape[0])
        plane = cv2.resize(np.ascontiguousarray(coarse[..., k]), sides)[:height, :width]
        filled[..., k] = values[..., k] * weight + (1 - weight) * plane
    return filled


def _pulled(planes: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "p q c"]:
    """Sums of 2x2 pixels."""
    height, width = planes.shape[:2]
    even = np.pad(planes, ((0, height % 2), (0, width % 2), (0, 0))) if height % 2 or width % 2 else planes
    return np.asarray(even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2], np.float32)
