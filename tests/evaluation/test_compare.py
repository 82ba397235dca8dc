import csv
import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from tests.evaluation.helpers import Table, Tables, score_line
from texloom.stages.evaluation.compare import CompareParams, compare
from texloom.stages.vocabulary.declare import InputError

AXES = {"colors": "fidelity", "patches": "fidelity", "sharpness": "detail"}
MISSING = None


def table(**scores: float | None) -> Table:
    """A table of scores, as `metrics` makes it."""
    lines = {
        name: score_line(AXES[name], score, None if score is None else 1 - score) for name, score in scores.items()
    }
    return {"summary": {}, "measures": lines}


def items(count: int, seeds: int = 1) -> list[dict[str, Any]]:
    """As the runner names them."""
    return [
        {"name": f"e{number}-{seed}" if seeds > 1 else f"e{number}", "seed": seed, "sources": {}}
        for number in range(count)
        for seed in range(seeds)
    ]


def run(tables: Tables, seeds: int = 1, **params: Any) -> dict[str, Any]:
    count = len(next(iter(tables.values()))) // seeds
    result = compare(tables, items(count, seeds), CompareParams(**params)).table
    json.dumps(result, allow_nan=False)
    return result


def of_sharpness(**scores: list[float | None]) -> dict[str, Any]:
    tables: Tables = {name: [table(sharpness=score) for score in column] for name, column in scores.items()}
    measure: dict[str, Any] = run(tables)["measures"]["sharpness"]
    return measure


def exact_p(differences: list[float]) -> float:
    """Two-sided p of the signed-rank test, from all signs."""
    ranks = stats.rankdata(np.abs(differences))
    signs = np.array(np.meshgrid(*[[0, 1]] * len(ranks))).reshape(len(ranks), -1)
    sums = ranks @ signs
    seen = float(ranks[np.array(differences) > 0].sum())
    return min(1.0, 2 * min((sums <= seen + 1e-9).mean(), (sums >= seen - 1e-9).mean()))


def test_wins_losses_ties_and_p_by_hand() -> None:
    line = of_sharpness(
        one=[0.9, 0.8, 0.7, 0.6, 0.5, 0.40, 0.3],
        other=[0.5, 0.5, 0.5, 0.5, 0.5, 0.45, 0.1],
    )
    (pair,) = line["pairs"]
    assert (pair["one"], pair["other"]) == ("one", "other")
    assert (pair["wins"], pair["losses"], pair["ties"]) == (5, 1, 1)
    assert pair["rate"] == pytest.approx(5.5 / 7, rel=1e-5)
    # differences .4 .3 .2 .1 0 -.05 .2: the loss has rank 1 of 6; two of 64 signs give 0 or 1, on either side
    assert pair["p"] == pair["holm"] == 4 / 64
    assert pair["min_p"] == 2 / 64
    assert "reason" not in pair
    assert line["axis"] == "detail"
    assert line["means"] == {"one": 0.6, "other": pytest.approx(3.05 / 7, rel=1e-5)}
    assert line["exemplars"] == 7
    assert line["rates"] == {"one": pair["rate"], "other": pytest.approx(1.5 / 7, rel=1e-5)}


@settings(max_examples=15)
@given(st.lists(st.integers(-5, 5), min_size=6, max_size=9))
def test_p_is_that_of_all_signs(steps: list[int]) -> None:
    """Also where ranks are shared and where differences are 0."""
    differences = [step / 100 for step in steps]
    (pair,) = of_sharpness(a=[0.5 + difference for difference in differences], b=[0.5] * len(steps))["pairs"]
    nonzero = [difference for difference in differences if difference]
    if len(nonzero) < 6:
        assert pair["p"] is None
    else:
        assert pair["p"] == pytest.approx(exact_p(nonzero), rel=1e-4)


def test_p_of_many_pairs_is_scipys(rng: np.random.Generator) -> None:
    scores = rng.uniform(0.3, 0.6, 60).round(6)
    gains = rng.normal(0.02, 0.05, 60).round(6)
    (pair,) = of_sharpness(a=(scores + gains).tolist(), b=scores.tolist())["pairs"]
    assert pair["ties"] == (np.abs(gains) <= 0.001).sum()
    expected = stats.wilcoxon(np.where(np.abs(gains) <= 0.001, 0, gains).round(6)[np.abs(gains) > 0.001]).pvalue
    assert pair["p"] == pytest.approx(expected, rel=1e-3)


