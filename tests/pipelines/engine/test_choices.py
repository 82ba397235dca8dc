"""Choices: steps that run only where a choice has taken their label."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from tests.pipelines.flows import open_run, run_local
from texloom.pipelines.flow.loader import load_flow
from texloom.stages.vocabulary.declare import InputError

CHOOSING = """
flow: choosing
sources: {exemplar: wall.png, noise: noise.png}
steps:
  of_noise: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: noise}}
  of_wall: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: exemplar}}
  better:
    stage: evaluation.choice
    inputs: {first: noise, second: exemplar, first_scores: of_noise.table, second_scores: of_wall.table}
    params: {labels: [noise, wall]}
  noise_part: {stage: analysis.crop, inputs: {image: noise}, params: {size: 16}, only: better.noise}
  noise_scores: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: noise_part.image}}
  wall_part: {stage: analysis.crop, inputs: {image: exemplar}, params: {size: 16}, only: better.wall}
  wall_scores: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: wall_part.image}}
  result:
    stage: evaluation.choice
    inputs:
      first: noise_part.image
      first_scores: noise_scores.table
      second: wall_part.image
      second_scores: wall_scores.table
    params: {labels: [noise, wall]}
exports: {result.png: result.image, noise.png: noise_part.image, wall.png: wall_part.image}
"""

REFUSING = """
flow: refusing
sources: {exemplar: noise.png}
steps:
  offsets: {stage: analysis.offset_statistics, inputs: {image: exemplar}}
  lattice: {stage: analysis.lattice_selection, inputs: {image: exemplar, density: offsets.density}}
  methods:
    stage: analysis.candidate_methods
    inputs: {generators: lattice.generators}
    params: {labels: [tiles, part], of_lattices: []}
  tiles:
    stage: analysis.deformed_lattice
    inputs: {image: exemplar, generators: lattice.generators}
    only: methods.tiles
  part: {stage: analysis.crop, inputs: {image: exemplar}, params: {size: 16}, only: methods.part}
exports: {tiles.png: tiles.picture, part.png: part.image}
"""


def write(folder: Path, flow: str, rng: np.random.Generator) -> Path:
    rows = np.arange(64) // 8 % 2 * 120 + rng.integers(0, 60, 64)
    PIL.Image.fromarray(np.repeat(rows[:, None], 64, 1).astype(np.uint8)).save(folder / "wall.png")
    PIL.Image.fromarray(rng.integers(0, 256, (64, 64)).astype(np.uint8)).save(folder / "noise.png")
    (folder / "flow.yaml").write_text(flow)
    return folder / "flow.yaml"


def test_only_what_was_chosen_runs(tmp_path: Path, rng: np.random.Generator) -> None:
    run = open_run(write(tmp_path, CHOOSING, rng))
    waiting = {step.name: step.state for step in run.plan()}
    assert (waiting["noise_part"], waiting["wall_part"]) == ("wait", "wait")
    first = run_local(run, tmp_path / "out")
    assert not {"noise_part", "noise_scores"} & set(first.states)
    assert {first.states[name] for name in ("wall_part", "wall_scores", "result")} == {"ran"}
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["result.png", "wall.png"]
    written = [PIL.Image.open(tmp_path / "out" / name) for name in ("result.png", "wall.png")]
    np.testing.assert_array_equal(*map(np.asarray, written))
    skipped = {step.name: step.reasons for step in run.skipped()}
    assert skipped == dict.fromkeys(["noise_part", "noise_scores"], ("better took wall, not noise",))

    again = open_run(tmp_path / "flow.yaml")
    assert set(run_local(again, tmp_path / "out").states.values()) == {"cached"}
    assert {step.state for step in again.plan()} == {"cached"}
    assert [step.name for step in again.skipped()] == ["noise_part", "noise_scores"]


def test_each_item_of_a_set_chooses(tmp_path: Path, rng: np.random.Generator) -> None:
    flow = CHOOSING.replace("noise: noise.png", "noise: {each: 'tried/*.png'}")
    path = write(tmp_path, flow, rng)
    (tmp_path / "tried").mkdir()
    PIL.Image.open(tmp_path / "noise.png").save(tmp_path / "tried" / "a.png")
    PIL.Image.open(tmp_path / "wall.png").save(tmp_path / "tried" / "b.png")
    events = run_local(open_run(path), tmp_path / "out")
    assert events.items == {"a": None, "b": None}
    names = {path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*.png")}
    assert names == {"a/result.png", "a/wall.png", "b/result.png", "b/noise.png"}


def test_of_several_one_may_refuse(tmp_path: Path, rng: np.random.Generator) -> None:
    run = open_run(write(tmp_path, REFUSING, rng))
    events = run_local(run, tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["part.png"]
    (note,) = [note for note in events.notes if "passed over" in note]
    assert note.startswith("tiles is passed over: ")
    assert [step.name for step in run.skipped()] == ["tiles"]
    with pytest.raises(InputError, match=r"steps\.tiles: "):
        run_local(open_run(tmp_path / "flow.yaml", methods__methods="tiles"), tmp_path / "alone")


def test_where_all_refuse_the_run_fails(tmp_path: Path, rng: np.random.Generator) -> None:
    part = "part: {stage: analysis.crop, inputs: {image: exemplar}, params: {size: 16}, only: methods.part}"
    other = "{stage: analysis.deformed_lattice, inputs: {image: exemplar, generators: lattice.generators}"
    flow = REFUSING.replace(part, f"part: {other}, only: methods.part}}").replace("part.image", "part.picture")
    with pytest.raises(InputError, match=r"steps\.(tiles|part): "):
        run_local(open_run(write(tmp_path, flow, rng)), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [
        ("only: bettr.wall", r"steps\.wall_part\.only: no choice 'bettr'; did you mean 'better'\?"),
        ("only: of_wall.wall", r"steps\.wall_part\.only: no choice 'of_wall'; there are better, result"),
        ("only: better.wal", r"steps\.wall_part\.only: 'better' has no label 'wal'; did you mean 'wall'\?"),
    ],
)
def test_what_a_step_depends_on_must_be_there(
    wrong: str, problem: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    path = write(tmp_path, CHOOSING.replace("only: better.wall", wrong), rng)
    with pytest.raises(InputError, match=problem):
        load_flow(path)
