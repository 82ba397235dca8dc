"""Texture sequences: a result becomes the exemplar of the next one, again and again."""

import dataclasses
from typing import Any

import numpy as np

from texloom.stages.evaluation._measures.table import rounded
from texloom.stages.evaluation._pages.gathered import mean_of
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, stage

_GAP = 8  # px of white between pictures of the strip


@dataclasses.dataclass(frozen=True)
class Sequence:
    """The generations so far and how good they are."""

    strip: Image
    """the exemplar and every result, side by side"""
    table: dict[str, Any]
    """curves against the generation, see `sequence`. Ready for JSON"""


def _beside(strip: Image, image: Image) -> Image:
    """A strip with one more picture at its right."""
    if strip.channels != image.channels:
        raise InputError(f"image: has {', '.join(image.channels)}, the strip {', '.join(strip.channels)}")
    height, planes = max(strip.height, image.height), len(image.channels)
    pixels = np.ones((height, strip.width + _GAP + image.width, planes), np.float32)
    pixels[: strip.height, : strip.width] = strip.pixels
    pixels[: image.height, -image.width :] = image.pixels
    return image.elsewhere(pixels)


def _joined(scores: dict[str, Any], more: dict[str, Any] | None, where: str) -> dict[str, Any]:
    """Two tables of measures as one."""
    parts = ("summary", "measures")
    for table in (scores, more or {part: {} for part in parts}):
        if not all(isinstance(table.get(part), dict) for part in parts):
            raise InputError(f"{where}: has no scores; give a table of metrics or regularity")
    return {part: {**scores[part], **(more or {}).get(part, {})} for part in parts}


@stage(version=2)
def sequence(
    exemplar: Image,
    image: Image,
    scores: dict[str, Any],
    regularity: dict[str, Any] | None = None,
    strip: Image | None = None,
    table: dict[str, Any] | None = None,
) -> Sequence:
    """Add a generation to a sequence, to see what is lost when results are fed back as exemplars.

    Parameters
    ----------
    exemplar : the first one, by which all generations are judged.
    image : the generation's result.
    scores : `metrics` of it. `use`, `copying` and `continuity` go by pixels of the first exemplar if `traced_match`
        gives their match.
    regularity : the table of `regularity`, whose measures join the others.
    strip, table : of the generation before; none for the first.

    Returns
    -------
    The lists of ``table`` have an entry a generation: ``summary``, score by axis; ``measures``: ``values`` and
    ``scores`` by name, with ``what``, ``axis``, ``floor`` and ``ceiling``, see `metrics`. ``means`` are those of
    the summary over all generations: how well a texture lasts, in one figure. A score is 1 up to the floor, so slow
    losses show in the values first.

    Raises
    ------
    InputError : a table has no scores, or the result other channels than the exemplar.

    References
    ----------
    [Kaspar2015]_ section 4, Figure 8; the measures are ours, the paper shows pictures.
    """
    one = _joined(scores, regularity, "scores")
    before = table or {"generations": 0, "summary": {}, "measures": {}}
    missing = [None] * before["generations"]
    summary = {
        axis: [*before["summary"].get(axis, missing), one["summary"].get(axis)]
        for axis in {**before["summary"], **one["summary"]}
    }
    measures = {}
    for name in {**before["measures"], **one["measures"]}:
        line = one["measures"].get(name, {})
        known = before["measures"].get(name, {"values": missing, "scores": missing, **line})
        measures[name] = {
            **{key: known[key] for key in ("what", "axis", "floor", "ceiling")},
            "values": [*known["values"], line.get("value")],
            "scores": [*known["scores"], line.get("score")],
        }
    curves = {
        "generations": before["generations"] + 1,
        "summary": summary,
        "means": {axis: rounded(mean_of(values)) for axis, values in summary.items()},
        "measures": measures,
    }
    return Sequence(_beside(exemplar if strip is None else strip, image), curves)
