"""How good a result is: measures without learned weights, each beside what a good and a bad result score."""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Correspondence, Image, Mask
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.evaluation._measures import patches, reuse, spectrum
from texloom.stages.evaluation._measures import pictures as _pictures
from texloom.stages.evaluation._measures import pixels as _pixels
from texloom.stages.evaluation._measures import statistics as _statistics
from texloom.stages.evaluation._measures.pictures import Picture, UnmeasurableError
from texloom.stages.evaluation._measures.table import Figures, lines, share, table
from texloom.stages.kernels.core.threads import run_all
from texloom.stages.masks import fill_excluded


class MetricsParams(Params):
    """What is asked of the result."""

    copied: float = Field(0.25, gt=0, le=1)
    """area of a piece that counts as copied verbatim, as a share of the exemplar"""
    window: int = Field(9, ge=3, le=64)
    """side of the windows whose contrast tells smooth from rough, px"""


@dataclasses.dataclass(frozen=True)
class Metrics:
    """The figures."""

    table: dict[str, Any]
    """``summary``: mean score by axis; ``measures``: by name, see `metrics`. Ready for JSON"""


_GIVEN = "part of the result was given, and does not speak for what was made"


@dataclasses.dataclass(frozen=True)
class _Task:
    """All that measures may look at."""

    exemplar: Picture
    result: Picture
    shuffled: Picture
    """the exemplar in squares of 2 px, in random order: what a bad result is like"""
    match: np.ndarray | None
    tileable: bool
    params: MetricsParams

    @property
    def source_shape(self) -> tuple[int, int]:
        return self.exemplar.tone.shape[0], self.exemplar.tone.shape[1]

    @property
    def source_area(self) -> int:
        """Pixels of the exemplar that may be used."""
        usable = self.exemplar.usable
        return self.exemplar.tone.size if usable is None else int(usable.sum())

    def require_all_made(self) -> None:
        """`UnmeasurableError` where part of the result was given."""
        if self.result.made is not None:
            raise UnmeasurableError(_GIVEN)


def _between_halves(picture: Picture, distance: Callable[[Picture, Picture], float]) -> float:
    return float(np.mean([distance(one, other) for one, other in _pictures.halves(picture)]))


def _colors(task: _Task) -> Figures:
    task.require_all_made()
    _pictures.require_side(2, task.exemplar)
    channels = _pixels.color_distance(task.exemplar, task.result)
    floor = _between_halves(task.exemplar, lambda one, other: float(_pixels.color_distance(one, other).mean()))
    visible = 2.3 / 3  # a just noticeable difference, spread over three channels
    ceiling = max(_pixels.color_spread(task.exemplar), visible)
    return Figures(
        float(channels.mean()), floor, ceiling, {"channels": dict(zip("Lab", map(float, channels), strict=True))}
    )


def _patch_distances(task: _Task) -> Figures:
    _pictures.require_variation(task.exemplar)
    _pictures.require_side(4 * patches.SIDE, task.exemplar, task.result)
    task.require_all_made()
    deviation = float(np.sqrt(_pictures.channel_variances(task.exemplar.colors).mean()))

    def between(one: Picture, other: Picture, most: int = 4) -> list[float]:
        found = patches.sliced_wasserstein(one, other, most)
        if not found:
            raise UnmeasurableError(f"masks leave no patch of {patches.SIDE} px")
        return found

    levels = [level / deviation for level in between(task.exemplar, task.result)]

    def distance(one: Picture, other: Picture) -> float:
        return float(np.mean(between(one, other, len(levels)))) / deviation

    floor = _between_halves(task.exemplar, distance)
    return Figures(float(np.mean(levels)), floor, distance(task.exemplar, task.shuffled), {"levels": levels})


