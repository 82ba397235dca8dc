"""The table of figures: every measure a line, beside what a good and a bad result score."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from texloom.stages.evaluation._measures.pictures import UnmeasurableError

DIGITS = 6
"""significant; for reading, the figures themselves do not depend on the number of threads"""

_UNCLEAR = "the exemplar's halves differ as much as a bad result does"


@dataclasses.dataclass(frozen=True)
class Figures:
    """One measure's outcome; the score lies on the line from floor (1) to ceiling (0) unless given."""

    value: float
    floor: float
    ceiling: float
    more: dict[str, Any] = dataclasses.field(default_factory=dict)
    score: float | None = None
    unclear: str = _UNCLEAR
    """why there is no score where floor and ceiling are too close"""


def share(value: float, floor: float, ceiling: float) -> float | None:
    """Place between floor (1) and ceiling (0); None where they lie too close to tell results apart."""
    if ceiling - floor <= 0.1 * ceiling:
        return None
    return float(min(max((ceiling - value) / (ceiling - floor), 0.0), 1.0))


def rounded(value: Any) -> Any:
    """Plain Python numbers of a few digits, all through a measure's figures."""
    if isinstance(value, dict):
        return {key: rounded(part) for key, part in value.items()}
    if isinstance(value, list):
        return [rounded(part) for part in value]
    if value is None or isinstance(value, int | str):
        return value
    return float(f"{float(value):.{DIGITS}g}")


def lines(
    measure: Callable[[], Figures | tuple[Figures | str, ...]], names: tuple[str, ...]
) -> dict[str, dict[str, Any]]:
    """The lines that one measure fills, by name; null with a reason where there are no figures."""
    found: Figures | tuple[Figures | str, ...]
    try:
        found = measure()
    except UnmeasurableError as error:
        found = (str(error),) * len(names)
    # A text is the reason why one of several lines has no figures.
    filled = {}
    for name, figures in zip(names, found if isinstance(found, tuple) else (found,), strict=True):
        if isinstance(figures, str):
            filled[name] = {"value": None, "floor": None, "ceiling": None, "score": None, "reason": figures}
            continue
        score = figures.score
        if score is None:
            score = share(figures.value, figures.floor, figures.ceiling)
        line: dict[str, Any] = {
            "value": figures.value,
            "floor": figures.floor,
            "ceiling": figures.ceiling,
            "score": score,
        }
        line |= {"more": figures.more} if figures.more else {}
        line |= {"reason": figures.unclear} if score is None else {}
        filled[name] = rounded(line)
    return filled


def table(titles: Mapping[str, tuple[str, str]], found: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """``measures``, the lines in the order of their titles (axis and meaning), and ``summary``, each axis' mean."""
    measures = {name: {"what": what, "axis": axis, **found[name]} for name, (axis, what) in titles.items()}
    scores: dict[str, list[float]] = {}
    for line in measures.values():
        scores.setdefault(line["axis"], []).extend([] if line["score"] is None else [line["score"]])
    summary = {axis: rounded(float(np.mean(known))) if known else None for axis, known in scores.items()}
    return {"summary": summary, "measures": measures}
