"""The table of measures: one line each, with the values of a good and a bad result."""

import csv
import dataclasses
import io
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from texloom.stages.evaluation._measures.pictures import UnmeasurableError

DIGITS = 6
"""significant digits, for readability: figures do not depend on the number of threads"""

T = TypeVar("T")

_UNCLEAR = "the exemplar's own parts differ as much as a bad result does"
_FORMULAS = ("=", "+", "-", "@")  # first characters of formulas in spreadsheets


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

    def line(self) -> dict[str, Any]:
        """The measure's line of the table."""
        score = share(self.value, self.floor, self.ceiling) if self.score is None else self.score
        line: dict[str, Any] = {"value": self.value, "floor": self.floor, "ceiling": self.ceiling, "score": score}
        line |= {"more": self.more} if self.more else {}
        line |= {"reason": self.unclear} if score is None else {}
        return {key: rounded(part) for key, part in line.items()}


def unmeasured(reason: str) -> dict[str, Any]:
    """The line of an impossible measure."""
    return {"value": None, "floor": None, "ceiling": None, "score": None, "reason": reason}


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
    measure: Callable[[T], Figures | tuple[Figures | str, ...]], task: T, names: tuple[str, ...]
) -> dict[str, dict[str, Any]]:
    """The lines of one measure by name; null with a reason where it is impossible (an error or a text)."""
    try:
        measured = measure(task)
    except UnmeasurableError as error:
        return {name: unmeasured(str(error)) for name in names}
    parts = measured if isinstance(measured, tuple) else (measured,)
    return {
        name: unmeasured(one) if isinstance(one, str) else one.line()
        for name, one in zip(names, parts, strict=True)
    }


def table(titles: Mapping[str, tuple[str, str]], measured: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """``measures``, the lines in the order of their titles (axis and meaning), and ``summary``, the axes' worst."""
    measures = {name: {"what": what, "axis": axis, **measured[name]} for name, (axis, what) in titles.items()}
    scores: dict[str, list[float]] = {}
    for line in measures.values():
        scores.setdefault(line["axis"], []).extend([] if line["score"] is None else [line["score"]])
    summary = {axis: rounded(min(known)) if known else None for axis, known in scores.items()}
    return {"summary": summary, "measures": measures}


def csv_text(rows: Iterable[Iterable[Any]]) -> str:
    """Rows for spreadsheets; texts that those would take for a formula are preceded by a '."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for row in rows:
        writer.writerow(
            [f"'{cell}" if isinstance(cell, str) and cell.lstrip().startswith(_FORMULAS) else cell for cell in row]
        )
    return text.getvalue()
