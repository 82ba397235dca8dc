"""Pieces of a result moved onto its lattice, where that makes the joints between them cheaper."""

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64

from texloom.stages.kernels.core.elementary_functions import phase_of, phasor
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.correspondence import Patches
from texloom.stages.synthesis.optimisation.lattice_phase import LatticePhase
from texloom.stages.synthesis.optimisation.target_windows import target_windows
from texloom.stages.synthesis.stitching.seams import SeamCosts, Sources, pairs
from texloom.stages.vocabulary.arrays import Vectors
from texloom.stages.vocabulary.facts import Wraps

_WINDOW = 1280  # px of the result that are in memory at once
_OVERLAP = 256  # px; larger pieces at the border of a window stay
_ROUNDED = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))  # px: pieces lie between pixels of a fractional lattice
_EVERY = 8  # px between those of which the result's lattice is taken
_STEPS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1))
# generators by which sources are moved that would lie beyond the exemplar's border


def align_pieces(
    match: Patches,
    lab: Float32[np.ndarray, "h w 3"],
    patch_size: int,
    margin: tuple[int, int],
    wrap: Wraps,
    generators: Vectors,
    phase: LatticePhase,
    allowed: Allowed | None,
) -> None:
    """Move pieces by the few pixels that they lie off the result's lattice, where joints get cheaper by that.

    A piece is what has one displacement to the exemplar. Displacements are chosen at coarse scales, where one px is
    several of the exemplar, so that lines bend where pieces meet, and no change of single patches mends that. Those
    pieces move with which all joints cost least, by a minimum cut. So what is irregular in the exemplar stays, as
    its joints would get dearer. Not in the paper.

    Parameters
    ----------
    match : at full size, changed in place; the target has ``margin`` px above and below, left and right.
    lab : the exemplar, CIELAB.
    wrap : where the target wraps.
    generators : px, two rows or one.
    """
    costs = SeamCosts(lab, gradients=True, squared=True)
    middle, basis = patch_size // 2, generators.astype(np.float64)
    places = np.array(costs.shape) - patch_size + 1
    mean = _mean_deviation(match, middle, margin, phase)
    for window in target_windows(match.shape[1:], wrap, _WINDOW, _OVERLAP):
        rows, columns = (
            line + (middle - before) for line, before in zip((window.rows, window.columns), margin, strict=True)
        )
        source = np.moveaxis(match[:, *window.place], 0, 2).astype(np.int32) + np.int32(middle)
        pieces = _AlignedPieces(source, rows, columns, costs.shape[1])
        for rounded in _ROUNDED:
            own = pieces.mean_of(source[..., 0], source[..., 1])
            cells = _deviation(own, pieces.position, phase) - mean + matrix_product(rounded, phase.exemplar)
            shift = np.rint(matrix_product(cells - np.rint(cells), basis)).astype(np.int32)
            moved = source - shift[pieces.number]
            fits = _brought_inside(moved, basis, middle, places, allowed)
            free = (shift != 0).any(axis=1)
            free[pieces.number[~fits | window.border]] = False
            moved = np.where(free[pieces.number][..., None], moved, source)
            taken = pieces.cheapest(costs, source, moved, free)
            source = np.where(taken[pieces.number][..., None], moved, source)
        match[:, *window.place] = np.moveaxis(source, 2, 0) - middle


def _deviation(
    source: Float64[np.ndarray, "n 2"], position: Float64[np.ndarray, "n 2"], phase: LatticePhase
) -> Float64[np.ndarray, "n k"]:
    """How far sources lie off the lattice at their positions, in cells, less whole ones."""
    cells = matrix_product(source, phase.exemplar) - matrix_product(position, phase.target) - phase.origin
    return np.asarray(cells - np.rint(cells))


def _mean_deviation(
    match: Patches, middle: int, margin: tuple[int, int], phase: LatticePhase
) -> Float64[np.ndarray, "*k"]:
    """That of all of the result, whose lattice may differ from that of the start."""
    row, column = (np.arange(0, side, _EVERY) for side in match.shape[1:])
    position = np.stack(np.meshgrid(row, column, indexing="ij"), axis=2).reshape(-1, 2) + (
        middle - np.array(margin)
    )
    source = np.moveaxis(match[:, ::_EVERY, ::_EVERY], 0, 2).reshape(-1, 2) + middle
    cells = _deviation(source.astype(np.float64), position.astype(np.float64), phase)
    return np.asarray(phase_of(phasor(2 * np.pi * cells).sum(axis=0)) / (2 * np.pi))


