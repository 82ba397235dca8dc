"""Regularity of a result: whether it has the exemplar's lattice, as straight and as even."""

import dataclasses
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float32, Float64, Int64
from pydantic import Field

from texloom.stages.common.regularity import lattice_cells
from texloom.stages.common.regularity.excess_repetition import autocorrelation
from texloom.stages.common.regularity.lattice_cells import Peaks, Tracked, reduced, track
from texloom.stages.evaluation._measures.pictures import (
    MeasuredPicture,
    UnmeasurableError,
    channel_variances,
    prepare,
    require_side,
    require_variation,
)
from texloom.stages.evaluation._measures.table import Figures, lines, table, unmeasured
from texloom.stages.vocabulary.arrays import Channels, Image, Vectors
from texloom.stages.vocabulary.declare import InputError, Params, stage

_PHASES = 3  # origins of the cells tried along each generator
_MIN_CELLS = 3
_MIN_CORRELATION = 0.1  # of two cells
_PIXEL_UNEVENNESS = 0.02  # relative to a cell's length; due to the pixel grid
_MIN_RECALL = 0.5  # for geometry and generators to be meaningful
_RINGS = 2  # lattice steps at which the autocorrelation is taken
_NOISE = 0.05  # difference of cells relative to the picture's variation
_UNCLEAR = "the exemplar's cells are as irregular as a bad result's"


class RegularityParams(Params):
    """What counts as a lattice point."""

    quantile: float = Field(0.1, gt=0, lt=0.5)
    """share of the exemplar's cells, and of its other places, that may be misclassified"""
    detail: int = Field(24, ge=8, le=256)
    """approximate length of the shorter generator to which larger cells are reduced, px"""


@dataclasses.dataclass(frozen=True)
class Regularity:
    """Scores and the lattice of the result."""

    table: dict[str, Any]
    """as that of `metrics`: ``summary`` and ``measures``, axis ``regularity``. Ready for JSON"""
    points: Annotated[Float32[np.ndarray, "points 2"], Channels(("row", "column"))]
    """lattice points of the result, px"""
    generators: Vectors
    """the result's lattice, px, the shorter first; no rows where it has not that of the exemplar"""


@dataclasses.dataclass(frozen=True)
class _MeanCell:
    """The exemplar's mean cell, at the scale of the measures."""

    generators: Float64[np.ndarray, "2 2"]
    offsets: Int64[np.ndarray, "m 2"]
    mean: Float64[np.ndarray, "m"]
    """of the exemplar's cells, normalised to mean 0 and length 1"""
    level: float
    """minimum correlation with it for a place to be a cell"""

    def peaks(self, picture: MeasuredPicture) -> Peaks:
        """The places of such cells in a picture."""
        reach = max(2.0, lattice_cells.REACH * float(np.hypot(*self.generators.T).min()))
        return lattice_cells.peaks(
            lattice_cells.correlation(picture.tone, self.offsets, self.mean), self.level, reach
        )


@dataclasses.dataclass(frozen=True)
class _RegularityTask:
    """What measures read."""

    exemplar: MeasuredPicture
    result: MeasuredPicture
    scale: int
    """factor by which both were reduced"""
    cell: _MeanCell
    chance: float
    """share of places at which a point is detected by chance"""
    exemplar_lattice: Tracked
    result_lattice: Tracked

    @property
    def unit(self) -> float:
        """Length of the shorter generator, px."""
        return float(np.hypot(*self.cell.generators.T).min())


def _recall(task: _RegularityTask) -> Figures:
    value, floor = task.result_lattice.recall, task.exemplar_lattice.recall
    more = {"expected": len(task.result_lattice.detected), "level": task.cell.level}
    room = floor - task.chance
    score = float(np.clip((value - task.chance) / room, 0, 1)) if room > 0.1 else None
    return Figures(value, floor, task.chance, more, score, _UNCLEAR)


def _unevenness(tracked: Tracked, unit: float) -> float:
    """RMS deviation of the steps between neighbours from their mean, relative to the shorter generator."""
    edges = [steps - steps.mean(axis=0) for steps in tracked.edges() if len(steps)]
    if tracked.recall < _MIN_RECALL or not edges:
        return lattice_cells.REACH
    return float(np.sqrt((np.concatenate(edges) ** 2).sum(axis=1).mean()) / unit)


def _bend(tracked: Tracked, unit: float) -> float | None:
    """RMS distance of the points from a straight lattice, relative to the shorter generator."""
    fitted = tracked.fitted()
    if fitted is None:
        return None
    straight = np.column_stack([tracked.steps, np.ones(len(tracked.steps))]) @ fitted
    deviation = (straight - tracked.places)[tracked.detected]
    return float(np.sqrt((deviation**2).sum(axis=1).mean()) / unit)


