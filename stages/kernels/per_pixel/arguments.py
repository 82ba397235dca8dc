"""What the kernels of per-pixel synthesis take: arrays and numbers that belong together.

A *place* is the number of a pixel in the exemplar with a margin around it, row * pitch + column. The margin
repeats the places that continue the exemplar there, so no index is ever wrapped. Levels are numbered from the
finest, 0; the pixels of level l are 2**l px apart, in the exemplar as in the result. Tables have one row a place,
level after level.

If the texture is distorted, offsets between pixels are no whole pixels. The result then stores not places but
*positions*, row << 32 | column in 1/256 px with the margin.
"""

from typing import NamedTuple

import numpy as np


class ExemplarTables(NamedTuple):
    """Tables over the places of an exemplar."""

    run: tuple[int, ...]
    """d integers, 8 or 16; the type tells kernels the length of a row of ``values``"""
    values: np.ndarray
    """(levels * places, d) int16, what describes each place's neighbourhood, then its control; places whose
    neighbourhood is not valid are far from all. For CUDA (levels * places, d / 4) int64, words of 4 numbers"""
    candidates: np.ndarray
    """(levels * places, k) int32, similar places. The first is the nearest place with a valid neighbourhood: the
    place itself where its own is valid"""
    rows: int
    pitch: int
    """places in a row, with the margin"""


class Appearance(NamedTuple):
    """From what the neighbourhood of a result's pixel is described."""

    vectors: np.ndarray
    """(levels * places, 8) int16, the appearance of each place"""
    sides: np.ndarray
    """(levels * 32, 16) int16, for each level and each of the eight neighbours the basis on which an appearance
    there is projected, see `texloom.stages.kernels.core.short_vectors.paired`"""


class Distortion(NamedTuple):
    """How texture is distorted in the exemplar and in the result."""

    jacobian: np.ndarray
    """(places, 4) float32, from texture to exemplar px"""
    inverse: np.ndarray
    """(pixels, 4) float32, from px of the result to texture, both in steps of the level in ``sampled``"""
    sampled: np.ndarray
    """(pixels,) uint8, the level of the exemplar that each pixel of the result is compared with"""


class LevelState(NamedTuple):
    """A level of the result."""

    number: int
    row: int
    """of the first pixel of the arrays in the endless result"""
    column: int
    states: np.ndarray
    """(passes + 1, rows, columns), before the first pass and after each: places (int32), or positions (int64) where
    texture is distorted"""
    given: np.ndarray
    """(rows, columns, d - 8) int16, control that the result shall have"""
    pinned: np.ndarray
    """(rows, columns), as a state, of the pixels that are fixed, -1 for others; (0, 0) if none is"""


class Subpass(NamedTuple):
    """A quarter of a correction pass: every second pixel of every second row [LefebvreHoppe2005]_."""

    number: int
    """of the pass"""
    vertical: int
    """1 if the neighbours above and below have been corrected in this pass, else 0"""
    horizontal: int
    diagonal: int


class Bonuses(NamedTuple):
    """What each neighbour that agrees takes off the factor on a squared distance, / 256; at most 31."""

    coherence: int
    """on that of the neighbourhood"""
    control: int
    """on that of control"""


class Pieces(NamedTuple):
    """Pieces of the exemplar that the coarsest level starts from."""

    core: tuple[int, int, int, int]
    """top, bottom, left and right of the places that they are taken from, if texture is not distorted"""
    endless: bool
    """whether the core wraps around; pieces then begin anywhere"""
    starts: np.ndarray
    """(n,) int32, places around which they are taken, if texture is distorted"""
    block: int
    """side, px of the level; what does not fit into a core that ends repeats its border, or where texture is
    distorted goes on elsewhere"""
    tries: int
    """places that are tried under control"""


class PhaseMaps(NamedTuple):
    """Phases in 2**-32 of a repetition along each of two generators; at most one row if the exemplar has none."""

    wanted: np.ndarray
    """(pixels, 2) uint32, of the result's coarsest level"""
    phases: np.ndarray
    """(places, 2) uint32, of the exemplar"""
    generators: tuple[int, int, int, int]
    """row and column of both, 1/256 px of texture"""
