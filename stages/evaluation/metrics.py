"""Quality of a result: measures without learned weights, each between the values of a good and a bad result."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.common.grids.working_size import reduction
from texloom.stages.evaluation._measures import (
    contents,
    joints,
    patches,
    periods,
    pixels,
    reuse,
    spectrum,
    statistics,
    steps,
    structure,
    windows,
)
from texloom.stages.evaluation._measures.pictures import UnmeasurableError, prepare, shuffled_blocks
from texloom.stages.evaluation._measures.table import Figures, lines, table, unmeasured
from texloom.stages.evaluation._measures.task import Task
from texloom.stages.kernels.core.threads import run_all
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.masks import fill_excluded
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.scratch import bands, empty
from texloom.stages.vocabulary.sizes import format_size


class MetricsParams(Params):
    """Scales of two measures."""

    copied: float = Field(0.75, gt=0, le=1)
    """area of a piece that counts as copied verbatim, as a share of the exemplar or, if it is smaller, the
    result"""
    window: int = Field(9, ge=3, le=64)
    """side of the windows whose contrast distinguishes smooth from rough, px"""


@dataclasses.dataclass(frozen=True)
class Metrics:
    """Values and scores."""

    table: dict[str, Any]
    """``summary``: worst score by axis; ``measures``: by name, see `metrics`; ``notes``; ``limits``: what no
    score detects. Ready for JSON"""
    joints: ScalarMap | None
    """of the result's size: how unlike the exemplar the joint in each pixel's cell is, see `metrics`; 0 without a
    joint, and where nothing was measured; None where joints cannot be measured"""


_MEASURES: tuple[tuple[Callable[[Task], Figures | tuple[Figures | str, ...]], tuple[str, ...]], ...] = (
    # slowest first: they run in parallel
    (patches.coherence_and_completeness, ("coherence", "completeness")),
    (statistics.joint_statistics, ("statistics",)),
    (patches.patch_distribution, ("patches",)),
    (spectrum.repetition_excess, ("repetition",)),
    (spectrum.autocorrelation_difference, ("autocorrelation",)),
    (pixels.colors, ("colors",)),
    (pixels.smoothness, ("smoothness",)),
    (pixels.sharpness, ("sharpness",)),
    (contents.contents, ("copies", "contents")),
    (reuse.copying_and_continuity, ("copying", "continuity")),
    (structure.straightness, ("straightness",)),
    (steps.tone_steps, ("steps",)),
    (pixels.seams, ("seams",)),
)

_TITLES = {
    "colors": ("fidelity", "Distance between the distributions of colours, CIELAB units."),
    "patches": ("fidelity", "Distance between the distributions of 7x7 patches."),
    "statistics": ("fidelity", "Difference of the joint statistics of wavelet coefficients."),
    "autocorrelation": ("fidelity", "Difference of the autocorrelations."),
    "coherence": ("fidelity", "Distance of the result's patches to the nearest in the exemplar."),
    "completeness": ("fidelity", "Distance of the exemplar's patches to the nearest in the result."),
    "sharpness": ("detail", "Fine detail relative to the exemplar's; below 1 is blurred."),
    "smoothness": ("detail", "Share of the result that is as smooth as the exemplar's smoothest tenth."),
    "continuity": ("detail", "Share of neighbouring pixels that are neighbours in the exemplar."),
    "repetition": ("variety", "Autocorrelation at long range in excess of the exemplar's."),
    "copies": ("variety", "Copies of the most repeated distinctive pieces, beyond their fair share."),
    "contents": ("variety", "Share of the exemplar's distinctive contents that the result does not show."),
    "copying": ("variety", "Share of the result that is copied from the exemplar in large pieces."),
    "joints": (
        "structure",
        "Distance of patches across the worst joints of the source map to the exemplar, relative to its own.",
    ),
    "straightness": ("structure", "Share of the straightness of the exemplar's main lines that is lost."),
    "steps": (
        "structure",
        "Share with steps of tone that the exemplar does not show: two-tone cells, cut contours, lighter pieces.",
    ),
    "seams": ("wrap", "Jumps across the border of the wrapped result, in deviations of those at inner lines."),
    "periods": ("wrap", "Periods of the lattice by which a wrapped side misses whole ones."),
}
"""axis and meaning of each measure, in the table's order"""