def test_p_is_never_below_the_possible() -> None:
    (pair,) = of_sharpness(a=[0.6] * 16, b=[0.5] * 16)["pairs"]
    assert pair["p"] >= pair["min_p"] == pytest.approx(2**-15, rel=1e-5)


@pytest.mark.parametrize(
    ("one", "reason"),
    [
        ([0.5] * 8, "all exemplars are ties"),
        ([0.9] * 5 + [0.5] * 3, "only 5 exemplars differ, with which p is at least 0.0625; it takes 6"),
        ([MISSING] * 8, "no exemplar has a score of both"),
    ],
)
def test_no_p_without_enough_differences(one: list[float | None], reason: str) -> None:
    (pair,) = of_sharpness(one=one, other=[0.5] * 8)["pairs"]
    assert pair["p"] is None
    assert pair["holm"] is None
    assert pair["reason"] == reason


def test_identical_methods_tie() -> None:
    scores = [table(colors=0.1 * number, sharpness=0.5) for number in range(8)]
    result = run({"one": scores, "same": scores})
    for line in (*result["measures"].values(), *result["axes"].values(), result["overall"]):
        assert line["means"]["one"] == line["means"]["same"]
        assert line["rates"] == {"one": 0.5, "same": 0.5}
        (pair,) = line["pairs"]
        assert (pair["wins"], pair["losses"], pair["ties"], pair["p"]) == (0, 0, 8, None)


def test_rounding_is_no_win() -> None:
    (pair,) = of_sharpness(a=[0.1 + 0.2] * 8, b=[0.3] * 8)["pairs"]
    assert pair["ties"] == 8


def test_the_largest_tie_is_a_parameter() -> None:
    tables = {"a": [table(colors=0.52)] * 6, "b": [table(colors=0.5)] * 6}
    assert run(tables)["measures"]["colors"]["pairs"][0]["wins"] == 6
    assert run(tables, tie=0.03)["measures"]["colors"]["pairs"][0]["ties"] == 6


def test_seeds_of_an_exemplar_count_once() -> None:
    # e0: mean .4 against .5, though two of three seeds win; e1: .8 against .6
    one = [0.6, 0.6, 0.0, 0.8, 0.8, MISSING]
    other = [0.5, 0.5, 0.5, 0.6, 0.6, 0.6]
    result = run({"one": [table(colors=s) for s in one], "other": [table(colors=s) for s in other]}, seeds=3)
    line = result["measures"]["colors"]
    (pair,) = line["pairs"]
    assert (pair["wins"], pair["losses"], pair["ties"]) == (1, 1, 0)
    assert line["means"] == {"one": 0.6, "other": 0.55}
    assert line["exemplars"] == 2
    assert result["items"] == ["e0-0", "e0-1", "e0-2", "e1-0", "e1-1", "e1-2"]
    assert result["exemplars"] == ["e0", "e1"]


def test_a_score_is_that_of_its_table() -> None:
    """Whatever the value: the page, the comparison and the item's own table must not contradict each other."""
    lines = {"colors": {**score_line("fidelity", 0.9, 0.4, 0.3), "ceiling": 2.0}}
    result = run({"one": [{"measures": lines}], "other": [table(colors=0.5)]})
    assert result["scores"]["one"][0] == {"overall": 0.9, "axes": {"fidelity": 0.9}, "measures": {"colors": 0.9}}
    colors = result["measures"]["colors"]
    assert colors["means"] == result["axes"]["fidelity"]["means"] == {"one": 0.9, "other": 0.5}
    assert colors["values"] == {"one": 0.4, "other": 0.5}


def test_names_end_in_the_seed_where_there_are_several() -> None:
    def exemplars(*pairs: tuple[str, int]) -> list[str]:
        named = [{"name": name, "seed": seed, "sources": {}} for name, seed in pairs]
        column: list[Table | None] = [table(colors=0.5)] * len(named)
        names: list[str] = compare({"a": column, "b": column}, named, CompareParams()).table["exemplars"]
        return names

    assert exemplars(("wall-1", 1), ("wall-2", 1)) == ["wall-1", "wall-2"]
    assert exemplars(("wall-1-1", 1), ("wall-1-12", 12), ("wall-2-1", 1), ("wall-2-12", 12)) == ["wall-1", "wall-2"]
    assert exemplars(("1", 1), ("2", 2)) == ["exemplar"]


