"""The page over a set of compactions."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.evaluation.helpers import EVIL, load, score_line
from tests.synthetic import picture
from texloom.stages.evaluation._pages.curve import energy_curve
from texloom.stages.evaluation.inverse_report import InverseReportParams, inverse_report
from texloom.stages.vocabulary.declare import InputError

ROUNDS = [{"level": level, "energy": 100.0 / (level + number)} for level in (1, 2) for number in range(3)]


def table(compaction: float, crop: float) -> dict[str, Any]:
    energies = {
        name: {
            **score_line("energy", 0.5, value),
            "more": {"inverse": value, "forward": 1.0},
            "what": f"What {EVIL}",
        }
        for name, value in (("compaction", compaction), ("crop", crop))
    }
    return {"summary": {}, "measures": {**energies, "reconstruction": score_line("likeness", 0.5, 3.25)}}


def page(count: int, failed: int | None = None, **params: Any) -> str:
    rng = np.random.default_rng(1)

    def column(*shape: int) -> list[Any]:
        return [None if index == failed else picture(rng.random(shape)) for index in range(count)]

    return inverse_report(
        {"texture": column(40, 60), "compaction": column(16, 20), f"best {EVIL}": column(16, 20)},
        [None if index == failed else ROUNDS for index in range(count)],
        [None if index == failed else table(10.0 + index, 11.0) for index in range(count)],
        InverseReportParams(title=f"Set {EVIL}", largest=32, **params),
        items=[{"name": f"t{index:02d}", "seed": 7, "sources": {"texture": EVIL}} for index in range(count)],
        provenance=[
            {"step": step, "item": f"t{index:02d}", "stage": "synthesis.compact", "seconds": 1.5, "params": {}}
            for step in ("compact", "result")
            for index in range(count)
            if index != failed
        ],
    ).page


def test_sizes_times_and_links_are_shown() -> None:
    html = page(3)
    assert "<script>alert" not in html
    assert html.count('class="thumb"') == html.count('loading="lazy"') == 9
    assert html.count('class="curve"') == 3
    for words in ("60 x 40 px", "20 x 16 px", "compact 1.50 s", "3.00 s", '<a href="#item-3">t02</a>'):
        assert words in html
    assert "failed" not in html.partition("<main>")[2]


def test_the_best_of_each_line_and_how_often() -> None:
    """Energies 10, 11 and 12 beside 11; equals go to the first."""
    html = page(3)
    assert re.findall(r'class="figure best"[^>]*><b>([\d.]+)</b>', html) == ["10", "11", "11"]
    wins = re.search(r"times lowest</th>(.*?)</tr>", html)
    assert wins is not None
    assert re.findall(r'class="figure">(\d+)<', wins.group(1)) == ["2", "1"]


def test_an_item_that_failed_leaves_the_others() -> None:
    html = page(3, failed=1)
    assert "1 of them failed" in html
    assert html.count('class="thumb"') == 6
    assert "texture: none" in html


def test_fifty_items_make_a_page_of_reasonable_size() -> None:
    assert len(page(50)) < 2_000_000


def test_lists_must_be_of_one_length() -> None:
    with pytest.raises(InputError, match="energies has 0 entries, tables has 1"):
        inverse_report({}, [], [None], InverseReportParams())
    with pytest.raises(InputError, match="entry 1 is not a table of scores"):
        inverse_report({}, [None], [{}], InverseReportParams())


def test_a_curve_falls_and_breaks_between_levels() -> None:
    paths = re.findall(r'<path d="M([^"]+)"', energy_curve(ROUNDS))
    points = [np.array([place.split() for place in path.split("L")], float) for path in paths]
    assert [len(part) for part in points] == [3, 3]
    assert all((np.diff(part, axis=0) > 0).all() for part in points)  # right, and down
    assert energy_curve([]) == energy_curve([{"level": 1, "energy": None}]) == ""
    assert "nan" not in energy_curve([{"level": 1, "energy": 0.0}, {"level": 1, "energy": float("nan")}])


def test_pictures_open_in_a_browser(tab: Any, tmp_path: Path) -> None:
    load(tab, page(12), tmp_path)
    tab.evaluate("document.querySelectorAll('.thumb')[4].click()")
    assert tab.evaluate("document.querySelector('dialog [data-name]').textContent") == "t01, compaction"
