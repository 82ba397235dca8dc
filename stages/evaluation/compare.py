"""Paired comparison of methods on the same exemplars: ranks, wins, losses and their significance."""

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from jaxtyping import Float64
from pydantic import Field

from texloom.stages.evaluation._measures.table import csv_text, rounded
from texloom.stages.evaluation._pages.gathered import (
    Scores,
    exemplars_of,
    joined,
    least_of,
    mean_of,
    measures_of,
    require_length,
)
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.vocabulary.arrays import Spreadsheet
from texloom.stages.vocabulary.declare import InputError, Params, stage

_MIN_EXEMPLARS = 6  # that differ; with five, p is at least 1/16
_DECIMALS = 9  # of differences; digits beyond are rounding errors and must not break ties between ranks
_RESAMPLES = 2000
_CONFIDENCE = 0.95

Tables = dict[str, list[dict[str, Any] | None]]
"""method to tables, one an item, None where the item failed"""

Grid = dict[str, list[float | None]]
"""method to scores, one an exemplar"""

ItemScores = dict[str, Any]
"""``overall``, ``axes`` by name and ``measures`` by name: the scores of one result"""


class CompareParams(Params):
    """Which differences count."""

    tie: float = Field(0.001, ge=0, lt=1)
    """largest difference between two scores, which are in 0..1, that is a tie"""
    origins: Mapping[str, str] = Field({})
    """where methods come from that are not texloom's: a plug-in's distribution and version, or a folder"""


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Scores, ranks, wins and losses."""

    table: dict[str, Any]
    """see `compare`; ready for JSON"""
    csv: Spreadsheet
    """the leaderboard for spreadsheets: a row a method with the mean scores of axes and measures; empty where
    unknown"""


@stage(version=4)
def compare(
    tables: Tables, items: list[dict[str, Any]], params: CompareParams, more: Tables | None = None
) -> Comparison:
    """Compare methods by their scores, paired by exemplar.

    Measures have the scores of their tables. The score of an axis is that of its worst measure, and the overall
    score the mean of the axes; on each item, only measures count that every method has there, unless it failed
    altogether. The scores of an exemplar are the means over its seeds, which are not independent, and the means
    are those over exemplars.

    Parameters
    ----------
    tables : method to the tables of `metrics`, one an item, None where the item failed.
    items : ``name`` is the exemplar's; where there are several seeds, with the seed at its end, as ``wall-2``.
    more : further tables of the same form and methods, as those of `regularity`; their measures join the others.

    Returns
    -------
    ``methods``; ``items``, their names; ``exemplars``, the names; ``failed``: method to number of items without a
    table; ``partial``: the measures that some method lacks on some item, so that they do not count there;
    ``estimated``: method to its measures that use a source map estimated from the pixels;
    ``scores``: method to the ``overall`` score of each item and those of ``axes`` and ``measures`` by name, null
    where it failed; ``leaderboard``: the methods by rank, see below; ``measures`` (with their ``axis`` and ``what``
    they are) and ``axes`` by name, and ``overall``, each with

    ``means``
        method to mean score, 0..1, over the ``exemplars`` on which all methods that have any score have one;
    ``values``
        of measures only: method to mean value over the same exemplars, in the measure's unit;
    ``rates``
        method to share of wins against the others, ties counted half;
    ``pairs``
        of methods ``one`` and ``other``: ``wins``, ``losses`` and ``ties`` of ``one`` in exemplars, ``rate``, ``p``
        of the two-sided signed-rank test [Wilcoxon1945]_ over exemplars that are no tie, ``min_p``, the smallest p
        possible with that many, ``holm``, p corrected for the number of pairs [Holm1979]_, and where p is null, the
        ``reason``.

    A line of the leaderboard has ``rank`` (1 is best, equal means share one), ``method``, its ``origin`` or null,
    overall ``mean``, ``interval`` and ``ranks``, the lowest and highest mean and rank in 95 % of the samples of as
    many exemplars with replacement (the bootstrap of [Efron1979]_, with the same samples for all methods; null with
    fewer than six exemplars), ``wins``, ``losses`` and ``ties`` against all others, and ``rate``.

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
    partial = [_partial(row, measures) for row in zip(*lines.values(), strict=True)]
    scores = {
        method: [
            None if own is None else _item_scores(own, measures, lacking)
            for own, lacking in zip(column, partial, strict=True)
        ]
        for method, column in lines.items()
    }
    axes = dict.fromkeys(line["axis"] for line in measures.values())
    overall = _average_seeds(scores, exemplars, "overall")
    compared = _compare(overall, params.tie)
    table = {
        "methods": list(tables),
        "items": [item["name"] for item in items],
        "exemplars": list(dict.fromkeys(exemplars)),
        "failed": {method: sum(table is None for table in column) for method, column in tables.items()},
        "partial": [name for name in measures if any(name in lacking for lacking in partial)],
        "estimated": {method: names for method, column in lines.items() if (names := _estimated(column, measures))},
        "scores": rounded(scores),
        "leaderboard": _leaderboard(overall, compared, params.origins),
        "measures": {
            name: {
                **line,
                **_compare(_average_seeds(scores, exemplars, "measures", name), params.tie),
                "values": _mean_values(lines, exemplars, name),
            }
            for name, line in measures.items()
        },
        "axes": {axis: _compare(_average_seeds(scores, exemplars, "axes", axis), params.tie) for axis in axes},
        "overall": compared,
    }
    return Comparison(table, _csv(table))


