"""Several seeds from the command line, and the contact sheet of their results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import PIL.Image
import pytest
from click.testing import CliRunner

from tests.pipelines.flows import write_flow
from texloom.pipelines.cli import main
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.flow.seed_sheet import open_flow
from texloom.stages.vocabulary.declare import InputError

FLOW = """
flow: variations
seed: 5
sources: {exemplar: exemplar.png}
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}}
  start: {stage: synthesis.initialise, inputs: {image: exemplar}, params: {size: 40x32, method: pixels}}
exports:
  edges.exr: edges.strength
  start.png: start.image
"""


def run(folder: Path, *options: str) -> dict[str, Any]:
    write_flow(folder, FLOW)
    places = ["--store", str(folder / "store"), "--out", str(folder / "out")]
    arguments = ["run", str(folder / "flow.yaml"), *places, "--json", *options]
    result = CliRunner().invoke(main.texloom, arguments, standalone_mode=False, catch_exceptions=False)
    assert result.return_value == 0, result.output
    report: dict[str, Any] = json.loads(result.stdout)
    return report


def states(report: dict[str, Any]) -> dict[str, str]:
    return {f"{step['name']}-{step.get('item', '')}": step["state"] for step in report["steps"]}


def test_a_range_of_seeds_gives_each_and_one_sheet(tmp_path: Path) -> None:
    report = run(tmp_path, "--seeds", "2-4")
    exports = report["exports"]
    assert list(exports) == ["edges.exr", "contact_sheet.png", "2/start.png", "3/start.png", "4/start.png"]
    with PIL.Image.open(exports["contact_sheet.png"]) as sheet:
        assert sheet.mode == "RGB"
        assert min(sheet.size) > 80
    again = states(run(tmp_path, "--seeds", "3-5"))
    assert again["start-3"] == again["start-4"] == again["thumbnail-4"] == "cached"
    assert again["start-5"] == again["contact_sheet-"] == "ran"
    assert set(states(run(tmp_path, "--seeds", "3-5")).values()) == {"cached"}


def test_a_number_of_seeds_counts_from_the_first(tmp_path: Path) -> None:
    exports = run(tmp_path, "--seeds", "2")["exports"]
    assert "5/start.png" in exports
    assert "6/start.png" in exports
    exports = run(tmp_path, "--seeds", "1")["exports"]
    assert list(exports) == ["edges.exr", "start.png"]
    exports = run(tmp_path, "--seeds", "9-9")["exports"]
    assert "start.png" in exports


def test_steps_that_nothing_exports_stay(tmp_path: Path) -> None:
    path = write_flow(tmp_path, FLOW.replace("  edges.exr: edges.strength\n", ""))
    flow = open_flow(path, Overrides(params={"edges.finest": "2.5"}, seeds=2))
    assert flow.steps["edges"].params.model_dump()["finest"] == 2.5
    assert list(flow.exports) == ["start.png", "contact_sheet.png"]


@pytest.mark.parametrize("seeds", ["x", "4-2", "0", "-3", "1001", "0-1000", "1-2-3", "1..3"])
def test_seeds_that_are_wrong(tmp_path: Path, seeds: str) -> None:
    path = write_flow(tmp_path, FLOW)
    result = CliRunner().invoke(main.texloom, ["plan", str(path), f"--seeds={seeds}"])
    assert result.exit_code == 2
    assert "--seeds" in result.output


def test_one_seed_and_a_range_do_not_go_together(tmp_path: Path) -> None:
    path = write_flow(tmp_path, FLOW)
    result = CliRunner().invoke(main.texloom, ["plan", str(path), "--seed", "1", "--seeds", "0-3"])
    assert isinstance(result.exception, InputError)
    assert str(result.exception) == "--seed and a range of --seeds say the same; give one of them"


def test_flows_that_have_no_sheet(tmp_path: Path) -> None:
    path = write_flow(tmp_path, FLOW)
    assert open_flow(path, Overrides()).exports.keys() == {"edges.exr", "start.png"}
    several = Overrides(seeds=range(3))
    path.write_text(FLOW.replace("  start.png: start.image\n", ""))
    assert "contact_sheet" not in open_flow(path, several).steps
    path.write_text(FLOW.replace("start.png", "contact_sheet.png"))
    flow = open_flow(path, several)
    assert "contact_sheet" not in flow.steps
    assert flow.exports["contact_sheet.png"].name == "start"
