"""How regular a result is: whether the exemplar's lattice is found in it again, as straight and as even."""

import dataclasses
from functools import partial
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float32, Float64, Int64
from pydantic import Field

from texloom.stages.arrays import Channels, Image, Vectors
from texloom.stages.common import lattice_cells
from texloom.stages.common.lattice_cells import Peaks, Tracked, reduced
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.evaluation._measures import pictures as _pictures
from texloom.stages.evaluation._measures import spectrum
from texloom.stages.evaluation._measures.pictures import Picture, UnmeasurableError
from texloom.stages.evaluation._measures.table import Figures, lines, table

_PHASES = 3  # along each generator: where in the exemplar a cell begins
_LEAST_CELLS = 3
_LEAST_LIKENESS = 0.1  # correlation that two cells must have
_STRAIGHT = 0.02  # unevenness, by the length of a cell, that is due to pixels
_FOUND = 0.5  # share of the points without which their geometry means nothing
_RINGS = 2  # lattice steps whose autocorrelation counts
_SAME = 0.05  # difference of cells, as a share of the picture's variation, that is noise
_UNCLEAR = "the exemplar's own cells are as irregular as a bad result's"


class RegularityParams(Params):
    """What counts as a lattice point."""

    quantile: float = Field(0.1, gt=0, lt=0.5)
    """share of the exemplar's cells, and of its places that are none, that may lie on the wrong side"""
    detail: int = Field(24, ge=8, le=256)
    """length of the shorter generator, about, to which larger cells are reduced, px"""


@dataclasses.dataclass(frozen=True)
class Regularity:
    """The figures, and the lattice of the result."""

    table: dict[str, Any]
    """as that of `metrics`: ``summary`` and ``measures``, axis ``regularity``. Ready for JSON"""
    points: Annotated[Float32[np.ndarray, "found 2"], Channels(("row", "column"))]
    """where lattice points are found in the result, px"""
    generators: Vectors
    """the result's lattice, px, the shorter first; no rows where the exemplar's is not found again"""


@dataclasses.dataclass(frozen=True)
class _Cell:
    """What a cell of the exemplar looks like, at the scale of the measures."""

    generators: Float64[np.ndarray, "2 2"]
    offsets: Int64[np.ndarray, "m 2"]
    mean: Float64[np.ndarray, "m"]
    """of the cells of the exemplar; mean 0, length 1"""
    level: float
    """correlation with it from which a place counts as a cell"""

    def peaks(self, picture: Picture) -> Peaks:
        """Where a picture has such cells."""
        reach = max(2.0, lattice_cells.REACH * float(np.hypot(*self.generators.T).min()))
        return lattice_cells.peaks(
            lattice_cells.correlation(picture.tone, self.offsets, self.mean), self.level, reach
        )


def _without(cells: Float64[np.ndarray, "n m"]) -> np.ndarray:
    """Correlation of each cell with the mean of the others, (n,)."""
    others = lattice_cells.normalised(cells.sum(axis=0) - cells)
    return np.asarray((cells * others).sum(axis=1))


def _cell(exemplar: Picture, generators: np.ndarray, params: RegularityParams) -> _Cell:
    """The mean cell of the exemplar, cut where its cells are most alike, each moved to where it fits best."""
    offsets = lattice_cells.cell_offsets(generators)
    shares = np.stack(np.meshgrid(*[np.arange(_PHASES) / _PHASES] * 2, indexing="ij"), axis=2).reshape(-1, 2)
    shape = (exemplar.tone.shape[0], exemplar.tone.shape[1])
    grids = [lattice_cells.regular_points(shape, generators, share @ generators, offsets) for share in shares]
    most = max(len(places) for places in grids)
    if most < _LEAST_CELLS:
        raise UnmeasurableError(f"the exemplar shows {most} whole cells of its lattice, needs {_LEAST_CELLS}")
    best: tuple[float, _Cell] | None = None
    for grid in grids:
        if len(grid) < max(_LEAST_CELLS, 0.7 * most):
            continue
        places = grid
        for _ in range(2):
            cells = lattice_cells.normalised(lattice_cells.cut(exemplar.tone, places, offsets))
            cell = _Cell(
                generators, offsets, lattice_cells.normalised(cells.mean(axis=0)[None])[0], _LEAST_LIKENESS
            )
            peaks = cell.peaks(exemplar)
            tracked = lattice_cells.track(generators, peaks)
            places = tracked.places[tracked.found]
            if len(places) < _LEAST_CELLS:
                break
        else:
            alike = _without(lattice_cells.normalised(lattice_cells.cut(exemplar.tone, places, offsets)))
            if best is None or alike.mean() > best[0]:
                own = float(np.quantile(alike, params.quantile))
                others = np.append(peaks.elsewhere(places), _LEAST_LIKENESS)
                other = min(own, float(np.quantile(others, 1 - params.quantile)))
                best = (float(alike.mean()), dataclasses.replace(cell, level=(own + other) / 2))
    if best is None:
        raise UnmeasurableError("the exemplar's cells are not alike")
    return best[1]


