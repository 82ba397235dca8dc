"""Reading tables of scores that a flow over a set has gathered."""

import math
from collections.abc import Iterable
from typing import Any

from texloom.stages.declare import InputError

Scores = dict[str, dict[str, Any]]
"""the lines of a table of `metrics` or of its form, by measure"""

_DIGITS = 6  # significant; as many as `metrics` gives


def measures_of(table: dict[str, Any] | None, where: str) -> Scores | None:
    """The lines of a table; None where the item failed. `InputError` if it has none."""
    if table is None:
        return None
    lines = table.get("measures")
    if not isinstance(lines, dict) or not all(isinstance(line, dict) and "axis" in line for line in lines.values()):
        raise InputError(f"{where} is not a table of scores: it has no measures with an axis")
    return lines


def joined(one: Scores | None, other: Scores | None) -> Scores | None:
    """The lines of two tables of one result; none where there is neither."""
    return one if other is None else {**(one or {}), **other}


def require_items(count: int, items: list[dict[str, Any]], where: str) -> None:
    """There must be as many tables as items."""
    if count != len(items):
        raise InputError(f"{where}: {count} tables for {len(items)} items")


def exemplars_of(items: list[dict[str, Any]]) -> list[str]:
    """What each item is about but for the seed, which ends the items' names where there are several."""
    if len({item["seed"] for item in items}) < 2:
        return [item["name"] for item in items]
    return [item["name"].removesuffix(str(item["seed"])).removesuffix("-") or "exemplar" for item in items]


def mean_of(values: Iterable[float | None]) -> float | None:
    """Mean of what is known; None if nothing is."""
    known = [value for value in values if value is not None]
    return math.fsum(known) / len(known) if known else None


def rounded(value: float | None) -> float | None:
    """The digits that mean something."""
    return None if value is None else float(f"{value:.{_DIGITS}g}")
