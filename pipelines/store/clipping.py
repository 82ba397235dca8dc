"""What is said where a file holds values from 0 to 1, and a picture has others."""

from __future__ import annotations

import logging

import numpy as np

_LOG = logging.getLogger(__name__)


def count_clipped(values: np.ndarray, bits: int, encoded: bool) -> int:
    """Number of values that are farther outside of 0..1 than half a code; ``encoded``: by the curve of sRGB."""
    half = 0.5 / (2**bits - 1)
    below, above = (half / 12.92, half * 2.4) if encoded else (half, half)  # in linear light
    return int(np.count_nonzero((values < -below) | (values > 1 + above)))


def tell_clipped(what: str, share: float) -> None:
    """Warn that this share of the values of a map was cut off, if any was."""
    if share:
        instead = "heights from 0 to 1, and their scale" if what == "height" else "values from 0 to 1"
        text = "%s: %.1f %% of the values are outside of 0..1 and were cut off; use .exr, which holds them, or %s"
        _LOG.warning(text, what, max(100 * share, 0.1), instead)
