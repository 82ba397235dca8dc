"""Several methods on the same exemplars: who wins, and whether that may be chance."""

import dataclasses
from itertools import combinations
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.declare import InputError, Params, stage
from texloom.stages.evaluation._pages.gathered import (
    Scores,
    exemplars_of,
    joined,
    mean_of,
    measures_of,
    require_items,
    rounded,
)

_FEWEST = 6  # exemplars that differ; with five the test cannot come below 1/16
_DECIMALS = 9  # of differences; what lies beyond is rounding and must not break ties between ranks

Gathered = dict[str, list[dict[str, Any] | None]]
"""method to tables, one an item, None where the item failed"""

Grid = dict[str, list[float | None]]
"""method to grades, one an exemplar"""


class CompareParams(Params):
    """What counts as different."""

    tie: float = Field(0.001, ge=0, lt=1)
    """largest difference between two grades, which lie in 0..1, that is a tie"""
    beyond: bool = True
    """whether fidelity counts beyond the floor, where its scores end: most methods that are any good lie there"""


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Who wins."""

    table: dict[str, Any]
    """see `compare`; ready for JSON"""


def _grade(line: dict[str, Any], beyond: bool) -> float | None:
    """What methods are compared by, see `compare`."""
    score: float | None = line["score"]
    if beyond and line["axis"] == "fidelity" and score is not None and line["ceiling"] > 0:
        return float(min(max(1 - line["value"] / line["ceiling"], 0.0), 1.0))
    return score


def _seeds_averaged(
    lines: dict[str, list[Scores | None]], exemplars: list[str], beyond: bool
) -> tuple[dict[str, str], dict[str, Grid]]:
    """The axis of each measure, and for each measure the mean grade over the seeds of each exemplar."""
    names = list(dict.fromkeys(exemplars))
    axes = {
        measure: line["axis"]
        for column in lines.values()
        for scores in column
        for measure, line in (scores or {}).items()
    }

    def grade(method: str, name: str, measure: str) -> float | None:
        return mean_of(
            _grade(scores[measure], beyond)
            for scores, exemplar in zip(lines[method], exemplars, strict=True)
            if exemplar == name and scores is not None and measure in scores
        )

    return axes, {
        measure: {method: [grade(method, name, measure) for name in names] for method in lines} for measure in axes
    }


def _lines(gathered: Gathered, items: list[dict[str, Any]], where: str) -> dict[str, list[Scores | None]]:
    for method, column in gathered.items():
        require_items(len(column), items, f"{where}: {method}")
    return {
        method: [measures_of(table, f"{where}: {method}") for table in column]
        for method, column in gathered.items()
    }


def _mean_grid(grids: list[Grid]) -> Grid:
    """Mean of several grids at each place, over those of them that every method has which has any there."""
    methods = list(grids[0])
    mean: Grid = {method: [] for method in methods}
    for place in range(len(grids[0][methods[0]])):
        present = [method for method in methods if any(grid[method][place] is not None for grid in grids)]
        shared = [grid for grid in grids if all(grid[method][place] is not None for method in present)]
        for method in methods:
            mean[method].append(mean_of(grid[method][place] for grid in shared))
    return mean


def _signed_rank(differences: np.ndarray) -> tuple[float | None, str | None]:
    """Two-sided p of paired differences, or why there is none."""
    from scipy.stats import wilcoxon

    if not differences.size:
        return None, "no exemplar has a score of both"
    differences = differences[differences != 0]
    count = differences.size
    if not count:
        return None, "all exemplars are ties"
    least = 2.0 ** (1 - count)
    if count < _FEWEST:
        return None, f"only {count} exemplars differ, with which p is at least {least:g}; it takes {_FEWEST}"
    # The normal approximation, taken for many pairs, can fall below what is possible.
    return max(float(wilcoxon(differences).pvalue), least), None


def _pair(grid: Grid, one: str, other: str, tie: float) -> dict[str, Any]:
    """Two methods' wins, losses and ties, from the view of the first."""
    both = [(a, b) for a, b in zip(grid[one], grid[other], strict=True) if a is not None and b is not None]
    differences = np.round(np.array([a - b for a, b in both]), _DECIMALS)
    differences[np.abs(differences) <= tie] = 0
    p, reason = _signed_rank(differences)
    wins, losses = int((differences > 0).sum()), int((differences < 0).sum())
    ties = len(both) - wins - losses
    differ = wins + losses
    return {
        "one": one,
        "other": other,
        "wins": wins,
        "losses": losses,
        "ties": ties,
        "rate": rounded((wins + ties / 2) / len(both)) if both else None,
        "p": rounded(p),
        "least": rounded(2.0 ** (1 - differ)) if differ else None,
        **({"reason": reason} if reason else {}),
    }