def _brought_inside(
    source: Sources, basis: Float64[np.ndarray, "k 2"], middle: int, places: Int64[np.ndarray, "2"],
    allowed: Allowed | None,
) -> Bool[np.ndarray, "p q"]:  # fmt: skip
    """Which sources are middles of usable patches, after others are moved by a generator, in place."""

    def fit(some: Int32[np.ndarray, "*n 2"]) -> Bool[np.ndarray, "*n"]:
        first = some - middle
        inside = ((first >= 0) & (first < places)).all(axis=-1)
        if allowed is not None:
            inside[inside] = allowed.places[first[inside][:, 0], first[inside][:, 1]]
        return np.asarray(inside)

    inside = fit(source)
    for step in _STEPS if len(basis) == 2 else _STEPS[:2]:
        row, column = np.nonzero(~inside)
        other = source[row, column] + np.rint(matrix_product(step[: len(basis)], basis)).astype(np.int32)
        found = fit(other)
        row, column = row[found], column[found]
        source[row, column], inside[row, column] = other[found], True
    return inside


class _AlignedPieces:
    """Parts of a result that have one displacement to the exemplar each, of ``width`` px."""

    def __init__(
        self, source: Sources, rows: Int64[np.ndarray, "*p"], columns: Int64[np.ndarray, "*q"], width: int
    ):
        from texloom.stages.kernels.seams.piece_graph import number_pieces

        line = width + len(columns)  # so wide that no displacement is ambiguous
        displacement = (source[..., 0] - rows[:, None]) * line + source[..., 1] - columns
        self.number: Int64[np.ndarray, "p q"] = np.empty(displacement.shape, np.int64)
        """of the piece of each pixel"""
        number_pieces(displacement, self.number)
        self.size = np.bincount(self.number.ravel())
        self.position = self.mean_of(*np.broadcast_arrays(rows[:, None], columns))
        """mean row and column of each piece"""

    def mean_of(self, *planes: np.ndarray) -> Float64[np.ndarray, "m 2"]:
        """Mean of whole numbers over each piece."""
        sums = [np.bincount(self.number.ravel(), plane.ravel()) for plane in planes]
        return np.stack(sums, axis=1) / self.size[:, None]

    def cheapest(
        self, costs: SeamCosts, old: Sources, new: Sources, free: Bool[np.ndarray, "*m"]
    ) -> Bool[np.ndarray, "*m"]:
        """Which of the free pieces take their new sources so that all joints cost least."""
        ends, found = [], []
        for axis, step in enumerate(((1, 0), (0, 1))):
            both = [pairs(source, axis) for source in (old, new)]
            joint = np.logical_or(*((other - one != step).any(axis=2) for one, other in both))
            first, second = ([end[joint] for end in sides] for sides in zip(*both, strict=True))
            ends.append(np.stack([end[joint] for end in pairs(self.number, axis)]))
            found.append(np.stack([costs.between(axis, one, other) for one in first for other in second]))
        piece, cost = np.concatenate(ends, axis=1), np.concatenate(found, axis=1)
        taken = cheapest_moves(piece, cost, free)
        chosen = 2 * taken[piece[0]] + taken[piece[1]]
        cheaper = np.take_along_axis(cost, chosen[None], axis=0).sum() < cost[0].sum()
        return taken if cheaper else np.zeros_like(taken)


def cheapest_moves(
    piece: Int64[np.ndarray, "2 n"], cost: Int64[np.ndarray, "4 n"], free: Bool[np.ndarray, "*m"]
) -> Bool[np.ndarray, "*m"]:
    """Which free pieces move so that the sum of all joints is least; of equal choices, that which moves fewest.

    A joint costs no more if both its pieces stay, or both move, than if one does and the other does not, together.

    Parameters
    ----------
    piece : on both sides of each joint.
    cost : of each joint if none of both moves, the second, the first, or both.

    References
    ----------
    [Kolmogorov2004]_ section 4.1.
    """
    from texloom.stages.kernels.seams.piece_graph import cut_graph

    count, price = len(free), np.zeros(len(free), np.int64)  # of moving
    within = piece[0] == piece[1]
    np.add.at(price, piece[0][within], (cost[3] - cost[0])[within])
    key = piece.min(axis=0) * count + piece.max(axis=0)
    keys, edge = np.unique(key[~within], return_inverse=True)
    ordered = np.where(piece[0] > piece[1], cost[[0, 2, 1, 3]], cost)[:, ~within]
    stay, later, earlier, move = (np.bincount(edge, some, len(keys)).astype(np.int64) for some in ordered)
    first, second = np.divmod(keys, count)
    np.add.at(price, first, earlier - stay)
    np.add.at(price, second, move - earlier)
    apart = np.maximum(later + earlier - stay - move, 0)  # where the second moves alone
    price[~free] = 1 + np.abs(price).sum() + apart.sum()
    taken = np.empty(count, np.bool_)
    cut_graph(price, first, second, apart, taken)
    return taken
