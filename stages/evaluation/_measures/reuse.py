"""Measures of a source map: its entropy, and copied pieces."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Int64

from texloom.stages.common.source_maps.exemplar_use import source_counts
from texloom.stages.evaluation._measures.pictures import UnmeasurableError
from texloom.stages.evaluation._measures.table import Figures
from texloom.stages.evaluation._measures.task import Task
from texloom.stages.vocabulary.arrays import Correspondence, Mask

_VERBATIM = 0.95  # share of a result, or of the exemplar, that counts as all of it


def match_entropy(match: Correspondence, shape: tuple[int, int], count: int | None = None) -> float:
    """Entropy of the sources relative to that of uniform use; 0..1.

    ``count``: valid pixels, if not all.
    """
    pixels = match.shape[0] * match.shape[1]
    counts = source_counts(match, shape)
    shares = counts[counts > 0] / pixels
    most = np.log(min(count or shape[0] * shape[1], pixels))
    return float(-(shares * np.log(shares)).sum() / most) if most > 0 else 1.0


@dataclasses.dataclass(frozen=True)
class CopiedSegments:
    """The connected regions of a result that are copied with one displacement."""

    areas: Int64[np.ndarray, "n"]
    """px"""
    pixels: int
    """of the result, in segments or not"""
    continuity: float
    """share of neighbouring pixels whose sources are the same neighbours"""

    @property
    def typical(self) -> float:
        """Mean area of the segment that a pixel lies in, px."""
        return float((self.areas.astype(np.float64) ** 2).sum() / max(self.areas.sum(), 1))

    def share_above(self, area: float) -> float:
        """Share of the result that lies in segments of more than ``area`` px."""
        return float(self.areas[self.areas > area].sum() / max(self.pixels, 1))


def copied_segments(match: Correspondence, made: Mask | None = None, copies: Mask | None = None) -> CopiedSegments:
    """Find 4-connected regions of one displacement among the pixels that were ``made`` and are ``copies``.

    None is all. For the continuity, neighbours count of which at least one was made.
    """
    import cv2

    height, width = match.shape[:2]
    rows = match[..., 0].astype(np.int32) - np.arange(height, dtype=np.int32)[:, None]
    columns = match[..., 1].astype(np.int32) - np.arange(width, dtype=np.int32)[None, :]
    kept = [(np.diff(rows, axis=axis) == 0) & (np.diff(columns, axis=axis) == 0) for axis in (0, 1)]
    # Pixels, and between them what joins them: OpenCV labels what is true, not what is equal.
    joined = np.zeros((2 * height - 1, 2 * width - 1), np.uint8)
    joined[::2, ::2] = True if made is None else made
    if copies is not None:
        joined[::2, ::2] &= copies
    counted = joined[::2, ::2]
    joined[1::2, ::2] = kept[0] & counted[1:] & counted[:-1]
    joined[::2, 1::2] = kept[1] & counted[:, 1:] & counted[:, :-1]
    labels = cv2.connectedComponents(joined, connectivity=4)[1][::2, ::2]
    if made is not None:
        kept = [kept[0][made[1:] | made[:-1]], kept[1][made[:, 1:] | made[:, :-1]]]
    pairs = kept[0].size + kept[1].size
    return CopiedSegments(
        np.bincount(labels.ravel())[1:],
        height * width if made is None else int(made.sum()),
        float((kept[0].sum() + kept[1].sum()) / pairs) if pairs else 1.0,
    )


def copying_and_continuity(task: Task) -> tuple[Figures, Figures | str]:
    """Share in large copied pieces, and share of kept neighbours; both from the copied segments."""
    if task.match is None:
        raise UnmeasurableError("no source map was given")
    area = task.source_area
    segments = copied_segments(task.match, task.result.made, task.copies)
    if not segments.pixels:
        raise UnmeasurableError("nothing of the result was made")
    largest = float(segments.areas.max(initial=0))
    more: dict[str, Any] = {"typical": segments.typical, "largest": largest / area, "verbatim": None}
    if largest >= _VERBATIM * segments.pixels:
        more["verbatim"] = "a crop of the exemplar"
    elif segments.share_above(_VERBATIM * area) >= _VERBATIM:
        more["verbatim"] = "whole copies of the exemplar, side by side"
    copying = Figures(segments.share_above(task.copied * min(area, segments.pixels)), 0.5, 1.0, more)
    try:
        task.source_map()
    except UnmeasurableError as error:
        return copying, str(error)
    return copying, Figures(segments.continuity, 1.0, 0.0, score=segments.continuity)
