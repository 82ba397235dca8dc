"""What is plausible of files that do not say it: whether borders continue each other, and where green points.

Both are shown to the user; see `texloom.pipelines.media.contradictions` for what they decide.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import GREENS
from texloom.stages.vocabulary.normals import NORMAL

_LEAST_LINES = 32
_MOST_LINES = 512  # of a picture that are compared
_APART = (0.23, 0.31, 0.43, 0.5)  # distances of lines that do not follow each other, in heights of the picture
_SURE = 2.0  # logarithm of the ratio of likelihoods
_RARE = 0.004  # share of the lines inside that are as unlike as those at the border of a picture that does not wrap
_LEAST_STEP = 1e-3  # of sRGB levels, 0..1
_LEAST_SPREAD = 0.05
_FREEDOM = 4.0  # of Student's distribution: outliers, such as joints of bricks, are common
_FITS = 0.3  # correlation
_LEAST_SLOPE_Z = 0.1
_CLEARLY = 1.3  # ratio of the curls of both directions
_DECISIVE = 2.5  # the same; seven normal maps of photographs and scans in JPEG have 3.5 to 11
_CORRELATED = 0.6  # of slopes along both axes, from which heights decide

_Lines: TypeAlias = Float32[np.ndarray, "n w 3"]


def plausible_wraps(image: Image) -> dict[str, dict[str, Any]]:
    """Whether a picture continues across its borders, ready for JSON.

    The last and the first line are compared with lines that follow each other inside and with lines that lie far
    apart, by the difference of their levels and by their correlation. Both must be far more likely for the ones
    than for the others. Noise, plain pictures and lines that are alike everywhere, as in a wall whose joint lies at
    the border, are unclear.

    Returns
    -------
    for ``x`` and ``y``: ``wraps``, which is ``yes``, ``no`` or ``unclear``, and ``score``, the logarithm of the
    ratio of likelihoods, of which from 2 to -2 is unclear; 0 where both measures contradict each other.
    """
    levels = np.repeat(image.srgb[..., :1], 3, axis=2) if image.channels[0] == "Y" else image.srgb
    return {"x": _continuation(levels.swapaxes(0, 1)), "y": _continuation(levels)}


def _continuation(levels: np.ndarray) -> dict[str, Any]:
    count = len(levels)
    if min(levels.shape[:2]) < _LEAST_LINES:
        return {"wraps": "unclear", "score": 0.0}
    rows = np.unique(np.linspace(0, count - 2, min(count - 1, _MOST_LINES)).astype(int))
    lines = _floats(levels[rows])
    inside = _likeness(lines, _floats(levels[rows + 1]))
    apart = [_likeness(lines, _floats(levels[(rows + int(count * part)) % count])) for part in _APART]
    border = _likeness(_floats(levels[-1:]), _floats(levels[:1]))[:, 0]
    ratios = [
        _likelihood(near, value) - _likelihood(far, value)
        for near, far, value in zip(inside, np.concatenate(apart, axis=1), border, strict=True)
    ]
    score = min(ratios) if min(ratios) > 0 else min(0.0, max(ratios))
    is_rare = all((near >= value).mean() < _RARE for near, value in zip(inside, border, strict=True))
    wraps = "yes" if score >= _SURE else "no" if score <= -_SURE and is_rare else "unclear"
    return {"wraps": wraps, "score": round(float(score), 1)}


def _floats(levels: np.ndarray) -> _Lines:
    return levels.astype(np.float32) / np.float32(255)


def _likeness(first: _Lines, second: _Lines) -> Float64[np.ndarray, "2 n"]:
    """How unlike lines are: logarithm of their mean difference, and inverse of their correlation."""
    step = np.log(np.abs(first - second).mean(axis=(1, 2)) + _LEAST_STEP)
    one, other = (line - line.mean(axis=1, keepdims=True) for line in (first, second))
    product, squares = (one * other).sum(axis=(1, 2)), (one**2).sum(axis=(1, 2)) * (other**2).sum(axis=(1, 2))
    return np.stack([step, -np.arctanh(np.clip(product / np.sqrt(squares + 1e-9), -0.999, 0.999))])


def _likelihood(values: np.ndarray, value: float) -> float:
    """Logarithm of the likelihood of a value among others, by Student's distribution."""
    middle = np.median(values)
    spread = max(1.4826 * np.median(np.abs(values - middle)) + _LEAST_SPREAD, 0.7 * values.std())
    deviation = (value - middle) / spread
    return float(-np.log(spread) - (_FREEDOM + 1) / 2 * np.log1p(deviation**2 / _FREEDOM))


def plausible_green(image: Image) -> dict[str, Any] | None:
    """Whether normals fit the heights of a material, and where green points in their file; None without both.

    Returns
    -------
    ``green``: ``up`` (OpenGL), ``down`` (DirectX), or ``does not fit the height``; ``height``: ``depth`` where the
    map is white where the surface is low, else ``height``; ``correlation`` of the slopes across and down with those
    of the heights, -1..1, signs as in the file.
    """
    if not {*NORMAL, "height"} <= set(image.channels):
        return None
    height, x, y = (image.pixels[..., image.channels.index(name)] for name in ("height", *NORMAL[:2]))
    if min(height.shape) < 2 or min(plane.std() for plane in (height, x, y)) < _LEAST_STEP:
        return None
    down, across = np.gradient(height)
    if image.facts.of_map("normal").green == "down":
        y = -y
    found = [float(np.corrcoef(one.ravel(), other.ravel())[0, 1]) for one, other in ((-across, x), (down, y))]
    fits = min(map(abs, found)) >= _FITS
    return {
        "green": GREENS[found[0] * found[1] < 0] if fits else "does not fit the height",
        **({"height": "depth" if found[0] < 0 else "height"} if fits else {}),
        "correlation": [round(value, 2) for value in found],
    }


def plausible_integrable_green(image: Image) -> dict[str, Any] | None:
    """Where green of normals points in their file by whether slopes are those of a surface; None if it is unclear.

    The slopes of heights have no curl; with green the wrong way they have.

    Returns
    -------
    ``green``: ``up`` or ``down``; ``curl``: how many times as large its mean square is with the other direction.
    """
    if not {*NORMAL} <= set(image.channels) or min(image.height, image.width) < _LEAST_LINES:
        return None
    x, y, z = (image.pixels[..., image.channels.index(name)].astype(np.float64) for name in NORMAL)
    if image.facts.of_map("normal").green == "down":
        y = -y
    z = np.maximum(z, _LEAST_SLOPE_Z)
    first, second = np.gradient(-x / z, axis=0), np.gradient(y / z, axis=1)
    up, down = (float(((first - sign * second) ** 2).mean()) for sign in (1, -1))
    if max(up, down) < _CLEARLY * min(up, down) or max(up, down) == 0:
        return None
    return {"green": GREENS[down < up], "curl": round(max(up, down) / max(min(up, down), 1e-9), 1)}


def decisive_green(image: Image) -> tuple[str, str]:
    """Where green of normals points in their file, and by what, if content leaves no doubt; else empty texts."""
    by_height, by_curl = plausible_green(image), plausible_integrable_green(image)
    said = by_height["green"] if by_height else ""
    if by_height and said in GREENS and min(map(abs, by_height["correlation"])) >= _CORRELATED:
        return said, "by the slopes of the height"
    if by_curl and by_curl["curl"] >= _DECISIVE and (said not in GREENS or said == by_curl["green"]):
        return by_curl["green"], "as its slopes are those of a surface only so"
    return "", ""
