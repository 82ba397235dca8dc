"""Every figure and table of five papers has a command, which runs."""

from __future__ import annotations

import os
import re
from pathlib import Path
from types import ModuleType

import pytest

from tests.docs.pages import DOCS, script
from tests.docs.test_commands import texloom

PAPERS: ModuleType = script(DOCS / "make_papers.py")
ROWS = [(paper, one) for paper, rows in PAPERS.figures().items() for one in rows]
SMALL = {" ".join(PAPERS.smaller(one)): PAPERS.smaller(one) for _, one in ROWS if "run" in one}
"""the commands at small size, each once"""
QUICK = ("contour_report", "inverse texloom", "feature_mask", "graph_cut", "adaptive ")
"""beginnings of those that run in every test; all others do with TEXLOOM_FIGURES=1"""
COUNTS = {
    "Kaspar2015": (10, 0),
    "Wei2008": (20, 2),
    "Eisenacher2008": (19, 0),
    "Lin2004": (49, 3),
    "Ding2014": (2, 3),
}
"""figures and tables of each paper"""


def numbers(text: str, kind: str) -> list[int]:
    """The numbers of figures or tables that a cell names."""
    found: list[int] = []
    for part in re.findall(rf"{kind}s? ([\d, andto]+)", text):
        for first, last in re.findall(r"(\d+)(?: to (\d+))?", part):
            found += range(int(first), int(last or first) + 1)
    return found


@pytest.mark.parametrize("paper", COUNTS)
def test_every_figure_and_table_has_one_row(paper: str) -> None:
    cells = [one["figure"] for key, one in ROWS if key == paper]
    for kind, count in zip(("Figure", "Table"), COUNTS[paper], strict=True):
        assert sorted(number for cell in cells for number in numbers(cell, kind)) == list(range(1, count + 1))


def test_a_row_without_a_command_says_why() -> None:
    assert all(one["differs"] for _, one in ROWS)
    assert sum("run" not in one for _, one in ROWS) <= 2


def test_commands_are_accepted_as_printed(tmp_path: Path) -> None:
    written = ["--store", str(tmp_path / "store"), "--out", str(tmp_path / "out")]
    for run in sorted({one["run"] for _, one in ROWS if "run" in one}):
        code, said = texloom(["plan", *run.split(), *written])
        assert code == 0, f"{run}\n{said}"


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store, so that commands share steps."""
    return tmp_path_factory.mktemp("figures")


@pytest.mark.parametrize("command", SMALL)
def test_commands_run_at_small_size(command: str, shared: Path, tmp_path: Path) -> None:
    if not command.startswith(QUICK) and not os.environ.get("TEXLOOM_FIGURES"):
        pytest.skip("TEXLOOM_FIGURES=1 runs all")
    written = ["--store", str(shared / "store"), "--out", str(tmp_path / "out")]
    code, said = texloom(["run", *SMALL[command], *written])
    assert code == 0, said
    assert any((tmp_path / "out").iterdir())
