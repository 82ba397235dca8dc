"""The page that a person reads about one result."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Image, Mask, ScalarMap, Vectors
from texloom.stages.color import srgb_from_linear
from texloom.stages.common.maps import map_channels
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.evaluation._pages import page, plots
from texloom.stages.normals import NORMAL


class ReportParams(Params):
    """What the page shows."""

    title: str = "Texture report"
    """heading of the page"""
    largest: int = Field(2048, ge=16, le=16383)
    """longest side of the pictures in the page, px; larger ones are reduced"""


@stage(version=1)
def report(
    exemplar: Image,
    image: Image,
    table: dict[str, Any],
    params: ReportParams,
    distance: ScalarMap | None = None,
    structure: Mask | None = None,
    generators: Vectors | None = None,
    occurrence: ScalarMap | None = None,
    scales: list[dict[str, Any]] | None = None,
    regularity: dict[str, Any] | None = None,
    preview: Image | None = None,
    provenance: Sequence[Mapping[str, Any]] = (),
) -> page.ReportPage:
    """Show on one page what a person needs to judge a result and to make it again.

    Parameters
    ----------
    exemplar, image : the texture and the result; shown are their colour and each other map of one or three planes,
        lossless unless reduced.
    table, regularity : tables of `metrics` and `regularity`.
    distance : signed distance to features, of the exemplar's size; see `signed_distance`.
    structure : the features; see `otsu`.
    generators : the exemplar's lattice, px; no rows where it has none.
    occurrence, scales : use of the exemplar and course of the optimisation; see `optimise`.
    preview : the material under a light; see `lit_preview`.
    provenance : the steps upstream.

    Raises
    ------
    InputError : a map is not of the exemplar's size.
    """
    size = (exemplar.height, exemplar.width)
    for name, plane in (("distance", distance), ("structure", structure), ("occurrence", occurrence)):
        if plane is not None and plane.shape != size:
            raise InputError(f"{name} is {plane.shape[0]}x{plane.shape[1]} px, the exemplar {size[0]}x{size[1]}")
    largest = params.largest
    return page.render(
        __file__,
        params.title,
        provenance,
        exemplar=page.shown(exemplar, largest),
        image=page.shown(image, largest),
        lattice="" if generators is None else lattice_path(generators, *size),
        generators=None if generators is None else generators[:2].tolist(),
        channels=_channels(exemplar, image, largest),
        preview=None if preview is None else page.shown(preview, max(largest, preview.width), 90),
        maps=_maps(structure, distance, occurrence, largest),
        energies=plots.energies(scales or []),
        tables=[_measures("Measures", table), *([_measures("Regularity", regularity)] if regularity else [])],
    )


def _maps(
    structure: Mask | None, distance: ScalarMap | None, occurrence: ScalarMap | None, largest: int
) -> list[dict[str, Any]]:
    """What is known of the exemplar's pixels; ``ends`` are the values at the ends of the colour scale."""
    maps: list[dict[str, Any]] = []
    if structure is not None:
        shown = page.shown_structure(structure, largest)
        maps.append({"name": "Structure", "what": "White: features.", "shown": shown, "ends": None})
    if distance is not None:
        finite = np.abs(distance[np.isfinite(distance)])
        reach = float(finite.max()) if finite.size and finite.max() > 0 else 1.0
        what = "Signed distance to the borders of the features, px; negative inside."
        shown = page.shown_field(distance, 0.0, reach, largest)
        maps.append({"name": "Guidance", "what": what, "shown": shown, "ends": (-reach, reach)})
    if occurrence is not None:
        what = f"How often the result uses each pixel; 1 is even use, {occurrence.max():.3g} the maximum."
        shown = page.shown_field(occurrence, 1.0, 1.0, largest)
        maps.append({"name": "Occurrence", "what": what, "shown": shown, "ends": (0.0, "2 and more")})
    return maps


def _channels(exemplar: Image, image: Image, largest: int) -> list[dict[str, Any]]:
    """Each map of a material besides its colour, the exemplar's beside the result's."""
    in_exemplar = map_channels(exemplar.channels)
    channels: list[dict[str, Any]] = []
    for name, places in map_channels(image.channels).items():
        if len(places) not in (1, 3):
            continue
        maps = [exemplar.pixels[..., in_exemplar[name]]] if name in in_exemplar else []
        maps.append(image.pixels[..., places])
        if tuple(image.channels[place] for place in places) == NORMAL:
            what = "X right, Y up, Z towards the viewer, as red, green and blue from -1 to 1."
            maps = [_from_to(values, -1.0, 1.0) for values in maps]
        elif name == "emissive" and len(places) == 3:
            what = "Light, in sRGB."
            maps = [np.asarray(srgb_from_linear(values)) for values in maps]
        else:
            low, high = 0.0, 1.0
            if maps[0].min() < 0 or maps[0].max() > 1:
                low, high = float(maps[0].min()), float(maps[0].max())
            what = f"From {low:.3g}, black, to {high:.3g}, white."
            maps = [_from_to(values, low, high) for values in maps]
        shown = [page.shown_levels(values, largest) for values in maps]
        ours = {"exemplar": shown[0] if len(shown) == 2 else None, "image": shown[-1]}
        channels.append({"name": name, "title": name[:1].upper() + name[1:], "what": what, **ours})
    return channels


def _from_to(values: np.ndarray, low: float, high: float) -> np.ndarray:
    return np.asarray((values - np.float32(low)) / np.float32(high - low), np.float32)


def _measures(title: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """The lines of a table of measures by axis, each axis with its mean score; see `metrics`.

    Where nothing could be measured, for one reason, ``reason`` is all that is shown.
    """
    summary = table.get("summary") or {}
    measures: Mapping[str, Mapping[str, Any]] = table.get("measures") or {}
    groups: dict[str, dict[str, Any]] = {}
    for name, line in measures.items():
        axis = line.get("axis", "")
        group = groups.setdefault(axis, {"axis": axis, "score": summary.get(axis), "lines": []})
        known = {key: line.get(key) for key in ("what", "value", "floor", "ceiling", "score", "reason")}
        group["lines"].append({"name": name, **known, "more": line.get("more") or {}})
    reasons = {line.get("reason") if line.get("value") is None else None for line in measures.values()}
    reason = reasons.pop() if len(reasons) == 1 else None
    return {"title": title, "groups": [] if reason else list(groups.values()), "reason": reason}


def lattice_path(generators: Vectors, height: int, width: int) -> str:
    """The lines of a lattice through the centre of a picture as an SVG path in px; empty without a lattice."""
    if len(generators) < 2:
        return ""
    pair = generators[:2].astype(np.float64)
    centre = np.array([height, width]) / 2
    reach = float(np.hypot(height, width))
    lines = []
    for along, across in (pair, pair[::-1]):
        length = float(np.hypot(*along))
        spacing = abs(float(along[0] * across[1] - along[1] * across[0])) / max(length, 1e-9)
        if spacing < 1:  # px; too dense to draw
            return ""
        for step in range(-int(reach / 2 / spacing), int(reach / 2 / spacing) + 1):
            normal = np.array([-along[1], along[0]]) / length
            foot = centre + step * spacing * normal
            ends = [foot + sign * reach * along / length for sign in (-1, 1)]
            lines.append("M" + "L".join(f"{column:.1f} {row:.1f}" for row, column in ends))
    return "".join(lines)
