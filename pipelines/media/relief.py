"""What heights in files mean: integers hold 0..1, others are normalised and documents say what 0 and 1 mean."""

from __future__ import annotations

import dataclasses
import logging
from typing import Any

import numpy as np

from texloom.pipelines.media.delivery import METRES
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import DISPLACEMENT, MapFacts

_LOG = logging.getLogger(__name__)
_HEIGHT = "height"
_ROUNDING = 0.5 / (2**16 - 1)
_OVERSHOOT = 0.05  # of heights from 0 to 1 that were integrated or filtered
_NARROW = 1 / 16  # of 0..1: integers of 16 bits would have less than 12


@dataclasses.dataclass(frozen=True)
class Relief:
    """The heights of a material in a file."""

    low: float = 0.0
    """what 0 in the file stands for"""
    high: float = 1.0
    """what 1 in the file stands for"""
    unit: str = ""
    """of ``low`` and ``high``, one of `texloom.stages.vocabulary.facts.UNITS`; empty where none is known"""

    is_assumed: bool = False
    """whether nobody said the unit"""

    @property
    def is_normalised(self) -> bool:
        """Whether the file holds other values than the map."""
        return (self.low, self.high) != (0.0, 1.0)

    def displacement(self, width: float) -> tuple[float, float]:
        """Factor and summand that make metres of the file's values; ``width`` of the texture, m."""
        metres = METRES[self.unit] if self.unit else DISPLACEMENT * width
        return (self.high - self.low) * metres, self.low * metres

    def normalised(self, image: Image) -> Image:
        """The image with the heights that a file of integers holds."""
        if not self.is_normalised:
            return image
        pixels = image.pixels.copy()
        plane = pixels[..., image.channels.index(_HEIGHT)]
        plane -= np.float32(self.low)
        plane /= np.float32(self.high - self.low)
        return image.with_pixels(pixels)

    def facts(self) -> MapFacts:
        """What a file of integers says of its heights."""
        return MapFacts(unit=self.unit, range=(self.low, self.high) if self.is_normalised else None)

    def record(self) -> dict[str, Any]:
        """For programs that read no document, ready for JSON."""
        scale, bias = self.displacement(1.0)
        return {"black": self.low, "white": self.high, "unit": self.unit, "scale_m": scale, "bias_m": bias}

    def tell(self) -> None:
        """Warn that a file holds other values than the map."""
        if self.is_normalised:
            became = "became 0..1 in PNG; scale and offset are in documents, EXR has the values"
            assumed = (
                "; the unit is assumed, 'height_unit' in a YAML file of maps says it" if self.is_assumed else ""
            )
            _LOG.warning("height: %.6g .. %.6g %s %s%s", self.low, self.high, self.unit, became, assumed)


def relief_of(image: Image) -> Relief:
    """How integers can hold the heights of an image.

    Those whose source was floats beyond 0..1, or in a small part of it, are normalised, so that 0 is the lowest one
    and 1 the highest; their unit, if none is known, is the metre, as renderers have it. Others that leave 0..1 a
    little, as integrated ones do, are not.
    """
    if _HEIGHT not in image.channels:
        return Relief()
    plane = image.pixels[..., image.channels.index(_HEIGHT)]
    low, high = float(plane.min()), float(plane.max())
    known: MapFacts = image.facts.of_map(_HEIGHT)
    if known.range is None:
        fits = low >= -_OVERSHOOT and high <= 1 + _OVERSHOOT
    else:
        first, last = known.range
        fits = first >= -_ROUNDING and last <= 1 + _ROUNDING and last - first >= _NARROW
    if fits:
        return Relief(unit=known.unit if known.range is not None else "")
    return Relief(low, high if high > low else low + 1, known.unit or "m", not known.unit)


UNIT_RELIEF = Relief()
"""of heights that a file holds as they are, without a unit"""
