"""Sources that keep the order in which their files are given."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from texloom.pipelines.flow.items import items_of
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Overrides
from texloom.stages.vocabulary.declare import InputError

FLOW = """
flow: all_of_them
sources:
  pictures: {SOURCE}
steps:
  tone: {{stage: analysis.tone, inputs: {{image: pictures}}}}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in "abc":
        PIL.Image.fromarray(np.zeros((8, 8), np.uint8)).save(tmp_path / f"{name}.png")
    return tmp_path


def names(folder: Path, source: str, *given: str) -> list[str]:
    path = folder / "flow.yaml"
    path.write_text(FLOW.format(SOURCE=source))
    pictures: Sequence[str] = [str(folder / one) for one in given]
    return [item.name for item in items_of(load_flow(path, Overrides(pictures=pictures)))]


def test_a_list_of_files_keeps_its_order_where_it_matters(folder: Path) -> None:
    assert names(folder, "{each: [c.png, a.png], ordered: true}") == ["c", "a"]
    assert names(folder, "{each: [c.png, a.png]}") == ["a", "c"]


def test_files_that_are_given_one_by_one_keep_theirs(folder: Path) -> None:
    ordered = "{each: '*.png', ordered: true}"
    assert names(folder, ordered, "c.png", "a.png", "b.png") == ["c", "a", "b"]
    assert names(folder, ordered, "*.png") == ["a", "b", "c"]
    assert names(folder, ordered, "c.png", "[ab].png") == ["a", "b", "c"]
    assert names(folder, ordered, ".") == ["a", "b", "c"]
    assert names(folder, "{each: '*.png'}", "c.png", "a.png") == ["a", "c"]


def test_too_few_files_are_refused(folder: Path) -> None:
    source = "{each: [c.png, a.png], least: 2}"
    assert names(folder, source, "[ab].png") == ["a", "b"]
    for given in (["a.png"], ["a.png", "a.png"], ["a.png", "[a].png"]):
        with pytest.raises(InputError, match="2 pictures or more are needed, got 1"):
            names(folder, source, *given)


@pytest.mark.parametrize("each", ["[]", "[a.png, 3]", "[a.png, '']"])
def test_lists_of_other_things_are_refused(folder: Path, each: str) -> None:
    with pytest.raises(InputError, match="must be a pattern"):
        names(folder, f"{{each: {each}}}")
