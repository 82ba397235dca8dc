"""Maps that went through an sRGB curve: what undoes it, and whether it seems so, by their content.

Nothing in a file of data says it: programs that take a map for a picture put the curve on, or take it off.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Any, TypeAlias

import numpy as np

from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import linear_from_srgb, srgb_from_linear
from texloom.stages.vocabulary.normals import NORMAL

_Curve: TypeAlias = Callable[[Any], Any]
CURVES: Mapping[str, tuple[_Curve, _Curve]] = {
    "srgb": (srgb_from_linear, linear_from_srgb),
    "inverse_srgb": (linear_from_srgb, srgb_from_linear),
}
"""a curve that a map went through, as YAML files name it: the function, and that which undoes it"""
_TOLD = {"srgb": ("put on", "takes it off"), "inverse_srgb": ("taken off", "puts it on again")}
"""what is told of a curve, and of what undoes it"""
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
_AROUND = 513  # levels of 16 bits around one
_BLOCK = 64  # levels of 16 bits whose evidence is one sample
_CERTAIN = 50.0  # logarithm of the ratio of likelihoods; at most -900 in 8 maps of 16 bits without a curve
_DEVIATIONS = 4.0  # of that logarithm from 0, by its spread over blocks of levels
_SOFT = 0.1  # share of what a level holds that no curve moves
_MOST = 2**18  # pixels of floats that are compared
_ON_LEVELS = 0.98  # share of pixels on levels of 8 bits
_OFF_LEVELS = 0.9  # the same without the curve
_LEAST_DISTINCT = 16  # of such levels
_HALF = 2.0**-11 * 1.02  # rounding of floats of 16 bits, relative to the power of two below them


def curves_of(
    codes: Mapping[str, np.ndarray], image: Image | None = None, is_depth: bool = False
) -> Iterator[tuple[str, str, str]]:
    """The maps of a material that seem to have gone through a curve: role, one of `CURVES`, and by what.

    Parameters
    ----------
    codes : role to the values of its file, of data that are one value a pixel: uint8, uint16, or floats in 0..1.
    image : heights and normals, if there are any.
    is_depth : whether the heights were read as 1 minus what the file has.
    """
    by_slopes = "" if image is None else curve_of_heights(image, is_depth)
    if by_slopes:
        yield "height", by_slopes, "slopes fit the normals much better without it"
    for role, values in codes.items():
        if not (role == "height" and by_slopes):
            curve, measure = curve_of_values(values)
            if curve:
                yield role, curve, measure


def told_of_curve(role: str, entry: str, curve: str, measure: str) -> str:
    """One line on a map that seems to have gone through a curve, with what undoes it; ``entry`` is its file."""
    what, undone = _TOLD[curve]
    return (
        f"{role}: an sRGB curve seems to have been {what} ({measure}); in a YAML file of maps "
        f"'{role}: {{{entry}, curve: {curve}}}' {undone}"
    )


def curve_of_values(values: np.ndarray) -> tuple[str, str]:
    """Which curve the values of a map went through, one of `CURVES`, and by what; nothing where it cannot be told.

    A curve that was put on values of more bits than the file has leaves nothing to see.

    Parameters
    ----------
    values : uint8, uint16, or floats in 0..1.
    """
    if values.dtype == np.uint8:
        return curve_of_codes(values), "some levels hold twice the pixels of others, as such a curve leaves them"
    if values.dtype == np.uint16:
        counts = np.bincount(values.ravel(), minlength=2**16)
        levels = np.flatnonzero(counts)
        rounding = np.full(len(levels), 0.75 / (2**16 - 1))
        if found := _curve_of_few(levels / (2**16 - 1), counts[levels], rounding):
            return found, "its values are levels of 8 bits only without it"
        return _curve_of_many(
            counts.astype(np.float64)
        ), "levels of 16 bits are left out and joined as by such a curve"
    few = values.ravel()[:: max(1, values.size // _MOST)].astype(np.float64)
    if few.min() < 0 or few.max() > 1:
        return "", ""
    rounding = _HALF * 2.0 ** np.floor(np.log2(np.maximum(few, 2.0**-14)))
    return _curve_of_few(few, np.ones(few.size), rounding), "its values are levels of 8 bits only without it"


def _curve_of_few(values: np.ndarray, counts: np.ndarray, rounding: np.ndarray) -> str:
    """The curve without which values, 0..1, are levels of 8 bits, if they are not so as they are."""

    def on_levels(curve: _Curve, undone: _Curve) -> tuple[float, int]:
        levels = np.rint(255 * np.asarray(undone(values)))
        inside = (levels > 0) & (levels < 255)
        on = inside & (np.abs(np.asarray(curve(levels / 255)) - values) <= rounding)
        return float(counts[on].sum() / max(1, counts[inside].sum())), len(np.unique(levels[on]))

    if on_levels(np.asarray, np.asarray)[0] > _OFF_LEVELS:
        return ""
    for name, functions in CURVES.items():
        share, distinct = on_levels(*functions)
        if share >= _ON_LEVELS and distinct >= _LEAST_DISTINCT:
            return name
    return ""


def _curve_of_many(counts: np.ndarray) -> str:
    """The curve that 16-bit levels went through at 16 bits, by how likely it makes their counts."""
    rim = _AROUND // 2
    inner = counts.copy()
    inner[:rim] = inner[-rim:] = 0  # they hold what was clipped
    around = _mean_around(inner)
    for name in CURVES:
        made = _levels_made(name, 16)
        usual = _mean_around(made)
        used = (around > 0) & (usual > 0)
        used[:rim] = used[-rim:] = False
        ratio = np.where(used, _SOFT + (1 - _SOFT) * made / np.where(used, usual, 1), 1)
        evidence = np.where(used, inner * np.log(ratio) - around * (ratio - 1), 0)
        blocks = evidence.reshape(-1, _BLOCK).sum(axis=1)
        blocks = blocks[blocks != 0]
        spread = blocks.std() * np.sqrt(len(blocks)) if len(blocks) > 1 else np.inf
        if blocks.sum() > max(_CERTAIN, _DEVIATIONS * spread):
            return name
    return ""


def _mean_around(counts: np.ndarray) -> np.ndarray:
    summed = np.cumsum(np.pad(counts, (_AROUND // 2 + 1, _AROUND // 2)))
    return np.asarray((summed[_AROUND:] - summed[:-_AROUND]) / _AROUND)


@cache
def _levels_made(name: str, bits: int) -> np.ndarray:
    """How many of the levels of ``bits`` a curve makes to each."""
    count = 2**bits
    made = np.rint((count - 1) * np.asarray(CURVES[name][0](np.arange(count) / (count - 1))))
    return np.bincount(made.astype(int), minlength=count).astype(np.float64)


def curve_of_codes(codes: np.ndarray) -> str:
    """Which curve 8-bit levels went through at 8 bits, one of `CURVES`, or nothing that can be told.

    Where a curve is steep it leaves levels out, where it is flat several become one.
    """
    counts = np.bincount(codes.ravel(), minlength=256).astype(np.float64)
    around = np.convolve(counts, _WINDOW, "same")
    for what in CURVES:
        made = _levels_made(what, 8)
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
    for what, (_, undone) in CURVES.items():
        without = fits(np.asarray(undone(height)))
        if (abs(without) > _FITS).all() and (1 - as_it_is**2 > _BETTER * (1 - without**2)).all():
            return what
    return ""
