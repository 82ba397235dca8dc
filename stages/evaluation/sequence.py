"""Texture sequences: a result becomes the exemplar of the next one, again and again."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import pydantic
from pydantic import Field

from texloom.stages.analysis.edges import EdgesParams, edges
from texloom.stages.analysis.guidance_weight import GuidanceWeightParams, guidance_weight
from texloom.stages.analysis.lattice import LatticeParams, lattice
from texloom.stages.analysis.offset_statistics import OffsetStatisticsParams, offset_statistics
from texloom.stages.analysis.otsu import OtsuParams, otsu
from texloom.stages.analysis.signed_distance import signed_distance
from texloom.stages.arrays import Correspondence, Image
from texloom.stages.checkpoints import Checkpoints, NoCheckpoints
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.evaluation._measures.table import rounded
from texloom.stages.evaluation._pages.gathered import mean_of
from texloom.stages.evaluation.metrics import MetricsParams, metrics
from texloom.stages.evaluation.regularity import RegularityParams, regularity
from texloom.stages.progress import Progress, part, report
from texloom.stages.sizes import Size
from texloom.stages.synthesis import initialise as start
from texloom.stages.synthesis import optimise as optimisation
from texloom.stages.synthesis.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimise import OptimiseParams, optimise

_GAP = 8  # px of white between pictures of the strip
_READ, _STARTED, _OPTIMISED = 0.05, 0.08, 0.85  # shares of a generation's time that have passed; then it is judged


class SequenceParams(Params):
    """How far the sequence goes."""

    generations: int = Field(5, ge=1, le=100)
    """how often a result is made; the first few are the same however many follow"""
    preset: Literal["kaspar2015", "default", "fast"] = "default"
    """the optimisation's preset, see `optimise`"""
    size: Size | None = None
    """height and width of every result, px; null: those of the exemplar"""


@dataclasses.dataclass(frozen=True)
class SequenceGeneration:
    """The state after a generation, from which the next one goes on."""

    last: Image
    """the generation's result"""
    match: Correspondence
    """the pixel of the first exemplar under each of its pixels"""
    strip: Image
    """see `Sequence`"""
    lines: list[dict[str, Any]]
    """what is known of each generation so far"""


@dataclasses.dataclass(frozen=True)
class Sequence:
    """The generations and how good they are."""

    last: Image
    """the result of the last generation"""
    match: Correspondence
    """the pixel of the first exemplar under each pixel of ``last``, traced back through all generations"""
    strip: Image
    """the exemplar and every result, side by side"""
    table: dict[str, Any]
    """curves against the generation, see `sequence`. Ready for JSON"""


def _size(params: SequenceParams, exemplar: Image) -> InitialiseParams:
    try:
        return InitialiseParams(size=params.size or (exemplar.height, exemplar.width))
    except pydantic.ValidationError as error:
        wrong = error.errors()[0]["msg"]
        sides = f"{exemplar.height}x{exemplar.width}"
        raise InputError(f"exemplar: no result can be of its {sides} px ({wrong}); give a size") from None


def check_exemplar(params: SequenceParams, known: Mapping[str, Any]) -> None:
    """The exemplar must suit the start and the optimisation."""
    exemplar = known.get("exemplar")
    if exemplar is not None:
        start.check_exemplar(_size(params, exemplar), {"image": exemplar})
        optimisation.check_exemplar(OptimiseParams(preset=params.preset), {"image": exemplar})


def _beside(strip: Image, image: Image) -> Image:
    """A strip with one more picture at its right."""
    height, planes = max(strip.height, image.height), len(image.channels)
    pixels = np.ones((height, strip.width + _GAP + image.width, planes), np.float32)
    pixels[: strip.height, : strip.width] = strip.pixels
    pixels[: image.height, -image.width :] = image.pixels
    return Image(pixels, image.channels)


