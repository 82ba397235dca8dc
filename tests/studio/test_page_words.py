"""What the page says in place of options of the command line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.conftest import ROOT
from texloom.pipelines.studio.page_words import page_words

OPTION = re.compile(r"--(set|source|seeds?|size|tileable|preset|crop|reduce)\b")


@pytest.mark.parametrize(
    ("problem", "told"),
    [
        ("it is not, --set accept=true goes on", "it is not, “Also if it has structure” goes on"),
        ("keep all (--set unlike=1000), crop", "keep all (Foreign parts: kept), crop"),
        ("as it is (--set plane=0)", "as it is (Surface: seen from the front)"),
        ("give corners (--set geometry=my.yaml)", "give corners (Place surfaces by hand)"),
        ("a mask (--source mask=my.png)", "a mask (paint it on the layer Guides, under Leave out)"),
        ("give --source target=PICTURE; or another", "give “Trend of the result”; or another"),
        ("change --size or --seed 8", "change Size or Seed 8"),
        ("--tileable=off does not", "Tileable off does not"),
        ("--set suits.way=none", "suits.way: none in the flow file, which Show as YAML or command has"),
        ("--set height.joints=0 ignores them", "“Joints” at 0 ignores them"),
        ("--memory 8GB allows more", "--memory 8GB allows more"),
    ],
)  # fmt: skip
def test_options_have_the_words_of_the_page(problem: str, told: str) -> None:
    assert page_words(problem) == told


def test_no_problem_of_a_stage_leaves_an_option() -> None:
    """Texts of all stages, as far as they stand in their code."""
    found = [
        line.strip()
        for path in Path(ROOT, "stages").rglob("*.py")
        for line in path.read_text().splitlines()
        if OPTION.search(line)
    ]
    assert len(found) > 30
    assert [line for line in found if OPTION.search(page_words(line))] == []
