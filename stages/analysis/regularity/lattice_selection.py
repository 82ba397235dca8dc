"""The most confident lattice of an exemplar, of two dimensions or of one."""

import dataclasses
import logging
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.analysis.regularity.autocorrelation import AutocorrelationParams, dominant_peaks
from texloom.stages.analysis.regularity.course_phase import larger_bond, lattice_in_phase
from texloom.stages.analysis.regularity.courses import CoursesParams, detected_courses
from texloom.stages.analysis.regularity.fanning_lines import fan_of_lines
from texloom.stages.analysis.regularity.full_resolution import refined_in_full
from texloom.stages.analysis.regularity.lattice import (
    Lattice,
    LatticeParams,
    detail,
    gradient_magnitude,
    lattice_of,
    mean_around,
    self_correlation,
    significance,
    valid_lightness,
)
from texloom.stages.analysis.regularity.lines import line_period, refined_period
from texloom.stages.analysis.regularity.offset_statistics import offset_density
from texloom.stages.analysis.regularity.pattern_search import autocorrelation_splines, refined_generators
from texloom.stages.analysis.regularity.shown import elements, mirror_symmetry, periods, periods_of_directions
from texloom.stages.analysis.regularity.superlattice import superlattice
from texloom.stages.common.grids.working_size import image_of_means, working_image
from texloom.stages.common.regularity.lattice_cells import reduced
from texloom.stages.numerics.matrices import determinant
from texloom.stages.vocabulary.arrays import Channels, Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.masks import valid_pixels
from texloom.stages.vocabulary.progress import Progress, part, report
from texloom.stages.vocabulary.scratch import bands

_LOG = logging.getLogger(__name__)

_SYMMETRIC = 0.75  # correlation with its mirror image of a picture of one ornament
_MIN_SHOWN = 2.0  # times that an exemplar has to show its structure
_MIN_CELLS = 4.0  # or elements, that it has to show
_CONFIDENCE_TOLERANCE = 0.015  # smaller differences in confidence are ignored
_MIN_SIGNIFICANCE = 2.0  # of a lattice that is accepted by its confidence
_WEAK_CONFIDENCE = 0.6  # of a lattice to which courses are preferred, if its
_WEAK_SIGNIFICANCE = 4.0  # is no higher either: blocks in courses of any phase have a lattice by their joints
_MIN_SIDE = 16  # px of an exemplar for further attempts
_FURTHER_CONFIDENCE = (
    0.5  # share of the minimum confidence that these have to reach, as they have to be significant
)
_FIRST_STEP = 0.05  # of the refinement of generators, as a share of the shorter one
_MAX_REFINEMENT = 0.1  # the same, of their change; larger ones lead to other peaks
_HALVED = 512  # px of a shorter side from which gradients are compared at half the size
_MIN_HALVED = 24.0  # px of a generator for that
_COARSE = 160  # px of the shorter side, at least, of means in which a lattice is searched that grains may hide
_BETA = 3.0  # of `lattice`: the autocorrelation has few peaks, so recall counts more


class LatticeSelectionParams(Params):
    """When a lattice is accepted."""

    confidence: float = Field(0.4, ge=-1, le=1)
    """minimum correlation of the exemplar with itself, shifted by the generators, to accept a lattice whose
    significance is at least 2"""
    significance: float = Field(5.5, ge=0, le=100)
    """minimum significance to accept a lattice of less confidence; see `lattice`"""
    min_length: float = Field(10.0, ge=2)
    """minimum length of a generator, px"""
    stripes: bool = False
    """accept by confidence alone: stripes repeat too, by every displacement along them"""
    courses: bool = True
    """where there is no such lattice, accept one of one dimension: courses; see `courses`"""
    lines: bool = False
    """where there are no courses either, accept straight lines at uneven distances along all of the exemplar's rows
    or columns, such as joints of planks or grain: one step, in which their pattern is repeated"""