LIMITS = (
    "One or two fused objects among hundreds: no score detects them; the map of joints shows where to look.",
    "Steps of tone that the texture beside them masks.",
    "Whether an object is plausible: letters, faces and machines are judged by their patches.",
    "Faults within a cell of an exemplar that shows less than two repetitions.",
)
"""faults that no score detects"""

_OF_SOURCE_MAP = ("continuity", "copies", "contents", "copying", "joints", "steps")


@stage(version=6, in_bands=True, exemplar_bytes=140, seconds=(1.3, 1.5), role="scores")
def metrics(
    exemplar: Image,
    image: Image,
    params: MetricsParams,
    match: Correspondence | None = None,
    keep: Mask | None = None,
    copies: Mask | None = None,
    generators: Vectors | None = None,
) -> Metrics:
    """Score a result by measures that need no learned weights and no reference but the exemplar.

    Each measure is a line of the table: ``value``; ``floor``, that of a good result; ``ceiling``, that of a bad
    one, such as the exemplar's pixels in random order or a plain picture; ``score``, from 1 at the floor or
    better to 0 at the ceiling or worse; ``what`` it means; ``axis``, the quality that it belongs to; ``more``,
    its parts. Where a measure is impossible, figures are null, with a ``reason``. The floor of the distances of
    fidelity is what sampling allows: the distance between the exemplar's halves; of distributions, which are the
    nearer the larger the samples, at the sizes of exemplar and result. So noise, where any sample is as far, is not
    punished. The floors of the statistics and of smoothness are the values of the exemplar's halves. The score of
    the joint statistics is the mean of their groups' scores. The summary is the worst score of each axis: fidelity,
    detail, variety, structure, wrap; ``notes`` names a result that is a verbatim crop or tiling. No axis replaces
    another: a blurred result may be faithful, and a verbatim tiling is faithful and sharp.

    Of completeness, the nearest of each patch of the exemplar is sought among the patches of the result that show
    a part of it by ``match``, and among 65,536 others. Without ``match``, a large result has a larger distance than
    a small one.

    Joints are where neighbouring pixels come from pixels that are no neighbours. In each cell of the result (at
    most 2048) the joint of the largest jump is measured: the squared distance of the 7x7 patch there, samples 1, 2
    and 4 px apart, to the nearest patch of the exemplar, over the mean distance of the exemplar's patches to those
    that do not overlap them; mean over the scales. 0 is a patch of the exemplar, 1 as unlike as its patches are to
    each other. ``value`` is the mean of the worst tenth of the cells with joints; good results have about 1.4,
    blocks joined at random 3. The score is that of ``bad``, the share of the result's cells with a joint above 2.

    Straightness is the power of the gradient across the exemplar's most coherent direction that is left after
    averaging it along that direction (16 to 32 px), over its power before; ``value`` is the share of this that
    the result has lost, ``ceiling`` that of the exemplar bent by waves, ``floor`` what the exemplar's halves lack.
    Where that is half the ceiling, as of polygons, whose lines run in many directions, there is no score.

    Steps are where the tone jumps at a joint and the exemplar's does not within 2 px of either source: cells of two
    tones, contours that end, lighter or darker pieces. A step is the distance between the mean colours of 9x9 px on
    both sides of the joint, less the larger of those that the exemplar shows there. It is seen if it is more than
    half of the squares' mean deviation, which masks it, and 2.3 CIELAB units, which are just noticeable, both
    squared and added. ``value`` is the share of the result's cells of 9x9 px with such a step.

    Copies and contents are those of pieces of a tenth of the exemplar's side. A piece is as distinctive as it is
    unlike the nearest piece that does not overlap: 1 with nothing in common, near 0 in a lattice. ``copies`` is the
    root of this times the use beyond the fair share, mean over the most repeated 3 %; ``contents`` is the share of
    the pieces, weighted by it, that are shown less than a quarter of their fair share.

    Seams are measured at the border of a result that wraps around: the mean of the jumps between neighbours in
    excess of the jumps before and after them, less the median over the inner lines, in deviations of the inner
    lines; the worse of the axes along which it does. Tileable pictures are below 1.5.

    Periods are measured where the result's lattice is given: a side of a whole number and a half of bricks has
    bricks of wrong length at the border, whose seam no jump shows.

    A result of more than 4096 x 4096 px is measured in windows of 2048 x 2048 px about the middles of its quarters,
    and, where it wraps around, seams in one about its corner; `copies` and `contents` take all of it. Figures are
    then means over the windows, and ``limits`` and ``windows`` (top and left of each, px) of the table say so.

    Parameters
    ----------
    exemplar, image : the texture and the result, of any sizes; only their colour counts. Masked pixels (see
        `valid_pixels`) are ignored. The border of a result that wraps is a joint, and measured as `seams`.
    match : the source of the result's pixels; without it, `copies`, `contents`, `copying`, `continuity`, `joints`
        and `steps` are not measured.
    keep : true where the result was given, as when holes are filled. Then measures take only what touches pixels
        that were made, `seams` excepted, and measures of the whole picture are left out.
    copies : true where the pixel is a copy of its source; given if ``match`` is estimated from the pixels, see
        `estimated_match`. The lines of the measures of the source map are then marked as ``estimated``. Where less
        than half of the pixels are copies, only `copying` is measured.
    generators : of the lattice that the result continues, px; see `whole_periods`. Without them there is no line
        `periods`.

    Raises
    ------
    InputError : a colour is not a finite number; ``match``, ``keep`` or ``copies`` is not of the result's size, or
        ``match`` points outside the exemplar; a mask leaves no pixel.

    References
    ----------
    Coherence and completeness: [Simakov2008]_. Patches: [Elnekave2022]_. Statistics: [Portilla2000]_. The rest, the
    scale of floor and ceiling, and the axes are ours.

    Examples
    --------
    >>> import skimage.data, texloom
    >>> brick = skimage.data.brick()[:96, :96]
    >>> texloom.stages.metrics(brick, brick).table["summary"]["detail"]
    1.0
    """
    _check(exemplar, image, match, keep, copies)
    limits = list(LIMITS)
    of_lattice = {} if generators is None else lines(_periods(image), generators, ("periods",))
    corners = windows.corners(image.height, image.width)
    if not corners:
        measured, located = _measured(exemplar, image, params, match, keep, copies)
        return Metrics({**_table(measured | of_lattice), "limits": limits}, located)
    limits.append(f"Faults outside the {len(corners)} windows of {windows.SIDE} px that were measured.")
    measured, located = _measured_in_windows(corners, exemplar, image, params, match, keep, copies)
    return Metrics({**_table(measured | of_lattice), "limits": limits, "windows": corners}, located)


