"""Windows of a large result in which it is measured."""

from typing import Any

import numpy as np

from texloom.stages.evaluation._measures.table import rounded
from texloom.stages.vocabulary.arrays import Image

LARGEST = 4096**2
"""pixels of a result above which it is measured in windows"""
SIDE = 2048
"""of a window, px"""


def corners(height: int, width: int) -> list[list[int]]:
    """Top and left of the windows about the middles of a result's quarters, px; none where it is not large."""
    if height * width <= LARGEST:
        return []
    tops, lefts = (
        sorted({max(0, min(side * part // 4 - SIDE // 2, side - SIDE)) for part in (1, 3)})
        for side in (height, width)
    )
    return [[top, left] for top in tops for left in lefts]


def around_corner(image: Image) -> Image:
    """The window about the corner where a result wraps around; its border is that of the result."""
    halves = ((min(SIDE, side) // 2, side) for side in (image.height, image.width))
    return image.elsewhere(image.pixels[np.ix_(*(np.r_[:half, side - half : side] for half, side in halves))])


def mean_lines(tables: list[dict[str, dict[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Mean of the figures of each measure over the windows that have them."""
    means = {}
    for name, first in tables[0].items():
        known = [one[name] for one in tables if one[name]["value"] is not None]
        means[name] = _mean(known) if known else first
    return means


def _mean(parts: list[Any]) -> Any:
    """Mean of numbers, also in dicts of equal keys; a text only if all have it; of anything else the first."""
    if all(isinstance(part, dict) and part.keys() == parts[0].keys() for part in parts):
        return {key: _mean([part[key] for part in parts]) for key in parts[0]}
    if all(isinstance(part, int | float) and not isinstance(part, bool) for part in parts):
        return rounded(sum(parts) / len(parts))
    if any(isinstance(part, str) for part in parts):
        return parts[0] if all(part == parts[0] for part in parts) else None
    return parts[0]