@dataclasses.dataclass(frozen=True)
class LatticeSelection:
    """The selected lattice, if one was accepted."""

    generators: Vectors
    """of the selected lattice, px, two rows; one row, at right angles to the courses or lines, where only these
    repeat; no rows where nothing is accepted"""
    best: Annotated[Float32[np.ndarray, "tried 2"], Channels(("row", "column"))]
    """the same, accepted or not"""
    confidence: float
    """of ``best``, -1..1"""
    significance: float
    """of ``best``; 0 for courses"""
    chosen: str
    """`features`, `autocorrelation`, `short offsets`, `gradients`, `courses`, `phase`, `lines`, `known`, `none`"""
    shown: float = 0.0
    """how often the exemplar shows its structure: the number of periods, in the direction of fewest, fewer where
    directions change from cell to cell, as in a herringbone of which only the planks' width repeats; or without a
    lattice the number of elements, within a factor of two; 1 for a single symmetric ornament"""
    cells: float = 0.0
    """number of cells of the lattice, of courses, or as ``shown`` of elements that the exemplar shows"""
    fan: float = 0.0
    """degrees by which its lines turn from side to side, see `fan_of_lines`; 0 where they do not clearly"""


Origin = Literal["features", "autocorrelation", "short offsets", "gradients", "courses", "phase", "lines"]


@stage(version=7)
def lattice_selection(
    image: Image, density: ScalarMap, params: LatticeSelectionParams, known: Vectors | None = None
) -> LatticeSelection:
    """Detect the exemplar's lattice by matched features and by autocorrelation, and select the most confident.

    Features fail on large uniform parts and on fine weaves, autocorrelation where elements differ in colour. Of two
    lattices of about the same confidence the one with smaller cells is selected, since every second row of a
    lattice is a lattice too. Where neither is confident, the more significant one is selected.

    Where neither is accepted, two more are tried: by the autocorrelation at offsets of up to a quarter of the
    exemplar's sides, for fine lattices that drift across the exemplar; and by the autocorrelation of the gradient
    magnitude, for elements of different colours, whose lightness does not repeat while their contours do. These
    have to be significant and half as confident. Of any of these, the coarser lattice by which lightness or its
    gradient repeats clearly better is selected, if there is one: squares of a checkerboard repeat nearly, pairs of
    them exactly. Where all fail, courses may have an even spacing and a free phase along them, or lines an uneven
    one (see ``lines``). Courses are also preferred to a lattice that is barely confident and barely significant.
    Where elements of courses are equally long and line up in every second or third one, by the joints between
    them, they are a lattice; see `lattice_in_phase`. One that the joints repeat only half is made larger, as by
    English bond; see `larger_bond`.
    Where nothing repeats, a lattice is searched once more in means over squares, of exemplars of 320 px or more:
    grains, as of granite, differ from slab to slab and outweigh the joints.

    Of an exemplar of more than 1.5 million pixels, its `working_image` is searched, and generators of two
    dimensions and periods of lines are refined in the exemplar itself.

    A warning tells that the exemplar shows its structure less than twice, so that a result can only repeat or
    distort it, or fewer than four cells or elements, which would return side by side.

    Parameters
    ----------
    image : the exemplar.
    density : of the offsets between matching features, see `offset_statistics`.
    known : generators that are known, px, as from `between_joints`, which are taken if there are any rows.

    Raises
    ------
    InputError
        all pixels are excluded.

    References
    ----------
    [Kaspar2015]_ section 3.3 and [Liu2004]_ each detect a lattice; selecting between them, short offsets and
    gradients are ours.
    """
    if known is not None and len(known):
        shown = periods(known, (image.height, image.width))
        selected = LatticeSelection(known, known, 1.0, 0.0, "known", shown=shown, cells=shown)
        _warn_if_few(selected, "periods")
        return selected
    fan = fan_of_lines(image)
    if fan:
        _LOG.warning(
            "lines of the exemplar fan out by %.0f degrees from side to side, as in perspective: those of the "
            "result will waver. Straighten it first: texloom run photo_flattening, or photo_material for all maps",
            fan,
        )
    small, step = working_image(image)
    of_small = params.model_copy(update={"min_length": params.min_length / step})
    with part(0.0, 0.6):
        selected = _selected(small, density, of_small)
    if not len(selected.generators):
        with part(0.6, 0.7):
            selected = _in_means(small, of_small) or selected
    _warn_if_few(selected, "elements" if selected.chosen in ("none", "lines") else "cells of its lattice")
    selected = dataclasses.replace(selected, fan=fan)
    if step == 1:
        report(Progress(1.0))
        return selected
    generators, best = (vectors * np.float32(step) for vectors in (selected.generators, selected.best))
    if len(generators) == 2 or selected.chosen == "lines":
        generators = best = _refined_in_full(image, generators, selected.chosen, step)
    report(Progress(1.0))
    return dataclasses.replace(selected, generators=generators, best=best)


