"""Scopes: what is checked before anything runs, and results in memory."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

from tests.pipelines.flows import SYNTHESIS, open_run, paint, run_local, write_flow
from texloom.pipelines.engine import scope
from texloom.pipelines.engine.scope_run import ScopeRun
from texloom.pipelines.engine.task_spec import Inputs, Output
from texloom.pipelines.flow.model import Reference, Runner
from texloom.pipelines.store import exr
from texloom.pipelines.store.outputs import outputs_of
from texloom.pipelines.store.store import Store
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

TWICE = SYNTHESIS.replace("exports:", "exports:\n  texture.png: texture.image\n  start.png: start.image")


def test_a_cold_run_reads_nothing_that_it_has_just_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_flow(tmp_path, TWICE)
    run_local(open_run(path), tmp_path / "before")

    def never(*arguments: object, **_: object) -> None:
        raise AssertionError(arguments)

    monkeypatch.setattr(exr, "load", never)
    monkeypatch.setattr(Store, "load", never)
    other = write_flow(tmp_path / "other", TWICE)
    run_local(open_run(other), tmp_path / "after")
    monkeypatch.undo()
    for name in ("texture.exr", "texture.png", "start.png"):
        assert (tmp_path / "after" / name).read_bytes() == (tmp_path / "before" / name).read_bytes()


def flat(value: Any) -> tuple[Any, ...]:
    """All by which a consumer could tell one value from another."""
    if isinstance(value, Image):
        return (value.channels, *flat(value.pixels))
    if isinstance(value, np.ndarray):
        return value.dtype, value.shape, value.strides, value.flags.writeable, value.tobytes()
    return type(value), repr(value)


def test_values_are_those_that_are_read_back(tmp_path: Path) -> None:
    run = open_run(write_flow(tmp_path, SYNTHESIS))
    run_local(run, tmp_path / "out")
    for step in run.flow.steps.values():
        artifact = run.shared.artifacts[step.name]
        stored = run.store.load(artifact, step.stage.result)
        prepared = outputs_of(step.stage.result(**stored))
        assert {name: flat(prepared.as_read(name)) for name in prepared} == {
            name: flat(value) for name, value in stored.items()
        }


def test_arrays_in_other_orders_come_in_that_of_the_store(tmp_path: Path) -> None:
    stage = find_stage("analysis.otsu")
    made = stage.result(structure=np.asfortranarray(np.eye(5, 7) > 0), threshold=0.5)
    store = Store(tmp_path)
    store.create()
    artifact = store.save(stage, "0" * 64, made, {})
    assert flat(outputs_of(made).as_read("structure")) == flat(store.load(artifact, stage.result)["structure"])


def kept(tmp_path: Path) -> tuple[ScopeRun, Output]:
    """The scope of a finished run, in which three steps and exports take ``structure.structure``."""
    text = """
flow: small
sources:
  exemplar: exemplar.png
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}}
  structure: {stage: analysis.otsu, inputs: {strength: edges.strength}}
  one: {stage: analysis.signed_distance, inputs: {structure: structure.structure}}
  two: {stage: analysis.signed_distance, inputs: {structure: structure.structure}}
"""
    run = open_run(write_flow(tmp_path, text))
    run_local(run, tmp_path / "out")
    artifact = run.shared.artifacts["structure"]
    given = Output("structure", artifact.stage, artifact.key, "structure", artifact.outputs["structure"])
    return ScopeRun(run, run.shared, "shared"), given


def test_each_consumer_has_a_copy_and_the_last_use_frees_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scope_run, given = kept(tmp_path)
    inputs, reads = scope_run.inputs, []
    read = Inputs.output
    monkeypatch.setattr(Inputs, "output", lambda self, given: reads.append(given) or read(self, given))
    whole = inputs.output(given).copy()
    changed = inputs.output(given)
    changed[:] = ~changed
    np.testing.assert_array_equal(inputs.output(given), whole)
    assert len(reads) == 1
    inputs.release([given.reference])
    np.testing.assert_array_equal(inputs.output(given), whole)
    assert len(reads) == 1, "the last one receives what was kept"
    inputs.output(given)
    assert len(reads) == 2, "and then it is gone"


def test_memory_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scope, "_MAX_KEPT", 1000)
    scope_run, given = kept(tmp_path)
    values = [scope_run.inputs.output(given) for _ in range(2)]
    assert values[0].nbytes > 1000
    assert flat(values[0]) == flat(values[1])
    assert given.reference == Reference("structure", "structure")


FILL = """
flow: filled
sources: {exemplar: exemplar.png, holes: exemplar.png}
steps:
  rest: {stage: analysis.exclusion_mask, inputs: {image: exemplar, mask: holes}}
  start: {stage: synthesis.inpaint, inputs: {image: rest.image, keep: rest.valid}}
