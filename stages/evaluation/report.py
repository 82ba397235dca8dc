"""The page that a person reads about one result."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import Field as Knob

from stages.arrays import Field, Image, Mask, Page, Vectors
from stages.declare import InputError, Params, stage
from stages.evaluation import _page, _plots


class ReportParams(Params):
    """What the page shows."""

    title: str = "Texture report"
    """what stands above"""
    largest: int = Knob(2048, ge=16, le=16383)
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


def _maps(field: Field | None, mask: Mask | None, occurrence: Field | None, largest: int) -> list[dict[str, Any]]:
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
    field: Field | None = None,
    mask: Mask | None = None,
    generators: Vectors | None = None,
    occurrence: Field | None = None,
    scales: list[dict[str, Any]] | None = None,
    regularity: dict[str, Any] | None = None,
    provenance: Sequence[Mapping[str, Any]] = (),
) -> Report:
    """Put on one page what a person needs to judge a result and to make it again.

    Parameters
    ----------
    exemplar, image : the texture and the result; their colour is shown, without loss unless it is reduced.
    table, regularity : measures and scores as `metrics` gives them.
    field : signed distance to features, of the exemplar's size; see `signed_distance`.
    mask : the features.
    generators : the exemplar's lattice, px; none or no rows where it has none.
    occurrence, scales : use of the exemplar and course of the optimisation; see `optimise`.
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
        "report.html",
        title=params.title,
        exemplar=_page.shown(exemplar, params.largest),
        image=_page.shown(image, params.largest),
        lattice="" if generators is None else lattice_path(generators, *size),
        generators=None if generators is None else generators[:2].tolist(),
        maps=maps,
        legend=_page.legend_colors() if maps else [],
        energies=_plots.energies(scales or []),
        tables=tables,
        steps=_page.steps(provenance),
    )
    return Report(page)
