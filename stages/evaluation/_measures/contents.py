"""Which of the exemplar's contents a result shows: copies of what is distinctive, and what is left out."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Float64, Int64

from texloom.stages.common.source_maps.exemplar_use import use_of_exemplar
from texloom.stages.evaluation._measures.pictures import MeasuredPicture, UnmeasurableError, require_variation
from texloom.stages.evaluation._measures.reuse import match_entropy
from texloom.stages.evaluation._measures.table import Figures
from texloom.stages.evaluation._measures.task import Task
from texloom.stages.numerics.matrices import row_product

_SIDE = 48  # px of the reduced exemplar, root of its area
_PIECE = 5  # px of it
_STEP = 2  # px of it between pieces
_MOST_USED = 0.03  # share of the pieces that are called the most repeated
_RARE = 0.25  # of a fair share; below, what is shown is no more than its rim


class _Pieces(NamedTuple):
    """Pieces of an exemplar that cover it."""

    places: Int64[np.ndarray, "n 2"]
    """their middles, px"""
    distinct: Float64[np.ndarray, "*n"]
    """squared distance to the nearest piece that does not overlap, 1 for pieces that have nothing in common"""
    side: int
    """px"""


def pieces_of(picture: MeasuredPicture) -> _Pieces:
    """The pieces of an exemplar, and how distinctive each is; `UnmeasurableError` where masks leave few."""
    import cv2

    require_variation(picture)
    shape = np.array(picture.tone.shape)
    factor = max(1.0, float(np.sqrt(picture.tone.size)) / _SIDE)
    rows, columns = (int(side) for side in np.rint(shape / factor))
    if min(rows, columns) < 3 * _PIECE:
        raise UnmeasurableError("the exemplar is too small or too narrow to compare its pieces")
    small = cv2.resize(picture.compared, (columns, rows), interpolation=cv2.INTER_AREA).reshape(rows, columns, -1)
    counts = (rows - _PIECE + 1, columns - _PIECE + 1)
    windows = np.lib.stride_tricks.sliding_window_view(small - small.mean(axis=(0, 1)), (_PIECE, _PIECE), (0, 1))
    pieces = np.ascontiguousarray(windows.reshape(counts[0] * counts[1], -1), np.float32)
    places = np.stack(np.divmod(np.arange(len(pieces)), counts[1]), axis=1)
    useful = np.ones(len(pieces), bool)
    if picture.valid is not None:
        share = cv2.resize(picture.valid.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
        useful = cv2.boxFilter(share, -1, (_PIECE, _PIECE))[2:-2, 2:-2].ravel() > 1 - 1e-3
    own = np.flatnonzero(useful & (places % _STEP == 0).all(axis=1))
    if len(own) < 2 * _PIECE**2:
        raise UnmeasurableError("masks leave too little of the exemplar")
    squares = (pieces * pieces).sum(axis=1)
    distances = squares[:, None] - 2 * row_product(pieces, np.ascontiguousarray(pieces[own].T))
    distances += squares[own]
    overlap = (np.abs(places[:, None] - places[own]) < _PIECE).all(axis=2)
    distances[overlap | ~useful[:, None]] = np.inf
    alike = 2 * _PIECE**2 * small.reshape(-1, small.shape[2]).var(axis=0).sum()
    distinct = np.maximum(distances.min(axis=0), 0) / max(float(alike), 1e-12)
    middles = np.rint((places[own] + _PIECE / 2) * (shape / (rows, columns))).astype(np.int64)
    return _Pieces(
        np.minimum(middles, shape - 1), np.minimum(distinct, 1).astype(np.float64), round(_PIECE * factor)
    )


def uses_of(task: Task, pieces: _Pieces) -> Float32[np.ndarray, "*n"]:
    """How often the result shows each piece, over its fair share."""
    import cv2

    valid = task.exemplar.valid
    use = use_of_exemplar(task.source_map(), task.source_shape, valid)
    side = max(1, pieces.side * 3 // 5)  # less than a piece: its rim may be cut
    shown = cv2.boxFilter(use, -1, (side, side))
    if valid is not None:
        shown /= np.maximum(cv2.boxFilter(valid.astype(np.float32), -1, (side, side)), np.float32(1e-6))
    return np.asarray(shown[tuple(pieces.places.T)])


def contents(task: Task) -> tuple[Figures, Figures]:
    """Copies of the most repeated pieces beyond their fair share, and the share of what is not shown.

    Pieces count by how distinctive they are: those of a lattice, which are alike, hardly do.
    """
    task.source_map()
    task.require_all_made()
    pieces = pieces_of(task.exemplar)
    uses = uses_of(task, pieces)
    excess = np.sort(np.sqrt(pieces.distinct) * (uses - 1))
    most = float(excess[-max(1, round(_MOST_USED * len(excess))) :].mean())
    weight = max(float(pieces.distinct.sum()), 1e-12)
    hidden = float((pieces.distinct * (uses < _RARE)).sum()) / weight
    largest = int(uses.argmax())
    more = {"largest": float(uses[largest]), "place": pieces.places[largest].tolist()}
    entropy = match_entropy(task.source_map(), task.source_shape, task.source_area)
    return Figures(most, 1.0, 3.0, more), Figures(hidden, 0.05, 0.5, {"entropy": entropy})
