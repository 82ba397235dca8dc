"""Paired comparison of several methods on the same exemplars: wins, losses and their significance."""

import dataclasses
from itertools import combinations
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.declare import InputError, Params, stage
from texloom.stages.evaluation._measures.table import rounded
from texloom.stages.evaluation._pages.gathered import (
    Scores,
    exemplars_of,
    joined,
    mean_of,
    measures_of,
    require_length,
)

_MIN_EXEMPLARS = 6  # that differ; with five, p is at least 1/16
_DECIMALS = 9  # of differences; digits beyond are rounding errors and must not break ties between ranks

Tables = dict[str, list[dict[str, Any] | None]]
"""method to tables, one an item, None where the item failed"""

Grid = dict[str, list[float | None]]
"""method to grades, one an exemplar"""


class CompareParams(Params):
    """How results are graded, and which differences count."""

    tie: float = Field(0.001, ge=0, lt=1)
    """largest difference between two grades, which are in 0..1, that is a tie"""
    uncapped_fidelity: bool = True
    """grade fidelity by distance, not by score: scores end where the exemplar's halves differ as much, so that most
    good methods have 1"""


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Grades, wins and losses."""

    table: dict[str, Any]
    """see `compare`; ready for JSON"""


@stage(version=1)
def compare(
    tables: Tables, items: list[dict[str, Any]], params: CompareParams, more: Tables | None = None
) -> Comparison:
    """Compare methods by their scores, paired by exemplar.

    The grade of a result is its score. With ``uncapped_fidelity``, that of a measure of fidelity, which is a
    distance, is 1 - value / ceiling instead: 1 is no difference at all.

    The seeds of an exemplar are averaged first, as they are not independent. Measures, axes and all together are
    compared alike. The grade of an axis is the mean of its measures, and the overall grade the mean of the axes;
    on each exemplar, only measures count that every method has there, unless it failed altogether.

    Parameters
    ----------
    tables : method to the tables of `metrics`, one an item, None where the item failed.
    items : ``name`` is the exemplar's; where there are several seeds, with the seed at its end, as ``wall-2``.
    more : further tables of the same form and methods, as those of `regularity`; their measures join the others.

    Returns
    -------
    ``methods``; ``items``, their number; ``exemplars``, the names; ``uncapped_fidelity``; ``failed``: method to
    number of items without a table; ``grades``: method to the grades of each item by axis, null where it failed;
    ``measures`` (with their ``axis`` and ``what`` they are) and ``axes`` by name, and ``overall``, each with

    ``means``
        method to mean grade, 0..1, over the ``exemplars`` on which all methods that have any grade have one;
    ``rates``
        method to share of wins against the others, ties counted half;
    ``pairs``
        of methods ``one`` and ``other``: ``wins``, ``losses`` and ``ties`` of ``one`` in exemplars, ``rate``, ``p``
        of the two-sided signed-rank test [Wilcoxon1945]_ over exemplars that are no tie, ``min_p``, the smallest p
        possible with that many, ``holm``, p corrected for the number of pairs [Holm1979]_, and where p is null, the
        ``reason``.

    Raises
    ------
    InputError : fewer than two methods; tables without scores, or not one an item.
    """
    if len(tables) < 2:
        raise InputError(f"tables: {', '.join(tables) or 'nothing'} cannot be compared; give two methods or more")
    if more is not None and set(more) - set(tables):
        raise InputError(f"more: {', '.join(sorted(set(more) - set(tables)))} is not one of tables' methods")
    exemplars = exemplars_of(items)
    lines = _lines(tables, items, "tables")
    for method, column in _lines(more or {}, items, "more").items():
        lines[method] = [joined(*pair) for pair in zip(lines[method], column, strict=True)]
    measures = {
        name: {"axis": line["axis"], "what": line.get("what", "")}
        for column in lines.values()
        for scores in column
        for name, line in (scores or {}).items()
    }
    grades = {
        method: [_grades(scores, params.uncapped_fidelity) for scores in column] for method, column in lines.items()
    }
    grids = {name: _average_seeds(grades, exemplars, name) for name in measures}
    axes = dict.fromkeys(line["axis"] for line in measures.values())
    by_axis = {
        axis: _mean_grid([grid for name, grid in grids.items() if measures[name]["axis"] == axis]) for axis in axes
    }
    overall: Grid = _mean_grid(list(by_axis.values())) if by_axis else {method: [] for method in tables}
    return Comparison(
        {
            "methods": list(tables),
            "items": len(items),
            "exemplars": list(dict.fromkeys(exemplars)),
            "uncapped_fidelity": params.uncapped_fidelity,
            "failed": {method: sum(table is None for table in column) for method, column in tables.items()},
            "grades": {
                method: [
                    None if scores is None else _axis_means(scores, own)
                    for scores, own in zip(lines[method], column, strict=True)
                ]
                for method, column in grades.items()
            },
            "measures": {name: {**measures[name], **_compare(grid, params.tie)} for name, grid in grids.items()},
            "axes": {axis: _compare(grid, params.tie) for axis, grid in by_axis.items()},
            "overall": _compare(overall, params.tie),
        }
    )


def _lines(tables: Tables, items: list[dict[str, Any]], where: str) -> dict[str, list[Scores | None]]:
    require_length(len(items), "items", **{where: tables})
    return {
        method: [measures_of(table, f"{where}.{method}") for table in column] for method, column in tables.items()
    }


def _grades(scores: Scores | None, uncapped_fidelity: bool) -> dict[str, float | None]:
    """The grade of each measure of a result; see `compare`."""
    grades: dict[str, float | None] = {}
    for name, line in (scores or {}).items():
        grades[name] = line["score"]
        if uncapped_fidelity and line["axis"] == "fidelity" and line["score"] is not None and line["ceiling"] > 0:
            grades[name] = float(min(max(1 - line["value"] / line["ceiling"], 0.0), 1.0))
    return grades


def _axis_means(scores: Scores, grades: dict[str, float | None]) -> dict[str, float | None]:
    return {
        axis: rounded(mean_of(grade for name, grade in grades.items() if scores[name]["axis"] == axis))
        for axis in dict.fromkeys(line["axis"] for line in scores.values())
    }


def _average_seeds(grades: dict[str, list[dict[str, float | None]]], exemplars: list[str], measure: str) -> Grid:
    """The mean grade of a measure over the seeds of each exemplar."""
    return {
        method: [
            mean_of(own.get(measure) for own, of in zip(column, exemplars, strict=True) if of == exemplar)
            for exemplar in dict.fromkeys(exemplars)
        ]
        for method, column in grades.items()
    }


def _mean_grid(grids: list[Grid]) -> Grid:
    """Mean of several grids; on each exemplar, of those in which all methods that have any grade there have one."""
    methods = list(grids[0])
    mean: Grid = {method: [] for method in methods}
    for index in range(len(grids[0][methods[0]])):
        present = [method for method in methods if any(grid[method][index] is not None for grid in grids)]
        shared = [grid for grid in grids if all(grid[method][index] is not None for method in present)]
        for method in methods:
            mean[method].append(mean_of(grid[method][index] for grid in shared))
    return mean


def _compare(grid: Grid, tie: float) -> dict[str, Any]:
    """Means, win rates and pairs of one grid."""
    graded = [method for method, grades in grid.items() if any(grade is not None for grade in grades)]
    rows = zip(*(grid[method] for method in graded), strict=True)
    shared = [index for index, row in enumerate(rows) if all(grade is not None for grade in row)]
    pairs = [_pair(grid, one, other, tie) for one, other in combinations(grid, 2)]
    _correct(pairs)
    rates: dict[str, list[float]] = {method: [] for method in grid}
    for pair in pairs:
        if pair["rate"] is not None:
            rates[pair["one"]].append(pair["rate"])
            rates[pair["other"]].append(1 - pair["rate"])
    return {
        "means": {
            method: rounded(mean_of(grades[index] for index in shared)) if method in graded else None
            for method, grades in grid.items()
        },
        "exemplars": len(shared),
        "rates": {method: rounded(mean_of(values)) for method, values in rates.items()},
        "pairs": pairs,
    }


def _pair(grid: Grid, one: str, other: str, tie: float) -> dict[str, Any]:
    """Wins, losses and ties of the first of two methods."""
    both = [(a, b) for a, b in zip(grid[one], grid[other], strict=True) if a is not None and b is not None]
    differences = np.round(np.array([a - b for a, b in both]), _DECIMALS)
    differences[np.abs(differences) <= tie] = 0
    p, reason = _signed_rank(differences)
    wins, losses = int((differences > 0).sum()), int((differences < 0).sum())
    ties = len(both) - wins - losses
    return {
        "one": one,
        "other": other,
        "wins": wins,
        "losses": losses,
        "ties": ties,
        "rate": rounded((wins + ties / 2) / len(both)) if both else None,
        "p": rounded(p),
        "min_p": rounded(_min_p(wins + losses)) if wins + losses else None,
        **({"reason": reason} if reason else {}),
    }


def _signed_rank(differences: np.ndarray) -> tuple[float | None, str | None]:
    """Two-sided p of paired differences, or why there is none."""
    from scipy.stats import wilcoxon

    if not differences.size:
        return None, "no exemplar has a score of both"
    differences = differences[differences != 0]
    count = differences.size
    if not count:
        return None, "all exemplars are ties"
    if count < _MIN_EXEMPLARS:
        return None, (
            f"only {count} exemplars differ, with which p is at least {_min_p(count):g}; it takes {_MIN_EXEMPLARS}"
        )
    # the normal approximation, used for many pairs, can fall below what is possible
    return max(float(wilcoxon(differences).pvalue), _min_p(count)), None


def _min_p(count: int) -> float:
    return 2.0 ** (1 - count)


def _correct(pairs: list[dict[str, Any]]) -> None:
    """Add to each pair its p corrected for the number of pairs [Holm1979]_."""
    tested = sorted((pair for pair in pairs if pair["p"] is not None), key=lambda pair: float(pair["p"]))
    highest = 0.0
    for rank, pair in enumerate(tested):
        highest = max(highest, min(1.0, (len(tested) - rank) * pair["p"]))
        pair["holm"] = rounded(highest)
    for pair in pairs:
        pair.setdefault("holm", None)