def test_axes_are_their_worst_and_overall_their_mean() -> None:
    one = table(colors=0.2, patches=0.4, sharpness=0.9)
    other = table(colors=0.6, patches=0.8, sharpness=0.5)
    result = run({"one": [one], "other": [other]})
    assert result["axes"]["fidelity"]["means"] == {"one": 0.2, "other": 0.6}
    assert result["axes"]["detail"]["means"] == {"one": 0.9, "other": 0.5}
    assert result["overall"]["means"] == {"one": 0.55, "other": 0.55}
    assert result["overall"]["pairs"][0]["ties"] == 1


def test_a_measure_that_one_method_lacks_is_left_out_of_the_axis() -> None:
    one = table(colors=0.2, patches=None, sharpness=0.5)
    other = table(colors=0.3, patches=1.0, sharpness=0.5)
    result = run({"one": [one], "other": [other]})
    assert result["axes"]["fidelity"]["means"] == {"one": 0.2, "other": 0.3}
    assert result["measures"]["patches"]["means"] == {"one": None, "other": 1.0}
    assert result["measures"]["patches"]["rates"] == {"one": None, "other": None}
    assert result["partial"] == ["patches"]
    assert result["scores"]["other"][0]["measures"]["patches"] == 1.0
    assert result["scores"]["other"][0]["axes"]["fidelity"] == 0.3


def test_further_measures_join() -> None:
    tables: Tables = {"a": [table(colors=0.2), None], "b": [table(colors=0.4), table(colors=0.3)]}
    more: Tables = {"a": [table(sharpness=0.8), None], "b": [table(sharpness=0.2), None]}
    result = compare(tables, items(2), CompareParams(), more).table
    assert result["measures"]["colors"] == run(tables)["measures"]["colors"]
    assert result["axes"]["detail"]["means"] == {"a": 0.8, "b": 0.2}
    assert result["overall"]["means"] == {"a": 0.5, "b": 0.3}
    with pytest.raises(InputError, match="more: c is not one of tables' methods"):
        compare(tables, items(2), CompareParams(), {"c": [None, None]})
    with pytest.raises(InputError, match=r"more\.a has 1 entries, items has 2"):
        compare(tables, items(2), CompareParams(), {"a": [None]})


def test_a_failed_item_does_not_count() -> None:
    good = table(colors=0.9)
    result = run({"a": [good, None, good], "b": [table(colors=0.8), table(colors=0.1), None], "c": [good] * 3})
    assert result["failed"] == {"a": 1, "b": 1, "c": 0}
    line = result["measures"]["colors"]
    assert line["means"] == {"a": 0.9, "b": 0.8, "c": 0.9}  # of the exemplar that all have
    assert line["exemplars"] == 1
    counts = {(p["one"], p["other"]): (p["wins"], p["losses"], p["ties"]) for p in line["pairs"]}
    assert counts == {("a", "b"): (1, 0, 0), ("a", "c"): (0, 0, 2), ("b", "c"): (0, 2, 0)}
    assert result["overall"]["pairs"] == result["axes"]["fidelity"]["pairs"] == line["pairs"]


def test_a_method_that_always_failed_does_not_affect_others() -> None:
    tables: Tables = {"a": [table(colors=0.9)], "b": [None], "c": [table(colors=0.5)]}
    line = run(tables)["measures"]["colors"]
    assert line["means"] == {"a": 0.9, "b": None, "c": 0.5}
    assert line["rates"] == {"a": 1.0, "b": None, "c": 0.0}
    nothing = run({"a": [None], "b": [None]})
    assert nothing["measures"] == nothing["axes"] == {}
    assert nothing["overall"]["means"] == {"a": None, "b": None}


def test_holm_by_hand() -> None:
    # against c: a wins all 8 (p 2/256), b loses the smallest only (p 4/256); a and b: a wins all (p 2/256)
    c = [0.1] * 8
    b = [0.1 + 0.01 * step for step in (-1, 2, 3, 4, 5, 6, 7, 8)]
    a = [score + 0.01 * step for score, step in zip(b, (3, 4, 5, 6, 7, 8, 9, 10), strict=True)]
    pairs = of_sharpness(a=a, b=b, c=c)["pairs"]
    assert {(pair["one"], pair["other"]): (pair["p"], pair["holm"]) for pair in pairs} == {
        ("a", "b"): (2 / 256, 6 / 256),
        ("a", "c"): (2 / 256, 6 / 256),
        ("b", "c"): (4 / 256, 6 / 256),  # itself 4/256, but never below a smaller p's
    }


