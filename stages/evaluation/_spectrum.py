"""Measures of long range: autocorrelation and repetition."""

import numpy as np
from jaxtyping import Bool, Float32

_NEAR = 12  # px; nearer offsets correlate by the texture's own smoothness
_LEAST_ROOM = 0.2  # where the exemplar repeats itself almost exactly, little excess means nothing


def autocorrelation(tone: Float32[np.ndarray, "h w"], reach: tuple[int, int]) -> Float32[np.ndarray, "p q"]:
    """Normalised autocorrelation at offsets of up to ``reach`` rows and columns; offset 0 is in the middle.

    Products outside the picture are not made up: each offset's sum is divided by the pixels that overlap.
    """
    from scipy import fft

    height, width = tone.shape
    centred = tone - tone.mean(dtype=np.float64)
    shape = (fft.next_fast_len(height + reach[0], real=True), fft.next_fast_len(width + reach[1], real=True))
    spectrum = fft.rfft2(centred.astype(np.float32), s=shape)
    power = (spectrum.real**2 + spectrum.imag**2).astype(np.float32)
    sums = fft.irfft2(power, s=shape)
    rows, columns = np.arange(-reach[0], reach[0] + 1), np.arange(-reach[1], reach[1] + 1)
    overlap = (height - np.abs(rows))[:, None] * (width - np.abs(columns))[None, :]
    means = sums[np.ix_(rows % shape[0], columns % shape[1])] / overlap
    variance = float(means[reach[0], reach[1]])
    return (means / variance if variance > 0 else means).astype(np.float32)


def _far(reach: tuple[int, int], near: float) -> Bool[np.ndarray, "p q"]:
    rows, columns = np.arange(-reach[0], reach[0] + 1), np.arange(-reach[1], reach[1] + 1)
    return np.asarray(np.hypot(rows[:, None], columns[None, :]) >= near)


def repetition(
    exemplar: Float32[np.ndarray, "h w"], result: Float32[np.ndarray, "H W"]
) -> tuple[float, tuple[int, int]]:
    """How much more the result correlates with itself at a distance than the exemplar does.

    The largest excess over the exemplar's autocorrelation near the same offset; where the exemplar does not reach,
    over its 99.5 percentile; as a share of the largest excess possible, 1 less the exemplar's.

    Returns
    -------
    excess : 0 or more; a verbatim tiling scores about 1.
    offset : the (row, column) displacement at which it is found, px.
    """
    import cv2

    step = max(1, min(result.shape) // 512)  # repetition is coarse; half the size is a quarter of the time
    if step > 1:
        exemplar, result = (
            cv2.resize(tone, (tone.shape[1] // step, tone.shape[0] // step), interpolation=cv2.INTER_AREA)
            for tone in (exemplar, result)
        )
    reach = (int(0.6 * result.shape[0]), int(0.6 * result.shape[1]))
    known = (min(exemplar.shape[0] // 2, reach[0]), min(exemplar.shape[1] // 2, reach[1]))
    theirs = autocorrelation(exemplar, known)
    far = _far(known, _NEAR / step)
    expected = np.full((2 * reach[0] + 1, 2 * reach[1] + 1), max(float(np.quantile(theirs[far], 0.995)), 0.0))
    middle = np.s_[reach[0] - known[0] : reach[0] + known[0] + 1, reach[1] - known[1] : reach[1] + known[1] + 1]
    expected[middle] = np.maximum(cv2.dilate(theirs, np.ones((5, 5), np.uint8)), 0)
    excess = (autocorrelation(result, reach) - expected) / np.maximum(1 - expected, _LEAST_ROOM)
    excess[~_far(reach, _NEAR / step)] = 0
    row, column = np.unravel_index(int(np.argmax(excess)), excess.shape)
    return max(float(excess[row, column]), 0.0), (int(row - reach[0]) * step, int(column - reach[1]) * step)
