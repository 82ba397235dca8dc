"""Measures of a result's source map: how evenly the exemplar is used and how much is copied in one piece."""

import dataclasses

import numpy as np
from jaxtyping import Float32, Int64

from texloom.stages.arrays import Correspondence, Mask

_BOX = 9  # px over which use is averaged, about a patch


def use_of_exemplar(
    match: Correspondence, shape: tuple[int, int], usable: Mask | None = None
) -> Float32[np.ndarray, "h w"]:
    """How often each exemplar pixel occurs in the result, averaged over 9x9 pixels; the mean use is 1.

    Averages and mean are those of usable pixels; other places say nothing.
    """
    import cv2

    places = match[..., 0].astype(np.int64) * shape[1] + match[..., 1]
    counts = np.bincount(places.ravel(), minlength=shape[0] * shape[1]).reshape(shape).astype(np.float32)
    side = min(_BOX, *shape)
    averaged = cv2.boxFilter(counts, cv2.CV_32F, (side, side), borderType=cv2.BORDER_REFLECT_101)
    if usable is not None:
        cover = cv2.boxFilter(
            usable.astype(np.float32), cv2.CV_32F, (side, side), borderType=cv2.BORDER_REFLECT_101
        )
        averaged = np.where(usable, averaged / np.maximum(cover, np.float32(1e-6)), 0)
    mean = averaged.mean() if usable is None else averaged[usable].mean()
    return np.asarray(averaged / max(float(mean), 1e-12), np.float32)


def match_entropy(match: Correspondence, shape: tuple[int, int], count: int | None = None) -> float:
    """Entropy of the sources over its largest value, that of all pixels used equally; 0..1.

    ``count``: pixels that may be used, if not all.
    """
    places = match[..., 0].astype(np.int64) * shape[1] + match[..., 1]
    shares = np.bincount(places.ravel()) / places.size
    shares = shares[shares > 0]
    most = np.log(min(count or shape[0] * shape[1], places.size))
    return float(-(shares * np.log(shares)).sum() / most) if most > 0 else 1.0


@dataclasses.dataclass(frozen=True)
class Segments:
    """The connected regions of a result that are copied with one displacement."""

    areas: Int64[np.ndarray, "n"]
    """px"""
    continuity: float
    """share of neighbouring pixels whose sources are the same neighbours"""

    @property
    def typical(self) -> float:
        """Mean area of the segment that a pixel lies in, px."""
        return float((self.areas.astype(np.float64) ** 2).sum() / max(self.areas.sum(), 1))

    def share_above(self, area: float) -> float:
        """Share of the result that lies in segments of more than ``area`` px."""
        return float(self.areas[self.areas > area].sum() / max(self.areas.sum(), 1))


def copied_segments(match: Correspondence, made: Mask | None = None) -> Segments:
    """Find the regions that were copied in one piece (4-connected), of what is ``made``; none is all.

    Neighbours of which one is made count for the continuity.
    """
    from skimage.measure import label

    height, width = match.shape[:2]
    rows = match[..., 0].astype(np.int64) - np.arange(height)[:, None]
    columns = match[..., 1].astype(np.int64) - np.arange(width)[None, :]
    displacement = (rows - rows.min()) * (int(columns.max()) - int(columns.min()) + 1) + columns - columns.min()
    kept = [np.diff(displacement, axis=axis) == 0 for axis in (0, 1)]
    if made is not None:
        kept[0] = kept[0][made[1:] | made[:-1]]
        kept[1] = kept[1][made[:, 1:] | made[:, :-1]]
        displacement[~made] = -1
    pairs = kept[0].size + kept[1].size
    return Segments(
        np.bincount(label(displacement, background=-1, connectivity=1).ravel())[1:],
        float((kept[0].sum() + kept[1].sum()) / pairs) if pairs else 1.0,
    )
