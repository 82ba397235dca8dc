"""The main surface of a picture that shows several: bricks beside windows and cladding."""

import numpy as np
from jaxtyping import Float32

from texloom.stages.analysis.one_off.foreign_search import as_searched, counted, foreign_search
from texloom.stages.analysis.one_off.unlikeness import unlike_core
from texloom.stages.analysis.photographs.evenness import picture_evenness
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.vocabulary.arrays import Image, Mask

_CORE = 0.35  # share of the places whose looks are the surface's
_WINDOWS = 24, 36, 36  # deviation of the window of a look: the side over these, pass by pass
_ENOUGH = 0.75  # evenness at which no further pass is made
_FAR = 2.5  # times as far from the core as is usual, from which on a place is on another surface
_LEAST = 0.05  # share of what is known, of a part
_AS_LARGE = 0.9  # of the surface, of another one: neither is the main one
_TORN = 0.5  # share of the surface that its largest part has; a wall without its joints has less


def main_surface(image: Image, valid: Mask, threshold: float, least: float) -> tuple[Mask, float]:
    """Where the surface is that most of the picture looks like, without what is foreign to it, and its evenness.

    The third of the places that look most alike is the core; what looks like these is the surface, in parts that
    are not small. What the rest of that does not explain, such as windows within it, is searched as in
    `foreign_search`. Where what is left is not even, this is done again within it. A surface that falls into parts
    would be bricks without their joints, and does not count; nothing and 0 where there is no other, where that is
    less than ``least`` even, or another even one is as large.

    Parameters
    ----------
    valid : where the picture counts.
    threshold : of `foreign_search`.
    least : evenness.

    References
    ----------
    Ours; see `unlike_core`.
    """
    lab, _ = as_searched(image, valid)
    surface, even = _found(image, lab, valid, threshold)
    if even >= least:
        other, other_even = _found(image, lab, valid & ~surface, threshold)
        if other_even < _ENOUGH or other.sum() < _AS_LARGE * surface.sum():
            return surface, even
    return np.zeros(valid.shape, np.bool_), 0.0


def _found(image: Image, lab: Float32[np.ndarray, "H W 3"], valid: Mask, threshold: float) -> tuple[Mask, float]:
    best, surface, most = np.zeros(valid.shape, np.bool_), valid, 0.0
    for windows in _WINDOWS:
        surface = _alike(lab, surface, windows)
        if not surface.any():
            break
        surface &= ~foreign_search(image, surface, None, threshold)[1]
        even = picture_evenness(image, surface)
        if even > most and _is_whole(surface):
            best, most = surface, even
        if most >= _ENOUGH:
            break
    return best, most


def _alike(lab: Float32[np.ndarray, "H W 3"], valid: Mask, windows: int) -> Mask:
    """What looks like the core, in parts that are not small."""
    import cv2

    small = counted(valid)
    alike = small & (unlike_core(lab, small, float(np.sqrt(small.sum())) / windows, _CORE) < _FAR)
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(alike.astype(np.uint8), connectivity=4)
    large = boxes[:, cv2.CC_STAT_AREA] >= _LEAST * small.sum()
    large[0] = False
    wide = resize(large[labels].astype(np.float32)[..., None], len(valid), valid.shape[1], bilinear=True)
    return valid & (wide[..., 0] > 0.5)


def _is_whole(surface: Mask) -> bool:
    import cv2

    _, _, boxes, _ = cv2.connectedComponentsWithStats(surface.astype(np.uint8), connectivity=4)
    return bool(boxes[1:, cv2.CC_STAT_AREA].max(initial=0) >= _TORN * surface.sum())
