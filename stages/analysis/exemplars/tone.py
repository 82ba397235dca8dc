"""The slow tone of an exemplar, such as uneven light or ageing, and the exemplar without it."""

import dataclasses
import itertools
import logging
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, Literal

import numpy as np
from jaxtyping import Float32, Float64
from pydantic import Field

from texloom.stages.analysis.exemplars.picture_flaws import flaws_of
from texloom.stages.analysis.exemplars.plain_drift import plain_drift
from texloom.stages.analysis.exemplars.plain_margins import plain_margins
from texloom.stages.common.features.slow_tone import BLACK, ToneField, relative_tone, with_tone
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.common.grids.size_checks import check_side
from texloom.stages.numerics.matrices import solve
from texloom.stages.numerics.threshold import otsu_threshold
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Outline, Params, stage
from texloom.stages.vocabulary.masks import fill_excluded, nearest_valid, valid_pixels, with_usable
from texloom.stages.vocabulary.messages import OWN_STEP
from texloom.stages.vocabulary.progress import Progress, report

_LOG = logging.getLogger(__name__)

_BLOCKS = 8  # a side, whose quantiles are compared
_MIN_PIXELS = 10  # px a side of an exemplar
_MIN_SIDE = 64  # px of an exemplar in which drift can be told from detail
_MEASURED_SIDE = 384  # px to which larger exemplars are reduced
_MIN_VALID = 0.25  # share of a block's pixels that have to be valid
_MIN_BLOCKS = 0.6  # share of the blocks that have to be valid
_TAILS = (0.1, 0.9)  # quantiles of a block that bound its mean and have to drift with it
_MIN_MODE = 0.08  # share of a block's pixels that a mode needs there
_MODE_PASSES = 6
_PASSES = 12  # of the robust fit
_OUTLIER = 2.0  # standard deviations at which a block counts half
_LOW, _NEXT = 2.0, 4.5  # spatial frequencies of the drift and of the texture that it is compared with, half waves
_MIN_POWER = 8.0  # of the drift, relative to the next frequencies
_MIN_EXPLAINED = 0.6  # share of the variance between blocks
_MIN_SHARED = 0.4  # of the drift of the medians that dark and bright quantiles have to follow
_MIN_CONTRAST = 0.35  # range of the drift, relative to the deviation within blocks
_MAX_CHROMA = 30.0  # CIELAB units; larger changes are of the material, or a glare without detail
_SMOOTH_EXPLAINED, _SMOOTH_POWER = 0.9, 50.0  # the first two of these, of a drift that is as smooth as light
_SAMPLES = 32  # a side of the field of tone


class ToneParams(Params):
    """When the exemplar is evened."""

    even: Literal["auto", "always", "never"] = "auto"
    """`auto`: where the measured drift cannot be a coincidence; `always`: whatever is measured; `never`: the
    exemplar stays as it is"""
    min_drift: float = Field(4.0, ge=0, le=100)
    """minimum range of the drift that `auto` evens, CIELAB units"""
    margins: Literal["leave_out", "use"] = "leave_out"
    """whether plain margins and labels along the rim, see `plain_margins`, are excluded"""
    warn: bool = True
    """warn that the exemplar has margins, was evened, was enlarged, or shows strong compression; false where the
    even image serves only to find contours"""


@dataclasses.dataclass(frozen=True)
class Tone:
    """The exemplar without drift, and what was removed."""

    image: Image
    """all maps of the exemplar, with even colour; bit-identical to the exemplar if nothing was evened; with a
    channel `usable`, 0 on margins, labels and another material, where there are any"""
    tone: ToneField
    """the slow tone that was removed, relative to its mean; 0 if nothing was evened"""
    lightness: float
    """range of the drift of lightness, CIELAB units at mean lightness; 0 where it is not significant"""
    chroma: float
    """the same of a or b, whichever is larger"""


