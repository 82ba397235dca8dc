"""Tracking of a lattice of two generators: where the vertices of an exemplar's cells are."""

import dataclasses

import numpy as np
from jaxtyping import Float64

from texloom.stages.analysis.regularity.lattice import gradient_magnitude, valid_lightness
from texloom.stages.analysis.regularity.vertices import Vertices
from texloom.stages.common.regularity import lattice_cells
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.masks import valid_pixels

MIN_VERTICES = 4
"""of a lattice that is detected"""

_MAX_GENERATOR = 48.0  # px; the exemplar is reduced so that no generator is longer while vertices are tracked
_SEEDS = 3  # a side: cells of the exemplar that are tried as the first template
_PASSES = 2  # with the mean of the detected cells as template
_MIN_CORRELATION = 0.25  # of a vertex with the template
_FINE = 1 / 12  # of the shorter generator: standard deviation of the blur that fine lightness leaves out
_NOISE = 0.7  # px of the blur that it keeps
_CLEARER = 1.2  # times the score of lightness that another plane needs
_LINES = ((1, 0), (0, 1), (1, 1), (1, -1))  # steps to neighbours that vertices are compared with
_UNEVEN = 0.1  # of the shorter generator: a second difference of places that halves a vertex's score


@dataclasses.dataclass(frozen=True)
class _TrackedPlane:
    """Vertices that were tracked in one plane, px of it."""

    peaks: lattice_cells.Peaks
    tracked: lattice_cells.Tracked

    @property
    def places(self) -> Float64[np.ndarray, "n 2"]:
        return self.tracked.places[self.tracked.detected]

    @property
    def correlations(self) -> Float64[np.ndarray, "n"]:  # type: ignore[name-defined]
        """Of each vertex with the template, 0..1."""
        likeness = self.peaks.likeness[tuple(np.rint(self.places).astype(int).T)]
        return np.clip(likeness.astype(np.float64), 0, 1)

    def score(self, generators: Float64[np.ndarray, "2 2"]) -> float:
        """Sum of the correlations, times the share of vertices that lie midway between two others.

        A vertex that jumps from one edge of a joint to the other correlates as much, but is out of line.
        """
        at = dict(zip(map(tuple, self.tracked.steps[self.tracked.detected].tolist()), self.places, strict=True))
        away = np.array(
            [
                at[i - di, j - dj] + at[i + di, j + dj] - 2 * place
                for (i, j), place in at.items()
                for di, dj in _LINES
                if (i - di, j - dj) in at and (i + di, j + dj) in at
            ]
        ).reshape(-1, 2)
        unit = _UNEVEN * float(np.hypot(*generators.T).min())
        even = 1 / (1 + (away**2).sum(axis=1) / unit**2)
        return float(self.correlations.sum() * (even.sum() + 0.5) / (len(even) + 1))

    @property
    def is_lattice(self) -> bool:
        """Whether there are enough vertices, not on one line."""
        return len(self.places) >= MIN_VERTICES and self.tracked.fitted() is not None


def track_lattice(
    image: Image, generators: Float64[np.ndarray, "2 2"], reach: float
) -> tuple[Vertices, Float64[np.ndarray, "n"]]:  # type: ignore[name-defined]
    """The vertices detected in an exemplar, and the correlation of each with the mean cell, 0..1.

    Vertices are where the exemplar correlates with a template of the lattice's cell. The first template is the cell
    of the exemplar that detects most others; later ones are the mean of the detected cells.

    Of tiles of many tones only the joints are alike, which are faint in lightness beside the tones. So lightness
    without its coarse parts, or its gradient magnitude, is compared instead where vertices correlate clearly more
    by it and lie as evenly.

    Parameters
    ----------
    generators : of the lattice, px.
    reach : see `DeformedLatticeParams`.

    Raises
    ------
    InputError
        fewer than four vertices are detected, or all on one line; the exemplar is smaller than a cell.
    """
    lightness = valid_lightness(image)
    lengths = np.hypot(*generators.T)
    factor = min(1.0, _MAX_GENERATOR / float(lengths.max()))
    coarse = gaussian_blur(lightness, _FINE * float(lengths.min()))
    planes = (
        lightness,
        gaussian_blur(lightness, _NOISE) - coarse,
        gradient_magnitude(lightness, valid_pixels(image)),
    )
    reduced = [_reduced(plane, factor) for plane in planes]
    scale = np.array(lightness.shape) / reduced[0].shape
    short = generators / scale
    found = _tracked(reduced[0], short, reach)
    others = [_tracked(plane, short, reach, found) for plane in reduced[1:]]
    best = max(others, key=lambda other: other.score(short))
    if best.score(short) >= _CLEARER * found.score(short):
        found = best
    if not found.is_lattice:
        raise InputError(
            "image: the lattice's cells are not detected in the exemplar; give its vertices in a file, or use "
            "self_tuning, or wang_tiles for a plane without end"
        )
    # Pixel centres are at integers, so that a reduced pixel lies over the middle of those it averages.
    places = (found.places + 0.5) * scale - 0.5
    return Vertices(found.tracked.steps[found.tracked.detected], places, None), found.correlations


def _tracked(
    plane: ScalarMap, generators: Float64[np.ndarray, "2 2"], reach: float, known: _TrackedPlane | None = None
) -> _TrackedPlane:
    """The vertices by one plane; the first template is the mean of the cells at those by another, if known."""
    offsets = lattice_cells.cell_offsets(generators)
    radius = max(2.0, reach * float(np.hypot(*generators.T).min()))

    def track_by(template: np.ndarray) -> _TrackedPlane:
        likeness = lattice_cells.correlation(plane, offsets, lattice_cells.normalised(template[None])[0])
        peaks = lattice_cells.peaks(likeness, _MIN_CORRELATION, radius)
        return _TrackedPlane(peaks, lattice_cells.track(generators, peaks))

    if known is not None and known.is_lattice:
        best = known
    else:
        seeds = _seed_positions(plane.shape, offsets)
        found = (track_by(lattice_cells.cut(plane, seed[None], offsets)[0]) for seed in seeds)
        best = max(found, key=lambda one: float(one.correlations.sum()))
    for _ in range(_PASSES):
        if len(best.places) < MIN_VERTICES:
            break
        cells = lattice_cells.cut(plane, best.places, offsets)
        best = track_by(lattice_cells.normalised(cells).mean(axis=0))
    return best


def _reduced(plane: ScalarMap, factor: float) -> np.ndarray:
    import cv2

    if factor == 1:
        return np.asarray(plane)
    sides = (round(plane.shape[1] * factor), round(plane.shape[0] * factor))
    return np.asarray(cv2.resize(plane, sides, interpolation=cv2.INTER_AREA))


def _seed_positions(shape: tuple[int, ...], offsets: np.ndarray) -> np.ndarray:
    """Evenly spaced positions, (n, 2), whose cells lie inside the exemplar."""
    low, high = -offsets.min(axis=0), np.array(shape) - 1 - offsets.max(axis=0)
    if (high < low).any():
        raise InputError("image: the exemplar does not contain one whole cell of its lattice")
    axes = (np.linspace(first, last, 2 * _SEEDS + 1)[1::2] for first, last in zip(low, high, strict=True))
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
