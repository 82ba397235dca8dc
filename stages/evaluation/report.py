"""The page that a person reads about one result."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Image, Mask, Page, ScalarMap, Vectors
from texloom.stages.color import srgb_from_linear
from texloom.stages.common.maps import map_channels
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.evaluation._pages import page as _page
from texloom.stages.evaluation._pages import plots
from texloom.stages.normals import NORMAL


class ReportParams(Params):
    """What the page shows."""

    title: str = "Texture report"
    """what stands above"""
    largest: int = Field(2048, ge=16, le=16383)
    """longest side of the pictures in the page, px; larger ones are reduced"""


@dataclasses.dataclass(frozen=True)
class Report:
    """The page."""

    page: Page
    """all pictures are inside; it needs no network"""


def lattice_path(generators: Vectors, height: int, width: int) -> str:
    """The lines of a lattice through the middle of a picture, as the path of an SVG whose units are px.

    Empty where there is no lattice. Lines go beyond the picture.
    """
    if len(generators) < 2:
        return ""
    pair = generators[:2].astype(np.float64)
    middle = np.array([height, width]) / 2
    reach = float(np.hypot(height, width))
    lines = []
    for along, across in (pair, pair[::-1]):
        length = float(np.hypot(*along))
        spacing = abs(float(along[0] * across[1] - along[1] * across[0])) / max(length, 1e-9)
        if spacing < 1:  # px; not a lattice that can be drawn
            return ""
        for step in range(-int(reach / 2 / spacing), int(reach / 2 / spacing) + 1):
            normal = np.array([-along[1], along[0]]) / length
            foot = middle + step * spacing * normal
            ends = [foot + sign * reach * along / length for sign in (-1, 1)]
            lines.append("M" + "L".join(f"{column:.1f} {row:.1f}" for row, column in ends))
    return "".join(lines)


def _channels(exemplar: Image, image: Image, largest: int) -> list[dict[str, Any]]:
    """Each map of a material besides its colour, the exemplar's beside the result's."""
    theirs = map_channels(exemplar.channels)
    found: list[dict[str, Any]] = []
    for name, places in map_channels(image.channels).items():
        if len(places) not in (1, 3):
            continue
        pair = [exemplar.pixels[..., theirs[name]]] if name in theirs else []
        pair.append(image.pixels[..., places])
        low, high = 0.0, 1.0
        what = "From 0, black, to 1, white."
        if tuple(image.channels[place] for place in places) == NORMAL:
            low, what = -1.0, "X right, Y up, Z towards the viewer, as red, green and blue from -1 to 1."
        elif name == "emissive" and len(places) == 3:
            pair, what = [_encoded(values) for values in pair], "Light, in sRGB."
        elif pair[0].min() < 0 or pair[0].max() > 1:
            low, high = float(pair[0].min()), float(pair[0].max())
            what = f"From {low:.3g}, black, to {high:.3g}, white."
        shown = [_page.shown_levels(_from_to(values, low, high), largest) for values in pair]
        found.append(
            {
                "name": name,
                "title": name[:1].upper() + name[1:],
                "what": what,
                "exemplar": shown[0] if len(shown) == 2 else None,
                "image": shown[-1],
            }
        )
    return found


def _encoded(values: np.ndarray) -> np.ndarray:
    return np.asarray(srgb_from_linear(values))


def _from_to(values: np.ndarray, low: float, high: float) -> np.ndarray:
    return np.asarray((values - np.float32(low)) / np.float32(high - low), np.float32)


def _maps(
    field: ScalarMap | None, mask: Mask | None, occurrence: ScalarMap | None, largest: int
) -> list[dict[str, Any]]:
    """The maps over the exemplar with what their colours mean."""
    maps: list[dict[str, Any]] = []
    if mask is not None:
        maps.append(
            {
                "name": "Structure",
                "what": "White: features.",
                "shown": _page.shown_mask(mask, largest),
                "ends": None,
            }
        )
    if field is not None:
        finite = np.abs(field[np.isfinite(field)])
        reach = float(finite.max()) if finite.size and finite.max() > 0 else 1.0
        maps.append(
            {
                "name": "Guidance",
                "what": "Signed distance to the features' borders; negative inside.",
                "shown": _page.shown_field(field, 0.0, reach, largest),
                "ends": (-reach, 0.0, reach),
            }
        )
    if occurrence is not None:
        maps.append(
            {
                "name": "Occurrence",
                "what": f"How often the result uses each pixel; 1 is even use, {occurrence.max():.3g} the most.",
                "shown": _page.shown_field(occurrence, 1.0, 1.0, largest),
                "ends": (0.0, 1.0, "2 and more"),
            }
        )
    return maps


def measure_groups(table: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The lines of a table of measures by axis, each axis with its mean score; see `metrics`."""
    summary = table.get("summary") or {}
    groups: dict[str, dict[str, Any]] = {}
    for name, line in (table.get("measures") or {}).items():
        axis = str(line.get("axis", ""))
        group = groups.setdefault(axis, {"axis": axis, "score": summary.get(axis), "lines": []})
        known = {key: line.get(key) for key in ("what", "value", "floor", "ceiling", "score", "reason")}
        group["lines"].append({"name": name, **known, "more": line.get("more") or {}})
    return list(groups.values())


@stage(version=1)
def report(
    exemplar: Image,
    image: Image,
    table: dict[str, Any],
    params: ReportParams,
    field: ScalarMap | None = None,
    mask: Mask | None = None,
    generators: Vectors | None = None,
    occurrence: ScalarMap | None = None,
    scales: list[dict[str, Any]] | None = None,
    regularity: dict[str, Any] | None = None,
    preview: Image | None = None,
    provenance: Sequence[Mapping[str, Any]] = (),
) -> Report:
    """Put on one page what a person needs to judge a result and to make it again.

    Parameters
    ----------
    exemplar, image : the texture and the result; their colour is shown, and each map besides it of one plane or
        three, without loss unless reduced.
    table, regularity : measures and scores as `metrics` gives them.
    field : signed distance to features, of the exemplar's size; see `signed_distance`.
    mask : the features.
    generators : the exemplar's lattice, px; none or no rows where it has none.
    occurrence, scales : use of the exemplar and course of the optimisation; see `optimise`.
    preview : the material under a light; see `lit_preview`.
    provenance : the steps upstream.

    Raises
    ------
    InputError : a map is not of the exemplar's size.
    """
    size = (exemplar.height, exemplar.width)
    for name, plane in (("field", field), ("mask", mask), ("occurrence", occurrence)):
        if plane is not None and plane.shape != size:
            raise InputError(f"{name} is {plane.shape[0]}x{plane.shape[1]} px, the exemplar {size[0]}x{size[1]}")
    maps = _maps(field, mask, occurrence, params.largest)
    tables = [("Measures", measure_groups(table))]
    if regularity:
        tables.append(("Regularity", measure_groups(regularity)))
    page = _page.render(
        __file__,
        title=params.title,
        exemplar=_page.shown(exemplar, params.largest),
        image=_page.shown(image, params.largest),
        lattice="" if generators is None else lattice_path(generators, *size),
        generators=None if generators is None else generators[:2].tolist(),
        channels=_channels(exemplar, image, params.largest),
        preview=None if preview is None else _page.shown(preview, max(params.largest, preview.width), 90),
        maps=maps,
        legend=_page.legend_colors() if maps else [],
        energies=plots.energies(scales or []),
        tables=tables,
        steps=_page.steps(provenance),
    )
    return Report(page)