def _nearest(task: _Task) -> tuple[Figures, Figures | str]:
    """Coherence and completeness, which share their patches."""
    _pictures.require_variation(task.exemplar)
    _pictures.require_side(4 * patches.SIDE, task.exemplar, task.result)
    steps = [step for step in (1, 4) if min(task.exemplar.shorter, task.result.shorter) >= 4 * patches.SIDE * step]
    variance = float(_pictures.channel_variances(task.exemplar.colors).sum())
    mean = task.exemplar.colors.mean(axis=0)
    counted = task.exemplar.counted
    rows = []
    for step in steps:
        labs = [
            patches.smoothed(picture.lab - mean, step) for picture in (task.exemplar, task.result, task.shuffled)
        ]
        wholes = [patches.whole_patches(picture, step) for picture in (task.exemplar, task.result)]
        directions = patches.principal_directions(labs[0], step, wholes[0])
        exemplar, result = (
            patches.index_patches(lab, step, directions, whole=whole)
            for lab, whole in zip(labs[:2], wholes, strict=True)
        )
        shuffled = patches.index_patches(labs[2], step, directions, 8192)
        rows.append(
            [
                patches.nearest_distance(result, exemplar),
                patches.nearest_distance(exemplar, result),
                float(np.mean([patches.nearest_distance(*pair, 128) for pair in exemplar.halves()])),
                patches.nearest_distance(shuffled, exemplar, 128),
                # a plain picture's distance
                float(_pictures.channel_variances(labs[0] if counted is None else labs[0][counted]).sum()),
            ]
        )
    levels = np.array(rows) / variance
    coherence, completeness, floor, torn, plain = (float(mean) for mean in levels.mean(axis=0))
    return (
        Figures(coherence, floor, torn, {"levels": levels[:, 0].tolist()}),
        _GIVEN
        if task.result.made is not None
        else Figures(completeness, floor, plain, {"levels": levels[:, 1].tolist()}),
    )


def _joint_statistics(task: _Task) -> Figures:
    _pictures.require_variation(task.exemplar)
    _pictures.require_side(2 * _statistics.SMALLEST, task.exemplar)
    _pictures.require_side(_statistics.SMALLEST, task.result)
    task.require_all_made()
    scale = np.sqrt(_pictures.channel_variances(task.exemplar.colors))
    scale = np.maximum(scale, 0.1 * scale.max())  # a grey exemplar's a and b have no scale of their own

    def groups(one: Picture, other: Picture) -> dict[str, float]:
        side = _statistics.window_side(one, other)
        first, second = (_statistics.statistics(picture, side, scale) for picture in (one, other))
        return _statistics.statistics_distance(first, second)

    found = groups(task.exemplar, task.result)
    between = [groups(*pair) for pair in _pictures.halves(task.exemplar)]
    floors = {group: float(np.mean([half[group] for half in between])) for group in found}
    ceilings = groups(task.exemplar, task.shuffled)
    # band energies differ by far more than correlations do, so each group is judged by its own floor and ceiling
    scores = [share(found[group], floors[group], ceilings[group]) for group in found]
    known = [score for score in scores if score is not None]
    value, floor, ceiling = (float(np.mean(list(parts.values()))) for parts in (found, floors, ceilings))
    return Figures(value, floor, ceiling, {"groups": found}, float(np.mean(known)) if known else None)


def _autocorrelation(task: _Task) -> Figures:
    _pictures.require_variation(task.exemplar)
    _pictures.require_side(32, task.exemplar)
    _pictures.require_side(16, task.result)
    task.require_all_made()
    reach = min(task.exemplar.shorter, task.result.shorter) // 4

    def distance(one: Picture, other: Picture) -> float:
        first, second = (
            spectrum.autocorrelation(picture.tone, (reach, reach), picture.usable) for picture in (one, other)
        )
        return float(np.sqrt(((first - second) ** 2).mean()))

    floor = _between_halves(task.exemplar, distance)
    ceiling = distance(task.exemplar, task.shuffled)
    return Figures(distance(task.exemplar, task.result), floor, ceiling)


def _sharpness(task: _Task) -> Figures:
    _pictures.require_variation(task.exemplar)
    _pictures.require_side(8, task.exemplar, task.result)
    theirs = _pixels.laplacians(task.exemplar.tone, counted=task.exemplar.counted)
    ours = _pixels.laplacians(task.result.tone, counted=task.result.counted)
    if not (theirs and ours):
        raise UnmeasurableError("masks leave too little")
    if theirs[0] < _pictures.FLAT:
        raise UnmeasurableError("the exemplar has no detail")
    levels = [one / max(other, 1e-9) for one, other in zip(ours, theirs, strict=False)]
    blurred = _pixels.blurred(task.exemplar.tone, 1.0)
    soft = _pixels.laplacians(blurred, 1, task.exemplar.counted)[0] / theirs[0]
    off = float(np.log(max(levels[0], 1e-9)))
    worst = np.log(2) if off > 0 else max(-np.log(max(soft, 1e-9)), 0.2)
    score = share(abs(off), np.log(1.05), worst)
    more = {"levels": levels, "target": [0.95, 1.05]}  # at twice the detail the score is 0
    return Figures(levels[0], 1.0, soft, more, score)


