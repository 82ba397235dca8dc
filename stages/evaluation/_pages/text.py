"""Numbers and texts as pages show them."""

from collections.abc import Iterable
from typing import Any

import numpy as np

_WORST, _MIDDLE, _BEST = (213, 94, 0), (240, 228, 66), (0, 158, 115)
"""vermilion, yellow, bluish green: they differ for colour-blind eyes too"""


def writable(text: str) -> str:
    """Text without lone surrogates, which names of files may have and UTF-8 cannot encode."""
    return text.encode("utf-8", "replace").decode()


def number(value: Any) -> str:
    """A number in at most four digits; words as they are; a dash for None."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return (f"{value:.4g}" if abs(value) >= 0.001 or value == 0 else f"{value:.1e}").replace("-", "−", 1)
    if isinstance(value, list | tuple):
        return ", ".join(number(part) for part in value)
    return str(value)


def seconds(value: Any) -> str:
    """A duration."""
    if not isinstance(value, int | float):
        return "–"
    return f"{value:.2f} s" if value < 10 else f"{value:.0f} s" if value < 120 else f"{value / 60:.1f} min"


def score_color(score: Any) -> str:
    """CSS colour of a score: bluish green for 1, yellow for a half, vermilion for 0, grey for None."""
    if not isinstance(score, int | float) or not np.isfinite(score):
        return "rgb(128 128 128)"
    place = min(max(float(score), 0.0), 1.0) * 2
    low, high = (_WORST, _MIDDLE) if place < 1 else (_MIDDLE, _BEST)
    share = place if place < 1 else place - 1
    return css_color([round(one + (other - one) * share) for one, other in zip(low, high, strict=True)])


def css_color(color: Iterable[int]) -> str:
    """An sRGB colour of 0..255."""
    red, green, blue = color
    return f"rgb({red} {green} {blue})"