def _selected(image: Image, density: ScalarMap, params: LatticeSelectionParams) -> LatticeSelection:
    """See `lattice_selection`."""
    lightness, valid = valid_lightness(image), valid_pixels(image)
    fine = detail(lightness)
    correlation = self_correlation(fine)
    report(Progress(0.15))
    peaks = dominant_peaks(lightness, correlation, AutocorrelationParams()).density
    by_features = lattice_of(correlation, density, _lattice_params(params))
    report(Progress(0.3))
    by_correlation = lattice_of(correlation, peaks, _correlation_params(params))
    selected = most_confident({"features": by_features, "autocorrelation": by_correlation}, params)
    report(Progress(0.45))
    if params.courses and _is_weak(selected):
        gradients = gradient_magnitude(lightness, valid)
        selected = _courses(lightness, correlation, (fine, detail(gradients)), params) or selected
    shown = 0.0
    if not len(selected.generators):
        gradients = gradient_magnitude(lightness, valid)
        planes = fine, detail(gradients)
        further = _further_lattice(lightness, gradients, planes[1], correlation, params)
        selected = further or _rows(lightness, correlation, planes, params) or selected
        shown = elements(gradients)
    report(Progress(0.8))
    if len(selected.generators) == 2:
        gradients = gradient_magnitude(lightness, valid)
        plane = gradients if selected.chosen == "gradients" else lightness
        whole = _whole(selected.generators, correlation, gradients)
        bond = larger_bond(lightness, whole, params.min_length) if params.courses else None
        best = _refined(whole if bond is None else bond, plane, valid)
        selected = dataclasses.replace(selected, generators=best, best=best)
    cells = shown
    if len(selected.generators) and selected.chosen != "lines":
        cells = shown = periods(selected.generators, lightness.shape)
    elif mirror_symmetry(lightness) >= _SYMMETRIC:
        cells = shown = min(shown, 1.0)
    if len(selected.generators) == 2:
        if valid is None:
            shown = min(shown, periods_of_directions(lightness, selected.generators))
        cells = lightness.size / abs(float(determinant(selected.generators.astype(np.float64))))
    report(Progress(1.0))
    return dataclasses.replace(selected, shown=shown, cells=cells)


def _in_means(image: Image, params: LatticeSelectionParams) -> LatticeSelection | None:
    """The lattice of the image's means over squares, if one is accepted there: grains hide what is much larger."""
    side = 1
    while min(image.height, image.width) >= 2 * side * _COARSE:
        side *= 2
    if side == 1:
        return None
    coarse = image_of_means(image, side)
    of_coarse = params.model_copy(update={"min_length": params.min_length / side})
    with part(0.0, 0.4):
        density = offset_density(coarse)
    with part(0.4, 0.8):
        selected = _selected(coarse, density, of_coarse)
    if len(selected.generators) != 2:
        return None
    with part(0.8, 1.0):
        generators = _refined_in_full(image, selected.generators * np.float32(side), selected.chosen, side)
    return dataclasses.replace(selected, generators=generators, best=generators)


