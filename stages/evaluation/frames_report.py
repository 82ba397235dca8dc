"""The page of a compacted frame stack: strips of its frames, and animations."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.common.grids.size_checks import check_same_size
from texloom.stages.common.similarity.patch_distance import blurred
from texloom.stages.evaluation._pages import page
from texloom.stages.evaluation._pages.curve import energy_curve
from texloom.stages.evaluation._pages.gathered import measures_of
from texloom.stages.vocabulary.arrays import Image, Page
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.frame_stacks import frames_of


class FramesReportParams(Params):
    """What the page shows."""

    title: str = "Compaction of a frame stack"
    """heading of the page"""
    frames: int = Field(8, ge=2, le=64)
    """frames of a strip, evenly spread from the first to the last"""
    largest: int = Field(256, ge=16, le=4096)
    """longest side of a picture in the page, px; larger ones are reduced"""
    blur: float = Field(2.0, ge=0.3, le=50)
    """standard deviation of the blur before frames are compared, px"""


@dataclasses.dataclass(frozen=True)
class FramesReport:
    """The page."""

    page: Page
    """with all pictures inside; it needs no network"""
    differences: list[dict[str, Any]]
    """for each ``frame`` its number, and the mean ``distance`` of the pixels of reconstruction and texture, both
    blurred, CIELAB units"""


@stage(version=1)
def frames_report(
    texture: Image,
    compaction: Image,
    reconstruction: Image,
    energy: list[dict[str, Any]],
    table: dict[str, Any],
    params: FramesReportParams,
    provenance: Sequence[Mapping[str, Any]] = (),
) -> FramesReport:
    """Show the frames of a texture, of its compaction, and of the texture made again from that.

    Parameters
    ----------
    texture, compaction, reconstruction : frame stacks of as many frames.
    energy : the rounds of the compaction, see `compact`.
    table : of `summary_scores`.
    provenance : the steps upstream.

    Raises
    ------
    InputError
        numbers of frames differ; the reconstruction has not the texture's size; there are no scores.
    """
    check_same_size(reconstruction, "reconstruction", texture, "texture")
    stacks = {
        "texture": frames_of(texture), "compaction": frames_of(compaction),
        "reconstruction": frames_of(reconstruction),
    }  # fmt: skip
    counts = {name: len(frames) for name, frames in stacks.items()}
    if len(set(counts.values())) > 1:
        raise InputError(f"stacks of different lengths: {counts}")
    pairs = zip(stacks["texture"], stacks["reconstruction"], strict=True)
    distances = [_distance(one, other, params.blur) for one, other in pairs]
    numbers = sorted({round(at) for at in np.linspace(0, len(distances) - 1, params.frames)})
    rows = [
        {
            "name": name,
            "height": frames[0].height,
            "width": frames[0].width,
            "animation": page.shown_frames(frames, params.largest),
            "strip": [page.shown(frames[number], params.largest) for number in numbers],
        }
        for name, frames in stacks.items()
    ]
    made = page.render(
        page.template_of(__file__),
        params.title,
        provenance,
        is_titled=params.title != FramesReportParams().title,
        count=len(distances),
        rows=rows,
        numbers=[{"number": number + 1, "distance": distances[number]} for number in numbers],
        lines=measures_of(table, "table") or {},
        curve=energy_curve(energy),
    )
    differences = [{"frame": number, "distance": distance} for number, distance in enumerate(distances, 1)]
    return FramesReport(made.page, differences)


def _distance(one: Image, other: Image, blur: float) -> float:
    planes = [blurred(lab_from_linear(image.color), blur) for image in (one, other)]
    return float(np.sqrt(((planes[0] - planes[1]) ** 2).sum(axis=2)).mean())
