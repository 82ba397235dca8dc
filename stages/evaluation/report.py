"""The page that a person reads about one result."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.features.maps import map_channels
from texloom.stages.common.source_maps.places import worst_places
from texloom.stages.evaluation._pages import page, plots
from texloom.stages.kernels.core.threads import run_all
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.color import srgb_from_linear
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.normals import NORMAL
from texloom.stages.vocabulary.sizes import format_size


class ReportParams(Params):
    """What the page shows."""

    title: str = ""
    """heading of the page; the picture's name if not given"""
    largest: int = Field(2048, ge=16, le=16383)
    """longest side of the pictures in the page, px; larger ones are reduced"""
    places: int = Field(6, ge=0, le=99)
    """how many of the worst places of the result are shown"""


_PORTRAIT = 208  # px
_CROP = 96  # px; side of the surroundings that are shown of a place

_BLIND = {
    "colors": "where the colours are.",
    "patches": "faults in few places, and structure larger than 56 px.",
    "statistics": "broken or merged objects whose edges look natural.",
    "autocorrelation": "faults in few places, and whatever does not repeat.",
    "coherence": "right pieces in a wrong arrangement, and faults in few places.",
    "completeness": "how often each part of the exemplar is used.",
    "sharpness": "whether the detail is the right one; noise counts as detail.",
    "smoothness": "where the smooth parts are.",
    "continuity": "whether a joint is visible.",
    "repetition": "single objects that occur again at irregular distances.",
    "copies": "whether copies of a part are next to each other.",
    "contents": "how often what is shown is repeated.",
    "copying": "whether the pieces fit together.",
    "joints": "faults without a joint, and joints less bad than the worst tenth.",
    "straightness": "bends of single lines, and lines in other directions than most.",
    "steps": "faults without a joint, and objects fused where their tones are alike.",
    "seams": "faults away from the border.",
    "recall": "faults inside of cells.",
    "geometry": "cells that are missing.",
    "appearance": "whether cells are in the right places.",
    "period": "faults in few places.",
}
"""what each measure cannot detect"""


@stage(version=1, in_bands=True)
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
    joints: Float32[np.ndarray, "H W"] | None = None,
    one_off: dict[str, Any] | None = None,
    one_off_picture: Image | None = None,
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
    generators : the exemplar's lattice, px, two rows; one row, at right angles to its courses; no rows where it has
        neither.
    occurrence, scales : use of the exemplar and course of the optimisation; see `optimise`.
    preview : the material under a light; see `lit_preview`.
    joints : how unlike the exemplar the result is at each pixel, see `metrics`. Its worst places are shown.
    one_off, one_off_picture : what the exemplar shows once, and it with that tinted; see `one_off_parts`.
    provenance : the steps upstream.

    Raises
    ------
    InputError : a map is not of the exemplar's or the result's size.
    """
    size = (exemplar.height, exemplar.width)
    for name, plane in (("distance", distance), ("structure", structure), ("occurrence", occurrence)):
        if plane is not None and plane.shape != size:
            raise InputError(f"{name} is {format_size(plane.shape)}, the exemplar {format_size(size)}")
    if joints is not None and joints.shape != image.shape[:2]:
        raise InputError(f"joints is {format_size(joints.shape)}, the result {format_size(image)}")
    largest = params.largest
    tables = [_measures("Scores", table), *([_measures("Regularity", regularity)] if regularity else [])]
    seams = (table.get("measures") or {}).get("seams") or {}
    view = page.overview(image)
    ours, template, maps, theirs, portrait, energies = run_all(
        lambda made: made(),
        [
            (partial(page.shown, view, largest),),  # slowest first: they run in parallel
            (partial(page.template_of, __file__),),
            (partial(_maps, structure, distance, occurrence, largest),),
            (partial(page.shown, exemplar, largest),),
            (partial(page.shown, view, _PORTRAIT, 85),),
            (partial(plots.energies, scales or []),),
        ],
    )
    color = {"name": "color", "title": "Colour", "what": "", "image": ours, "exemplar": theirs}
    pairs = [color, *_channels(exemplar, view, largest)]
    for pair in pairs:  # the view may be smaller than the result
        pair["image"] = dataclasses.replace(pair["image"], height=image.height, width=image.width)
    return page.render(
        template,
        params.title or "Texture report",
        provenance,
        is_titled=bool(params.title),
        portrait=portrait,
        exemplar=exemplar,
        image=image,
        pairs=pairs,
        lattice="" if generators is None else lattice_path(generators, *size),
        generators=None if generators is None else (generators[:2].round(1) + 0).tolist(),  # + 0: no -0.0
        is_tileable=seams.get("value") is not None,
        places=[] if joints is None else worst_places(joints, params.places, _CROP // 2),
        place_side=_CROP,
        preview=None if preview is None else page.shown(preview, max(largest, preview.width), 90),
        one_off=(one_off or {}).get("why") or "",
        once=page.shown(one_off_picture, largest, 90),
        maps=maps,
        energies=energies,
        tables=[shown for shown in tables if shown["groups"]],
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
        channels.append(
            {
                "name": name,
                "title": name.upper() if name == "ao" else name[:1].upper() + name[1:],
                "what": what,
                **ours,
            }
        )
    return channels


def _from_to(values: np.ndarray, low: float, high: float) -> np.ndarray:
    return np.asarray((values - np.float32(low)) / np.float32(high - low), np.float32)


def _measures(title: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """The lines of a table of measures by axis with its worst score, and the names without a score by reason."""
    summary = table.get("summary") or {}
    groups: dict[str, dict[str, Any]] = {}
    unscored: dict[str, list[str]] = {}
    for name, line in (table.get("measures") or {}).items():
        known = {
            key: line.get(key) for key in ("what", "value", "floor", "ceiling", "score", "reason", "estimated")
        }
        shown = {"name": name, **known, "more": line.get("more") or {}, "blind": _BLIND.get(name)}
        if line.get("score") is None:
            unscored.setdefault(line.get("reason") or "no value", []).append(name)
        else:
            axis = line.get("axis", "")
            group = groups.setdefault(axis, {"axis": axis, "score": summary.get(axis), "lines": []})
            group["lines"].append(shown)
    return {
        "title": title,
        "groups": list(groups.values()),
        "unscored": unscored,
        "estimated": any(line["estimated"] for group in groups.values() for line in group["lines"]),
        "notes": table.get("notes") or [],
        "limits": table.get("limits") or [],
    }


def lattice_path(generators: Vectors, height: int, width: int) -> str:
    """The lines of a lattice through the centre of a picture as an SVG path in px; empty without a lattice.

    One generator is at right angles to courses, whose borders are drawn.
    """
    if not len(generators):
        return ""
    pair = generators[:2].astype(np.float64)
    courses = len(pair) == 1
    if courses:
        pair = np.array([[-pair[0, 1], pair[0, 0]], pair[0]])
    centre = np.array([height, width]) / 2
    reach = float(np.hypot(height, width))
    lines = []
    for along, across in (pair,) if courses else (pair, pair[::-1]):
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