@dataclasses.dataclass(frozen=True)
class _Drift:
    """Slow change of a plane: a sum of `_basis`, its range, whether it is significant, and as smooth as light."""

    coefficients: Float64[np.ndarray, "6"]
    range: float
    significant: bool
    smooth: bool = True


def check_image(params: ToneParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """The exemplar must have the size that synthesis needs."""
    image = known.get("image")
    if image is not None:
        check_side(image, _MIN_PIXELS)


def outlines(params: ToneParams, known: Mapping[str, Any]) -> dict[str, Outline]:  # noqa: ARG001
    """The image keeps its size and maps."""
    image = known.get("image")
    return {} if image is None else {"image": Outline(image.height, image.width, image.channels)}


@stage(version=3, check=check_image, outlines=outlines, seconds=(0.3, 0))
def tone(image: Image, params: ToneParams, foreign: Mask | None = None) -> Tone:
    """Separate the drift of an exemplar's tone from its detail, so that distant parts fit together.

    The logarithm of lightness, and chroma relative to lightness, are each compared between 8x8 blocks, and only
    within each of the exemplar's two tones, such as stones and their joints: so their proportions, or a dark rim,
    are no drift. A polynomial of second degree, with a level for each tone, is fitted to the means of the blocks,
    robustly: blocks with unusual objects count little. The tones are told apart by Otsu's threshold on lightness
    without the drift, in a few passes. The drift counts as significant where it

    - explains most of the variance between blocks, and has many times the power of the next higher spatial
      frequencies, while a random texture has about as much in both;
    - moves dark and bright quantiles along with the means, in each tone, or in the whole while each tone's mean
      follows; not asked of chroma where it and the lightness both drift as smoothly as light falls off;
    - is visible: its range exceeds ``min_drift``, and a third of the deviation within blocks.

    Colours are then divided by the drift, which removes uneven light and preserves contrast: black remains black.
    An exemplar whose chroma drifts by more than 30 units is preserved, with a warning, since it has several
    materials, or a glare that hides its detail; but not if its lightness drifts more, and both as smoothly as light
    falls off. Maps other than colour do not change. Exemplars below 64 px a side are changed by `always` only.

    Of a plain surface, without details, all that changes slowly is drift, see `plain_drift`.

    Before that, plain margins and labels along the rim are excluded, see `plain_margins`, unless the exemplar says
    that it continues across its border. Of one that was enlarged or strongly compressed it warns, see `flaws_of`.

    Parameters
    ----------
    image : the exemplar; its masked pixels have no influence.
    foreign : what of it is another material, as of `foreign_margins`, which is excluded.

    Raises
    ------
    InputError
        the exemplar is smaller than 10 x 10 px, or all its pixels are excluded.

    References
    ----------
    Ours. [HollandWelsch1977]_ for the robust fit, with Cauchy's weights; [Otsu1979]_ for the threshold.
    """
    if params.margins == "leave_out" and not image.wraps:
        image = _without_margins(image, params)
    if foreign is not None and foreign.any():
        known = valid_pixels(image)
        image = with_usable(image, ~foreign if known is None else known & ~foreign)
    if params.warn:
        for flaw in flaws_of(image):
            _LOG.warning("%s", flaw)
        report(Progress(0.4))
    unchanged = Tone(image, np.zeros((_SAMPLES, _SAMPLES, 3), np.float32), 0.0, 0.0)
    if params.even == "never" or (params.even == "auto" and min(image.height, image.width) < _MIN_SIDE):
        return unchanged
    lab, valid = _reduced(image)
    report(Progress(0.6))
    known = lab if valid is None else lab[valid]
    scale = float(known[..., 0].mean(dtype=np.float64)) + float(BLACK)  # CIELAB units of 1 in a relative plane
    planes = relative_tone(lab)
    plain = plain_drift(lab, planes, valid) if params.even == "auto" else None
    if plain is not None:
        return _without(image, plain, scale, params)
    modes = _modes(planes[..., 0], valid)
    drifts = [_drift(planes[..., 0], modes, scale, params)]
    if image.channels[0] != "Y":
        light = drifts[0].significant and drifts[0].smooth
        drifts += [_drift(planes[..., place], modes, scale, params, light) for place in (1, 2)]
    lightness, chroma = drifts[0].range, max((drift.range for drift in drifts[1:]), default=0.0)
    is_light = lightness > chroma and all(drift.smooth for drift in drifts if drift.range > _MAX_CHROMA)
    if params.even == "auto" and chroma > _MAX_CHROMA and not is_light:
        _LOG.warning(
            "the exemplar's colour drifts by %.0f CIELAB units, more than light alone does; it was kept. The "
            "result may show steps of tone: use a part of one tone, or try --set %s.even=always",
            chroma,
            OWN_STEP,
        )
        return unchanged
    if not any(drift.significant for drift in drifts):
        return unchanged
    if params.warn:
        _report(lightness, chroma)
    report(Progress(0.8))
    return Tone(
        with_tone(image, -_field(drifts, (image.height, image.width))).wrapping(False),  # drift ends differently
        _field(drifts, (_SAMPLES, _SAMPLES)),
        lightness,
        chroma,
    )


def _without_margins(image: Image, params: ToneParams) -> Image:
    margins = plain_margins(image)
    valid = valid_pixels(image)
    if margins is None or (valid is not None and not (valid & margins).any()):
        return image
    if params.warn:
        _LOG.warning(
            "%.2g%% of the exemplar are a plain margin or a label along its rim, and are left out; "
            "--set %s.margins=use uses all alike",
            100 * float(margins.mean()),
            OWN_STEP,
        )
    return with_usable(image, ~margins if valid is None else valid & ~margins)


def _without(image: Image, drift: Float32[np.ndarray, "h w 3"], scale: float, params: ToneParams) -> Tone:
    """The image without the drift of a plain surface, of which 1 is ``scale`` CIELAB units."""
    field = resize(drift, _SAMPLES, _SAMPLES)
    if image.channels[0] == "Y":
        field[..., 1:] = 0
    lightness, light_a, light_b = (scale * np.ptp(field, axis=(0, 1))).tolist()
    if max(lightness, light_a, light_b) < params.min_drift:
        return Tone(image, np.zeros_like(field), 0.0, 0.0)
    if params.warn:
        _report(lightness, max(light_a, light_b))
    report(Progress(0.8))
    return Tone(with_tone(image, -field).wrapping(False), field, lightness, max(light_a, light_b))


def _report(lightness: float, chroma: float) -> None:
    amounts = [f"{name} by {amount:.0f}" for name, amount in (("light", lightness), ("colour", chroma)) if amount]
    _LOG.warning(
        "the exemplar's tone drifts (%s CIELAB units), and was evened; --set %s.even=never keeps it",
        ", ".join(amounts),
        OWN_STEP,
    )


def _reduced(image: Image) -> tuple[Float32[np.ndarray, "h w 3"], Mask | None]:
    """CIELAB of the image at no more than `_MEASURED_SIDE`, and the pixels without influence of masked ones."""
    import cv2

    valid = valid_pixels(image)
    color = fill_excluded(image).color
    factor = -(-max(image.height, image.width) // _MEASURED_SIDE)
    if factor > 1:
        size = (max(1, image.width // factor), max(1, image.height // factor))
        color = cv2.resize(color, size, interpolation=cv2.INTER_AREA)
        if valid is not None:
            valid = cv2.resize(valid.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 1 - 1e-3
    return lab_from_linear(np.ascontiguousarray(color)), valid


def _drift(plane: ScalarMap, modes: list[Mask], scale: float, params: ToneParams, light: bool = False) -> _Drift:
    """The drift of ``plane``, of which 1 is ``scale`` CIELAB units, within each of ``modes``.

    Parameters
    ----------
    light : the lightness drifts as smoothly as light; a plane that does too is lit alike, whatever its modes.
    """
    none = _Drift(np.zeros(6), 0.0, False)
    blocks = [_blocks(plane, mode) for mode in modes]
    whole = _blocks(plane, np.logical_or.reduce(modes))
    if sum(len(block) >= _MIN_VALID * plane.size / _BLOCKS**2 for block in whole) < _MIN_BLOCKS * _BLOCKS**2:
        return none
    means, weights = _of_blocks(blocks, _trimmed_mean), _weights(blocks)
    coefficients, levels = _fitted(means, weights)
    drift = _polynomial(coefficients, (_BLOCKS, _BLOCKS))
    extent = float(np.ptp(drift)) * scale
    even = _combined(means - levels[:, None, None], weights)
    explained = 1 - float(np.var(even - drift)) / max(float(np.var(even)), 1e-12)
    power = _power(even)
    smooth = explained >= _SMOOTH_EXPLAINED and power >= _SMOOTH_POWER
    tails = [partial(_quantile, share=share) for share in _TAILS]
    if params.even == "auto" and not (
        extent >= params.min_drift
        and extent >= _MIN_CONTRAST * scale * float(np.median([block.std() for block in whole if len(block)]))
        and explained >= _MIN_EXPLAINED
        and power >= _MIN_POWER
        and (
            (light and smooth)
            or _follow(blocks, drift, tails)
            or (_follow(blocks, drift, [_trimmed_mean]) and _follow([whole], drift, tails))
        )
    ):
        return none
    return _Drift(coefficients, extent, True, smooth)


def _modes(lightness: ScalarMap, valid: Mask | None) -> list[Mask]:
    """The pixels of the two tones of an exemplar, such as stones and joints; drift moves none into the other.

    The drift is measured within each, and without it they are told apart again.
    """
    counted = np.ones(lightness.shape, bool) if valid is None else valid
    modes = [counted]
    for _ in range(_MODE_PASSES):
        blocks = [_blocks(lightness, mode) for mode in modes]
        coefficients, _levels = _fitted(_of_blocks(blocks, _trimmed_mean), _weights(blocks))
        even = lightness - _polynomial(coefficients, lightness.shape)
        bright = even > otsu_threshold(even[counted])
        modes = [counted & ~bright, counted & bright]
    return modes


def _blocks(plane: ScalarMap, counted: Mask) -> list[np.ndarray]:
    """Values of each block that count, sorted."""
    rows, columns = (np.arange(_BLOCKS + 1) * side // _BLOCKS for side in plane.shape)
    return [
        np.sort(plane[top:bottom, left:right][counted[top:bottom, left:right]].astype(np.float64))
        for top, bottom in itertools.pairwise(rows)
        for left, right in itertools.pairwise(columns)
    ]


def _weights(modes: list[list[np.ndarray]]) -> Float64[np.ndarray, "m 8 8"]:
    """How much each mode counts in each block: by its pixels, and 0 where these are few."""
    counts = np.array([[len(block) for block in blocks] for blocks in modes], np.float64)
    counts[counts < _MIN_MODE * counts.sum(axis=0).mean()] = 0
    return np.asarray(counts / max(counts.sum(axis=0).max(), 1)).reshape(-1, _BLOCKS, _BLOCKS)


def _of_blocks(
    modes: list[list[np.ndarray]], measure: Callable[[np.ndarray], float]
) -> Float64[np.ndarray, "m 8 8"]:
    """A measure of each mode in each block; 0 where it has no pixels."""
    values = [[measure(block) if len(block) else 0.0 for block in blocks] for blocks in modes]
    return np.array(values).reshape(-1, _BLOCKS, _BLOCKS)


def _quantile(values: np.ndarray, share: float) -> float:
    return float(values[round(share * (len(values) - 1))])


def _combined(
    values: Float64[np.ndarray, "m 8 8"], weights: Float64[np.ndarray, "m 8 8"]
) -> Float64[np.ndarray, "8 8"]:
    """Mean over the modes; the value of the nearest block where none counts."""
    total = weights.sum(axis=0)
    mean = (values * weights).sum(axis=0) / np.maximum(total, 1e-12)
    row, column = nearest_valid(total > 0)
    return np.asarray(mean[row, column])


def _trimmed_mean(values: np.ndarray) -> float:
    """Mean without the tails, less noisy than the median where a texture has two tones."""
    low, high = (round(share * len(values)) for share in _TAILS)
    return float(values[low : max(high, low + 1)].mean())


def _basis(shape: tuple[int, int]) -> Float64[np.ndarray, "6 h w"]:
    """Polynomials of second degree; those but the first have a mean of about 0."""
    down, across = np.meshgrid(*((2 * np.arange(side) + 1) / side - 1 for side in shape), indexing="ij")
    return np.stack([np.ones(shape), down, across, down**2 - 1 / 3, down * across, across**2 - 1 / 3])


def _fitted(
    means: Float64[np.ndarray, "m 8 8"], weights: Float64[np.ndarray, "m 8 8"]
) -> tuple[Float64[np.ndarray, "6"], np.ndarray]:
    """Coefficients of `_basis` but for the constant, which all modes share, and the level of each; robust."""
    modes = len(means)
    shared = _basis((_BLOCKS, _BLOCKS))[1:]
    basis = np.zeros((modes + len(shared), *means.shape))
    for mode in range(modes):
        basis[mode, mode] = 1
    basis[modes:] = shared[:, None]
    robust = weights
    for _ in range(_PASSES):
        weighted = basis * robust
        normal = (weighted[:, None] * basis[None]).sum(axis=(2, 3, 4))
        normal += np.diag(np.where(np.arange(len(normal)) < modes, 1e-9, 0))  # where a mode counts nowhere
        coefficients = solve(normal, (weighted * means).sum(axis=(1, 2, 3)))
        residual = means - (coefficients[:, None, None, None] * basis).sum(axis=0)
        deviation = 1.4826 * float(np.median(np.abs(residual[weights > 0]))) + 1e-9
        robust = weights / (1 + np.square(residual / (_OUTLIER * deviation)))
    return np.concatenate([[0.0], coefficients[modes:]]), np.asarray(coefficients[:modes])


def _polynomial(coefficients: Float64[np.ndarray, "6"], shape: tuple[int, int]) -> Float64[np.ndarray, "h w"]:
    """The sum of all but the constant."""
    basis = _basis(shape)
    return np.asarray((coefficients[1:, None, None] * basis[1:]).sum(axis=0))


def _power(values: Float64[np.ndarray, "8 8"]) -> float:
    """Power of the lowest spatial frequencies relative to the next ones."""
    import cv2

    power = np.square(cv2.dct(values))
    frequency = np.hypot(*np.indices(power.shape))
    low = float(power[(frequency > 0) & (frequency <= _LOW)].mean())
    return low / max(float(power[(frequency > _LOW) & (frequency <= _NEXT)].mean()), 1e-12)


def _follow(
    modes: list[list[np.ndarray]],
    drift: Float64[np.ndarray, "8 8"],
    measures: Iterable[Callable[[np.ndarray], float]],
) -> bool:
    """All measures of all modes drift in the same way; not asked of a mode that is seen in few blocks."""
    weights = _weights(modes)
    seen = np.count_nonzero(weights, axis=(1, 2)) >= _MIN_BLOCKS * _BLOCKS**2
    own = [
        _polynomial(_fitted(values[[mode]], weights[[mode]])[0], drift.shape)
        for values in (_of_blocks(modes, measure) for measure in measures)
        for mode in np.flatnonzero(seen)
    ]
    return all(float((each * drift).sum()) >= _MIN_SHARED * float(np.square(drift).sum()) for each in own)


def _field(drifts: list[_Drift], shape: tuple[int, int]) -> ToneField:
    field = np.zeros((*shape, 3), np.float32)
    for place, drift in enumerate(drifts):
        if drift.significant:
            field[..., place] = _polynomial(drift.coefficients, shape)
    return field
