"""The stage declaration, and what every stage of the project must say about itself."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import sys
import types
from collections.abc import Callable
from typing import Any

import annotated_types
import numpy as np
import pydantic
import pytest

from texloom.stages.lookup.registry import GROUPS, find_stage, shipped_stages, stage_names
from texloom.stages.vocabulary import declare
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap
from texloom.stages.vocabulary.checkpoints import Checkpoints
from texloom.stages.vocabulary.declare import InputError, NoParams, OddSize, Params, field_help, stage

NAMES = stage_names()


def test_names_are_grouped_and_hide_helpers() -> None:
    assert {"analysis.edges", "analysis.otsu", "analysis.signed_distance", "analysis.guidance_weight"} <= set(NAMES)
    assert len(NAMES) == len(set(NAMES))
    groups = [name.partition(".")[0] for name in NAMES]
    assert [GROUPS.index(group) for group in groups] == sorted(GROUPS.index(group) for group in groups)
    assert not any(part.startswith("_") for name in NAMES for part in name.split("."))


@pytest.mark.parametrize("name", NAMES)
def test_stage_is_found_and_described(name: str) -> None:
    declared = find_stage(name)
    module = importlib.import_module(declared.module)
    assert declared.name == name
    assert module.__name__.startswith(f"texloom.stages.{name.partition('.')[0]}.")
    assert module.__name__.rpartition(".")[2] == name.rpartition(".")[2]
    assert inspect.unwrap(declared.function).__module__ == module.__name__
    assert declared.version >= 1
    assert (module.__doc__ or "").strip()
    assert declared.summary.endswith("."), f"the docstring of {name} must begin with one sentence on one line"
    assert "References\n----------" in (inspect.getdoc(declared.function) or "") or name.startswith("evaluation.")


@pytest.mark.parametrize("name", NAMES)
def test_parameters_have_help_and_refuse_unknown_names(name: str) -> None:
    params = find_stage(name).params
    assert issubclass(params, Params)
    assert (params.__doc__ or "").strip()
    texts = field_help(params)
    for field in params.model_fields:
        assert texts.get(field), f"{params.__name__}.{field} needs a docstring"
    with pytest.raises(pydantic.ValidationError, match="Extra inputs"):
        params.model_validate({"no_such_parameter": 1})


@pytest.mark.parametrize("name", NAMES)
def test_numbers_have_a_least_value_and_defaults_are_within_bounds(name: str) -> None:
    params = find_stage(name).params
    for field, info in params.model_fields.items():
        if info.annotation in (int, float):
            bounded = any(isinstance(part, annotated_types.Ge | annotated_types.Gt) for part in info.metadata)
            assert bounded, f"{params.__name__}.{field} needs ge or gt"
    if not any(info.is_required() for info in params.model_fields.values()):
        params.model_validate(params().model_dump())


@pytest.mark.parametrize("name", NAMES)
def test_results_are_frozen_and_documented(name: str) -> None:
    declared = find_stage(name)
    assert dataclasses.is_dataclass(declared.result)
    assert declared.result.__dataclass_params__.frozen
    assert declared.outputs
    assert set(declared.outputs) == {field.name for field in dataclasses.fields(declared.result)}
    classes = [one for one in declared.result.__mro__ if dataclasses.is_dataclass(one)]
    source = "\n".join(map(inspect.getsource, classes)).splitlines()
    for field in declared.outputs:
        line = next(n for n, text in enumerate(source) if text.strip().startswith(f"{field}:"))
        assert '"""' in "".join(source[line + 1 :]), f"{declared.result.__name__}.{field} needs a docstring"


class Toy(Params):
    """Two knobs."""

    size: OddSize = 3
    """a side"""
    share: float = 0.5
    """a share"""


