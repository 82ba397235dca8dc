"""Whether a texture turns with its control map."""

import dataclasses
import logging
import math
from collections.abc import Mapping
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Float32, Float64, Int64
from pydantic import Field

from texloom.stages.analysis.control.control_direction import ControlDirectionParams, control_direction
from texloom.stages.common.features.control import check_maps, painted_values, resize_control
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.common.similarity.components import components
from texloom.stages.kernels.core.elementary_functions import cos, sin
from texloom.stages.numerics.filters import gaussian_blur, interpolated
from texloom.stages.numerics.matrices import row_product
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.tileable import Tileable

LIMIT = 0.92
"""error of neighbourhoods that turn, relative to that of those that do not, up to which a texture turns"""

_SIDE = 384  # px, the longer one, at which it is measured
_LEAST = 64  # px, the shorter one, below which parts hold too little
_PARTS = 4  # along each side; each is held out once
_HELD = 1024  # neighbourhoods that are sought, and _KNOWN in which they are
_KNOWN = 8192
_RADIUS = 6  # samples around the middle, at every second of them
_SCALES = ((1.0, 1.0), (2.5, 3.0))  # px; blur, and the distance of samples
_COMPONENTS = 24
_OTHER = 30.0  # degrees that directions differ by, at least
_FEW = 128  # neighbourhoods of other directions that must be there for one to count
_COVERED = 0.1  # of the neighbourhoods must count
_AGREEING = 0.75  # of the parts must show it
_BLUR = 1.0  # px; of control, before colours are predicted from it
_KNOTS = 32  # quantiles of control at which that is done

_Neighbourhoods: TypeAlias = Float32[np.ndarray, "n k"]


class TurningParams(Params):
    """What is decided here, and what is measured."""

    way: Literal["auto", "plain", "turned"] = "auto"
    """`plain` keeps the texture's own directions, `turned` turns it with the map, `auto` measures which suits"""
    labels: tuple[str, ...] = ("plain", "turned")
    """the ways that there are"""
    most: int = Field(2 * 1024**2, ge=1)
    """px of a texture that `auto` turns, at most, as `appearance_stack` takes"""
    tileable: Tileable = NOWHERE
    """the result is to continue across its borders, for which it is not turned here"""


@dataclasses.dataclass(frozen=True)
class Turning:
    """What was measured, and chosen."""

    table: dict[str, Any]
    """``chosen``: a list of one way, and ``because``. Measured also: ``ratio`` of the errors with and without
    turning, of which below 1 says that it turns; ``plain`` and ``turned``, these errors, squared CIELAB units;
    ``parts`` held out, and how many ``agree`` that turning helps; ``other_directions``: whether each neighbourhood
    was sought among those whose directions differ by 30 degrees or more"""


def check_pair_of_maps(params: TurningParams, known: Mapping[str, Any]) -> None:
    """Texture and control must fit each other; a tileable result cannot be turned."""
    if params.way == "turned" and params.tileable:
        raise InputError("way: turned results are not tileable here; those of the flow per_pixel_oriented are")
    check_maps({"image": known.get("texture"), "control": known.get("control")})


@stage(version=1, role="choice", check=check_pair_of_maps)
def turning(texture: Image, control: Image, params: TurningParams) -> Turning:
    """Measure whether a texture turns with its control map, as rivers, cracks and grain along a line do.

    Parts of the texture are held out in turn. Each of their neighbourhoods is sought, exhaustively, among those of
    the other parts at like control, once as it lies in the picture and once read along the directions of the
    control map. A texture that turns with its map is found again with a smaller error in the second way; one that
    keeps its directions, or is lit from one side, in the first; where directions are noise or nothing runs along
    them, both errors are alike. What control predicts by its value is taken from colours before, since that turns
    with any map. Where the picture has them, only neighbourhoods of other directions are sought among, so that
    it is turning that is measured, and not the number of neighbourhoods that serve.

    Parameters
    ----------
    texture : any channels; colour is compared, of at most 384 px a side.
    control : of any size of the same aspect ratio.

    Raises
    ------
    InputError
        control does not fit the texture, is constant or not finite; ``labels`` lack the way that is asked for.

    Examples
    --------
    >>> import numpy as np, texloom
    >>> rows, columns = np.indices((96, 96)) - 48
    >>> rings = 0.5 + 0.4 * np.sin(np.hypot(rows, columns) / 2)  # around a middle, and so is its map
    >>> control = (np.hypot(rows, columns) / 70).astype(np.float32)
    >>> texloom.stages.turning(rings.astype(np.float32), control).table["chosen"]
    ['turned']

    References
    ----------
    [Wei2008]_ section 4.2, orientation beside control. The measure is ours.
    """
    if params.way != "auto":
        if params.way not in params.labels:
            raise InputError(f"way: {params.way} is not among {', '.join(params.labels)}")
        return Turning({"chosen": [params.way], "because": "it was asked for"})
    if min(texture.height, texture.width) < _LEAST:
        return Turning({"chosen": ["plain"], "because": f"below {_LEAST} px whether it turns cannot be measured"})
    table = turning_of(texture, control)
    chosen, because = _verdict(table)
    if chosen == "turned" and (obstacle := _obstacle(texture, params)):
        chosen, because = "plain", f"{because}, but {obstacle}"
        logging.getLogger(__name__).warning(
            "the texture turns with its control map, and is not turned: %s", because
        )
    return Turning({"chosen": [chosen], "because": because, **table})


