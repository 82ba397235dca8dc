"""The page of papers is current, complete, and names files and flows that there are."""

from __future__ import annotations

import ast
import re
from types import ModuleType

import pytest

from tests.conftest import ROOT
from tests.docs.pages import DOCS, script
from texloom.pipelines.flow.shipped import shipped_flows


@pytest.fixture(scope="module")
def papers() -> ModuleType:
    return script(DOCS / "make_papers.py")


@pytest.fixture(scope="module")
def rows(papers: ModuleType) -> dict[str, list[tuple[str, ...]]]:
    """The cells of each paper's table of stages, as they stand on the page."""
    sections = re.split(r"^## (\w+)\n", papers.FILE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    found = {}
    for key, section in zip(sections[1::2], sections[2::2], strict=True):
        lines = section.partition("| figure or table |")[0].splitlines()
        found[key] = [tuple(line[2:-2].split(" | ")) for line in lines if line.startswith("| ")][1:]
    return found


def test_page_is_current(papers: ModuleType) -> None:
    assert papers.FILE.read_text(encoding="utf-8") == papers.page(), "run: python docs/make_papers.py"


def test_every_citation_of_a_stage_has_a_row(papers: ModuleType, rows: dict[str, list[tuple[str, ...]]]) -> None:
    missing = []
    for file, stage in papers.stage_files().items():
        [function] = [
            node
            for node in ast.parse((ROOT / file).read_text(encoding="utf-8")).body
            if isinstance(node, ast.FunctionDef) and node.name == stage.rpartition(".")[2]
        ]
        for key in re.findall(r"\[(\w+\d{4}[a-z]?)\]_", ast.get_docstring(function) or ""):
            if not any(row[1:3] == (f"`{file}`", f"`{stage}`") for row in rows[key]):
                missing.append((file, key))
    assert not missing


def test_files_and_flows_of_rows_exist(rows: dict[str, list[tuple[str, ...]]]) -> None:
    listed = [row for table in rows.values() for row in table]
    assert {len(row) for row in listed} == {4}
    assert not [file for _, file, _, _ in listed if not (ROOT / file.strip("`")).is_file()]
    flows = {name for *_, flows in listed for name in re.findall(r"`(\w+)`", flows)}
    assert flows <= set(shipped_flows())


def test_places_belong_to_the_citation_before_them(papers: ModuleType) -> None:
    text = "[Wei2008]_ sections 4.2 and 5, Figure 3a; [Lin2004]_, as\n    in Tables 2 and 3.\n\n    Not section 9."
    assert papers.citations(text) == {"Wei2008": ["sections 4.2 and 5", "Figure 3a"], "Lin2004": ["Tables 2 and 3"]}
    assert papers.citations("# [Wei2008, Figures 19 and 20] and\n# equation (4)")["Wei2008"] == [
        "Figures 19 and 20",
        "equation (4)",
    ]