def test_params_refuse_what_is_wrong() -> None:
    for wrong in ({"sise": 3}, {"size": 4}, {"size": 0}, {"share": float("nan")}, {"share": float("inf")}):
        with pytest.raises(pydantic.ValidationError):
            Toy.model_validate(wrong)
    with pytest.raises(pydantic.ValidationError, match="must be odd, got 4"):
        Toy(size=4)


def test_params_are_frozen_and_equal_by_value() -> None:
    toy = Toy(size=5)
    with pytest.raises(pydantic.ValidationError, match="frozen"):
        toy.size = 7
    assert toy == Toy(size=5) != Toy()
    assert hash(toy) == hash(Toy(size=5))


def test_docstrings_of_fields_become_help() -> None:
    assert field_help(Toy) == {"size": "a side", "share": "a share"}


def test_input_error_is_a_value_error() -> None:
    """Callers that know nothing of the project can catch it."""
    assert issubclass(InputError, ValueError)


def test_unknown_stage_is_a_key_error() -> None:
    for name in ("analysis.no_such_stage", "kernels.threads", "synthesis._vote"):
        with pytest.raises(KeyError):
            find_stage(name)


def test_finding_does_not_import() -> None:
    """Listing is for planning; it must not load the stages."""
    names = [name for name in sys.modules if name.startswith("texloom.stages.analysis.")]
    loaded = {name: sys.modules.pop(name) for name in names}
    try:
        shipped_stages.cache_clear()
        assert stage_names() == NAMES
        assert not any(name.startswith("texloom.stages.analysis.") for name in sys.modules)
    finally:
        sys.modules.update(loaded)


@dataclasses.dataclass(frozen=True)
class Result:
    """One output."""

    mask: Mask
    """where"""


@pytest.fixture
def register(monkeypatch: pytest.MonkeyPatch) -> Callable[..., declare.Stage]:
    """Declares a function as if it were in a stage module of the given name."""
    monkeypatch.setattr(declare, "declared", {})

    def as_stage(function: Callable[..., Any], module: str, **options: Any) -> declare.Stage:
        moved = types.FunctionType(
            function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
        )
        moved.__annotations__ = inspect.get_annotations(function, eval_str=True)
        moved.__doc__, moved.__module__ = function.__doc__, f"texloom.stages.{module}"
        assert inspect.unwrap(stage(**{"version": 1, **options})(moved)) is moved
        return declare.declared[module]

    return as_stage


def test_signature_is_the_declaration(register: Callable[..., declare.Stage]) -> None:
    def toy(
        image: Image,
        params: Toy,
        rng: np.random.Generator,
        checkpoints: Checkpoints,
        extra: ScalarMap | None = None,
    ) -> Result:
        """Do nothing.

        More.
        """
        return Result(np.zeros((1, 1), bool))

    def check(params: Any, known: Any) -> None:
        pass

    declared = register(toy, "analysis.toy", version=3, check=check)
    assert declared.name == "analysis.toy"
    assert declared.version == 3
    assert declared.params is Toy
    assert dict(declared.inputs) == {"image": Image, "extra": ScalarMap | None}
    assert declared.optional == {"extra"}
    assert dict(declared.outputs) == {"mask": Mask}
    assert declared.result is Result
    assert declared.uses_rng
    assert declared.uses_checkpoints
    assert declared.check is check
    assert declared.summary == "Do nothing."


def test_least_declaration(register: Callable[..., declare.Stage]) -> None:
    def toy(mask: Mask) -> Result:
        return Result(mask)

    declared = register(toy, "analysis.toy")
    assert declared.params is NoParams
    assert not declared.optional
    assert not declared.uses_rng
    assert not declared.uses_checkpoints
    assert declared.check is None
    assert declared.summary == ""


def test_stage_must_bear_the_name_of_its_module(register: Callable[..., declare.Stage]) -> None:
    def toy(mask: Mask) -> Result:
        return Result(mask)

    with pytest.raises(TypeError, match="module of its own name"):
        register(toy, "analysis.other")
