"""Values that a flow over a set has gathered: one an item, None where the item failed."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from texloom.stages.vocabulary.declare import InputError

Scores = dict[str, dict[str, Any]]
"""the lines of a table of `metrics` or of the same form, by measure"""


def measures_of(table: dict[str, Any] | None, where: str) -> Scores | None:
    """The lines of a table; None where the item failed. `InputError` if it has none."""
    if table is None:
        return None
    lines = table.get("measures")
    if not isinstance(lines, dict) or not all(isinstance(line, dict) and "axis" in line for line in lines.values()):
        raise InputError(f"{where} is not a table of scores: it has no measures with an axis")
    return lines


def joined(one: Scores | None, other: Scores | None) -> Scores | None:
    """The lines of two tables of one result; None where there is neither."""
    return one if other is None else {**(one or {}), **other}


def require_length(count: int, of: str, **columns: Sequence[Any] | Mapping[str, Sequence[Any]]) -> None:
    """`InputError` where a column, or one of a mapping of columns, has not ``count`` entries, as ``of`` has."""
    for name, value in columns.items():
        named = {f".{key}": column for key, column in value.items()} if isinstance(value, Mapping) else {"": value}
        for label, column in named.items():
            if len(column) != count:
                raise InputError(f"{name}{label} has {len(column)} entries, {of} has {count}")


def item_at(items: Sequence[Mapping[str, Any]], index: int) -> dict[str, Any]:
    """``name``, ``seed`` and ``sources`` of an item; items are numbered where their names are not known."""
    item = items[index] if items else {}
    name = str(item.get("name") or f"item {index + 1}")
    return {"name": name, "seed": item.get("seed"), "sources": item.get("sources") or {}}


def seconds_by_step(provenance: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Step to item to the seconds that the step took, where they are known."""
    seconds: dict[str, dict[str, float]] = {}
    for entry in provenance:
        if isinstance(entry.get("seconds"), int | float):
            seconds.setdefault(str(entry.get("step")), {})[str(entry.get("item"))] = float(entry["seconds"])
    return seconds


def exemplars_of(items: list[dict[str, Any]]) -> list[str]:
    """The items' names without the seed at their end, which is there where there are several seeds."""
    if len({item["seed"] for item in items}) < 2:
        return [item["name"] for item in items]
    return [item["name"].removesuffix(str(item["seed"])).removesuffix("-") or "exemplar" for item in items]


def mean_of(values: Iterable[float | None]) -> float | None:
    """Mean of the known values; None if there are none."""
    known = [value for value in values if value is not None]
    return math.fsum(known) / len(known) if known else None


def least_of(values: Iterable[float | None]) -> float | None:
    """Least of the known values; None if there are none."""
    return min((value for value in values if value is not None), default=None)
