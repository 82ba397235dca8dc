"""Plain margins and labels along a picture's rim, such as a white frame, black bars, or a box with its source."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float32

from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.color import srgb_from_linear

_SAME = 16.0  # codes of 8 bits by which a channel may differ from a plain colour, also after compression
_STEP = (
    12.0  # codes by which the first line inside differs on average from the last of a margin; a gradient has none
)
_SOFT = 2  # px around what is plain, mixed with it by reduction and compression
_WIDEST = 0.25  # of the picture's side
_ELSEWHERE = 0.002  # share of all else that is plain parts of the same colour; more is of the texture
_PARTS = (5, 5), (1, 15), (15, 1)  # px of such parts at least: areas and lines, such as joints
_BROAD = 12  # px of a margin, from which narrow parts of its colour, such as joints, are none like it
_PLAIN, _OPEN = 0.95, 0.3  # shares of a line that have the colour: in a margin, or at a label's edge; and beside it

_LOOKED_AT = 1024  # px a side, to which larger pictures are reduced, but for margins
_LEAST = (9, 24)  # px of a label, at right angles to the rim and along it
_GROUND = (0.25, 0.95)  # share of a label that is plain; the rest is writing


def plain_margins(image: Image) -> Mask | None:
    """What of a picture is no texture, but a plain margin or a label along its rim; None where nothing is.

    A margin consists of lines from border to border of one colour, which end in a step. A label is a box at the rim
    with plain edges, and writing on a plain ground. Neither is one where the rest of the picture has parts of its
    colour: it then belongs to the texture, as joints of tiles do. A margin of 12 px and more is one where such
    parts are less than half as broad.

    References
    ----------
    Ours.

    Examples
    --------
    >>> import numpy as np
    >>> from texloom.stages.vocabulary.arrays import Image
    >>> pixels = np.random.default_rng(0).random((60, 60, 3), np.float32)
    >>> pixels[:, :10] = 1
    >>> plain_margins(Image.of(pixels))[30].sum()
    12
    """
    found = np.ones((image.height, image.width), np.bool_)
    inside = inside_margins(image.color)
    found[inside] = False
    codes = _reduced(image.color[inside])
    marked = np.zeros(codes.shape[:2], np.bool_)
    for turns in range(4):
        _mark_labels(np.rot90(codes, turns), np.rot90(marked, turns))
    if marked.any():
        rows, columns = (
            np.arange(side) * small // side for side, small in zip(found[inside].shape, marked.shape, strict=True)
        )
        found[inside] |= marked[np.ix_(rows, columns)]
    return found if found.any() else None


def _codes(color: Float32[np.ndarray, "*s c"]) -> Float32[np.ndarray, "*s c"]:
    return np.asarray(255 * srgb_from_linear(color))


def _reduced(color: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "p q c"]:
    """Codes of the colours at no more than `_LOOKED_AT`."""
    import cv2

    factor = -(-max(color.shape) // _LOOKED_AT)
    height, width = (side // factor for side in color.shape[:2])
    small = cv2.resize(color, (width, height), interpolation=cv2.INTER_AREA) if factor > 1 else color
    return _codes(small.reshape(height, width, -1))


def inside_margins(color: Float32[np.ndarray, "h w c"]) -> tuple[slice, slice]:
    """Rows and columns of a picture without its margins; those of all of it where it has none."""
    sides = [0, color.shape[0], 0, color.shape[1]]
    plain = {}
    for _ in range(2):  # bars at the sides may end at those above and below, or these at them
        for side, turns in enumerate((0, 2, 3, 1)):
            lines = np.rot90(color[sides[0] : sides[1], sides[2] : sides[3]], turns)
            breadth = _breadth(lines)
            if breadth:
                plain[side] = np.median(_codes(lines[0]), axis=0)
                sides[side] += -breadth if side % 2 else breadth
    if plain:
        whole = (0, color.shape[0], 0, color.shape[1])
        rest = _reduced(color[sides[0] : sides[1], sides[2] : sides[3]])
        for side, value in plain.items():
            breadth = abs(sides[side] - whole[side]) * max(rest.shape) // max(color.shape)
            if _has_parts_of(rest, value) and (breadth < _BROAD or _has_as_broad(rest, value, breadth)):
                sides[side] = whole[side]
    return slice(*sides[:2]), slice(*sides[2:])


def _breadth(lines: Float32[np.ndarray, "h w c"]) -> int:
    """Of the margin above, px."""
    value = np.median(_codes(lines[0]), axis=0)
    most = int(_WIDEST * len(lines))
    breadth = 0
    while breadth < most and _like(_codes(lines[breadth]), value).mean() >= _PLAIN:
        breadth += 1
    if not 1 < breadth < most - _SOFT:
        return 0
    step = np.abs(_codes(lines[breadth + _SOFT]) - _codes(lines[breadth - 1])).max(axis=1).mean()
    return 0 if step < _STEP else breadth + _SOFT


def _like(pixels: Float32[np.ndarray, "*s c"], color: Float32[np.ndarray, "*_"]) -> Bool[np.ndarray, "*s"]:
    alike = np.ones(pixels.shape[:-1], np.bool_)
    for channel in range(pixels.shape[-1]):  # NumPy is slow along a short axis
        alike &= np.abs(pixels[..., channel] - color[..., channel]) <= _SAME
    return alike


def _has_parts_of(
    pixels: Float32[np.ndarray, "h w c"], color: Float32[np.ndarray, "*_"], but: Mask | None = None
) -> bool:
    """Whether a picture has plain parts of a colour, beside those in ``but``."""
    import cv2

    like = _like(pixels, color)
    if but is not None:
        like &= ~but
    parts = (cv2.erode(like.astype(np.uint8), np.ones(sides, np.uint8), borderValue=0) for sides in _PARTS)
    return any(float(part.mean()) > _ELSEWHERE for part in parts)


def _has_as_broad(pixels: Float32[np.ndarray, "h w c"], color: Float32[np.ndarray, "*_"], breadth: int) -> bool:
    """Whether a picture has a plain part of a colour that is half as broad as a margin; joints rarely are."""
    import cv2

    like = _like(pixels, color).astype(np.uint8)
    return bool(cv2.erode(like, np.ones((breadth // 2, breadth // 2), np.uint8), borderValue=0).any())


def _mark_labels(codes: Float32[np.ndarray, "h w c"], marked: Mask) -> None:
    """Mark the labels that begin at the first row."""
    width = codes.shape[1]
    for last, begin, end in _edges(codes[: int(_WIDEST * len(codes))]):
        box = codes[: last + 1, begin:end]
        color = np.median(box[-1], axis=0)
        like = _like(box, color)
        if not _GROUND[0] <= like.mean() <= _GROUND[1] or like[-1].mean() < _PLAIN:
            continue
        open_sides = [(like[:, :_SOFT], begin - _SOFT)] if begin else []
        open_sides += [(like[:, -_SOFT:], end - 1 + _SOFT)] if end < width else []
        if any(
            own.mean(axis=0).max() < _PLAIN
            or _like(codes[: last + 1, min(max(0, beside), width - 1)], color).mean() > _OPEN
            for own, beside in open_sides
        ):
            continue
        whole = np.zeros(marked.shape, np.bool_)
        whole[: last + 1 + _SOFT, max(0, begin - _SOFT) : end + _SOFT] = True
        if not _has_parts_of(codes, color, whole):
            marked |= whole


def _edges(codes: Float32[np.ndarray, "h w c"]) -> Iterator[tuple[int, int, int]]:
    """Row, first column and the one after the last of what may be a label's edge opposite to the rim.

    They are runs of one colour with another one beyond them.
    """
    first = _LEAST[0] - 1
    if len(codes) <= first + _SOFT:
        return
    change = np.ones((len(codes) - first - _SOFT, codes.shape[1] + 1), np.bool_)
    change[:, 1:-1] = np.abs(np.diff(codes[first:-_SOFT], axis=1)).max(axis=2) > 2 * _SAME
    row, column = np.nonzero(change)
    long = np.flatnonzero((np.diff(column) >= _LEAST[1]) & (np.diff(row) == 0))
    last, begin, end = row[long] + first, column[long], column[long + 1]
    is_edge = np.zeros(len(long), np.bool_)
    for length in np.unique(end - begin):  # thousands of runs, of few lengths
        own = np.flatnonzero(end - begin == length)
        along = begin[own, None] + np.arange(length)
        color = np.median(codes[last[own, None], along], axis=1, keepdims=True)
        is_edge[own] = _like(codes[last[own, None] + _SOFT, along], color).mean(axis=1) <= _OPEN
    yield from zip(last[is_edge].tolist(), begin[is_edge].tolist(), end[is_edge].tolist(), strict=True)
