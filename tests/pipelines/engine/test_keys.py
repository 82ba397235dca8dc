"""What changes a key, and what does not."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from texloom.pipelines.engine.keys import KeyParts, canonical_json, generator, key_parts
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Step
from texloom.pipelines.store.atomic import file_digest
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary import declare
from texloom.stages.vocabulary.declare import InputError

FLOW = """
flow: contours
seed: 7
sources: {exemplar: skimage:brick}
steps:
  edges:
    stage: analysis.edges
    inputs: {image: exemplar}
    params: {finest: 2.0, detector: gradient, model: model.yml}
  start: {stage: synthesis.initialise, inputs: {image: exemplar}, params: {size: 32x64}}
"""
DIGEST = {"image": "0" * 64}
DRAWS, DRAWS_NOT = "start", "edges"


@pytest.fixture
def load(tmp_path: Path) -> Callable[..., dict[str, str]]:
    """Loads FLOW with some texts in place of others; the keys of its steps by their stages."""
    (tmp_path / "model.yml").write_text("one")

    def load(
        *changes: tuple[str, str], name: str = "flow.yaml", inputs: Mapping[str, str] = DIGEST
    ) -> dict[str, str]:
        text = FLOW
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / name
        path.write_text(text)
        flow = load_flow(path)
        steps = {DRAWS if step.stage.uses_rng else DRAWS_NOT: step for step in flow.steps.values()}
        return {name: key_parts(step, flow.seeds[0], inputs).key for name, step in steps.items()}

    return load


# -- the flow file: (changes, the steps whose key changes)

FLOW_CHANGES: dict[str, tuple[list[tuple[str, str]], set[str]]] = {
    "a param": ([("finest: 2.0", "finest: 2.5")], {DRAWS_NOT}),
    "a param of another step": ([("size: 32x64", "size: 64x32")], {DRAWS}),
    "a param away from its default": ([("size: 32x64", "size: 32x64, tries: 3")], {DRAWS}),
    "a param given as its default": ([("size: 32x64", "size: 32x64, tries: 10")], set()),
    "the same number written otherwise": ([("finest: 2.0", "finest: 2")], set()),
    "order of params": ([("finest: 2.0, detector: gradient", "detector: gradient, finest: 2.0")], set()),
    "seed": ([("seed: 7", "seed: 8")], {DRAWS}),
    "name of a step that draws": ([("start:", "begin:")], {DRAWS}),
    "name of a step that does not draw": ([("edges:", "contours:")], set()),
    "name of the flow": ([("flow: contours", "flow: lines")], set()),
    "name of a source": ([("exemplar", "example")], set()),
    "reference of a source of the same content": ([("skimage:brick", "copy.png")], set()),
    "an export": ([("steps:", "exports: {e.png: edges.strength}\nsteps:")], set()),
    "a comment": ([("steps:", "# words\nsteps:")], set()),
}


@pytest.mark.parametrize(("changes", "changed"), FLOW_CHANGES.values(), ids=FLOW_CHANGES)
def test_what_a_flow_file_changes(
    load: Callable[..., dict[str, str]], changes: list[tuple[str, str]], changed: set[str]
) -> None:
    before, after = load(), load(*changes)
    assert {step for step in before if before[step] != after[step]} == changed


def test_the_file_name_of_the_flow_does_not_count(load: Callable[..., dict[str, str]]) -> None:
    assert load(name="one.yaml") == load(name="other.yaml")


def test_content_of_inputs_counts(load: Callable[..., dict[str, str]]) -> None:
    before, after = load(), load(inputs={"image": "1" * 64})
    assert all(before[step] != after[step] for step in before)


def test_order_of_inputs_does_not_count() -> None:
    step = Step("s", find_stage("analysis.otsu"), {}, find_stage("analysis.otsu").params())
    assert key_parts(step, 0, {"a": "1", "b": "2"}).key == key_parts(step, 0, {"b": "2", "a": "1"}).key
    assert key_parts(step, 0, {"a": "1", "b": "2"}).key != key_parts(step, 0, {"a": "2", "b": "1"}).key


def test_an_optional_input_counts(load: Callable[..., dict[str, str]]) -> None:
    before, after = load(), load(inputs={**DIGEST, "mask": "2" * 64})
    assert before[DRAWS] != after[DRAWS]


def test_content_of_a_file_param_counts_and_its_name_does_not(
    load: Callable[..., dict[str, str]], tmp_path: Path
) -> None:
    before = load()
    (tmp_path / "copy.yml").write_text("one")
    assert load(("model.yml", "copy.yml")) == before
    (tmp_path / "copy.yml").write_text("two")
    after = load(("model.yml", "copy.yml"))
    assert {step for step in before if before[step] != after[step]} == {DRAWS_NOT}
    without = load((", model: model.yml", ""))
    assert without[DRAWS_NOT] not in (before[DRAWS_NOT], after[DRAWS_NOT])


def test_a_file_param_that_has_gone_is_a_wrong_request(tmp_path: Path) -> None:
    stage = find_stage("analysis.edges")
    step = Step("edges", stage, {}, stage.params.model_validate({"model": tmp_path / "gone.yml"}))
    with pytest.raises(InputError, match=r"^steps\.edges\.params\.model: .*gone\.yml: No such file"):
        key_parts(step, 0, {})


@pytest.mark.parametrize(
    "name", ["TEXLOOM_THREADS", "TEXLOOM_DEVICE", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "PYTHONHASHSEED"]
)
def test_threads_do_not_count(
    load: Callable[..., dict[str, str]], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    before = load()
    monkeypatch.setenv(name, "1")
    assert load() == before


def test_version_of_the_stage_counts(load: Callable[..., dict[str, str]], monkeypatch: pytest.MonkeyPatch) -> None:
    before = load()
    changed = dataclasses.replace(find_stage("analysis.edges"), version=99)
    monkeypatch.setitem(declare.declared, "analysis.edges", changed)
    after = load()
    assert {step for step in before if before[step] != after[step]} == {DRAWS_NOT}


# -- the parts of a key


PARTS = KeyParts("analysis.otsu", 1, "c" * 64, {"a": 1, "b": [1, 2], "c": None}, "7/start", {"image": "d" * 64})

DIFFERENCES: dict[str, tuple[dict[str, Any], list[str]]] = {
    "nothing": ({}, []),
    "stage": ({"stage": "analysis.edges"}, ["stage: analysis.edges -> analysis.otsu"]),
    "version": ({"version": 2}, ["version of analysis.otsu: 2 -> 1"]),
    "code": ({"code": "e" * 64}, ["code of analysis.otsu changed"]),
    "param": ({"params": {**PARTS.params, "a": 2}}, ["param a: 2 -> 1"]),
    "param that was not there": ({"params": {"b": [1, 2], "c": None}}, ["param a: none -> 1"]),
    "param that has gone": ({"params": {**PARTS.params, "z": "long"}}, ["param z: long -> none"]),
    "long param": ({"params": {**PARTS.params, "a": "x" * 99}}, [f"param a: {'x' * 37}... -> 1"]),
    "seed": ({"seed": "8/start"}, ["seed: 8/start -> 7/start"]),
    "input": ({"inputs": {"image": "e" * 64}}, ["input image changed"]),
    "another input": ({"inputs": {}}, ["input image changed"]),
    "several": ({"version": 2, "inputs": {}}, ["version of analysis.otsu: 2 -> 1", "input image changed"]),
}


@pytest.mark.parametrize(("change", "said"), DIFFERENCES.values(), ids=DIFFERENCES)
def test_differences_in_words(change: dict[str, Any], said: list[str]) -> None:
    earlier = json.loads(json.dumps({**dataclasses.asdict(PARTS), **change}))
    assert PARTS.differences(earlier) == said


CHANGED_PARTS: list[dict[str, Any]] = [
    {"stage": "x"}, {"version": 2}, {"code": "x"}, {"params": {}}, {"seed": None}, {"seed": "8/start"},
    {"inputs": {}}, {"inputs": {"mask": "d" * 64}},
]  # fmt: skip


@pytest.mark.parametrize("change", CHANGED_PARTS, ids=str)
def test_every_part_is_in_the_key(change: dict[str, Any]) -> None:
    assert dataclasses.replace(PARTS, **change).key != PARTS.key


def test_a_key_is_stable_and_looks_like_one() -> None:
    assert PARTS.key == dataclasses.replace(PARTS).key
    assert len(PARTS.key) == 64
    assert int(PARTS.key, 16)
    # A change here makes everybody's store worthless: raise it only with intent.
    assert PARTS.key == "727f08ee57e2fe3a50f0021052da625c297e1623c1494a7d9bfefb3cfba473d0"


def test_canonical_json_is_equal_for_equal_values() -> None:
    assert canonical_json({"b": 1, "a": [1.5, None]}) == canonical_json({"a": [1.5, None], "b": 1})
    assert canonical_json({"b": 1, "a": [1.5, None]}) == '{"a":[1.5,null],"b":1}'


def test_file_digest_is_sha256(tmp_path: Path) -> None:
    (tmp_path / "abc").write_bytes(b"abc")
    known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert file_digest(tmp_path / "abc") == known


def test_random_numbers_depend_on_seed_and_step_alone() -> None:
    draws = {
        (seed, step): tuple(generator(seed, step).integers(0, 2**32, 4))
        for seed in (0, 7, 2**63 - 1)
        for step in ("a", "b", "start")
    }
    assert len(set(draws.values())) == len(draws)
    assert draws[7, "start"] == tuple(generator(7, "start").integers(0, 2**32, 4))
    assert isinstance(generator(0, "a"), np.random.Generator)