@dataclasses.dataclass(frozen=True)
class _Task:
    """All that measures may look at."""

    exemplar: Picture
    result: Picture
    cell: _Cell
    chance: float
    """share of places at which a point would be found anyway"""
    theirs: Tracked
    """the lattice in the exemplar"""
    ours: Tracked
    """the lattice in the result"""

    @property
    def unit(self) -> float:
        """Length of the shorter generator, px."""
        return float(np.hypot(*self.cell.generators.T).min())


def _recall(task: _Task) -> Figures:
    value, floor = task.ours.recall, task.theirs.recall
    more = {"expected": len(task.ours.found), "level": task.cell.level}
    room = floor - task.chance
    score = float(np.clip((value - task.chance) / room, 0, 1)) if room > 0.1 else None
    return Figures(value, floor, task.chance, more, score, _UNCLEAR)


def _unevenness(tracked: Tracked, unit: float) -> float:
    """Root mean square deviation of the steps between neighbours from their mean, by the shorter generator."""
    edges = [steps - steps.mean(axis=0) for steps in tracked.edges() if len(steps)]
    if tracked.recall < _FOUND or not edges:
        return lattice_cells.REACH
    return float(np.sqrt((np.concatenate(edges) ** 2).sum(axis=1).mean()) / unit)


def _bend(tracked: Tracked, unit: float) -> float | None:
    """Root mean square distance of the found points from a straight lattice, by the shorter generator."""
    fitted = tracked.fitted()
    if fitted is None:
        return None
    straight = np.column_stack([tracked.steps, np.ones(len(tracked.steps))]) @ fitted
    away = (straight - tracked.places)[tracked.found]
    return float(np.sqrt((away**2).sum(axis=1).mean()) / unit)


def _geometry(task: _Task) -> Figures:
    floor, value = (_unevenness(tracked, task.unit) for tracked in (task.theirs, task.ours))
    floor = max(floor, _STRAIGHT)
    more = {
        "ratio": value / floor,
        "bend": _bend(task.ours, task.unit),
        "exemplar's bend": _bend(task.theirs, task.unit),
    }
    # two points that lie anywhere within reach are as far from their mean step
    return Figures(value, floor, lattice_cells.REACH, more, unclear=_UNCLEAR)


def _difference(picture: Picture, tracked: Tracked, offsets: np.ndarray) -> float:
    """Standard deviation between the same pixels of all cells by that of the picture, CIELAB."""
    cells = lattice_cells.cut(picture.lab, tracked.places, offsets)
    spread = cells.var(axis=0, dtype=np.float64, ddof=1).sum(axis=1).mean()
    return float(np.sqrt(spread / max(float(_pictures.channel_variances(picture.lab).sum()), 1e-12)))


def _appearance(task: _Task) -> Figures:
    offsets = task.cell.offsets
    floor = _difference(task.exemplar, task.theirs, offsets)
    value = _difference(task.result, task.ours, offsets)
    score = None
    if value < floor:  # cells may be more alike than the exemplar's by its noise, but one cell is no texture
        score = float(np.clip((value + _SAME) / (0.8 * floor), 0, 1))
    return Figures(value, floor, 1.0, {"ratio": value / max(floor, 1e-3)}, score, _UNCLEAR)


