"""Values of control that an exemplar hardly has."""

import numpy as np
from jaxtyping import Float32

_LEVELS = 64  # of a channel's range
_MIN_PIXELS = 49  # of the exemplar that must have a value, or one beside it; in small exemplars
_MIN_SHARE = 0.002  # of the exemplar's pixels
_MAX_OUTSIDE = 0.01  # share of the target outside the range of control, above which a note is given
_MAX_RARE = 0.02  # share of the target with values that are rare in control, above which a note is given


def extrapolated(
    own: Float32[np.ndarray, "h w k"], wanted: Float32[np.ndarray, "H W k"], strength: float
) -> tuple[Float32[np.ndarray, "H W k"], float]:
    """The target's control with values that the exemplar hardly has replaced by the nearest that it has.

    Where a value occurs in a few pixels of the exemplar only, these would repeat over the whole region that asks
    for it. Values are replaced by a shift of their level, so that gradients stay smooth.

    Parameters
    ----------
    own, wanted : control of the exemplar and of the target, 0 to ``strength``.

    Returns
    -------
    the control, and the share of its pixels that are replaced, 0..1.
    """
    from scipy.ndimage import uniform_filter
    from scipy.spatial import KDTree

    channels = own.shape[2]
    if channels not in (1, 2, 3) or strength <= 0:
        return wanted, 0.0
    shape = (_LEVELS,) * channels
    factor = _LEVELS / strength
    planes = [part.reshape(-1, channels) for part in (own, wanted)]
    levels = [np.clip((part * factor).astype(np.int64), 0, _LEVELS - 1) for part in planes]
    numbers = [np.ravel_multi_index(tuple(part.T), shape) for part in levels]
    counts = np.bincount(numbers[0], minlength=_LEVELS**channels).reshape(shape).astype(np.float64)
    around = uniform_filter(counts, 3, mode="constant") * 3**channels
    is_frequent = around >= min(_MIN_PIXELS, _MIN_SHARE * own.shape[0] * own.shape[1])
    known = is_frequent & (counts > 0)
    asked = np.bincount(numbers[1], minlength=_LEVELS**channels)
    is_rare = ~is_frequent.ravel() & (asked > 0)
    if not known.any() or not is_rare.any():
        return wanted, 0.0
    cells = np.argwhere(known)
    rare = np.argwhere(is_rare.reshape(shape))
    shift = np.zeros((is_rare.size, channels), np.float32)
    shift[is_rare] = (cells[KDTree(cells).query(rare)[1]] - rare) / factor
    moved = (wanted.reshape(-1, channels) + shift[numbers[1]]).reshape(wanted.shape)
    return np.asarray(moved, np.float32), float(asked[is_rare].sum() / asked.sum())


def notes_on_target(outside: float, rare: float) -> list[str]:
    """What is to be said of a target, a sentence each.

    Parameters
    ----------
    outside, rare : shares of its pixels, 0..1: outside the range of control, and of values that control hardly has.
    """
    notes = []
    if outside > _MAX_OUTSIDE:
        notes.append(f"{outside:.1%} of the target is beyond the control map's values and takes the nearest.")
    if rare > _MAX_RARE:
        notes.append(f"{rare:.1%} of the target has values that hardly occur in control and takes the nearest.")
    return notes