def _lines(tables: Tables, items: list[dict[str, Any]], where: str) -> dict[str, list[Scores | None]]:
    require_length(len(items), "items", **{where: tables})
    return {
        method: [measures_of(table, f"{where}.{method}") for table in column] for method, column in tables.items()
    }


def _estimated(column: Sequence[Scores | None], measures: Mapping[str, Any]) -> list[str]:
    """The measures of a method that are estimates for some item."""
    known = {name for scores in column for name, line in (scores or {}).items() if line.get("estimated")}
    return [name for name in measures if name in known]


def _partial(row: Sequence[Scores | None], measures: Mapping[str, Any]) -> set[str]:
    """The measures of an item that some methods have and others, which did not fail, lack."""
    known = [{name for name, line in scores.items() if line["score"] is not None} for scores in row if scores]
    return {
        name for name in measures if any(name in own for own in known) and not all(name in own for own in known)
    }


def _item_scores(lines: Scores, measures: Mapping[str, Mapping[str, str]], lacking: set[str]) -> ItemScores:
    """The scores of one result; measures in ``lacking`` have one, but do not count."""
    own = {name: lines[name]["score"] if name in lines else None for name in measures}
    axes: dict[str, float | None] = {
        axis: least_of(
            score for name, score in own.items() if measures[name]["axis"] == axis and name not in lacking
        )
        for axis in dict.fromkeys(line["axis"] for line in measures.values())
    }
    return {"overall": mean_of(axes.values()), "axes": axes, "measures": own}


def _average_seeds(
    scores: Mapping[str, Sequence[ItemScores | None]], exemplars: Sequence[str], part: str, name: str | None = None
) -> Grid:
    """The mean score over the seeds of each exemplar."""

    def of(own: ItemScores | None) -> float | None:
        if own is None:
            return None
        score: float | None = own[part] if name is None else own[part][name]
        return score

    return {method: _by_exemplar(list(map(of, column)), exemplars) for method, column in scores.items()}


def _by_exemplar(values: Sequence[float | None], exemplars: Sequence[str]) -> list[float | None]:
    return [
        mean_of(value for value, one in zip(values, exemplars, strict=True) if one == exemplar)
        for exemplar in dict.fromkeys(exemplars)
    ]


def _mean_values(
    lines: Mapping[str, Sequence[Scores | None]], exemplars: Sequence[str], name: str
) -> dict[str, float | None]:
    """Method to the mean value of a measure, over the exemplars that its mean score is of."""
    scores, values = (
        {
            method: _by_exemplar([(own or {}).get(name, {}).get(field) for own in column], exemplars)
            for method, column in lines.items()
        }
        for field in ("score", "value")
    )
    shared = _shared(scores)
    return {method: rounded(mean_of(column[index] for index in shared)) for method, column in values.items()}


def _shared(grid: Grid) -> list[int]:
    """The exemplars on which all methods that have any score have one."""
    graded = [scores for scores in grid.values() if any(score is not None for score in scores)]
    return [index for index, row in enumerate(zip(*graded, strict=True)) if all(score is not None for score in row)]


