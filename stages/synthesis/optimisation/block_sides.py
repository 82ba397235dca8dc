"""Sides of the blocks that the optimisation starts from, and their overlap."""

import numpy as np

from texloom.stages.vocabulary.arrays import Mask, Vectors

MIN_MARGIN = 25  # px of the default overlap
MIN_BLOCK = 20  # px: twice the usual patch
_LATTICE_BLOCKS = 8  # blocks of an exemplar with a lattice are at least its shorter side divided by this
_GUIDED_BLOCKS = 8  # the same under a guide, whose regions may be small
_BESIDE_MASK = 0.75  # share of the usable pixels that lie in blocks without masked ones; else blocks are smaller
_SMALLER = 0.8  # sides of blocks relative to those tried before


def block_sides(exemplar: tuple[int, int], generators: Vectors, block: int | None, guided: bool) -> tuple[int, int]:
    """Height and width of a block: a box of whole lattice cells, at most a third of the exemplar."""
    shorter = min(exemplar)
    if len(generators) == 2:
        min_side = max(MIN_BLOCK, block or shorter // _LATTICE_BLOCKS)
        corners = np.vstack([np.zeros(2), generators])
        box = np.maximum(1, np.ceil(np.ptp(corners, axis=0)))
        sides = box * np.ceil(min_side / box)
    else:
        sides = np.full(2, max(MIN_BLOCK, block or shorter // (_GUIDED_BLOCKS if guided else 3)))
    height, width = (int(np.clip(side, 2, max(2, whole // 3))) for side, whole in zip(sides, exemplar, strict=True))
    return height, width


def block_margin(sides: tuple[int, int], margin: int | None) -> int:
    """Overlap of a block with its neighbours, px: a quarter of its shorter side by default, at most half of it."""
    if margin is None:
        margin = max(MIN_MARGIN, min(sides) // 4)
    return min(margin, *(int(side) // 2 for side in sides))


def sides_beside_mask(sides: tuple[int, int], usable: Mask, margin: int | None) -> tuple[int, int]:
    """Sides of blocks so small that most of what is usable lies in blocks without masked pixels.

    Larger ones would come from few places, or from a single one, again and again.
    """
    import cv2

    while min(sides) > MIN_BLOCK:
        overlap = block_margin(sides, margin)
        # Where blocks with their overlaps may be.
        whole = usable[overlap:, overlap : usable.shape[1] - overlap].astype(np.uint8)
        block = np.ones((sides[0] | 1, sides[1] | 1), np.uint8)  # odd, as an opening by even ones is displaced
        covered = cv2.morphologyEx(whole, cv2.MORPH_OPEN, block, borderType=cv2.BORDER_CONSTANT, borderValue=0)
        if covered.sum() >= _BESIDE_MASK * whole.sum():
            break
        sides = max(MIN_BLOCK, round(_SMALLER * sides[0])), max(MIN_BLOCK, round(_SMALLER * sides[1]))
    return sides
