"""Autocorrelation at long range, and how far a texture repeats itself more than its exemplar."""

import numpy as np
from jaxtyping import Bool, Float32

from texloom.stages.vocabulary.arrays import Mask

_MIN_OFFSET = 12  # px; at smaller ones, the texture's smoothness correlates
_MIN_OVERLAP = 0.05  # of the picture, for an offset to be known
_MIN_ROOM = 0.2  # of the excess; where the exemplar is almost periodic, a small one is meaningless


def autocorrelation(
    tone: Float32[np.ndarray, "h w"], reach: tuple[int, int], valid: Mask | None = None
) -> Float32[np.ndarray, "p q"]:
    """Normalised autocorrelation at offsets of up to ``reach`` rows and columns; offset 0 is in the middle.

    Each offset's sum is divided by the number of valid pixels that overlap; where hardly any do, it is 0.
    """
    height, width = tone.shape
    rows, columns = np.arange(-reach[0], reach[0] + 1), np.arange(-reach[1], reach[1] + 1)
    if valid is None:
        centred = tone - tone.mean(dtype=np.float64)
        overlap = (height - np.abs(rows))[:, None] * (width - np.abs(columns))[None, :]
        means = _shifted_products(centred.astype(np.float32), reach) / overlap
    else:
        centred = np.where(valid, tone - tone[valid].mean(dtype=np.float64), 0)
        pairs = np.rint(_shifted_products(valid.astype(np.float64), reach))
        known = pairs >= max(1, _MIN_OVERLAP * valid.sum())
        means = np.where(known, _shifted_products(centred.astype(np.float32), reach) / np.maximum(pairs, 1), 0)
    variance = float(means[reach[0], reach[1]])
    return (means / variance if variance > 0 else means).astype(np.float32)


def _shifted_products(plane: np.ndarray, reach: tuple[int, int]) -> np.ndarray:
    """Sum of each pixel times the one at an offset, 0 outside, for offsets of up to ``reach``."""
    import cv2

    shape = tuple(cv2.getOptimalDFTSize(side + most) for side, most in zip(plane.shape, reach, strict=True))
    padded = np.zeros(shape, plane.dtype)
    padded[: plane.shape[0], : plane.shape[1]] = plane
    spectrum = cv2.dft(padded, nonzeroRows=plane.shape[0])
    power = cv2.mulSpectrums(spectrum, spectrum, 0, conjB=True)
    rows, columns = (np.arange(-most, most + 1) % side for most, side in zip(reach, shape, strict=True))
    return np.asarray(cv2.dft(power, flags=cv2.DFT_INVERSE | cv2.DFT_SCALE)[np.ix_(rows, columns)])


def _far(reach: tuple[int, int], near: float) -> Bool[np.ndarray, "p q"]:
    rows, columns = np.arange(-reach[0], reach[0] + 1), np.arange(-reach[1], reach[1] + 1)
    return np.asarray(np.hypot(rows[:, None], columns[None, :]) >= near)


def repetition(
    exemplar: Float32[np.ndarray, "h w"],
    result: Float32[np.ndarray, "H W"],
    valid: tuple[Mask | None, Bool[np.ndarray, "H W"] | None] = (None, None),
    cells: bool = True,
) -> tuple[float, tuple[int, int]]:
    """Excess of the result's long-range autocorrelation over the exemplar's.

    The largest excess over the exemplar's autocorrelation near the same offset. Where the exemplar is too small, it
    is that over its 99.5 percentile; with ``cells`` over the most in the outer half of its offsets, as from a cell
    of a lattice to others; or over what holds in that half of the same row or column, as along straight lines. It
    is a share of the largest excess possible, 1 minus the exemplar's. ``valid``: pixels of either that count; None
    is all.

    Returns
    -------
    excess : 0 or more; a verbatim tiling scores about 1.
    offset : the (row, column) displacement at which it occurs, px.
    """
    import cv2

    step = max(1, min(result.shape) // 512)  # repetition is coarse, and half the size takes a quarter of the time
    if step > 1:
        exemplar, result = (
            cv2.resize(tone, (tone.shape[1] // step, tone.shape[0] // step), interpolation=cv2.INTER_AREA)
            for tone in (exemplar, result)
        )
        valid = (whole_squares(valid[0], step), whole_squares(valid[1], step))
    reach = (int(0.6 * result.shape[0]), int(0.6 * result.shape[1]))
    known = (min(exemplar.shape[0] // 2, reach[0]), min(exemplar.shape[1] // 2, reach[1]))
    correlation = autocorrelation(exemplar, known, valid[0])
    far = _far(known, _MIN_OFFSET / step)
    usual = max(float(np.quantile(correlation[far], 0.995)), 0.0)
    if cells:
        usual = max(usual, float(correlation[_far(known, min(known) / 2)].max()))
    expected = np.full((2 * reach[0] + 1, 2 * reach[1] + 1), usual)
    correlation = np.maximum(cv2.dilate(correlation, np.ones((5, 5), np.uint8)), 0)
    rows, columns = (slice(most - own, most + own + 1) for most, own in zip(reach, known, strict=True))
    # What straight lines correlate along themselves does not end where the exemplar does.
    expected[:, columns] = np.maximum(expected[:, columns], correlation[: known[0] // 2 + 1].min(axis=0))
    expected[rows] = np.maximum(expected[rows], correlation[:, : known[1] // 2 + 1].min(axis=1)[:, None])
    expected[rows, columns] = correlation
    excess = (autocorrelation(result, reach, valid[1]) - expected) / np.maximum(1 - expected, _MIN_ROOM)
    excess[~_far(reach, _MIN_OFFSET / step)] = 0
    row, column = np.unravel_index(int(np.argmax(excess)), excess.shape)
    return max(float(excess[row, column]), 0.0), (int(row - reach[0]) * step, int(column - reach[1]) * step)


def whole_squares(mask: Bool[np.ndarray, "h w"] | None, step: int) -> Bool[np.ndarray, "H W"] | None:
    """True where all of a square of ``step`` px is true; where there is none, where any of it is."""
    if mask is None or step == 1:
        return mask
    height, width = mask.shape[0] // step, mask.shape[1] // step
    blocks = mask[: height * step, : width * step].reshape(height, step, width, step)
    reduced = blocks.all(axis=(1, 3))
    return reduced if reduced.any() else blocks.any(axis=(1, 3))