def _at_steps(tone: Float32[np.ndarray, "h w"], generators: np.ndarray) -> float:
    """Mean autocorrelation at the nearest lattice steps, best within 2 px, above its mean at all offsets."""
    import cv2

    around = range(-_RINGS, _RINGS + 1)
    steps = np.array([(i, j) for i in around for j in around if (i, j) > (0, 0)]) @ generators
    reach = (tone.shape[0] // 2, tone.shape[1] // 2)
    steps = np.rint(steps[(np.abs(steps) <= np.array(reach)).all(axis=1)]).astype(int)
    if not len(steps):
        raise UnmeasurableError("no lattice step fits in half the picture")
    correlation = spectrum.autocorrelation(tone, reach)
    near = cv2.dilate(correlation, np.ones((5, 5), np.uint8))
    return float(near[steps[:, 0] + reach[0], steps[:, 1] + reach[1]].mean() - correlation.mean())


def _period(task: _Task) -> Figures:
    generators = task.cell.generators
    floor, value = (_at_steps(picture.tone, generators) for picture in (task.exemplar, task.result))
    more: dict[str, Any] = {}
    fitted = task.ours.fitted()
    if fitted is not None:
        more["off"] = float(np.hypot(*(fitted[:2] - generators).T).max() / task.unit)
    score = float(np.clip(value / floor, 0, 1)) if floor > 0.05 else None
    return Figures(value, floor, 0.0, more, score, _UNCLEAR)


_MEASURES = {"recall": _recall, "geometry": _geometry, "appearance": _appearance, "period": _period}

_TITLES = {
    "recall": ("regularity", "Share of the lattice's points at which the result has a cell like the exemplar's."),
    "geometry": ("regularity", "How unevenly the points that are found are spaced, by the length of a cell."),
    "appearance": ("regularity", "How different the cells are from each other, by the picture's variation."),
    "period": ("regularity", "How like itself the result is one or two cells further on."),
}


def _reduced_in_size(picture: Picture, step: int) -> Picture:
    """Each square of ``step`` px averaged; what does not fill a square is dropped."""
    import cv2

    if step == 1:
        return picture
    height, width = (side // step for side in picture.tone.shape)
    inside = np.s_[: height * step, : width * step]
    lab, tone = (
        cv2.resize(plane[inside], (width, height), interpolation=cv2.INTER_AREA)
        for plane in (picture.lab, picture.tone)
    )
    return Picture(lab, tone)


def _task(exemplar: Picture, result: Picture, generators: np.ndarray, params: RegularityParams) -> _Task:
    _pictures.require_variation(exemplar)
    _pictures.require_variation(result, "the result")
    cell = _cell(exemplar, generators, params)
    theirs = cell.peaks(exemplar)
    ours = lattice_cells.track(generators, cell.peaks(result))
    if len(ours.found) < _LEAST_CELLS:
        raise UnmeasurableError(f"the result has room for {len(ours.found)} whole cells, needs {_LEAST_CELLS}")
    return _Task(exemplar, result, cell, theirs.chance(), lattice_cells.track(generators, theirs), ours)


@stage(version=1)
def regularity(
    exemplar: Image, image: Image, params: RegularityParams, generators: Vectors | None = None
) -> Regularity:
    """Look for the exemplar's lattice in a result, and tell how whole, straight and even it is there.

    The mean cell of the exemplar is looked for by normalised correlation, point by point along the generators. Four
    lines, in the form of `metrics`: ``recall``, the share of the expected points that are found, between what the
    exemplar scores and what chance finds; ``geometry``, how much the steps between neighbours differ;
    ``appearance``, how much the cells differ, by the variation of the picture, which may be neither much more than
    in the exemplar nor, as when one cell is repeated, much less; ``period``, the autocorrelation at lattice steps.
    Where the exemplar has no lattice all are null.

    Parameters
    ----------
    exemplar, image : the texture and the result; only their colour counts.
    generators : the exemplar's lattice, (2, 2) px; none or no rows where it has none.

    Raises
    ------
    InputError : ``generators`` are neither two independent displacements nor none.

    References
    ----------
    [Lin2004]_ section 3 judges by eye whether the regularity is preserved; the measures are ours.
    """
    none = np.zeros((0, 2), np.float32)
    if generators is None or not len(generators):
        reason = "the exemplar has no lattice"
        return Regularity(table(_TITLES, lines(partial(_refuse, reason), tuple(_TITLES))), none, none)
    if generators.shape != (2, 2) or abs(np.linalg.det(generators.astype(np.float64))) < 1:
        raise InputError(f"generators must be two independent displacements, got {generators.tolist()}")
    pair = reduced(generators)
    step = max(1, round(float(np.hypot(*pair.T).min()) / params.detail))
    pictures = _pictures.pictures(exemplar, image)
    try:
        _pictures.require_side(3 * step, *pictures)
        theirs, ours = (_reduced_in_size(picture, step) for picture in pictures)
        task = _task(theirs, ours, pair / step, params)
    except UnmeasurableError as error:
        return Regularity(table(_TITLES, lines(partial(_refuse, str(error)), tuple(_TITLES))), none, none)
    found: dict[str, dict[str, Any]] = {}
    for name, measure in _MEASURES.items():
        found |= lines(partial(measure, task), (name,))
    places = task.ours.places[task.ours.found] * step + (step - 1) / 2
    fitted = task.ours.fitted()
    again = fitted is not None and (found["recall"]["score"] or 0.0) >= 0.5
    return Regularity(
        table(_TITLES, found),
        places.astype(np.float32),
        reduced(fitted[:2] * step).astype(np.float32) if fitted is not None and again else none,
    )


def _refuse(reason: str) -> Figures:
    raise UnmeasurableError(reason)
