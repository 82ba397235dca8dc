"""Lattice phase: features that keep a result on the exemplar's lattice."""

import itertools

import numpy as np
from jaxtyping import Bool, Complex64, Complex128, Float32, Float64, UInt8, UInt32

from texloom.stages.common.regularity.lattice_cells import steps_along
from texloom.stages.common.regularity.lattice_strain import lattice_strain, visibility
from texloom.stages.kernels.core.elementary_functions import phase_of, phasor, squared_size
from texloom.stages.numerics.matrices import determinant, inverse_of, matrix_product, rank
from texloom.stages.vocabulary.arrays import Correspondence, Mask, Vectors
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.scratch import bands

_MAX_STRETCH = 0.75  # cells along a window by which a given texture's lattice may differ from the exemplar's
_STRETCHES = (0.125, 0.015625)  # cells: steps of the search
_MIN_GAIN = 1.01  # of coherence, by a stretch that is not a coincidence
_PARTS = 6  # along each generator
_TILT = 0.0262  # px a px, 1.5 degrees, of rows and columns, which is not seen
_NEARLY = 0.65  # cells along a side by which its number may change, to avoid more; the nearest changes by up to .5


class LatticePhase:
    """Position within a lattice cell of exemplar and target pixels, as points on two circles.

    Pixels at the same position in their cells have the same four values; half a cell apart they are opposite. The
    target's phase continues the mean one of the start; on a torus its generators are stretched to whole cells.
    With one generator, that of courses, there is one circle, and positions along the courses do not matter.

    Parameters
    ----------
    generators : px, two rows or one.
    start : exemplar pixel of every target pixel.
    wrap : where the target wraps.
    given : target pixels of a texture whose phase is continued, and whose lattice may be stretched; none if all of
        the target is synthesised.
    period : height and width of the parts of a target that wraps, each with whole cells; None for all of it.
    """

    def __init__(
        self,
        generators: Vectors,
        start: Correspondence,
        wrap: Wraps,
        given: Mask | None = None,
        period: tuple[int, int] | None = None,
    ):
        self.exemplar = steps_along(generators.astype(np.float64))  # pixel (row, column) @ this = cells
        self.target = self.exemplar
        around = np.array(wrap)[:, None]
        if wrap:
            sides = np.array(period or start.shape[:2], np.float64)
            cells = _whole_cells(self.exemplar * sides[:, None], sides, around)
            if rank(cells) == len(generators):
                self.target = cells / sides[:, None]
        if given is not None and not wrap.both:
            drift = np.stack([self._drift(line, row) for row, line in enumerate(start)]).astype(np.complex64)
            stretch = _stretch(np.where(given[..., None], drift, np.complex64(0)))
            self.target = self.target + np.where(around, 0, stretch)
        total = np.zeros(len(generators), np.complex128)
        for row, line in enumerate(start):  # one by one, as intermediate values take many times the memory
            drift = self._drift(line, row)
            total += drift.sum(axis=0) if given is None else drift[given[row]].sum(axis=0)
        self.origin = phase_of(total / (start.shape[0] * start.shape[1])) / (2 * np.pi)

    def _drift(self, sources: UInt32[np.ndarray, "W 2"], row: int) -> Complex128[np.ndarray, "W k"]:
        """Phases of a row's sources relative to those of its pixels."""
        columns = np.arange(len(sources))
        own = np.stack([np.full_like(columns, row), columns], axis=1)
        return np.asarray(
            phasor(2 * np.pi * (matrix_product(sources, self.exemplar) - matrix_product(own, self.target)))
        )

    def of_exemplar(
        self, height: int, width: int, factor: float, rows: slice = slice(None)
    ) -> Float32[np.ndarray, "h w k"]:
        """Phases of an exemplar's pixels at the scale of ``factor``, of some rows."""
        origin = np.zeros(self.exemplar.shape[1])
        return _circles(range(height)[rows], width, factor, (0, 0), self.exemplar, origin)

    def parts(self, places: tuple[int, int], factor: float) -> UInt8[np.ndarray, "p q"]:
        """Number of the part of a lattice cell, or of a course, in which each of an exemplar's patches lies.

        At the scale of ``factor``, for the patches' first pixels.
        """
        rows, columns = (np.arange(count) / factor for count in places)
        number = np.zeros(places, np.uint8)
        for band in bands(places[0]):
            for down, across in self.exemplar.T:
                cells = rows[band, None] * down + columns * across
                cells -= np.floor(cells)
                number[band] = number[band] * _PARTS + np.minimum((cells * _PARTS).astype(np.uint8), _PARTS - 1)
        return number

    def of_target(
        self, rows: range, width: int, factor: float, margin: tuple[int, int]
    ) -> Float32[np.ndarray, "H W k"]:
        """Phases of rows of a target at the scale of ``factor``; it begins ``margin`` px before the start."""
        return _circles(rows, width, factor, margin, self.target, self.origin)


