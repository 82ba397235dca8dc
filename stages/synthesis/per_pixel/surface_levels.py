"""Per-pixel synthesis of all charts of a surface at once, level by level."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64, Int64

from texloom.stages.common.per_pixel.levels import (
    NO_REPETITION,
    SUBPASSES,
    Style,
    distortion_of,
    halved,
    piece_starts,
    subpass,
)
from texloom.stages.common.per_pixel.tables import Tables
from texloom.stages.common.surface.texels import Texels
from texloom.stages.kernels.core.threads import run_spans, thread_count
from texloom.stages.kernels.per_pixel.arguments import Bonuses, Distortion, LevelState, PhaseMaps, Pieces
from texloom.stages.vocabulary.progress import Progress, report

_STRIP = 2**14  # texels of a strip, about


@dataclass(frozen=True)
class _SurfaceLevel:
    texels: Texels
    state: LevelState
    distortion: Distortion
    strips: Int64[np.ndarray, "n 6"]
    tile: Int64[np.ndarray, "*n"]
    """of each strip"""
    parity: Int64[np.ndarray, "*m"]
    """of the links' targets in the result: 2 * row + column, each modulo 2"""


class SurfaceLevels:
    """All levels of the texture.

    Parameters
    ----------
    texels : one level for each of ``tables``.
    control : what the result shall follow, 0..1, at each px of it; or None.
    repetition : of the exemplar, and its phases at the texels of the coarsest level.
    """

    def __init__(
        self,
        tables: Tables,
        style: Style,
        texels: list[Texels],
        control: Float32[np.ndarray, "H W k"] | None,
        repetition: PhaseMaps = NO_REPETITION,
    ):
        self.tables, self.style, self.repetition = tables, style, repetition
        self.levels = []
        for level in texels:
            self.levels.append(self._level(level, control))
            control = None if control is None else halved(control)

    def _level(self, texels: Texels, control: Float32[np.ndarray, "H W k"] | None) -> _SurfaceLevel:
        passes, count = self.style.passes[texels.number], texels.tiles.shape[0] * texels.tiles.shape[1]
        strips, tile = _strips(texels)
        jacobian = np.tile(np.array([1, 0, 0, 1], np.float32), (1, count, 1))
        jacobian[0, texels.flat] = texels.jacobian[0]
        pinned = np.zeros(count, np.int64)
        pinned[texels.flat] = -1
        state = LevelState(
            texels.number, 0, 0,
            np.zeros((passes + 1, *texels.tiles.shape), np.int64),
            np.zeros((*texels.tiles.shape, self.tables.values.shape[1] - 8), np.int16),
            pinned.reshape(texels.tiles.shape),
        )  # fmt: skip
        if control is not None:
            self._give(state.given, texels, control)
        rows, columns = texels.in_result(texels.links.targets, texels.link_place).T % 2
        distortion = distortion_of(self.tables, jacobian, texels.number)
        return _SurfaceLevel(texels, state, distortion, strips, tile, 2 * rows + columns)

    def _give(self, given: np.ndarray, texels: Texels, control: Float32[np.ndarray, "H W k"]) -> None:
        """Fill the control that texels on the surface shall have."""
        rows, columns = texels.in_result(texels.flat, texels.place).T
        values = control[np.clip(rows, 0, len(control) - 1), np.clip(columns, 0, control.shape[1] - 1)]
        fixed = np.rint(values * np.float32(self.tables.strengths[texels.number])).astype(np.int16)
        given.reshape(-1, given.shape[2])[texels.flat, : fixed.shape[1]] = fixed

    def run(self) -> None:
        """Compute everything."""
        count = len(self.levels)
        for number in reversed(range(count)):
            self._begin(number)
            self._correct(self.levels[number])
            report(Progress(0.25**number, scale=count - number, scales=count))

    def positions(self) -> tuple[Float64[np.ndarray, "n 2"], Int64[np.ndarray, "n 2"]]:
        """Rows and columns in the exemplar, and in the result, of texels on the surface, then of those linked."""
        level = self.levels[0]
        texels = level.texels
        flat = np.concatenate([texels.flat, texels.links.targets])
        place = np.concatenate([texels.place, texels.link_place])
        stored = level.state.states[-1].ravel()[flat]
        positions = np.stack([stored >> 32, stored & (2**32 - 1)], axis=1) / 256 - self.tables.margin
        return positions, texels.in_result(flat, place)

    def _begin(self, number: int) -> None:
        from texloom.stages.kernels.surface.tiles import refine_strips, start_strips

        level, tables, style = self.levels[number], self.tables, self.style
        key = style.key_of(number)
        if number == len(self.levels) - 1:
            pieces = Pieces(tables.core, tables.endless, piece_starts(tables), style.block, style.tries)
            shared = (
                level.state, tables.exemplar, level.distortion, pieces, self.repetition,
                style.tolerance_of(number, tables.strengths), key, level.strips,
            )  # fmt: skip
            run_spans(start_strips, shared, len(level.strips), _pieces())
        else:
            coarse = self.levels[number + 1]
            origins = coarse.texels.tiles.origins[level.tile]
            refined = (
                level.state, coarse.state, origins, tables.exemplar, level.distortion,
                style.amplitude_of(number), key, level.strips,
            )  # fmt: skip
            run_spans(refine_strips, refined, len(level.strips), _pieces())
        self._carry(level, 0, None)

    def _correct(self, level: _SurfaceLevel) -> None:
        """All passes over a level."""
        from texloom.stages.kernels.surface.tiles import correct_strips

        tables, style, states = self.tables, self.style, level.state.states
        bonuses = Bonuses(style.coherence_bonus, style.control_bonus)
        for number in range(len(states) - 1):
            # links read texels of either pass
            states[number + 1] = states[number]
            for index, parity in enumerate(SUBPASSES):
                shared = (
                    level.state, subpass(number, index), parity, tables.exemplar, tables.vectors, level.distortion,
                    bonuses, style.tolerance_of(level.texels.number, tables.strengths), level.strips,
                )  # fmt: skip
                run_spans(correct_strips, shared, len(level.strips), _pieces())
                self._carry(level, number + 1, 2 * parity[0] + parity[1])

    def _carry(self, level: _SurfaceLevel, state: int, parity: int | None) -> None:
        """Bring links up to date, those of one parity or all."""
        from texloom.stages.kernels.surface.links import carry

        links, tables = level.texels.links, self.tables
        which = slice(None) if parity is None else np.flatnonzero(level.parity == parity)
        targets = links.targets[which]
        shared = (
            level.state.states[state].ravel(), targets, links.sources[which], links.offsets[which], tables.jacobian,
            tables.exemplar.pitch, tables.exemplar.rows,
        )  # fmt: skip
        run_spans(carry, shared, targets.size, thread_count())


def _pieces() -> int:
    return 4 * thread_count()


def _strips(texels: Texels) -> tuple[Int64[np.ndarray, "n 6"], Int64[np.ndarray, "*n"]]:
    """The tiles without their outermost texels, cut into strips of about the same size; and the tile of each."""
    made, tile = [], []
    for place, (top, bottom, left, right) in enumerate(texels.tiles.rectangles.tolist()):
        rows = max(1, _STRIP // (right - left))
        for first in range(top + 1, bottom - 1, rows):
            made.append((first, min(first + rows, bottom - 1), left + 1, right - 1, *texels.tiles.origins[place]))
            tile.append(place)
    return np.array(made, np.int64).reshape(-1, 6), np.array(tile, np.int64)
