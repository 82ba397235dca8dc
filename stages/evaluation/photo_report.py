"""A page about the texture of a photograph: what was decided, by what, and the option that changes it."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import Field

from texloom.stages.analysis.photographs.other_plane import other_plane
from texloom.stages.evaluation._pages import page
from texloom.stages.vocabulary.arrays import Image, Page, Vectors
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.masks import valid_pixels
from texloom.stages.vocabulary.sizes import format_size

_FEW = 0.5  # share of the exemplar that is usable
_DECIDE = "--set geometry=my.yaml, --source mask=foreign.png, or --set unlike=1000"
_SMALL = 128  # px of an exemplar's shorter side


class PhotoReportParams(Params):
    """What the page shows."""

    largest: int = Field(1536, ge=16, le=16383)
    """longest side of the pictures in the page, px; larger ones are reduced"""
    quality: int = Field(90, ge=1, le=100)
    """of the lossy compression of pictures"""


@dataclasses.dataclass(frozen=True)
class PhotoReport:
    """The decisions, as a table and on a page."""

    table: dict[str, list[dict[str, str]]]
    """``decisions``: ``what``, ``decided`` and ``change``, the option that changes it, of each"""
    page: Page
    """with all pictures inside; it needs no network"""


@stage(version=1)
def photo_report(
    planes: Image,
    surface: dict[str, Any],
    distortion: float,
    exemplar: Image,
    generators: Vectors,
    image: Image,
    table: dict[str, Any],
    params: PhotoReportParams,
    foreign: dict[str, Any] | None = None,
    masked: Image | None = None,
    level: dict[str, Any] | None = None,
    whole: dict[str, Any] | None = None,
    fitted: dict[str, Any] | None = None,
    light: dict[str, Any] | None = None,
    provenance: Sequence[Mapping[str, Any]] = (),
) -> PhotoReport:
    """Show what was decided on the way from a photograph to a texture, and how to decide otherwise.

    Parameters
    ----------
    planes, surface : picture and table of `plane_proposal`.
    distortion : see `lens_distortion`.
    exemplar : the surface from the front.
    generators : of its repetition, see `lattice_selection`.
    image : the texture.
    table : its scores, see `metrics`.
    foreign, masked : table and picture of `foreign_parts`, where these were searched.
    level : table of `level_surface`, where that was tried.
    whole : table of `between_joints`, where whole periods were searched.
    fitted : table of `fitted_cells`, where cells were fitted to a size.
    light : what was found of the light, see `delight`.
    provenance : the steps upstream.

    References
    ----------
    Ours.
    """
    valid = valid_pixels(exemplar)
    usable = 1.0 if valid is None else float(valid.mean())
    size = f"{format_size(exemplar)}, of which {usable:.0%} are usable"
    if usable < _FEW or min(exemplar.height, exemplar.width) < _SMALL:
        size += ": little, so that the texture repeats itself"
    repetition = ("none is clear", "in one direction", "in two directions")[len(generators)]
    if len(generators):
        repetition += f", {' and '.join(f'{row:.1f} down, {column:.1f} across' for row, column in generators)} px"
    lens = f"{distortion:.3f}, straightened" if distortion else "none is clear"
    another = [f"{option}, by planes.png"] if (option := other_plane(surface)) else []
    ways = another + ["--set plane=0 for the photograph as it is"] * bool(surface["taken"])
    rows = [
        ("lens distortion", lens, "--set distortion=0, or another value"),
        ("surface", surface["why"], ", or ".join([*ways, "--set geometry=my.yaml"])),
        (
            "exemplar",
            size,
            "--set detail=0.15 for a finer one, --set front.blur=3 for more of the surface",
        ),
        ("light", _light(light), "--set light.strength=0 for the light as it is, 1 for all that may be shadow"),
        ("repetition", repetition, "--set lattice.confidence=0.3, or 1 for none"),
        ("texture", format_size(image), "--size 2048, --tileable=off, --seed 8, --preset fast"),
    ]
    if foreign is not None:
        why = foreign["why"].partition("; edit ")[0]
        rows.insert(
            3, ("foreign parts", why, "--source mask=foreign.png, edited, or --set unlike=1000 to keep all")
        )
    doubts = [table["doubt"] for table in (surface, foreign or {}) if table.get("doubt")]
    rows[2:2] = [("doubt", doubt, ", ".join([*another, _DECIDE])) for doubt in doubts]
    for what, step, change in (
        ("rows and columns", level, "--set level=false to leave them"),
        ("whole periods", whole, "--set whole=false to keep all"),
        ("scale", fitted, "--set fit=false to cut cells instead"),
    ):
        if step is not None and step["why"]:
            rows.insert(-3, (what, step["why"].partition(" (--set")[0], change))
    decisions = [dict(zip(("what", "decided", "change"), row, strict=True)) for row in rows]
    shown = {
        name: page.shown(picture, params.largest, params.quality)
        for name, picture in (("planes", planes), ("exemplar", exemplar), ("masked", masked), ("texture", image))
        if picture is not None
    }
    made = page.render(
        page.template_of(__file__),
        "Texture of a photograph",
        provenance,
        False,
        decisions=decisions,
        shown=shown,
        scores=table["summary"],
    )
    return PhotoReport({"decisions": decisions}, made.page)


def _light(table: dict[str, Any] | None) -> str:
    found = [row["why"] for row in table["found"]] if table else []
    return "; ".join(found) or "no shadow is clear"
