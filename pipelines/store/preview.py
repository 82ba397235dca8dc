"""8-bit pictures of arrays."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from texloom.stages.vocabulary.color import linear_from_lab, srgb_codes
from texloom.stages.vocabulary.masks import EXCLUSION_CHANNELS
from texloom.stages.vocabulary.scratch import release

_MAX_PLANES = 4  # side by side in a picture
_STRIP = 2**18  # pixels converted at once
_SIDE = 512  # px, of a small picture


@np.errstate(all="ignore")
def picture(
    planes: Mapping[str, np.ndarray], ranges: Mapping[str, tuple[float, float]] | None = None
) -> np.ndarray | None:
    """An 8-bit picture of planes of one size; the names of the channels decide how they are shown.

    ``R G B`` or ``Y`` are linear light and shown in sRGB, clipped to 0..1, as are ``L a b``. Their alpha is the
    smaller of ``A`` and ``usable``, so that excluded pixels are transparent; further channels are left out.
    ``row column`` are red and green, each relative to its largest value. Other planes are placed side by side in
    grey, each from its smallest to its largest value; a constant one is clipped to 0..1. NaN is black.

    Parameters
    ----------
    ranges : of planes, as `range_of` has them, that are windows of others; needed where they are not colour.

    Returns
    -------
    uint8, (h, w) or (h, w, c) with 2 channels (grey, alpha), 3 or 4; None for more than four planes that are not
    colour.
    """
    colors = colors_of(planes)
    if colors:
        return _color_picture(planes, colors)
    if set(planes) == {"L", "a", "b"}:
        return np.asarray(srgb_codes(linear_from_lab(_stacked(planes, "Lab"))))
    if set(planes) == {"row", "column"}:
        return _position_picture(planes, ranges)
    if len(planes) <= _MAX_PLANES:
        known = {name: range_of(plane) for name, plane in planes.items()} if ranges is None else ranges
        return np.concatenate([_stretched(plane, known[name]) for name, plane in planes.items()], axis=1)
    return None


def colors_of(names: Iterable[str]) -> str:
    """The channels among ``names`` that are colour in linear light, a letter each; empty without."""
    return next((colors for colors in ("RGB", "Y") if set(colors) <= set(names)), "")


def range_of(plane: np.ndarray) -> tuple[float, float]:
    """The smallest and the largest finite value; infinite and minus infinite where there is none."""
    finite = plane[np.isfinite(plane)]
    return (float(finite.min()), float(finite.max())) if finite.size else (np.inf, -np.inf)


def _position_picture(
    planes: Mapping[str, np.ndarray], ranges: Mapping[str, tuple[float, float]] | None
) -> np.ndarray:
    """Rows as red and columns as green."""
    height, width = planes["row"].shape
    levels = np.zeros((height, width, 3), np.uint8)
    strips = [slice(top, top + max(1, _STRIP // width)) for top in range(0, height, max(1, _STRIP // width))]
    for index, name in enumerate(("row", "column")):
        if ranges is None:
            largest = max([1.0, *(_finite(planes[name][strip]).max() for strip in strips)])
        else:
            largest = max(1.0, ranges[name][1])
        for strip in strips:
            levels[strip, :, index] = _rounded(np.clip(_finite(planes[name][strip]) / np.float32(largest), 0, 1))
    return levels


def _color_picture(planes: Mapping[str, np.ndarray], colors: str) -> np.ndarray:
    """``colors`` in sRGB with alpha."""
    strips = list(color_strips(planes, colors))
    rounded = np.concatenate(strips) if len(strips) > 1 else strips[0]
    return rounded[..., 0] if rounded.shape[2] == 1 else rounded


def color_strips(planes: Mapping[str, np.ndarray], colors: str) -> Iterator[np.ndarray]:
    """The picture of ``colors`` in sRGB, with alpha if there is one: strips of rows, uint8, (rows, w, c)."""
    height, width = planes[colors[0]].shape
    alphas = [name for name in EXCLUSION_CHANNELS if name in planes]
    rows = max(1, _STRIP // width)
    for top in range(0, height, rows):
        strip = {name: planes[name][top : top + rows] for name in (*colors, *alphas)}
        rounded = np.empty((*strip[colors[0]].shape, len(colors) + bool(alphas)), np.uint8)
        rounded[..., : len(colors)] = srgb_codes(_stacked(strip, colors))
        if alphas:
            rounded[..., -1] = _rounded(np.clip(_stacked(strip, alphas), 0, 1).min(axis=2))
        release(*strip.values())
        yield rounded


def small_png(levels: np.ndarray) -> bytes:
    """PNG of an 8-bit picture, (h, w, c), made smaller where a side is longer than 512 pixels."""
    import PIL.Image

    with PIL.Image.fromarray(levels.squeeze(2) if levels.shape[2] == 1 else levels) as made, io.BytesIO() as stream:
        made.thumbnail((_SIDE, _SIDE))
        made.save(stream, "png")
        return stream.getvalue()


def _rounded(levels: np.ndarray) -> np.ndarray:
    return np.asarray(np.rint(levels * levels.dtype.type(255)), np.uint8)


def _stacked(planes: Mapping[str, np.ndarray], names: Iterable[str]) -> np.ndarray:
    return np.stack([_finite(planes[name]) for name in names], axis=2)


def _finite(plane: np.ndarray) -> np.ndarray:
    return np.nan_to_num(plane.astype(np.float32, copy=False), nan=0, posinf=1, neginf=0)


def _stretched(plane: np.ndarray, bounds: tuple[float, float]) -> np.ndarray:
    """8-bit levels, 0 at the least and 255 at the greatest value; in strips, as they pass through doubles."""
    least, most = bounds
    levels = np.empty(plane.shape, np.uint8)
    rows = max(1, _STRIP // max(1, plane.shape[1]))
    for top in range(0, len(plane), rows):
        values = plane[top : top + rows].astype(np.float64)
        if most > least:
            values = (values - least) / (most - least)
        levels[top : top + rows] = _rounded(np.clip(np.nan_to_num(values, nan=0, posinf=1, neginf=0), 0, 1))
    return levels
