"""Seams of a result moved to where they are seen least, by expansion moves of its pieces."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float32, Int32

from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.correspondence import Patches
from texloom.stages.synthesis.stitching.seams import UNIT, SeamCosts
from texloom.stages.vocabulary.facts import Wraps

_TILE = 64  # px of the result, in which pieces spread
_LEAST_PIECE = 160  # px; smaller ones save little more and take as long again
_LEAST_SEAM = 1.0  # just visible seam in a tile, px at half size
_OFFSET = 8.0  # CIELAB units, added to gradients: else flat places outweigh broken contours
_PRICE = 0.04  # of a pixel at half size whose source is used twice as much as on average, px of just visible seam
_USE_SIDE = 9  # px at half size, over which use is averaged
_OFFSETS = ((0, 0), (1, 1))  # of the tiles of each round, in half tiles


def relax_seams(
    match: Patches, features: Float32[np.ndarray, "h w c"], patch_size: int, wrap: Wraps, allowed: Allowed | None,
    places: tuple[int, int],
) -> None:  # fmt: skip
    """Let pieces of a result spread over their neighbours where that makes the seams between them cheaper.

    A piece has one displacement to the exemplar. Where patches of several meet, the optimisation averages them,
    and leaves the border between them where it was when they met; here it becomes a minimum cut [Kwatra2003]_, by
    expansion moves [Boykov2001]_ in tiles of the result, whose borders lie elsewhere in every round. What is used
    much costs more. Not in the paper.

    Parameters
    ----------
    match : at full size, changed in place.
    features : of the exemplar at half its size, CIELAB units.
    allowed : which of the exemplar's ``places`` of patches may be used; none for all.
    """
    from texloom.stages.kernels.core.threads import run_spans
    from texloom.stages.kernels.seams.expansion import expand_in_tiles

    middle = patch_size // 2
    usable = np.zeros((places[0] + middle, places[1] + middle), np.bool_)
    usable[middle:, middle:] = True if allowed is None else allowed.places
    costs = SeamCosts(np.ascontiguousarray(features), gradients=True, squared=True, offset=_OFFSET)
    least = np.array([_LEAST_PIECE // 4, round(_LEAST_SEAM * UNIT)])
    match += middle
    for offset in _OFFSETS:
        tiles = np.array(list(_tiles(match.shape[1:], wrap, offset)))
        price = _price(match, features.shape[:2], usable)
        given = costs.given, price, usable, match, tiles, least
        run_spans(expand_in_tiles, given, len(tiles), 8)
    match -= middle


def _tiles(sides: tuple[int, ...], wrap: Wraps, offset: tuple[int, int]) -> Iterator[tuple[int, int, int, int]]:
    """First row and column, height and width of tiles that cover what does not wrap, or all but a half tile."""
    lines = []
    for side, around, half in zip(sides, wrap, offset, strict=True):
        begin = half * _TILE // 2
        firsts = range(begin, side + begin, _TILE) if around else range(-begin, side, _TILE)
        last = side + begin if around else side
        ends = [(first if around else max(0, first), min(first + _TILE, last)) for first in firsts]
        lines.append([(first, end - first) for first, end in ends])
    for top, height in lines[0]:
        for left, width in lines[1]:
            if min(height, width) >= 8:
                yield top, left, height, width


def _price(match: Patches, shape: tuple[int, int], usable: Bool[np.ndarray, "y x"]) -> Int32[np.ndarray, "h w"]:
    """What a source costs, which is used more than on average."""
    import cv2

    used = np.zeros(shape[0] * shape[1], np.int64)
    for first in range(0, match.shape[1], 512):
        row, column = match[:, first : first + 512 : 2, ::2] // 2
        used += np.bincount((row * shape[1] + column).ravel(), minlength=used.size)
    sides = (_USE_SIDE, _USE_SIDE)
    near = cv2.boxFilter(
        used.reshape(shape).astype(np.float32), -1, sides, normalize=False, borderType=cv2.BORDER_CONSTANT
    )
    even = -(-match[0].size // 4) / (usable.sum() / 4) * _USE_SIDE**2
    return np.rint(_PRICE * UNIT * np.maximum(near / even - 1, 0)).astype(np.int32)
