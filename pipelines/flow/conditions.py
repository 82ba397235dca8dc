"""Conditions on params: steps that are there only where a param, their own or another, has a value, or has not."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Iterable, Mapping
from typing import Any

import pydantic

from texloom.pipelines.errors import closest, hint, one_of
from texloom.pipelines.flow.draft import DraftStep, Entry
from texloom.pipelines.yaml import parse_yaml
from texloom.stages.vocabulary.declare import Params, Stage

_IS = "="
_NOT = "!"


@dataclasses.dataclass(frozen=True)
class Condition:
    """That a param has a value, as ``parts.one_off=keep_whole``, or has not, as ``parts.one_off!=use``."""

    step: str
    param: str
    value: Any
    is_not: bool = False

    def holds(self, params: Mapping[str, Params]) -> bool:
        """Whether that is so, of the params of the steps that are there."""
        return self.step in params and (getattr(params[self.step], self.param) == self.value) != self.is_not


def is_condition(text: str) -> bool:
    """Whether ``only`` has a condition, and neither a source nor a choice."""
    return _IS in text


def checked_condition(entry: Entry, stages: Mapping[str, Stage]) -> Condition:
    """The condition in an entry; `InputError` where there is no such step or param, or it cannot have the value."""
    target, _, text = str(entry.value).partition(_IS)
    step, _, param = target.removesuffix(_NOT).partition(".")
    if step not in stages:
        raise entry.fail(f"no step '{step}'{closest(step, stages) or one_of(stages)}")
    model = stages[step].params
    if param not in model.model_fields:
        raise entry.fail(f"stage {stages[step].name} has no param '{param}'{hint(param, model.model_fields)}")
    kind = typing.get_type_hints(model, include_extras=True)[param]
    try:
        value = pydantic.TypeAdapter(kind).validate_python(parse_yaml(text, entry.where()))
    except pydantic.ValidationError as error:
        told: str = error.errors()[0]["msg"]
        raise entry.fail(f"{param}: {told[0].lower()}{told[1:]}, got {text}") from None
    return Condition(step, param, value, is_not=target.endswith(_NOT))


def conditions(steps: Iterable[DraftStep], stages: Mapping[str, Stage]) -> dict[str, Condition]:
    """All conditions of steps, by their texts."""
    entries = [step.only for step in steps if step.only is not None and is_condition(step.only.value)]
    return {entry.value: checked_condition(entry, stages) for entry in entries}