def _obstacle(texture: Image, params: TurningParams) -> str:
    """Why a texture that turns cannot be turned here, and what to do."""
    if params.tileable:
        return "a tileable result is not turned here; that of the flow per_pixel_oriented is"
    if texture.height * texture.width > params.most:
        return f"it has more than {params.most} px; --reduce 0.5 gives one that can be turned"
    return ""


def _verdict(table: Mapping[str, Any]) -> tuple[str, str]:
    """The way, and why."""
    ratio, parts, agree = table["ratio"], table["parts"], table["agree"]
    measured = f"turned with its map, parts held out are found in the rest with {ratio:.2f} times the error"
    if ratio <= LIMIT and agree >= _AGREEING * parts:
        return "turned", f"{measured}, {agree} of {parts} with less"
    if ratio <= LIMIT:
        return "plain", f"{measured}, but only {agree} of {parts} with less; --set way=turned turns it"
    if not table["other_directions"]:
        return "plain", f"{measured}; the map hardly has other directions: if it should turn, --set way=turned"
    return "plain", measured


def turning_of(texture: Image, control: Image) -> dict[str, Any]:
    """What `Turning` says was measured."""
    factor = min(1.0, _SIDE / max(texture.height, texture.width))
    height, width = (max(1, round(side * factor)) for side in (texture.height, texture.width))
    small = Image(resize(np.ascontiguousarray(texture.color), height, width), ("R", "G", "B"))
    wanted = resize_control(control, height, width)
    angle = control_direction(wanted, ControlDirectionParams()).angle
    values = np.stack(
        [gaussian_blur(np.ascontiguousarray(one), _BLUR) for one in np.moveaxis(painted_values(wanted), 2, 0)],
        axis=2,
    )
    colours = unpredicted(lab_from_linear(small.color), values)

    margin = min(int(_RADIUS * _SCALES[-1][1]) + 1, min(height, width) // 6)
    rng = np.random.default_rng(0)
    rows, columns = (rng.integers(margin, side - margin, _KNOWN) for side in (height, width))
    held = np.arange(min(_HELD, _KNOWN))
    part = rows * _PARTS // height * _PARTS + columns * _PARTS // width
    directions = angle[rows, columns]
    # turned by one angle everywhere, what lies as it is in the picture is interpolated just as much
    ways = {"plain": np.full_like(directions, 0.35), "turned": directions}
    known = {way: _read(colours, rows, columns, angles, margin) for way, angles in ways.items()}
    beside = _scaled(values[rows, columns])
    others = np.full((len(held), _KNOWN), True)
    for number in held:
        others[number] = (part != part[number]) & (
            np.maximum(np.abs(rows - rows[number]), np.abs(columns - columns[number])) > 2 * _RADIUS
        )
    turned_away = others & (_alike(directions, held) < math.cos(math.radians(_OTHER)))
    counted = turned_away.sum(axis=1) >= _FEW
    has_others = bool(counted.mean() >= _COVERED)
    if has_others:
        held, others = held[counted], turned_away[counted]
    errors = {way: _errors(rows_of, beside, held, others) for way, rows_of in known.items()}
    sums = [np.bincount(part[held], errors[way], _PARTS**2) for way in ("turned", "plain")]
    shown = np.bincount(part[held], minlength=_PARTS**2) > 0
    means = {way: float(error.mean()) for way, error in errors.items()}
    return {
        "ratio": means["turned"] / max(means["plain"], 1e-9),
        **means,
        "parts": int(shown.sum()),
        "agree": int((sums[0] < sums[1])[shown].sum()),
        "other_directions": has_others,
    }


def unpredicted(
    colours: Float32[np.ndarray, "h w 3"], control: Float32[np.ndarray, "h w k"]
) -> Float32[np.ndarray, "h w 3"]:
    """Colours less what the values of control predict, channel by channel, twice."""
    left = colours.astype(np.float64)
    for _ in range(2):
        for values in np.moveaxis(control.astype(np.float64), 2, 0):
            edges = np.unique(np.quantile(values, np.linspace(0, 1, _KNOTS + 1)))
            if len(edges) < 2:
                continue
            cells = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2).ravel()
            count = np.maximum(np.bincount(cells, minlength=len(edges) - 1), 1)
            knots = np.bincount(cells, values.ravel(), len(edges) - 1) / count
            for channel in range(left.shape[2]):
                means = np.bincount(cells, left[..., channel].ravel(), len(edges) - 1) / count
                left[..., channel] -= np.interp(values, knots, means)
    return np.ascontiguousarray(left, np.float32)