def _geometry(task: _RegularityTask) -> Figures:
    floor, value = (_unevenness(tracked, task.unit) for tracked in (task.exemplar_lattice, task.result_lattice))
    floor = max(floor, _PIXEL_UNEVENNESS)
    more = {
        "ratio": value / floor,
        "bend": _bend(task.result_lattice, task.unit),
        "exemplar's bend": _bend(task.exemplar_lattice, task.unit),
    }
    # the ceiling is the deviation of points anywhere within reach
    return Figures(value, floor, lattice_cells.REACH, more, unclear=_UNCLEAR)


def _difference(picture: MeasuredPicture, tracked: Tracked, offsets: np.ndarray) -> float:
    """Standard deviation of corresponding pixels of all cells, relative to that of the picture, CIELAB."""
    cells = lattice_cells.cut(picture.lab, tracked.places, offsets)
    spread = cells.var(axis=0, dtype=np.float64, ddof=1).sum(axis=1).mean()
    return float(np.sqrt(spread / max(float(channel_variances(picture.lab).sum()), 1e-12)))


def _appearance(task: _RegularityTask) -> Figures:
    offsets = task.cell.offsets
    floor = _difference(task.exemplar, task.exemplar_lattice, offsets)
    value = _difference(task.result, task.result_lattice, offsets)
    score = None
    if value < floor:  # cells that are more alike, beyond noise, are copies of one
        score = float(np.clip((value + _NOISE) / (0.8 * floor), 0, 1))
    return Figures(value, floor, 1.0, {"ratio": value / max(floor, 1e-3)}, score, _UNCLEAR)