def _whole_cells(
    cells: Float64[np.ndarray, "2 k"], sides: Float64[np.ndarray, "2"], around: Bool[np.ndarray, "2 1"]
) -> Float64[np.ndarray, "2 k"]:
    """Cells along both sides, px: whole numbers along those that wrap.

    The nearest ones, but where they tilt rows or columns, and others that are hardly farther by half of it or less:
    of a bond, whose rows are half a brick apart, one generator may gain half a cell and the other lose as much.
    """
    nearest = np.asarray(np.where(around, np.rint(cells), cells))
    if cells.shape[1] < 2 or rank(nearest) < 2:
        return nearest

    def strain(whole: Float64[np.ndarray, "2 2"]) -> Float64[np.ndarray, "2 2"]:
        own = (np.asarray(matrix_product(inverse_of(each), np.diag(sides))) for each in (cells, whole))
        return lattice_strain(*own)

    def tilt(whole: Float64[np.ndarray, "2 2"]) -> float:
        change = strain(whole)
        return max(abs(float(change[0, 1])), abs(float(change[1, 0])))

    known = tilt(nearest)
    if known <= _TILT:
        return nearest
    other = nearest + np.where(around, np.sign(cells - nearest), 0)
    other = np.where(np.abs(other - cells) <= _NEARLY, other, nearest)
    changes = np.array(list(itertools.product((False, True), repeat=4))).reshape(-1, 2, 2)
    others = [whole for whole in np.where(changes, other, nearest) if rank(whole) == 2 and tilt(whole) <= known / 2]
    return min([nearest, *others], key=lambda whole: visibility(strain(whole)))


def _stretch(drift: Complex64[np.ndarray, "H W k"]) -> Float64[np.ndarray, "2 k"]:
    """Change of each phase per px, down and across, that the drift of the phases shows; 0 where it shows none."""
    sides = np.array(drift.shape[:2], np.float64)
    positions = [np.arange(side) / side - 0.5 for side in drift.shape[:2]]
    change = np.zeros((2, drift.shape[2]))
    for index, plane in enumerate(np.moveaxis(drift, 2, 0)):
        best, reach = np.zeros(2), _MAX_STRETCH
        coherence = least = _MIN_GAIN * float(np.sqrt(squared_size(plane.sum(dtype=np.complex128))))
        for step in _STRETCHES:
            steps = np.arange(-round(reach / step), round(reach / step) + 1) * step
            down, across = (
                phasor(-2 * np.pi * np.outer(steps + middle, position))
                for middle, position in zip(best, positions, strict=True)
            )
            found = np.sqrt(squared_size(matrix_product(matrix_product(down, plane), across.T)))
            row, column = np.unravel_index(int(found.argmax()), found.shape)
            if found[row, column] > coherence:
                coherence = float(found[row, column])
                best = best + steps[[row, column]]
            reach = step
        if coherence > least:
            change[:, index] = best / sides
    return change


def min_spacing(generators: Vectors) -> float:
    """The shorter distance between neighbouring lattice lines, or that between courses, px."""
    longest = float(np.hypot(*generators.T).max())
    return longest if len(generators) == 1 else float(abs(determinant(generators)) / np.hypot(*generators.T).max())


def _circles(
    lines: range, width: int, factor: float, margin: tuple[int, int], cells: np.ndarray, origin: np.ndarray
) -> Float32[np.ndarray, "h w k"]:
    from texloom.stages.kernels.lattice.phase_circles import fill_circles

    rows, columns = (
        (np.asarray(side) + 0.5) / factor - 0.5 - before
        for side, before in zip((lines, range(width)), margin, strict=True)
    )
    points = np.empty((rows.size, columns.size, 2 * origin.size), np.float32)
    fill_circles(rows, columns, np.ascontiguousarray(cells), origin, points)
    return points
