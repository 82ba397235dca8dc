"""Upsampling of a coarse picture along the borders of a control map."""

import numpy as np
from jaxtyping import Float32

from texloom.stages.common.grids.pyramid import resize
from texloom.stages.vocabulary.scratch import bands

_REACH = 2  # coarse pixels to every side
_NEAR = 0.5  # coarse pixels, at which a weight is a quarter of its most
_ALIKE = 0.1  # of control's range, the same


def along_control(
    coarse: Float32[np.ndarray, "h w c"],
    control: Float32[np.ndarray, "H W k"],
    own: Float32[np.ndarray, "h w k"] | None = None,
) -> Float32[np.ndarray, "H W c"]:
    """Resample to the size of ``control``, each pixel from those near it whose mean control is like its own.

    So a border between two materials is as sharp as in the control map, where a coarse pixel shows a mixture of
    both. Without channels of control this is a blur.

    Parameters
    ----------
    coarse, control : what is resampled, and the control at whose size it is wanted.
    own : mean control of coarse pixels that were taken from elsewhere; none: that of ``control`` there.

    References
    ----------
    [Kopf2007a]_ section 3, equation 3, with the control map in place of the image of full size.
    """
    (height, width), (rows, columns) = coarse.shape[:2], control.shape[:2]
    own = resize(control, height, width) if own is None else own
    ranges = np.ptp(control, axis=(0, 1)) if control.shape[2] else np.ones(1, np.float32)
    factor = np.float32(1 / max(_ALIKE * float(ranges.max()), 1e-6) ** 2)
    down, across = (
        (np.arange(many) + 0.5) * (few / many) - 0.5 for many, few in ((rows, height), (columns, width))
    )
    made = np.empty((rows, columns, coarse.shape[2]), np.float32)
    for band in bands(rows, made, control):
        total = np.zeros((*made[band].shape[:2], 1), np.float32)
        sums = np.zeros(made[band].shape, np.float32)
        for dy in range(-_REACH, _REACH + 1):
            near_rows, row_weight = _near(down[band], dy, height)
            for dx in range(-_REACH, _REACH + 1):
                near_columns, column_weight = _near(across, dx, width)
                at = np.ix_(near_rows, near_columns)
                unlike = np.square(control[band] - own[at]).sum(axis=2, keepdims=True)
                weight = (row_weight[:, None] * column_weight)[..., None] * _weight(factor * unlike)
                total += weight
                sums += weight * coarse[at]
        np.divide(sums, total, out=made[band])
    return made


def _near(position: np.ndarray, step: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """For positions along one axis, the coarse pixels ``step`` from the nearest, and their weights by distance."""
    place = np.rint(position).astype(np.int64) + step
    weight = _weight(np.square((place - position) / _NEAR)).astype(np.float32)
    return np.clip(place, 0, count - 1), weight


def _weight(square: np.ndarray) -> np.ndarray:
    """Falls with a squared distance, which is 1 at a quarter of its most; like a Gaussian, but never 0."""
    falling: np.ndarray = 1 / np.square(1 + square)
    return falling