def _holm(pairs: list[dict[str, Any]]) -> None:
    """Add to each pair its p corrected for the number of pairs [Holm1979]_."""
    tested = sorted((pair for pair in pairs if pair["p"] is not None), key=lambda pair: float(pair["p"]))
    highest = 0.0
    for rank, pair in enumerate(tested):
        highest = max(highest, min(1.0, (len(tested) - rank) * pair["p"]))
        pair["holm"] = rounded(highest)
    for pair in pairs:
        pair.setdefault("holm", None)


def _compared(grid: Grid, tie: float) -> dict[str, Any]:
    """Means, win rates and pairs of one grid."""
    scored = [method for method, scores in grid.items() if any(score is not None for score in scores)]
    columns = zip(*(grid[method] for method in scored), strict=True)
    shared = [place for place, column in enumerate(columns) if all(score is not None for score in column)]
    pairs = [_pair(grid, one, other, tie) for one, other in combinations(grid, 2)]
    _holm(pairs)
    rates: dict[str, list[float]] = {method: [] for method in grid}
    for pair in pairs:
        if pair["rate"] is not None:
            rates[pair["one"]].append(pair["rate"])
            rates[pair["other"]].append(1 - pair["rate"])
    return {
        "means": {
            method: rounded(mean_of(scores[place] for place in shared)) if method in scored else None
            for method, scores in grid.items()
        },
        "exemplars": len(shared),
        "rates": {method: rounded(mean_of(found)) for method, found in rates.items()},
        "pairs": pairs,
    }


@stage(version=1)
def compare(
    tables: dict[str, list[dict[str, Any] | None]],
    items: list[dict[str, Any]],
    params: CompareParams,
    more: dict[str, list[dict[str, Any] | None]] | None = None,
) -> Comparison:
    """Compare methods by their scores, paired by exemplar.

    The grade of a result is its score. For fidelity, whose measures are distances, it is 1 - value / ceiling
    instead if ``beyond``: scores do not tell results apart that are as near to the exemplar as its own halves are
    to each other.

    The seeds of an exemplar are averaged first, as they are not independent. Measures, axes and all together are
    compared alike. The grade of an axis is the mean of its measures, and the overall grade the mean of the axes;
    on each exemplar only measures count that every method has there, unless it failed altogether.

    Parameters
    ----------
    tables : method to the tables of `metrics`, one an item, None where the item failed.
    items : ``name`` is the exemplar's, with the seed at its end, as in ``wall-2``, where there are several seeds.
    more : further tables of the same form and methods, as those of `regularity`; their measures join the others.

    Returns
    -------
    ``methods``; ``items``, their number; ``exemplars``, the names; ``failed``: method to number of items without a
    table; ``measures`` and ``axes`` by name, and ``overall``, each with

    ``means``
        method to mean grade, 0..1, over the ``exemplars`` that all methods have which have any;
    ``rates``
        method to share of wins against the others, ties counted half;
    ``pairs``
        of methods ``one`` and ``other``: ``wins``, ``losses`` and ``ties`` of ``one`` in exemplars, ``rate``, ``p``
        of the two-sided signed-rank test [Wilcoxon1945]_ over exemplars that are no tie, ``least``, the least p
        that so many can give, ``holm``, p corrected for the number of pairs [Holm1979]_, and where p is null, the
        ``reason``.

    Raises
    ------
    InputError : fewer than two methods; tables that have no scores or are not one an item.
    """
    if len(tables) < 2:
        raise InputError(f"tables: {', '.join(tables) or 'nothing'} cannot be compared; give two methods or more")
    if more is not None and set(more) - set(tables):
        raise InputError(f"more: {', '.join(sorted(set(more) - set(tables)))} is not one of tables' methods")
    exemplars = exemplars_of(items)
    lines = _lines(tables, items, "tables")
    for method, column in _lines(more or {}, items, "more").items():
        lines[method] = [joined(*pair) for pair in zip(lines[method], column, strict=True)]
    axis_of, grids = _seeds_averaged(lines, exemplars, params.beyond)
    by_axis = {
        axis: _mean_grid([grids[measure] for measure in axis_of if axis_of[measure] == axis])
        for axis in dict.fromkeys(axis_of.values())
    }
    nothing: Grid = {method: [] for method in tables}
    overall = _mean_grid(list(by_axis.values())) if by_axis else nothing
    return Comparison(
        {
            "methods": list(tables),
            "items": len(items),
            "exemplars": list(dict.fromkeys(exemplars)),
            "failed": {method: sum(table is None for table in column) for method, column in tables.items()},
            "measures": {
                measure: {"axis": axis_of[measure], **_compared(grid, params.tie)}
                for measure, grid in grids.items()
            },
            "axes": {axis: _compared(grid, params.tie) for axis, grid in by_axis.items()},
            "overall": _compared(overall, params.tie),
        }
    )