"""
SMALL = """
flow: summary
sources: {texture: exemplar.png, control: exemplar.png, target: wide.png}
steps:
  features: {stage: synthesis.control_features, inputs: {texture: texture, control: control}}
  clusters: {stage: analysis.tsvq, inputs: {features: features.planes}}
  near:
    stage: analysis.k_coherence
    inputs: {features: features.planes, nodes: clusters.nodes, leaf: clusters.leaf}
  small:
    stage: synthesis.compact
    inputs:
      texture: texture
      features: features.planes
      nodes: clusters.nodes
      leaf: clusters.leaf
      candidates: near.candidates
      control: control
    params: {size: 32}
  result:
    stage: synthesis.reconstruct
    inputs: {image: small.image, control: small.control, target: target}
    params: {patch_size: 32}
"""
WRAPPED = SYNTHESIS.replace("size: 96", "size: 16").replace("preset: default", "patch_size: 20, tileable: true")
CUT = """
flow: cut
sources: {exemplar: exemplar.png}
steps:
  part: {stage: analysis.crop, inputs: {image: exemplar}, params: {size: 8}}
  start: {stage: synthesis.initialise, inputs: {image: part.image}}
"""


@pytest.mark.parametrize(
    ("text", "side", "problem"),
    [
        (FILL, 40, "steps.start: image: 40 x 40 px is too small for blocks of 32 px"),
        (SMALL, 64, "steps.result: image: 32 x 32 px is too small for patches of 32 px"),
        (WRAPPED, 64, "steps.texture: start: a tileable result of 16 x 16 px does not hold a patch of 20 px"),
        (CUT, 64, "steps.start: image: 8 x 8 px is too small"),
    ],
    ids=["masked", "compaction", "start", "crop"],
)
def test_sizes_of_results_are_checked_before_anything_runs(
    tmp_path: Path, text: str, side: int, problem: str
) -> None:
    path = write_flow(tmp_path, text, side)
    paint(tmp_path / "wide.png")
    with pytest.raises(InputError, match=re.escape(problem)):
        open_run(path)


def test_sizes_of_results_are_checked_for_items_alone(tmp_path: Path) -> None:
    path = write_flow(tmp_path, CUT.replace("exemplar: exemplar.png", "exemplar: {each: pictures/*.png}"))
    paint(tmp_path / "pictures" / "a.png")
    planned = open_run(path).plan()
    assert [plan.state for plan in planned] == ["refused"]
    assert "8 x 8 px is too small" in planned[0].reasons[0]


MASKED = """
flow: masked
sources: {exemplar: exemplar.png, mask: other.png}
steps:
  rest: {stage: analysis.exclusion_mask, inputs: {image: exemplar, mask: mask}}
"""
CONTROLLED = """
flow: controlled
sources: {exemplar: exemplar.png, control: other.png, target: other.png}
steps:
  structure: {stage: analysis.edges, inputs: {image: exemplar}}
  result: {stage: synthesis.reconstruct, inputs: {image: exemplar, control: control, target: target}}
"""
COLOURED = """
flow: coloured
sources: {exemplar: exemplar.png, control: grey.png, target: exemplar.png}
steps:
  result: {stage: synthesis.reconstruct, inputs: {image: exemplar, control: control, target: target}}
"""
SUMMARISED = """
flow: summarised
sources: {texture: exemplar.png, control: other.png}
steps:
  features: {stage: synthesis.control_features, inputs: {texture: texture, control: control}}
"""
MAPS = """
flow: maps
sources: {exemplar: set.yaml}
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}}
"""


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (MASKED, r"steps.rest: mask: all pixels of the image are excluded \(mask is .*other.png\)"),
        (CONTROLLED, r"steps.result: control: every channel is constant"),
        (COLOURED, r"steps.result: target: channels R G B do not match those of control, Y \(target is .*exemplar"),
        (SUMMARISED, r"steps.features: control: every channel is constant"),
        (MAPS, r"sources.exemplar: .*set.yaml: other.png is black: it excludes every pixel"),
    ],
    ids=["black mask", "constant control", "coloured target", "constant control of a summary", "black map"],
)
@pytest.mark.parametrize("runner", ["local", "threads", "processes"])
def test_pixels_of_sources_are_checked_before_anything_is_written(
    tmp_path: Path, text: str, problem: str, runner: Any
) -> None:
    path = write_flow(tmp_path, text)
    PIL.Image.new("L", (64, 64)).save(tmp_path / "other.png")
    PIL.Image.linear_gradient("L").resize((64, 64)).save(tmp_path / "grey.png")
    (tmp_path / "set.yaml").write_text("{albedo: exemplar.png, mask: other.png}")

    def attempt() -> None:
        run = open_run(path)
        run.flow = dataclasses.replace(run.flow, runner=Runner(runner, 1))
        run_local(run, tmp_path / "out")

    with pytest.raises(InputError, match=problem):
        attempt()
    assert not (tmp_path / "artifacts").exists()