def _at_steps(tone: Float32[np.ndarray, "h w"], generators: np.ndarray) -> float:
    """Mean autocorrelation at the nearest lattice steps, maximum within 2 px, minus its mean at all offsets."""
    import cv2

    around = range(-_RINGS, _RINGS + 1)
    steps = np.array([(i, j) for i in around for j in around if (i, j) > (0, 0)]) @ generators
    reach = (tone.shape[0] // 2, tone.shape[1] // 2)
    steps = np.rint(steps[(np.abs(steps) <= np.array(reach)).all(axis=1)]).astype(int)
    if not len(steps):
        raise UnmeasurableError("no lattice step fits in half the picture")
    correlation = autocorrelation(tone, reach)
    near = cv2.dilate(correlation, np.ones((5, 5), np.uint8))
    return float(near[steps[:, 0] + reach[0], steps[:, 1] + reach[1]].mean() - correlation.mean())


def _period(task: _RegularityTask) -> Figures:
    generators = task.cell.generators
    floor, value = (_at_steps(picture.tone, generators) for picture in (task.exemplar, task.result))
    more: dict[str, Any] = {}
    fitted = task.result_lattice.fitted()
    if fitted is not None:
        more["off"] = float(np.hypot(*(fitted[:2] - generators).T).max() / task.unit)
    score = float(np.clip(value / floor, 0, 1)) if floor > 0.05 else None
    return Figures(value, floor, 0.0, more, score, _UNCLEAR)


_MEASURES = {"recall": _recall, "geometry": _geometry, "appearance": _appearance, "period": _period}

_TITLES = {
    "recall": ("regularity", "Share of lattice points at which the result has a cell like the exemplar's."),
    "geometry": ("regularity", "Unevenness of the spacing of the lattice points, relative to a cell's length."),
    "appearance": ("regularity", "Difference between cells, relative to the picture's variation."),
    "period": ("regularity", "Autocorrelation at distances of one and two cells."),
}


@stage(version=1)
def regularity(
    exemplar: Image, image: Image, params: RegularityParams, generators: Vectors | None = None
) -> Regularity:
    """Find the exemplar's lattice in a result, and measure how complete, straight and even it is there.

    The mean cell of the exemplar is tracked by normalised correlation, point by point along the generators. The
    table has four lines in the form of `metrics`: ``recall``, the share of expected points that are detected,
    between that of chance and that of the exemplar; ``geometry``, how much the steps between neighbours differ;
    ``appearance``, how much the cells differ relative to the variation of the picture, which may be neither much
    more than in the exemplar nor, as when one cell is repeated, much less; ``period``, the autocorrelation at
    lattice steps. Where the exemplar has no lattice, all are null.

    Parameters
    ----------
    exemplar, image : the texture and the result; only their colour counts.
    generators : the exemplar's lattice, (2, 2) px; None or no rows where it has none.

    Raises
    ------
    InputError : ``generators`` are not two independent displacements.

    References
    ----------
    [Lin2004]_ section 3 judges regularity preservation by eye; the measures are ours.
    """
    none = np.zeros((0, 2), np.float32)
    try:
        task = _task(exemplar, image, generators, params)
    except UnmeasurableError as error:
        return Regularity(table(_TITLES, dict.fromkeys(_TITLES, unmeasured(str(error)))), none, none)
    measured: dict[str, dict[str, Any]] = {}
    for name, measure in _MEASURES.items():
        measured |= lines(measure, task, (name,))
    lattice = task.result_lattice
    points = lattice.places[lattice.detected] * task.scale + (task.scale - 1) / 2
    fitted = lattice.fitted()
    is_regular = fitted is not None and (measured["recall"]["score"] or 0.0) >= _MIN_RECALL
    return Regularity(
        table(_TITLES, measured),
        points.astype(np.float32),
        reduced(fitted[:2] * task.scale).astype(np.float32) if fitted is not None and is_regular else none,
    )


def _task(exemplar: Image, image: Image, generators: Vectors | None, params: RegularityParams) -> _RegularityTask:
    if generators is None or not len(generators):
        raise UnmeasurableError("the exemplar has no lattice")
    if len(generators) == 1:
        raise UnmeasurableError("the exemplar has courses only, which repeat in one direction")
    if generators.shape != (2, 2) or abs(np.linalg.det(generators.astype(np.float64))) < 1:
        raise InputError(f"generators must be two independent displacements, got {generators.tolist()}")
    pair = reduced(generators)
    scale = max(1, round(float(np.hypot(*pair.T).min()) / params.detail))
    pictures = prepare(exemplar, image)
    require_side(3 * scale, *pictures)
    source, result = (_reduced_in_size(picture, scale) for picture in pictures)
    require_variation(source)
    require_variation(result, "the result")
    pair = pair / scale
    cell = _cell(source, pair, params)
    peaks = cell.peaks(source)
    result_lattice = track(pair, cell.peaks(result))
    if len(result_lattice.detected) < _MIN_CELLS:
        raise UnmeasurableError(
            f"the result has room for {len(result_lattice.detected)} whole cells, needs {_MIN_CELLS}"
        )
    return _RegularityTask(source, result, scale, cell, peaks.chance(), track(pair, peaks), result_lattice)


def _cell(exemplar: MeasuredPicture, generators: np.ndarray, params: RegularityParams) -> _MeanCell:
    """The exemplar's mean cell: of the origin at which cells are most alike, each moved to its best fit."""
    offsets = lattice_cells.cell_offsets(generators)
    shares = np.stack(np.meshgrid(*[np.arange(_PHASES) / _PHASES] * 2, indexing="ij"), axis=2).reshape(-1, 2)
    shape = (exemplar.tone.shape[0], exemplar.tone.shape[1])
    grids = [lattice_cells.regular_points(shape, generators, share @ generators, offsets) for share in shares]
    most = max(len(places) for places in grids)
    if most < _MIN_CELLS:
        raise UnmeasurableError(f"the exemplar shows {most} whole cells of its lattice, needs {_MIN_CELLS}")
    fits = [
        _fit(exemplar, generators, offsets, places, params)
        for places in grids
        if len(places) >= max(_MIN_CELLS, 0.7 * most)
    ]
    known = [fit for fit in fits if fit is not None]
    if not known:
        raise UnmeasurableError("the exemplar's cells are not alike")
    return max(known, key=lambda fit: fit[0])[1]


def _fit(
    exemplar: MeasuredPicture,
    generators: np.ndarray,
    offsets: np.ndarray,
    places: np.ndarray,
    params: RegularityParams,
) -> tuple[float, _MeanCell] | None:
    """The mean cell at ``places``, twice moved to the best fit, and how alike its cells are; None if few fit."""
    for _ in range(2):
        cells = lattice_cells.normalised(lattice_cells.cut(exemplar.tone, places, offsets))
        mean = lattice_cells.normalised(cells.mean(axis=0)[None])[0]
        cell = _MeanCell(generators, offsets, mean, _MIN_CORRELATION)
        peaks = cell.peaks(exemplar)
        tracked = track(generators, peaks)
        places = tracked.places[tracked.detected]
        if len(places) < _MIN_CELLS:
            return None
    alike = _leave_one_out(lattice_cells.normalised(lattice_cells.cut(exemplar.tone, places, offsets)))
    own = float(np.quantile(alike, params.quantile))
    others = np.append(peaks.elsewhere(places), _MIN_CORRELATION)
    other = min(own, float(np.quantile(others, 1 - params.quantile)))
    return float(alike.mean()), dataclasses.replace(cell, level=(own + other) / 2)


def _leave_one_out(cells: Float64[np.ndarray, "n m"]) -> np.ndarray:
    """Correlation of each cell with the mean of the others, (n,)."""
    others = lattice_cells.normalised(cells.sum(axis=0) - cells)
    return np.asarray((cells * others).sum(axis=1))


def _reduced_in_size(picture: MeasuredPicture, step: int) -> MeasuredPicture:
    """Squares of ``step`` px averaged; what does not fill a square is dropped."""
    import cv2

    if step == 1:
        return picture
    height, width = (side // step for side in picture.tone.shape)
    inside = np.s_[: height * step, : width * step]
    lab, tone = (
        cv2.resize(plane[inside], (width, height), interpolation=cv2.INTER_AREA)
        for plane in (picture.lab, picture.tone)
    )
    return MeasuredPicture(lab, tone)
