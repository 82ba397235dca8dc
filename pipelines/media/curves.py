"""Whether maps of data went through an sRGB curve, by their content.

Nothing in a file of data says it: programs that take a map for a picture put the curve on, or take it off.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Any

import numpy as np

from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import linear_from_srgb, srgb_from_linear
from texloom.stages.vocabulary.normals import NORMAL

_CURVES: Mapping[str, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = {
    "put on": (srgb_from_linear, linear_from_srgb),
    "taken off": (linear_from_srgb, srgb_from_linear),
}
"""what was done to a map: the function, and that which undoes it"""
_WINDOW = np.hanning(11)[1:-1]
_WINDOW /= _WINDOW.sum()
_LEAST_COUNT = 16.0  # pixels of a level
_LEAST_LEVELS = 24
_LEAST_SPREAD = 0.2  # of how many levels become one, relative to that of levels around
_STEPS = 0.5  # correlation; 85 maps and pictures have at most .28, and after a curve 74 of 85 have more
_FITS = 0.85  # correlation of slopes
_BETTER = 1.3  # ratio of what slopes leave unexplained; at most 1.12 in ten sets, 1.1 to 20 after a curve
_LEAST_SLOPE_Z = 0.1
_LEAST_SIDE = 32  # px, from which slopes are measured


def told_of_curves(
    codes: Mapping[str, np.ndarray], image: Image | None = None, is_depth: bool = False
) -> Iterator[str]:
    """What is told of the maps of a material.

    Parameters
    ----------
    codes : role to the integers of 8 bits of its file, of data that are one value a pixel.
    image : heights and normals, if there are any.
    is_depth : whether the heights were read as 1 minus what the file has.
    """
    by_slopes = "" if image is None else curve_of_heights(image, is_depth)
    if by_slopes:
        yield _told("height", by_slopes, "slopes fit the normals much better without it")
    for role, values in codes.items():
        if (found := curve_of_codes(values)) and not (role == "height" and by_slopes):
            yield _told(role, found, "some levels hold twice the pixels of others, as such a curve leaves them")


def _told(role: str, what: str, measure: str) -> str:
    return f"{role}: an sRGB curve seems to have been {what} ({measure}); save it again as raw data"


@cache
def _levels_made(what: str) -> np.ndarray:
    """How many of 256 levels a curve makes to each."""
    made = np.rint(255 * np.asarray(_CURVES[what][0](np.arange(256) / 255)))
    return np.bincount(made.astype(int), minlength=256).astype(np.float64)


def curve_of_codes(codes: np.ndarray) -> str:
    """Which curve 8-bit levels went through at 8 bits: ``put on``, ``taken off``, or nothing that can be told.

    Where a curve is steep it leaves levels out, where it is flat several become one.
    """
    counts = np.bincount(codes.ravel(), minlength=256).astype(np.float64)
    around = np.convolve(counts, _WINDOW, "same")
    for what in _CURVES:
        made = _levels_made(what)
        usual = np.convolve(made, _WINDOW, "same")
        used = (around >= _LEAST_COUNT) & (usual > 0)
        used[: _WINDOW.size // 2] = used[-(_WINDOW.size // 2) :] = False  # 0 and 255 hold what was clipped
        if used.sum() < _LEAST_LEVELS:
            continue
        expected, found = made[used] / usual[used], counts[used] / around[used]
        if expected.std() >= _LEAST_SPREAD and found.std() > 0:
            spread = np.cov(expected, found, aweights=np.sqrt(around[used]))
            if spread[0, 1] > _STEPS * np.sqrt(spread[0, 0] * spread[1, 1]):
                return what
    return ""


def curve_of_heights(image: Image, is_depth: bool) -> str:
    """The same of heights, of any bits, by whether their slopes fit the normals better without the curve."""
    if not {*NORMAL, "height"} <= set(image.channels):
        return ""
    height, x, y, z = (
        image.pixels[..., image.channels.index(name)].astype(np.float64) for name in ("height", *NORMAL)
    )
    height = 1 - height if is_depth else height
    if (
        height.min() < 0
        or height.max() > 1
        or min(height.shape) < _LEAST_SIDE
        or min(map(np.std, (height, x, y))) == 0
    ):
        return ""
    wanted = x / np.maximum(z, _LEAST_SLOPE_Z), y / np.maximum(z, _LEAST_SLOPE_Z)

    def fits(values: np.ndarray) -> np.ndarray:
        down, across = np.gradient(values)
        pairs = zip((-across, down), wanted, strict=True)
        return np.array([np.corrcoef(one.ravel(), other.ravel())[0, 1] for one, other in pairs])

    as_it_is = fits(height)
    for what, (_, undone) in _CURVES.items():
        without = fits(np.asarray(undone(height)))
        if (abs(without) > _FITS).all() and (1 - as_it_is**2 > _BETTER * (1 - without**2)).all():
            return what
    return ""
