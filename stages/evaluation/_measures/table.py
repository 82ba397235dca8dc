"""The table of measures: one line each, with the values of a good and a bad result."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from texloom.stages.evaluation._measures.pictures import UnmeasurableError

DIGITS = 6
"""significant digits, for readability: figures do not depend on the number of threads"""

_UNCLEAR = "the exemplar's halves differ as much as a bad result does"


@dataclasses.dataclass(frozen=True)
class Figures:
    """The value of one measure; its score is linear from floor (1) to ceiling (0) unless given."""

    value: float
    floor: float
    ceiling: float
    more: dict[str, Any] = dataclasses.field(default_factory=dict)
    score: float | None = None
    unclear: str = _UNCLEAR
    """the reason if floor and ceiling are too close for a score"""


def share(value: float, floor: float, ceiling: float) -> float | None:
    """Linear from floor (1) to ceiling (0), clipped; None where they are too close to distinguish results."""
    if ceiling - floor <= 0.1 * ceiling:
        return None
    return float(min(max((ceiling - value) / (ceiling - floor), 0.0), 1.0))


def rounded(value: Any) -> Any:
    """Plain Python numbers with few digits, recursively."""
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
    """The lines of one measure by name; null with a reason where it is impossible (an error or a text)."""
    figures: Figures | tuple[Figures | str, ...]
    try:
        figures = measure()
    except UnmeasurableError as error:
        figures = (str(error),) * len(names)
    filled = {}
    for name, one in zip(names, figures if isinstance(figures, tuple) else (figures,), strict=True):
        if isinstance(one, str):
            filled[name] = {"value": None, "floor": None, "ceiling": None, "score": None, "reason": one}
            continue
        score = share(one.value, one.floor, one.ceiling) if one.score is None else one.score
        line: dict[str, Any] = {"value": one.value, "floor": one.floor, "ceiling": one.ceiling, "score": score}
        line |= {"more": one.more} if one.more else {}
        line |= {"reason": one.unclear} if score is None else {}
        filled[name] = rounded(line)
    return filled


def table(titles: Mapping[str, tuple[str, str]], filled: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """``measures``, the lines in the order of their titles (axis and meaning), and ``summary``, the axes' means."""
    measures = {name: {"what": what, "axis": axis, **filled[name]} for name, (axis, what) in titles.items()}
    scores: dict[str, list[float]] = {}
    for line in measures.values():
        scores.setdefault(line["axis"], []).extend([] if line["score"] is None else [line["score"]])
    summary = {axis: rounded(float(np.mean(known))) if known else None for axis, known in scores.items()}
    return {"summary": summary, "measures": measures}