def _refined_in_full(image: Image, generators: Vectors, chosen: str, step: int) -> Vectors:
    """Generators found in the `working_image`, refined in the image; see `_refined`."""
    valid = valid_pixels(image)
    plane = np.concatenate([lab_from_linear(image.color[band])[..., 0] for band in bands(image.height)])
    if valid is not None:
        plane[~valid] = plane[valid].mean()
    if chosen == "gradients":
        plane = gradient_magnitude(plane, valid)
    report(Progress(0.8))
    if chosen == "lines":
        return refined_period(plane, generators, step)
    fine = refined_in_full(plane, valid, generators, step)
    change = float(np.hypot(*(fine - reduced(generators)).T).max())
    return reduced(fine).astype(np.float32) if change <= step else generators


def _refined(generators: Vectors, plane: ScalarMap, valid: Mask | None) -> Vectors:
    """The generators that hold across the whole exemplar; the same where that is not clear.

    Errors of peaks' positions add up from cell to cell, and bend the rows of a result.
    """
    coarse = reduced(generators)
    fine, _ = refined_generators(*autocorrelation_splines(plane, valid), coarse, _FIRST_STEP)
    change = float(np.hypot(*(fine - coarse).T).max())
    return reduced(fine).astype(np.float32) if change <= _MAX_REFINEMENT * np.hypot(*coarse[0]) else generators


def _warn_if_few(selected: LatticeSelection, what: str) -> None:
    shown, cells = selected.shown, selected.cells
    advice = "Use a larger part of the texture, or a picture that shows more of it"
    if 0 < shown < _MIN_SHOWN:
        _LOG.warning(
            "the exemplar shows its structure about %.1f times, fewer than two: the result will repeat or "
            "distort it. %s",
            np.floor(10 * shown) / 10,  # 1.96 is fewer than two
            advice,
        )
    elif 0 < cells < _MIN_CELLS:
        _LOG.warning(
            "the exemplar shows about %.1f %s, fewer than four: the same ones will return side by side. %s",
            np.floor(10 * cells) / 10,
            what,
            advice,
        )