def _table(measured: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """The table, with ``notes`` on a result that was not made but copied as a whole."""
    verbatim = (measured["copying"].get("more") or {}).get("verbatim")
    notes = [f"The result is {verbatim}: nothing was synthesised."] if verbatim else []
    return {**table({name: _TITLES[name] for name in _TITLES if name in measured}, measured), "notes": notes}


def _periods(image: Image) -> Callable[[Vectors], Figures]:
    return functools.partial(periods.period_misfit, sides=(image.height, image.width), wraps=image.wraps)


def _measured_in_windows(
    corners: list[list[int]],
    exemplar: Image,
    image: Image,
    params: MetricsParams,
    match: Correspondence | None,
    keep: Mask | None,
    copies: Mask | None,
) -> tuple[dict[str, dict[str, Any]], ScalarMap | None]:
    """Means of the lines of the table over windows, and the joints in these."""
    tables: list[dict[str, dict[str, Any]]] = []
    whole = empty((image.height, image.width), np.float32)
    for band in bands(image.height, whole):
        whole[band] = 0
    is_located = False
    for top, left in corners:
        place = np.s_[top : top + windows.SIDE, left : left + windows.SIDE]
        part = image.elsewhere(np.ascontiguousarray(image.pixels[place]))
        given = [None if value is None else np.ascontiguousarray(value[place]) for value in (match, keep, copies)]
        measured, located = _measured(exemplar, part, params, given[0], given[1], given[2])
        tables.append(measured)
        if located is not None:
            whole[place], is_located = located, True
    means = windows.mean_lines(tables)
    source, corner = prepare(exemplar, windows.around_corner(image))
    task = Task(source, corner, source, match, copies, image.wraps, params.copied, params.window)
    if keep is None:
        means |= lines(pixels.seams, task, ("seams",)) | lines(contents.contents, task, ("copies", "contents"))
    return _marked(means, copies), whole if is_located else None


def _measured(
    exemplar: Image,
    image: Image,
    params: MetricsParams,
    match: Correspondence | None,
    keep: Mask | None,
    copies: Mask | None,
) -> tuple[dict[str, dict[str, Any]], ScalarMap | None]:
    """The lines of the table, and the map of the joints."""
    source, result = prepare(exemplar, image, keep)
    report(Progress(0.2))
    task = Task(
        source, result, shuffled_blocks(source, 2), match, copies, image.wraps, params.copied, params.window
    )
    measured: dict[str, dict[str, Any]] = {}
    calls = [functools.partial(lines, measure, task, names) for measure, names in _MEASURES]
    (located, of_joints), *others = _called([functools.partial(_joints, task), *calls], exemplar)
    for one in (*others, of_joints):
        measured |= one
    return _marked(measured, copies), located


def _marked(measured: dict[str, dict[str, Any]], copies: Mask | None) -> dict[str, dict[str, Any]]:
    """The lines with a mark on those of an estimated source map."""
    if copies is not None:
        for name in _OF_SOURCE_MAP:
            if measured[name]["value"] is not None:
                measured[name]["estimated"] = True
    return measured


def _called(calls: Sequence[Callable[[], Any]], exemplar: Image) -> list[Any]:
    """What they return; of a large exemplar one after the other, as each needs memory of its size."""
    if reduction(exemplar.height, exemplar.width) == 1:
        return run_all(_call, [(call,) for call in calls])
    results = []
    for call in calls:
        results.append(call())
        report(Progress(0.2 + 0.8 * len(results) / len(calls)))
    return results


def _call(function: Callable[[], Any]) -> Any:
    return function()


def _joints(task: Task) -> tuple[ScalarMap | None, dict[str, dict[str, Any]]]:
    """The map of the joints and their line of the table."""
    try:
        measured = joints.measure_joints(task)
    except UnmeasurableError as error:
        return None, {"joints": unmeasured(str(error))}
    shape, made = task.result.tone.shape, task.result.made
    cells = (task.result.tone.size if made is None else int(made.sum())) // measured.cell**2
    return measured.map((shape[0], shape[1])), {"joints": joints.joint_figures(measured, cells).line()}


def _check(
    exemplar: Image, image: Image, match: Correspondence | None, keep: Mask | None, copies: Mask | None
) -> None:
    for name, picture in (("exemplar", exemplar), ("image", image)):
        filled = fill_excluded(picture)
        parts = (filled.elsewhere(filled.pixels[band]) for band in bands(filled.height, filled.pixels))
        if not all(np.isfinite(part.color).all() for part in parts):
            raise InputError(f"{name} has colours that are not finite numbers")
    if match is not None:
        if match.shape[:2] != image.pixels.shape[:2]:
            raise InputError(f"match is {format_size(match.shape)}, the result {format_size(image)}")
        if any((match[band] >= (exemplar.height, exemplar.width)).any() for band in bands(len(match), match)):
            raise InputError(f"match points outside the exemplar of {format_size(exemplar)}")
    for name, mask in (("keep", keep), ("copies", copies)):
        if mask is not None and mask.shape != image.pixels.shape[:2]:
            raise InputError(f"{name} is {format_size(mask.shape)}, the result {format_size(image)}")
