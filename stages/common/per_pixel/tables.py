"""An exemplar as the kernels of per-pixel synthesis read it: tables over its places, with a margin around them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float32, Int16, Int32

from texloom.stages.common.features.control import by_plane
from texloom.stages.common.similarity.appearance import COMPONENTS, FAR
from texloom.stages.common.similarity.distorted_appearance import block_side
from texloom.stages.kernels.core.threads import run_spans
from texloom.stages.kernels.per_pixel.arguments import Appearance, ExemplarTables
from texloom.stages.vocabulary.arrays import Jacobian

_MAX_CONTROL_LENGTH = 16000  # of the vector of control values: squared distances stay within 31 bits

_PIECES = 32

CONTROLS = 8
"""most planes of control"""


@dataclass(frozen=True)
class Tables:
    """Tables over every place at every level, see `texloom.stages.kernels.per_pixel.arguments`.

    A place is ``(row + margin) * pitch + column + margin``; ``places`` is their number, that of the margin too.
    """

    shape: tuple[int, int]
    """height and width of the exemplar, px"""
    levels: int
    margin: int
    """px around the exemplar: one step of the coarsest level; none where it is distorted and no torus, because
    positions are kept inside"""
    appearance: Int16[np.ndarray, "levels_places 8"]
    sides: Int16[np.ndarray, "levels_sides 16"]
    """see `Appearance.sides`"""
    values: Int16[np.ndarray, "levels_places d"]
    """d = 8: neighbourhoods, far from all where they are not valid; d = 16: and control, zeros where there are
    fewer than 8 planes"""
    candidates: Int32[np.ndarray, "levels_places k"]
    jacobian: Float32[np.ndarray, "places 4"] | None
    core: tuple[int, int, int, int]
    """rows and columns, with the margin, that hold the valid neighbourhoods of the coarsest level: top, bottom,
    left, right"""
    endless: bool
    """whether the core is all of a torus"""
    strengths: tuple[float, ...]
    """for each level what the whole range of a plane of control counts in ``values``"""

    @property
    def pitch(self) -> int:
        """Places in a row."""
        return self.shape[1] + 2 * self.margin

    @property
    def places(self) -> int:
        """Places of a level."""
        return (self.shape[0] + 2 * self.margin) * self.pitch

    @cached_property
    def exemplar(self) -> ExemplarTables:
        """As kernels take it."""
        run = (0,) * int(self.values.shape[1])
        return ExemplarTables(run, self.values, self.candidates, self.places // self.pitch, self.pitch)

    @property
    def vectors(self) -> Appearance:
        """Appearances as kernels take them."""
        return Appearance(self.appearance, self.sides)

    def places_of(self, rows: np.ndarray, columns: np.ndarray) -> Int32[np.ndarray, "..."]:
        """Places of pixels of the exemplar."""
        return ((rows + self.margin) * self.pitch + columns + self.margin).astype(np.int32)

    def pixels_of(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns in the exemplar."""
        rows = places // np.int32(self.pitch)
        columns = places - rows * np.int32(self.pitch)  # several times as fast as the remainder
        return rows - np.int32(self.margin), columns - np.int32(self.margin)


