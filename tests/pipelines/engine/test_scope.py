"""Results in memory: as from the store, a copy for each consumer, dropped with their last use."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.pipelines.flows import SYNTHESIS, open_run, run_local, write_flow
from texloom.pipelines.engine import scope
from texloom.pipelines.engine.scheduler import ScopeRun
from texloom.pipelines.engine.task import Inputs, Output
from texloom.pipelines.flow.model import Reference
from texloom.pipelines.store import exr
from texloom.pipelines.store.outputs import outputs_of
from texloom.pipelines.store.store import Store
from texloom.stages.arrays import Image
from texloom.stages.declare import find_stage

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
