"""An exemplar as the kernels of per-pixel synthesis read it: tables over its places, with a margin around them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int16, Int32

from stages.analysis._appearance import AROUND, COMPONENTS, FAR, projected
from stages.analysis._distorted import BLOCKS
from stages.arrays import Jacobian
from stages.kernels.threads import run_spans

_MOST = 16000  # length of the vector of control values; with a neighbourhood's, differences stay within 31 bits

_PIECES = 32

CONTROLS = 8
"""most planes of control"""


@dataclass(frozen=True)
class Tables:
    """What is known of every place at every level; see `stages.kernels.per_pixel` for what the words mean.

    A place is ``(row + margin) * pitch + column + margin``; ``places`` is their number, that of the margin too.
    """

    shape: tuple[int, int]
    """height and width of the exemplar, px"""
    levels: int
    margin: int
    """px around the exemplar: one step of the coarsest level"""
    table: Int16[np.ndarray, "eight_levels_places 8"]
    """contribution of each place to the neighbourhood of what stands one step away, for each of the eight sides"""
    values: Int16[np.ndarray, "levels_places d"]
    """d = 8: neighbourhoods, far from all where they are not whole; d = 16: and control, zeros where there are
    fewer than 8 planes"""
    similar: Int32[np.ndarray, "levels_places others"]
    home: Int32[np.ndarray, " levels_places"]
    jacobian: Float32[np.ndarray, "places 4"] | None
    core: tuple[int, int, int, int]
    """rows and columns, with the margin, that hold the whole neighbourhoods of the coarsest level: top, bottom,
    left, right"""
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

    @property
    def run(self) -> tuple[int, ...]:
        """As many numbers as ``values`` has columns."""
        return (0,) * int(self.values.shape[1])

    def places_of(self, rows: np.ndarray, columns: np.ndarray) -> Int32[np.ndarray, "..."]:
        """Places of pixels of the exemplar."""
        return ((rows + self.margin) * self.pitch + columns + self.margin).astype(np.int32)

    def pixels_of(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns in the exemplar."""
        rows, columns = np.divmod(places, np.int32(self.pitch))
        return rows - np.int32(self.margin), columns - np.int32(self.margin)


def make_tables(
    appearance: Int16[np.ndarray, "levels h w 8"],
    basis: Int16[np.ndarray, "levels 64 8"],
    similar: Int32[np.ndarray, "levels h w k"],
    toroidal: bool,
    control: Float32[np.ndarray, "levels h w c"] | None = None,
    control_weight: float = 1.0,
    jacobian: Jacobian | None = None,
) -> Tables:
    """Lay out an exemplar's analysis.

    Parameters
    ----------
    appearance, basis, similar, toroidal : see `stages.analysis.appearance_stack`.
    control : the exemplar's control at each level, 0..1 a plane.
    control_weight : variance of all control together by that of the neighbourhoods.
    """
    from stages.kernels.distorted_windows import lay_out

    levels, height, width = appearance.shape[:3]
    margin = 2 ** (levels - 1)
    down, across = height + 2 * margin, width + 2 * margin
    rows, columns = np.indices((down, across), sparse=True)
    rows, columns = rows - margin, columns - margin
    count = down * across
    dimensions = COMPONENTS if control is None else 2 * COMPONENTS
    # where texture is distorted, what is not needed stays untouched
    table = (np.empty if jacobian is None else np.zeros)((8, levels, count, COMPONENTS), np.int16)
    values = np.zeros((levels, count, dimensions), np.int16)
    others = np.empty((levels, count, similar.shape[3] - 1), np.int32)
    homes = np.empty((levels, count), np.int32)
    strengths = []

    def place(pixels: np.ndarray) -> np.ndarray:
        return np.asarray((pixels // width + margin) * across + pixels % width + margin)

    for level in range(levels):
        home, further = similar[level, ..., 0], similar[level, ..., 1:]
        if toroidal:
            pixel = rows % height * width + columns % width
            own, target = pixel, home.ravel()[pixel]
        else:
            # beyond the border goes on from where the nearest pixel's home is
            near_rows, near_columns = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
            at = home[near_rows, near_columns]
            to_rows = np.clip(at // width + rows - near_rows, 0, height - 1)
            to_columns = np.clip(at % width + columns - near_columns, 0, width - 1)
            there = to_rows * width + to_columns
            target = np.where(home[to_rows, to_columns] == there, there, at)
            inside = (rows == near_rows) & (columns == near_columns)
            own = np.where(inside, near_rows * width + near_columns, target)
        own, target = own.ravel(), target.ravel()
        there = (np.clip(rows, 0, height - 1) * width + np.clip(columns, 0, width - 1)).ravel()
        moved = target != (own if toroidal else np.where(inside.ravel(), there, -1))
        homes[level] = place(target)
        others[level] = place(further.reshape(height * width, -1)[target])
        if jacobian is not None:
            every = max(1, 2**level // BLOCKS)
            values[level, :, 0] = np.where(moved, FAR, 0)
            shared = (
                appearance[level], basis[level], home, jacobian, 2.0**level, every, FAR, margin, table[:, level],
                values[level],
            )  # fmt: skip
            run_spans(lay_out, shared, -(-height // every), _PIECES)
            sums = values[level, ~moved, :COMPONENTS]
        else:
            total = np.zeros((height, width, COMPONENTS), np.int16)
            for side, (up, left) in enumerate(AROUND):
                part = basis[level, COMPONENTS * side : COMPONENTS * (side + 1)]
                table[side, level] = projected(appearance[level], part).reshape(-1, COMPONENTS)[own]
                to_rows = np.arange(height)[:, None] + up * 2**level + margin
                to_columns = np.arange(width) + left * 2**level + margin
                total += table[side, level, to_rows * across + to_columns]
            sums = total.reshape(-1, COMPONENTS)
            values[level, :, :COMPONENTS] = sums[target]
            values[level, moved, :COMPONENTS] = [FAR, *(0,) * (COMPONENTS - 1)]
        if control is not None:
            planes = control[level].reshape(height * width, -1)
            strengths.append(_strength(sums, planes, control_weight))
            fixed = np.rint(planes * np.float32(strengths[-1])).astype(np.int16)
            values[level, :, COMPONENTS : COMPONENTS + planes.shape[1]] = fixed[target]
    field = None
    if jacobian is not None:
        field = np.ascontiguousarray(jacobian[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)])
        field = field.reshape(-1, 4)
    return Tables(
        shape=(height, width),
        levels=levels,
        margin=margin,
        table=table.reshape(-1, COMPONENTS),
        values=values.reshape(-1, dimensions),
        similar=others.reshape(levels * count, -1),
        home=homes.ravel(),
        jacobian=field,
        core=_core(similar[-1, ..., 0], margin),
        strengths=tuple(strengths),
    )


def _core(home: np.ndarray, margin: int) -> tuple[int, int, int, int]:
    own = home == np.arange(home.size).reshape(home.shape)
    rows, columns = np.flatnonzero(own.any(axis=1)), np.flatnonzero(own.any(axis=0))
    edges = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    return int(edges[0]) + margin, int(edges[1]) + margin, int(edges[2]) + margin, int(edges[3]) + margin


def _strength(neighbourhoods: np.ndarray, control: np.ndarray, weight: float) -> float:
    spread = float(control.astype(np.float64).var(axis=0).sum())
    texture = float(neighbourhoods.astype(np.float64).var(axis=0).sum())
    strength = np.sqrt(weight * max(texture, 1.0) / max(spread, 1e-6))
    return float(min(strength, _MOST / np.sqrt(control.shape[1])))