def _scaled(values: Float32[np.ndarray, "n k"]) -> Float64[np.ndarray, "n k"]:
    """Control in units of its standard deviation, all channels together."""
    spread = np.sqrt(values.astype(np.float64).var(axis=0).sum())
    return np.asarray(values / max(float(spread), 1e-9), np.float64)


def _read(
    colours: Float32[np.ndarray, "h w 3"],
    rows: Int64[np.ndarray, "n"],  # type: ignore[name-defined]
    columns: Int64[np.ndarray, "n"],  # type: ignore[name-defined]
    angles: Float32[np.ndarray, "n"],  # type: ignore[name-defined]
    margin: int,
) -> _Neighbourhoods:
    """Neighbourhoods of two scales read along ``angles``, a row each."""
    steps = np.arange(-_RADIUS, _RADIUS + 1, 2)
    down, along = (part.ravel() for part in np.meshgrid(steps, steps, indexing="ij"))
    inside = down**2 + along**2 <= _RADIUS**2 + 1
    down, along = down[inside], along[inside]
    sine, cosine = sin(angles)[:, None], cos(angles)[:, None]
    parts = []
    for blur, step in _SCALES:
        reach = min(step, (margin - 1) / _RADIUS)
        at = (
            rows[:, None] + reach * (along * sine + down * cosine),
            columns[:, None] + reach * (along * cosine - down * sine),
        )
        parts.append(interpolated(gaussian_blur(colours, blur), *at).reshape(len(rows), -1))
    return np.asarray(np.concatenate(parts, axis=1), np.float32)


def _alike(angles: Float32[np.ndarray, "n"], held: Int64[np.ndarray, "m"]) -> np.ndarray:  # type: ignore[name-defined]
    """Cosines between the directions of some places and all."""
    unit = np.stack([cos(angles), sin(angles)], axis=1).astype(np.float32)
    return row_product(unit[held], np.ascontiguousarray(unit.T))


def _errors(
    known: _Neighbourhoods,
    control: Float64[np.ndarray, "n c"],
    held: Int64[np.ndarray, "m"],  # type: ignore[name-defined]
    others: np.ndarray,
) -> Float64[np.ndarray, "m"]:  # type: ignore[name-defined]
    """Of each neighbourhood that is held out, to the nearest of ``others``, (m, n); squared units of a sample.

    Neighbourhoods are compared by their components and by control, which weighs as much as colours do.
    """
    samples = known.shape[1] / 3
    mean, basis = components(known, _COMPONENTS)
    vectors = row_product(known - mean, basis) / np.sqrt(samples)
    strength = np.sqrt(vectors.var(axis=0).sum())
    vectors = np.concatenate([vectors, strength * control], axis=1)
    lengths = np.square(vectors).sum(axis=1)
    distances = lengths - 2 * row_product(vectors[held], np.ascontiguousarray(vectors.T))
    nearest = np.where(others, distances, np.inf).argmin(axis=1)
    return np.asarray(np.square(known[held].astype(np.float64) - known[nearest]).sum(axis=1) / samples, np.float64)