def _smoothness(task: _Task) -> Figures:
    _pictures.require_variation(task.exemplar)
    side = task.params.window
    _pictures.require_side(4 * side, task.exemplar)
    _pictures.require_side(2 * side, task.result)
    contrast = _contrast(task.exemplar, side)
    limit = max(float(np.quantile(contrast, 0.1)), 0.05 * float(contrast.mean()))

    def share(picture: Picture) -> float:
        return float((_contrast(picture, side) < limit).mean())

    floor = max(share(half) for pair in _pictures.halves(task.exemplar) for half in pair)
    soft = dataclasses.replace(task.exemplar, tone=_pixels.blurred(task.exemplar.tone, side / 4))
    return Figures(share(task.result), floor, share(soft))


def _contrast(picture: Picture, side: int) -> np.ndarray:
    """Standard deviations in the windows that count."""
    found = _pixels.local_contrast(picture.tone, side)
    whole = picture.windows(side, side)
    if whole is not None and not whole.any():
        raise UnmeasurableError(f"masks leave no window of {side} px")
    return np.asarray(found if whole is None else found[whole])


def _repetition(task: _Task) -> Figures:
    _pictures.require_variation(task.exemplar)
    _pictures.require_variation(task.result, "the result")
    _pictures.require_side(64, task.exemplar, task.result)
    task.require_all_made()

    def excess(one: Picture, other: Picture) -> tuple[float, tuple[int, int]]:
        return spectrum.repetition(one.tone, other.tone, (one.usable, other.usable))

    value, offset = excess(task.exemplar, task.result)
    floor = _between_halves(task.exemplar, lambda one, other: excess(one, other)[0])
    return Figures(value, min(floor, 0.5), 1.0, {"offset": list(offset)})


def _source_map(task: _Task) -> Correspondence:
    if task.match is None:
        raise UnmeasurableError("no source map was given")
    return task.match


def _use(task: _Task) -> Figures:
    match = _source_map(task)
    task.require_all_made()
    usable = task.exemplar.usable
    uses = reuse.use_of_exemplar(match, task.source_shape, usable)
    use = uses if usable is None else uses[usable]
    more = {
        "entropy": reuse.match_entropy(match, task.source_shape, task.source_area),
        "unused": float((use < 0.1).mean()),
        "largest": float(use.max()),
    }
    side = task.params.window
    whole = task.exemplar.windows(side, side) if task.exemplar.shorter >= 4 * side else np.zeros(0, bool)
    if whole is None or whole.any():
        contrast = _pixels.local_contrast(task.exemplar.tone, side)
        before = side // 2
        inner = uses[before : before + contrast.shape[0], before : before + contrast.shape[1]]
        if whole is not None:
            inner, contrast = inner[whole], contrast[whole]
        more["smooth"] = float(inner[contrast <= np.quantile(contrast, 0.1)].mean())
    return Figures(float(use.std()), 0.0, float(np.sqrt(3)), more)


def _segments(task: _Task) -> tuple[Figures, Figures]:
    """Copying and continuity, which share their segments."""
    area = task.source_area
    segments = reuse.copied_segments(_source_map(task), task.result.made)
    if not segments.areas.size:
        raise UnmeasurableError("nothing of the result was made")
    more = {"typical": segments.typical, "largest": float(segments.areas.max()) / area}
    return (
        Figures(segments.share_above(task.params.copied * area), 0.0, 1.0, more),
        Figures(segments.continuity, 1.0, 0.0, score=segments.continuity),
    )


def _seams(task: _Task) -> Figures:
    if not task.tileable:
        raise UnmeasurableError("the result is not meant to wrap around")
    _pictures.require_side(8, task.exemplar, task.result)
    ratio, rank = _pixels.seam(task.result.lab)
    bad = max(_pixels.seam(task.exemplar.lab)[0], 2.0)
    return Figures(ratio, 1.15, bad, {"rank": rank}, 1.0 if rank < 0.95 else None)