def make_tables(
    appearance: Int16[np.ndarray, "levels h w 8"],
    basis: Int16[np.ndarray, "levels 64 8"],
    candidates: Int32[np.ndarray, "levels h w k"],
    toroidal: bool,
    control: Float32[np.ndarray, "levels h w c"] | None = None,
    control_weight: float = 1.0,
    jacobian: Jacobian | None = None,
) -> Tables:
    """Lay out an exemplar's analysis.

    Parameters
    ----------
    appearance, basis, candidates, toroidal : see `texloom.stages.analysis.similarity.appearance_stack`.
    control : the exemplar's control at each level, 0..1 a plane.
    control_weight : variance of all control divided by that of the neighbourhoods.
    """
    from texloom.stages.kernels.core.short_vectors import paired
    from texloom.stages.kernels.distortion.distorted_windows import describe_whole
    from texloom.stages.kernels.per_pixel.correction import describe

    appearance, candidates = np.ascontiguousarray(appearance), np.ascontiguousarray(candidates)
    if jacobian is not None:
        jacobian = np.ascontiguousarray(jacobian)
    levels, height, width = appearance.shape[:3]
    # the analysis of a distorted exemplar is read where it is, without a margin
    margin = 2 ** (levels - 1) if jacobian is None or toroidal else 0
    core = _core(candidates[-1, ..., 0], margin)
    rows, columns = np.arange(-margin, height + margin)[:, None], np.arange(-margin, width + margin)
    inside = np.s_[margin : margin + height, margin : margin + width]
    own = np.arange(rows.size * columns.size, dtype=np.int32).reshape(rows.size, columns.size)
    if toroidal:
        own = own[inside][rows % height, columns % width]
    if margin:
        appearance, candidates = _with_margin(appearance, candidates, rows, columns, toroidal)
    sides = np.stack([paired(part) for part in basis])
    values = np.zeros((levels, *own.shape, COMPONENTS if control is None else 2 * COMPONENTS), np.int16)
    strengths = []
    for level in range(levels):
        valid, vectors = candidates[level, ..., 0], values[level]
        sums = vectors[..., :COMPONENTS]
        if jacobian is None:
            run_spans(describe, (appearance[level], sides[level], margin, 2**level, vectors), height, _PIECES)
            counted = sums[inside].reshape(-1, COMPONENTS)
        else:
            every = block_side(level, jacobian, (valid == own)[inside])
            shared = appearance[level], sides[level], margin, valid, jacobian, 2.0**level, every, FAR, vectors
            run_spans(describe_whole, shared, -(-height // every), _PIECES)
            counted = sums[inside][(valid == own)[inside]]
        if control is not None:
            strengths.append(_strength(counted, control[level].reshape(height * width, -1), control_weight))
            fixed = np.rint(control[level] * np.float32(strengths[-1])).astype(np.int16)
            pixel = (valid // columns.size - margin) * width + valid % columns.size - margin
            vectors[..., COMPONENTS : COMPONENTS + fixed.shape[2]] = fixed.reshape(height * width, -1).take(
                pixel, axis=0
            )
        if toroidal:
            sums[:] = sums[inside][rows % height, columns % width]
        if jacobian is None:
            sums[valid != own] = [FAR, *(0,) * (COMPONENTS - 1)]
    if jacobian is not None and margin:
        jacobian = jacobian[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
    return Tables(
        shape=(height, width),
        levels=levels,
        margin=margin,
        appearance=appearance.reshape(-1, COMPONENTS),
        sides=sides.reshape(-1, sides.shape[2]),
        values=values.reshape(-1, values.shape[3]),
        candidates=candidates.reshape(levels * own.size, -1),
        jacobian=None if jacobian is None else jacobian.reshape(-1, 4),
        core=core,
        endless=toroidal and (core[1] - core[0], core[3] - core[2]) == (height, width),
        strengths=tuple(strengths),
    )


def _with_margin(
    appearance: Int16[np.ndarray, "levels h w 8"],
    candidates: Int32[np.ndarray, "levels h w k"],
    rows: np.ndarray,
    columns: np.ndarray,
    toroidal: bool,
) -> tuple[Int16[np.ndarray, "levels down across 8"], Int32[np.ndarray, "levels down across k"]]:
    """Continue beyond the borders, and number places, not pixels.

    Parameters
    ----------
    rows, columns : (down, 1) and (across,), of all places; 0 are the exemplar's first.
    """
    levels, height, width = appearance.shape[:3]
    shown = np.empty((levels, rows.size, columns.size, COMPONENTS), np.int16)
    similar = np.empty((levels, rows.size, columns.size, candidates.shape[3]), np.int32)
    near_rows, near_columns = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
    inside = (rows == near_rows) & (columns == near_columns)
    for level in range(levels):
        valid = candidates[level, ..., 0]
        if toroidal:
            own = rows % height * width + columns % width
            target = valid[rows % height, columns % width]
        else:
            # continue the nearest valid neighbourhood of the nearest pixel
            at = valid[near_rows, near_columns]
            to_rows = np.clip(at // width + rows - near_rows, 0, height - 1)
            to_columns = np.clip(at % width + columns - near_columns, 0, width - 1)
            there = to_rows * width + to_columns
            target = np.where(valid[to_rows, to_columns] == there, there, at)
            own = np.where(inside, near_rows * width + near_columns, target)
        shown[level] = appearance[level].reshape(-1, COMPONENTS).take(own, axis=0)
        pixels = candidates[level].reshape(height * width, -1).take(target, axis=0)
        similar[level] = (pixels // width - rows[0]) * columns.size + pixels % width - columns[0]
    return shown, similar


def _core(nearest_valid: np.ndarray, margin: int) -> tuple[int, int, int, int]:
    """See `Tables.core`; ``nearest_valid`` is (h, w), for each pixel itself where its neighbourhood is valid."""
    own = nearest_valid == np.arange(nearest_valid.size).reshape(nearest_valid.shape)
    rows, columns = np.flatnonzero(own.any(axis=1)), np.flatnonzero(own.any(axis=0))
    edges = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    return int(edges[0]) + margin, int(edges[1]) + margin, int(edges[2]) + margin, int(edges[3]) + margin


def _strength(neighbourhoods: np.ndarray, control: np.ndarray, weight: float) -> float:
    """The factor by which control, (n, c), varies ``weight`` times as much as neighbourhoods, (n, 8), if it can."""
    planes = (by_plane(values, np.float64) for values in (control, neighbourhoods))
    spread, texture = (float(rows.var(axis=1).sum()) for rows in planes)
    strength = np.sqrt(weight * max(texture, 1.0) / max(spread, 1e-6))
    return float(min(strength, _MAX_CONTROL_LENGTH / np.sqrt(control.shape[1])))
