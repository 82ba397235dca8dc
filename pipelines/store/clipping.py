"""What is said where a file holds values from 0 to 1, and a picture has others."""

from __future__ import annotations

import dataclasses
import logging

import numpy as np

_LOG = logging.getLogger(__name__)
_CUT_OFF = "of the values are outside of 0..1 and were cut off"


@dataclasses.dataclass
class Clipped:
    """Counts values that are farther outside of 0..1 than half a code."""

    bits: int
    below: int = 0
    above: int = 0
    count: int = 0
    low: float = np.inf
    high: float = -np.inf

    def add(self, values: np.ndarray, encoded: bool) -> None:
        """Count values; ``encoded``: by the curve of sRGB."""
        half = 0.5 / (2**self.bits - 1)
        below, above = (half / 12.92, half * 2.4) if encoded else (half, half)  # in linear light
        self.below += int(np.count_nonzero(values < -below))
        self.above += int(np.count_nonzero(values > 1 + above))
        self.count += values.size
        self.low, self.high = min(self.low, float(values.min())), max(self.high, float(values.max()))

    def tell(self, what: str) -> None:
        """Warn of the shares of the values of a map that were cut off, if any were."""
        if self.below + self.above:
            instead = "heights from 0 to 1, and their scale" if what == "height" else "values from 0 to 1"
            text = (
                f"%s: %.1f %% {_CUT_OFF} (%.1f %% below 0, %.1f %% above 1, "
                "range %.4g .. %.4g); use .exr, which holds them, or %s"
            )
            parts = [100 * part / self.count for part in (self.below + self.above, self.below, self.above)]
            _LOG.warning(text, what, max(parts[0], 0.1), *parts[1:], self.low, self.high, instead)


def clipped_map(told: str) -> str | None:
    """The map of which a text of `Clipped.tell` tells; None of another text."""
    what = told.partition(":")[0]
    return ("albedo" if what == "colour" else what) if _CUT_OFF in told else None