def _generation(
    image: Image, params: SequenceParams, size: InitialiseParams, rng: np.random.Generator
) -> tuple[Image, Correspondence, dict[str, Any]]:
    """One run of the method with all its stages: the result, where it comes from, and what the method found."""
    at_start, at_optimisation = rng.spawn(2)
    strength = edges(image, EdgesParams()).strength
    mask = otsu(strength, OtsuParams()).mask
    distance = signed_distance(mask)
    guidance = guidance_weight(image, distance.pixels, GuidanceWeightParams())
    offsets = offset_statistics(image, OffsetStatisticsParams())
    found = lattice(image, offsets.density, LatticeParams())
    report(Progress(_READ))
    with part(_READ, _STARTED):
        begun = initialise(image, size, at_start, mask=mask, generators=found.generators)
    with part(_STARTED, _OPTIMISED):
        made = optimise(
            image,
            begun.match,
            OptimiseParams(preset=params.preset),
            at_optimisation,
            guidance=distance.field,
            weight=guidance.weight,
            generators=found.generators,
        )
    return (
        made.image,
        made.match,
        {
            "energy": made.scales[-1]["energy"],
            "weight": guidance.weight,
            "confidence": found.confidence,
            "generators": found.generators.tolist(),
        },
    )


def _scores(exemplar: Image, image: Image, match: Correspondence, generators: list[list[float]]) -> dict[str, Any]:
    """The tables of `metrics` and `regularity` in one."""
    lattice_of_first = np.array(generators, np.float32).reshape(-1, 2)
    tables = (
        metrics(exemplar, image, MetricsParams(), match=match).table,
        regularity(exemplar, image, RegularityParams(), generators=lattice_of_first).table,
    )
    return {part: {**tables[0][part], **tables[1][part]} for part in ("summary", "measures")}


def _curves(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """The generations' tables, turned into a list for each figure."""
    tables = [line["scores"] for line in lines]
    first = tables[0]["measures"]
    summary = {axis: [table["summary"][axis] for table in tables] for axis in tables[0]["summary"]}
    return {
        "generations": len(lines),
        "summary": summary,
        "means": {axis: rounded(mean_of(scores)) for axis, scores in summary.items()},
        "measures": {
            name: {
                **{key: first[name][key] for key in ("what", "axis", "floor", "ceiling")},
                "values": [table["measures"][name]["value"] for table in tables],
                "scores": [table["measures"][name]["score"] for table in tables],
            }
            for name in first
        },
        **{key: [line[key] for line in lines] for key in ("energy", "weight", "confidence", "generators")},
    }


@stage(version=1, check=check_exemplar)
def sequence(
    exemplar: Image,
    params: SequenceParams,
    rng: np.random.Generator,
    checkpoints: Checkpoints = NoCheckpoints(),  # noqa: B008
) -> Sequence:
    """Feed a result back as the exemplar, and watch what is lost from generation to generation.

    Every generation is the whole self-tuning method: features, guidance and lattice are read again from the last
    result, so that errors add up. All results are judged against the first exemplar.

    The table's lists have an entry a generation. ``summary``: score by axis, and ``means``, theirs over all
    generations: how well a texture lasts, in one figure; ``measures``: ``values`` and ``scores`` by name, with
    ``what``, ``axis``, ``floor`` and ``ceiling``, see `metrics` and `regularity`; ``energy``: of the last scale,
    CIELAB units squared a pixel; ``weight``, ``confidence`` and ``generators`` (px): of guidance and lattice, as
    read from what the generation was made from. `use`, `copying` and `continuity` go by pixels of the first
    exemplar, traced back through all generations. A score is 1 up to the floor, so slow losses show in the values
    first.

    Raises
    ------
    InputError : the exemplar is too small for a patch, or no size is given and its own cannot be a result's.

    References
    ----------
    [Kaspar2015]_ section 4, Figure 8; the measures are ours, the paper shows pictures.
    """
    check_exemplar(params, {"exemplar": exemplar})
    size = _size(params, exemplar)
    identity = np.moveaxis(np.indices((exemplar.height, exemplar.width), np.uint32), 0, 2)
    state = SequenceGeneration(exemplar, np.ascontiguousarray(identity), exemplar, [])
    first = 0
    resumed = checkpoints.latest(SequenceGeneration)
    if resumed is not None:
        first, state = resumed
    randoms = rng.spawn(params.generations)
    for index in range(first, params.generations):
        with part(index / params.generations, (index + 1) / params.generations):
            image, match, line = _generation(state.last, params, size, randoms[index])
            traced = state.match[match[..., 0], match[..., 1]]
            lines = [*state.lines, line]
            line["scores"] = _scores(exemplar, image, traced, lines[0]["generators"])
            state = SequenceGeneration(image, traced, _beside(state.strip, image), lines)
            if index + 1 < params.generations:
                checkpoints.save(index + 1, state)
            report(Progress(1.0))
    return Sequence(state.last, state.match, state.strip, _curves(state.lines))