def _compare(grid: Grid, tie: float) -> dict[str, Any]:
    """Means, win rates and pairs of one grid."""
    shared = _shared(grid)
    pairs = [_pair(grid, one, other, tie) for one, other in combinations(grid, 2)]
    _correct(pairs)
    rates: dict[str, list[float]] = {method: [] for method in grid}
    for pair in pairs:
        if pair["rate"] is not None:
            rates[pair["one"]].append(pair["rate"])
            rates[pair["other"]].append(1 - pair["rate"])
    return {
        "means": {method: rounded(mean_of(scores[index] for index in shared)) for method, scores in grid.items()},
        "exemplars": len(shared),
        "rates": {method: rounded(mean_of(values)) for method, values in rates.items()},
        "pairs": pairs,
    }


def _leaderboard(grid: Grid, compared: Mapping[str, Any], origins: Mapping[str, str]) -> list[dict[str, Any]]:
    """The methods by rank; see `compare`. Those without a score come last, without a rank."""
    means = {method: mean for method, mean in compared["means"].items() if mean is not None}
    shared = _shared(grid)
    intervals: dict[str, tuple[list[float], list[int]]] = {}
    if len(shared) >= _MIN_EXEMPLARS:
        scores = np.array([[grid[method][index] for index in shared] for method in means], np.float64)
        intervals = dict(zip(means, _intervals(scores), strict=True))
    board = []
    for method in sorted(grid, key=lambda method: (method not in means, -means.get(method, 0.0))):
        own = [
            (pair, pair["one"] == method) for pair in compared["pairs"] if method in (pair["one"], pair["other"])
        ]
        interval, ranks = intervals.get(method, (None, None))
        board.append(
            {
                "rank": 1 + sum(mean > means[method] for mean in means.values()) if method in means else None,
                "method": method,
                "origin": origins.get(method),
                "mean": means.get(method),
                "interval": rounded(interval),
                "ranks": ranks,
                "wins": sum(pair["wins" if first else "losses"] for pair, first in own),
                "losses": sum(pair["losses" if first else "wins"] for pair, first in own),
                "ties": sum(pair["ties"] for pair, _ in own),
                "rate": compared["rates"][method],
            }
        )
    return board


def _intervals(scores: Float64[np.ndarray, "methods exemplars"]) -> list[tuple[list[float], list[int]]]:
    """Interval of the mean and of the rank of each method."""
    stats = loaded("scipy.stats")
    count = scores.shape[1]
    samples = np.random.default_rng(0).integers(count, size=(_RESAMPLES, count))
    means = scores[:, samples].mean(axis=2).round(_DECIMALS)
    ranks = stats.rankdata(-means, method="min", axis=0)
    ends = [(1 - _CONFIDENCE) / 2, (1 + _CONFIDENCE) / 2]
    intervals, places = (
        np.quantile(samples, ends, axis=1, method="inverted_cdf").T.tolist() for samples in (means, ranks)
    )
    return [(interval, list(map(int, place))) for interval, place in zip(intervals, places, strict=True)]


def _csv(table: Mapping[str, Any]) -> str:
    """The leaderboard with the means of axes and measures."""
    parts = {**table["axes"], **table["measures"]}
    counted = ("wins", "losses", "ties", "rate")
    rows: list[list[Any]] = [
        [
            "rank",
            "method",
            "origin",
            "score",
            "low",
            "high",
            "best_rank",
            "worst_rank",
            *counted,
            "exemplars",
            "failed",
            *parts,
        ]
    ]
    for line in table["leaderboard"]:
        method = line["method"]
        low, high = line["interval"] or (None, None)
        best, worst = line["ranks"] or (None, None)
        rows.append(
            [
                *(line["rank"], method, line["origin"], line["mean"], low, high, best, worst),
                *(line[name] for name in counted),
                *(table["overall"]["exemplars"], table["failed"][method]),
                *(part["means"][method] for part in parts.values()),
            ]
        )
    return csv_text(rows)


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
    stats = loaded("scipy.stats")
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
    return max(float(stats.wilcoxon(differences).pvalue), _min_p(count)), None


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