def test_the_order_of_methods_does_not_matter(rng: np.random.Generator) -> None:
    def tables(methods: list[str]) -> Tables:
        return {method: columns[method] for method in methods}

    columns: Tables = {
        method: [
            None if rng.random() < 0.1 else table(colors=rng.random(), patches=rng.random(), sharpness=rng.random())
            for _ in range(24)
        ]
        for method in "abc"
    }
    forward, backward = (run(tables(list(order)), seeds=2) for order in ("abc", "cba"))

    def lines(result: dict[str, Any]) -> list[dict[str, Any]]:
        return [
            *(result[part][name] for part in ("measures", "axes") for name in sorted(result[part])),
            result["overall"],
        ]

    for one, other in zip(lines(forward), lines(backward), strict=True):
        assert one["means"] == other["means"]
        assert one["rates"] == pytest.approx(other["rates"], rel=1e-5)
        turned = {(pair["other"], pair["one"]): pair for pair in other["pairs"]}
        for pair in one["pairs"]:
            twin = turned[pair["one"], pair["other"]]
            assert (pair["wins"], pair["losses"], pair["ties"]) == (twin["losses"], twin["wins"], twin["ties"])
            assert (pair["p"], pair["holm"]) == (twin["p"], twin["holm"])


def test_ranks_and_their_intervals() -> None:
    rng = np.random.default_rng(5)
    scores = {
        "worst": rng.uniform(0, 0.1, 12),
        "best": rng.uniform(0.8, 0.9, 12),
        "middle": rng.uniform(0.4, 0.5, 12),
    }
    result = run({name: [table(sharpness=score) for score in column.tolist()] for name, column in scores.items()})
    board = result["leaderboard"]
    assert [(line["rank"], line["method"], line["ranks"]) for line in board] == [
        (1, "best", [1, 1]),
        (2, "middle", [2, 2]),
        (3, "worst", [3, 3]),
    ]
    assert [(line["wins"], line["losses"], line["ties"]) for line in board] == [(24, 0, 0), (12, 12, 0), (0, 24, 0)]
    for line in board:
        low, high = line["interval"]
        error = scores[line["method"]].std() / np.sqrt(12)
        assert line["mean"] == result["overall"]["means"][line["method"]]
        assert line["mean"] - low == pytest.approx(1.96 * error, rel=0.3)
        assert high - line["mean"] == pytest.approx(1.96 * error, rel=0.3)


def test_equal_methods_share_a_rank_and_a_failed_one_has_none() -> None:
    alike = [table(colors=0.1 * number) for number in range(8)]
    board = run({"failed": [None] * 8, "one": alike, "same": alike})["leaderboard"]
    assert [(line["rank"], line["method"], line["ranks"]) for line in board] == [
        (1, "one", [1, 1]),
        (1, "same", [1, 1]),
        (None, "failed", None),
    ]
    few = run({"one": alike[:5], "same": alike[:5]})["leaderboard"]
    assert [(line["rank"], line["interval"]) for line in few] == [(1, None), (1, None)]


def test_the_spreadsheet_is_the_leaderboard() -> None:
    tables: Tables = {"a": [table(colors=0.2), None], "b": [table(colors=0.4), table(colors=0.3)]}
    made = compare(tables, items(2), CompareParams())
    header, *rows = csv.reader(made.csv.splitlines())
    first, second = (dict(zip(header, row, strict=True)) for row in rows)
    assert (first["rank"], first["method"], first["score"], first["fidelity"], first["colors"]) == (
        *("1", "b", "0.4"),
        *("0.4", "0.4"),
    )
    assert (second["method"], second["losses"], second["failed"], second["low"]) == ("a", "1", "1", "")


def test_refused() -> None:
    good = table(colors=0.5)
    with pytest.raises(InputError, match="tables: a cannot be compared; give two methods or more"):
        compare({"a": [good]}, items(1), CompareParams())
    with pytest.raises(InputError, match=r"tables\.b has 2 entries, items has 1"):
        compare({"a": [good], "b": [good, good]}, items(1), CompareParams())
    with pytest.raises(InputError, match=r"tables\.b is not a table of scores"):
        compare({"a": [good], "b": [{"curves": {}}]}, items(1), CompareParams())
