"""`texloom commands`: lines that together do what a run does."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest

from tests.pipelines.cli.test_main import assert_refused, texloom
from tests.pipelines.flows import files, write_flow, write_set


def run_lines(text: str) -> list[list[str]]:
    """Run lines as a local runner of such lists does; the steps that each has computed."""
    computed = []
    for line in text.splitlines():
        program, *words = shlex.split(line)
        assert program == "texloom"
        result = texloom(*words, "--json")
        assert result.code == 0, result
        computed.append([step["name"] for step in json.loads(result.out)["steps"] if step["state"] == "ran"])
    return computed


def test_lines_make_what_a_run_makes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flow = write_set(tmp_path)
    monkeypatch.chdir(tmp_path)
    options = ("--source", "exemplar=pictures/*.png", "--set", "start.size=36", "--store", "store", "--out", "one")
    result = texloom("commands", str(flow), *options)
    assert result.code == 0, result
    lines = result.out.splitlines()
    assert len(lines) == 3 * 2 + 1
    assert all(line.endswith(f"--item {name}-{seed}") for line, (name, seed) in zip(
        lines, [(name, seed) for name in "abc" for seed in (1, 2)], strict=False))  # fmt: skip
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    computed = run_lines("\n".join([*lines[-2::-1], lines[-1]]))
    assert ["all"] not in computed[:-1]
    assert set(computed[-1]) == {"all", "contact_sheet"}
    assert not any(elsewhere.iterdir())
    assert run_lines(result.out) == [[]] * 7
    monkeypatch.chdir(tmp_path)
    assert texloom("run", str(flow), *options[:-2], "--out", "two", "--store", "other").code == 0
    assert files(tmp_path / "one") == files(tmp_path / "two")


def test_parts_of_the_list(tmp_path: Path) -> None:
    flow = write_set(tmp_path)
    whole, items, gather = (
        texloom("commands", str(flow), "--out", str(tmp_path / "out"), *only).out.splitlines()
        for only in ((), ("--only", "items"), ("--only", "gather"))
    )
    assert whole == items + gather
    assert len(gather) == 1
    report = json.loads(texloom("commands", str(flow), "--out", str(tmp_path / "out"), "--json").out)
    assert [shlex.join(words) for words in report["items"].values()] == items
    assert shlex.join(report["gather"]) == gather[0]


def test_a_flow_without_a_set_is_one_line(tmp_path: Path) -> None:
    flow = write_flow(tmp_path)
    result = texloom("commands", str(flow), "--seed", "3", "--out", str(tmp_path / "a folder"))
    (line,) = result.out.splitlines()
    assert line.startswith(f"texloom run {flow} --seed 3 --store ")
    assert line.endswith(f"--out '{tmp_path}/a folder'")
    assert not (tmp_path / "a folder").exists()


def test_delivery_and_exports_are_repeated(tmp_path: Path) -> None:
    flow = write_set(tmp_path)
    options = ("--export", "edges.tif=edges.strength", "--texel-size", "1mm", "--color-space", "acescg")
    (line, *others) = texloom("commands", str(flow), *options, "--seeds", "2-4").out.splitlines()
    words = "--export edges.tif=edges.strength --color-space acescg --texel-size 1mm --seeds 2-4 --store"
    assert words in line
    assert len(others) == 9


def test_items_that_are_wrong(tmp_path: Path) -> None:
    flow = write_set(tmp_path)
    wrong = texloom("run", str(flow), "--item", "a-11")
    assert_refused(wrong, "--item a-11: set has no such item; did you mean 'a-1'?")
    single = write_flow(tmp_path)
    assert_refused(texloom("run", str(single), "--item", "a"), "--item a: small runs over no set here")
