"""Seconds of steps over a set, beside the scores of their results."""

import dataclasses
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from texloom.stages.evaluation._measures.table import csv_text, rounded
from texloom.stages.evaluation._pages.gathered import mean_of, measures_of, require_length, seconds_by_step
from texloom.stages.vocabulary.arrays import Spreadsheet
from texloom.stages.vocabulary.declare import InputError, Params, stage


class TimingsParams(Params):
    """Whose seconds count."""

    step: str = ""
    """whose seconds count: the step ``LABEL_STEP`` of each variant; empty: the step called as the label"""


@dataclasses.dataclass(frozen=True)
class Timings:
    """One line a step."""

    table: dict[str, Any]
    """see `timings`; ready for JSON"""
    csv: Spreadsheet
    """a row a step: its median, minimum and maximum seconds, and its mean score on each axis"""


@stage(version=1)
def timings(
    tables: dict[str, list[dict[str, Any] | None]],
    items: list[dict[str, Any]],
    params: TimingsParams,
    provenance: Sequence[Mapping[str, Any]] = (),
) -> Timings:
    """List the seconds of several steps, over all items, beside the scores of their results.

    Seconds are wall time in the run that computed a step. They depend on the load of the computer, and the first
    step of a stage also loads its kernels: compare medians.

    Parameters
    ----------
    tables : label to the tables of `metrics` of what it made, one an item, None where the item failed.
    provenance : the steps upstream, of all items, with their seconds.

    Returns
    -------
    ``steps``: by name ``runs``, their number; ``median``, ``min`` and ``max`` seconds, and ``to_first``, the median
    relative to that of the first step; ``means``: axis to mean score. Null where unknown.

    Raises
    ------
    InputError : a name is no step upstream; tables without scores, or not one an item.
    """
    require_length(len(items), "items", tables=tables)
    steps: dict[str, dict[str, Any]] = {}
    first: float | None = None
    known = {str(entry.get("step")) for entry in provenance}
    seconds = seconds_by_step(provenance)
    for step, column in tables.items():
        timed = f"{step}_{params.step}" if params.step else step
        if provenance and timed not in known:
            raise InputError(f"tables: {timed} is no step that the tables come from; name them after their steps")
        took = list(seconds.get(timed, {}).values())
        median = statistics.median(took) if took else None
        first = median if first is None else first
        scores: dict[str, list[float | None]] = {}
        for table, item in zip(column, items, strict=True):
            for line in (measures_of(table, f"tables: {step}: {item['name']}") or {}).values():
                scores.setdefault(line["axis"], []).append(line["score"])
        steps[step] = {
            "runs": len(took),
            "median": rounded(median),
            "min": rounded(min(took, default=None)),
            "max": rounded(max(took, default=None)),
            "to_first": rounded(median / first) if median is not None and first else None,
            "means": {axis: rounded(mean_of(values)) for axis, values in scores.items()},
        }
    return Timings({"steps": steps}, _csv(steps))


def _csv(steps: Mapping[str, Mapping[str, Any]]) -> str:
    axes = list(dict.fromkeys(axis for step in steps.values() for axis in step["means"]))
    columns = ("runs", "median", "min", "max", "to_first")
    rows = [[name, *map(step.get, columns), *map(step["means"].get, axes)] for name, step in steps.items()]
    return csv_text([["step", *columns, *axes], *rows])
