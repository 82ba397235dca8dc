"""The command line that repeats a run."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import pytest

from texloom.pipelines.flow.command import command_of
from texloom.pipelines.flow.comparison import comparison_flow
from texloom.pipelines.flow.items import items_of
from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.flow.model import Overrides


@pytest.fixture(autouse=True)
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with pictures that have no content, as none is opened."""
    for name in ("set/a.png", "set/it's b.png"):
        (tmp_path / "work" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "work" / name).touch()
    monkeypatch.chdir(tmp_path / "work")
    return tmp_path / "work"


@pytest.mark.parametrize(
    ("overrides", "command"),
    [
        (Overrides(), "texloom run self_tuning --seed 7"),
        (
            Overrides({"exemplar": "skimage:grass"}, {"size": "512x768", "tileable": "true"}, seed=3),
            "texloom run self_tuning skimage:grass --size 512x768 --tileable --seed 3",
        ),
        (
            Overrides({"exemplar": "it's.png"}, {"size": "96x64", "preset": '"fast"', "texture.occurrence": "2"}),
            """texloom run self_tuning 'it'"'"'s.png' --size 96x64 --preset fast """
            "--set texture.occurrence=2 --seed 7",
        ),
        (
            Overrides({"control": "c.png"}, pictures=["a.png", "b.png"], exports={"tree.exr": "clusters.nodes"}),
            "texloom run inverse a.png b.png --source control=c.png --export tree.exr=clusters.nodes --seed 7",
        ),
        (Overrides(seeds=range(4, 7)), "texloom run self_tuning --seeds 4-6"),
        (
            Overrides({"exemplar": "set/*.png"}),
            "texloom run self_tuning 'set/*.png' --seed 7",
        ),
    ],
)
def test_what_was_given_is_given_again(overrides: Overrides, command: str) -> None:
    flow = load_flow(find_flow(command.split()[2]), overrides)
    assert command_of(flow) == command


def test_an_item_is_made_by_itself(work: Path) -> None:
    flow = load_flow(find_flow("quilting"), Overrides({"exemplar": "set/*.png"}, seeds=2))
    words = [shlex.split(command_of(flow, item)) for item in items_of(flow)]
    assert [line[3] for line in words] == [*["set/a.png"] * 2, *["set/it's b.png"] * 2]
    assert [line[-2:] for line in words] == [["--seed", "7"], ["--seed", "8"]] * 2
    (work.parent / "other").mkdir()
    os.chdir(work.parent / "other")
    assert shlex.split(command_of(flow, items_of(flow)[0]))[3] == f"{work}/set/a.png"


def test_a_comparison() -> None:
    flow = comparison_flow(["quilting", "hybrid"], Overrides(params={"size": "64"}, seeds=2), "set/*.png")
    assert command_of(flow) == "texloom compare quilting hybrid --over 'set/*.png' --size 64 --seeds 2 --seed 7"


@pytest.mark.parametrize("flows", [["quilting"], []])
def test_a_comparison_with_finished_pictures(flows: list[str]) -> None:
    folders = ["one=set", "other=set"]
    flow = comparison_flow([*flows, *folders], Overrides(params={"size": "64"}), "set")
    words = ["compare", *flows, "--over", "set", "--against", "one=set", "--against", "other=set", "--size", "64"]
    seed = 7 if flows else 0
    assert command_of(flow) == " ".join(["texloom", *words, "--seed", str(seed)])


def test_a_flow_file_is_named_by_its_path(work: Path) -> None:
    (work / "mine.yaml").write_text(find_flow("quilting").read_text())
    assert command_of(load_flow(find_flow("mine.yaml"))) == "texloom run mine.yaml --seed 7"
    elsewhere = work.parent / "quilting.yaml"
    elsewhere.write_text(find_flow("quilting").read_text())
    assert command_of(load_flow(elsewhere)) == f"texloom run {elsewhere} --seed 7"