def _whole(generators: Vectors, correlation: ScalarMap, gradients: ScalarMap) -> Vectors:
    """The lattice, or a coarser one by which lightness or gradients repeat clearly better; see `superlattice`.

    Parameters
    ----------
    correlation : of lightness.
    """
    import cv2

    best = superlattice(generators.astype(np.float64), correlation)
    step = 2 if min(gradients.shape) >= _HALVED and np.hypot(*best[0]) >= _MIN_HALVED else 1
    height, width = (side // step for side in gradients.shape)
    halved = gradients[: height * step, : width * step]
    if step > 1:  # `detail` leaves no more of it
        halved = cv2.resize(halved, (width, height), interpolation=cv2.INTER_AREA)
    best = superlattice(best / step, self_correlation(detail(halved))) * step
    return best.astype(np.float32)


def _is_weak(selected: LatticeSelection) -> bool:
    """Whether a lattice was accepted that may be one of courses alone."""
    weak = selected.confidence < _WEAK_CONFIDENCE and 0 <= selected.significance < _WEAK_SIGNIFICANCE
    return weak and len(selected.generators) == 2


def _rows(
    lightness: ScalarMap,
    correlation: ScalarMap,
    planes: tuple[ScalarMap, ScalarMap],
    params: LatticeSelectionParams,
) -> LatticeSelection | None:
    """The courses, or else the lines, if there are any and they are wanted."""
    rows = _courses(lightness, correlation, planes, params) if params.courses else None
    if rows is not None:
        return rows
    lines = line_period(planes) if params.lines else None
    return None if lines is None else LatticeSelection(lines[0], lines[0], lines[1], 0.0, "lines")


def _courses(
    lightness: ScalarMap,
    correlation: ScalarMap,
    planes: tuple[ScalarMap, ScalarMap],
    params: LatticeSelectionParams,
) -> LatticeSelection | None:
    """The courses, if there are any, or the lattice of those whose elements line up."""
    limits = CoursesParams().model_copy(update={"min_length": params.min_length})
    rows = detected_courses(planes, limits)
    if rows.confidence >= limits.confidence and rows.worst >= limits.worst:
        found = lattice_in_phase(lightness, rows.best[0].astype(np.float64), params.min_length)
        if found is not None:
            return _selection(found, correlation, "phase")
    if not len(rows.generators):
        return None
    return LatticeSelection(rows.generators, rows.best, rows.confidence, 0.0, "courses")


def _lattice_params(params: LatticeSelectionParams, **others: float) -> LatticeParams:
    # The length may be that of a reduced picture, below the limit of the field.
    return LatticeParams(**others).model_copy(update={"min_length": params.min_length})


def _correlation_params(params: LatticeSelectionParams) -> LatticeParams:
    return _lattice_params(params, beta=_BETA)


def _further_lattice(
    lightness: ScalarMap,
    gradients: ScalarMap,
    fine_gradients: ScalarMap,
    correlation: ScalarMap,
    params: LatticeSelectionParams,
) -> LatticeSelection | None:
    """The lattice by short offsets, else by gradients; none where neither is clear enough, see `_detected`."""
    if min(correlation.shape) < _MIN_SIDE:
        return None
    rows, columns = (side // 4 for side in correlation.shape)
    short = np.ascontiguousarray(correlation[rows:-rows, columns:-columns])
    candidate = _detected(lightness, short, correlation, params)
    if candidate is not None:
        return _selection(candidate.best, correlation, "short offsets")
    of_gradients = self_correlation(fine_gradients)
    candidate = _detected(gradients, of_gradients, of_gradients, params)
    if candidate is not None:
        return _selection(candidate.best, of_gradients, "gradients")
    return None


def _detected(
    plane: ScalarMap,
    part: Float32[np.ndarray, "rows columns"],
    correlation: ScalarMap,
    params: LatticeSelectionParams,
) -> Lattice | None:
    """The lattice by the peaks of ``part`` of a correlation, if it is significant and confident enough."""
    peaks = dominant_peaks(plane, part, AutocorrelationParams()).density
    candidate = lattice_of(correlation, peaks, _correlation_params(params))
    confident = candidate.confidence >= _FURTHER_CONFIDENCE * params.confidence
    accepted = confident and candidate.significance >= params.significance
    return candidate if accepted else None


def _selection(generators: np.ndarray, correlation: ScalarMap, origin: Origin) -> LatticeSelection:
    best = generators.astype(np.float32)
    confidence, excess = mean_around(correlation, generators), significance(correlation, generators)
    return LatticeSelection(best, best, confidence, excess, origin)


def most_confident(lattices: dict[Origin, Lattice], params: LatticeSelectionParams) -> LatticeSelection:
    """The most confident of several lattices, accepted or not.

    A lattice from features is also accepted where it has too few points for a significance, but not where it has
    enough and a low one: lines of text correlate whichever letters meet.
    """
    detected = {origin: lattice for origin, lattice in lattices.items() if len(lattice.best)}
    none = np.zeros((0, 2), np.float32)
    if not detected:
        return LatticeSelection(none, none, 0.0, 0.0, "none")
    confident = {
        origin: lattice
        for origin, lattice in detected.items()
        if lattice.confidence >= params.confidence
        and (
            lattice.significance >= _MIN_SIGNIFICANCE
            or params.stripes
            or (origin == "features" and lattice.significance < 0)
        )
    }
    if confident:
        highest = max(lattice.confidence for lattice in confident.values())
        origin = min(
            (name for name in confident if confident[name].confidence >= highest - _CONFIDENCE_TOLERANCE),
            key=lambda name: _cell_area(confident[name]),
        )
    else:
        origin = max(detected, key=lambda name: detected[name].significance)
    best = detected[origin]
    accepted = bool(confident) or best.significance >= params.significance
    return LatticeSelection(
        best.best if accepted else none,
        best.best,
        best.confidence,
        best.significance,
        origin if accepted else "none",
    )


def _cell_area(lattice: Lattice) -> float:
    """Area of a cell, px squared."""
    return abs(float(determinant(lattice.best.astype(np.float64))))