_MEASURES: tuple[tuple[Callable[[_Task], Figures | tuple[Figures | str, ...]], tuple[str, ...]], ...] = (
    # heaviest first: they run side by side
    (_nearest, ("coherence", "completeness")),
    (_joint_statistics, ("statistics",)),
    (_patch_distances, ("patches",)),
    (_repetition, ("repetition",)),
    (_autocorrelation, ("autocorrelation",)),
    (_colors, ("colors",)),
    (_smoothness, ("smoothness",)),
    (_sharpness, ("sharpness",)),
    (_use, ("use",)),
    (_segments, ("copying", "continuity")),
    (_seams, ("seams",)),
)

_TITLES = {
    "colors": ("fidelity", "How far the colours must move to become the exemplar's, CIELAB units."),
    "patches": ("fidelity", "How different the distributions of 7x7 patches are."),
    "statistics": ("fidelity", "How different the joint statistics of wavelet coefficients are."),
    "autocorrelation": ("fidelity", "How different the pictures' correlations with themselves are."),
    "coherence": ("fidelity", "How far the result's patches are from their nearest in the exemplar."),
    "completeness": ("fidelity", "How far the exemplar's patches are from their nearest in the result."),
    "sharpness": ("detail", "Fine detail of the result by that of the exemplar; below 1 is blurred."),
    "smoothness": ("detail", "Share of the result that is as smooth as the exemplar's smoothest tenth."),
    "continuity": ("detail", "Share of neighbouring pixels that were neighbours in the exemplar."),
    "repetition": ("variety", "How much more than the exemplar the result repeats itself at a distance."),
    "use": ("variety", "How unevenly the exemplar is used, as relative standard deviation."),
    "copying": ("variety", "Share of the result that is copied from the exemplar in large pieces."),
    "seams": ("wrap", "Jump where the result wraps around by the jump between neighbours inside."),
}
"""axis and meaning of each line, in the table's order"""


@stage(version=1)
def metrics(
    exemplar: Image,
    image: Image,
    params: MetricsParams,
    match: Correspondence | None = None,
    tileable: bool = False,
    keep: Mask | None = None,
) -> Metrics:
    """Judge a result by measures that need no learned weights and no second picture but the exemplar.

    Each measure is a line of the table: ``value``; ``floor``, what the exemplar's own halves score against each
    other, or the ideal; ``ceiling``, what a bad result scores, such as the exemplar's pixels in random order or a
    plain picture; ``score``, 1 at the floor or better and 0 at the ceiling or worse; ``what`` it is; ``axis``, what
    it speaks for; ``more``, its parts. What cannot be measured has null and a ``reason``. The score of the joint
    statistics is the mean of their groups' scores. The summary is the mean score of each axis: fidelity, detail,
    variety, wrap. They do not replace each other: a blurred result is faithful, a verbatim tiling is faithful and
    sharp.

    Parameters
    ----------
    exemplar, image : the texture and the result, each of any size; only their colour counts. Masked pixels (see
        `usable`) do not: they change no figure, whatever they hold.
    match : where the result's pixels come from; without it, `use`, `copying` and `continuity` are not measured.
    tileable : the result is meant to wrap around; without it, `seams` is not measured.
    keep : true where the result was given, as when holes are filled. Then what touches made pixels is judged, but
        for `seams`, and measures of the whole have no line: a picture that is kept is as good as itself.

    Raises
    ------
    InputError : a colour is not a finite number; ``match`` or ``keep`` is not of the result's size, or ``match``
        points outside the exemplar; a mask leaves no pixel.

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
    for name, picture in (("exemplar", exemplar), ("image", image)):
        if not np.isfinite(fill_excluded(picture).color).all():
            raise InputError(f"{name} has colours that are not finite numbers")
    if match is not None:
        if match.shape[:2] != image.pixels.shape[:2]:
            raise InputError(f"match is {match.shape[:2]}, the result {image.pixels.shape[:2]}")
        if int(match[..., 0].max()) >= exemplar.height or int(match[..., 1].max()) >= exemplar.width:
            raise InputError(f"match points outside the exemplar of {exemplar.height}x{exemplar.width}")
    if keep is not None and keep.shape != image.pixels.shape[:2]:
        raise InputError(f"keep is {keep.shape}, the result {image.pixels.shape[:2]}")
    source, result = _pictures.pictures(exemplar, image, keep)
    task = _Task(source, result, _pictures.shuffled_blocks(source, 2), match, tileable, params)
    found: dict[str, dict[str, Any]] = {}
    for measured in run_all(lines, [(partial(measure, task), names) for measure, names in _MEASURES]):
        found |= measured
    return Metrics(table(_TITLES, found))
