"""Orders: one step with all that it takes as plain data, so that any process that sees the store can compute it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import pydantic

from texloom.pipelines.engine.kernel_cache import keep_kernels
from texloom.pipelines.engine.keys import KeyParts, generator, key_parts
from texloom.pipelines.flow.model import Step
from texloom.pipelines.media.sources import Source
from texloom.pipelines.store.store import Artifact, BrokenArtifactError, Store
from texloom.stages.arrays import Image
from texloom.stages.declare import InputError, Stage, find_stage


@dataclasses.dataclass(frozen=True)
class Output:
    """An output of a step whose result is in the store."""

    step: str
    stage: str
    key: str
    output: str
    digest: str
    """of the output's content"""


Given = Source | Output
GivenList = list[Given | None]


@dataclasses.dataclass(frozen=True)
class Upstream:
    """A step whose result has gone into this one."""

    step: str
    item: str | None
    stage: str
    key: str


@dataclasses.dataclass(frozen=True)
class Order:
    """A step to compute."""

    flow: str
    step: str
    label: str
    """what the step is called among those of other items"""
    parts: KeyParts
    """what the key of the result is made of"""
    params: Mapping[str, Any]
    """as JSON has them"""
    seed: int
    draws_as: str
    inputs: Mapping[str, Given]
    gather: Mapping[str, GivenList | dict[str, GivenList]]
    items: list[dict[str, Any]] | None
    """all items, where the stage wants to know"""
    upstream: list[Upstream] | None
    """where the stage wants to know, in the order of the flow"""

    def to_json(self) -> str:
        """All of it as text."""
        return _ADAPTER.dump_json(self).decode()

    @classmethod
    def from_json(cls, text: str) -> Order:
        """The order that `to_json` wrote."""
        return _ADAPTER.validate_json(text)


_ADAPTER = pydantic.TypeAdapter(Order)


def read(given: Given, store: Store) -> Any:
    """A source's image, or an output from the store.

    Raises
    ------
    BrokenArtifactError : the files are not what was written; their record is gone now, so that the step runs again.
    """
    if isinstance(given, Source):
        return given.read()
    artifact = Artifact(given.stage, given.key, store.folder(given.stage, given.key), {})
    try:
        return store.load(artifact, find_stage(given.stage).result, [given.output])[given.output]
    except BrokenArtifactError as error:
        store.forget(given.stage, given.key)
        raise BrokenArtifactError(f"{given.step}: the stored result is broken ({error})", given.key) from None


def compute(
    order: Order,
    stage: Stage,
    store: Store,
    noted: Callable[[str], None],
    image: Callable[[Source], Image] = Source.read,
) -> Any:
    """Call the stage.

    Parameters
    ----------
    noted : hears what the user should know.
    image : decodes a source.
    """
    keep_kernels()
    known: dict[str, Any] = {}

    def value(given: Given | None) -> Any:
        if given is None:
            return None
        return image(given) if isinstance(given, Source) else read(given, store)

    def values(listed: GivenList) -> list[Any]:
        """Equal ones are read once."""
        for given in listed:
            if given is not None and given.digest not in known:
                known[given.digest] = value(given)
        return [None if given is None else known[given.digest] for given in listed]

    arguments: dict[str, Any] = {name: value(given) for name, given in order.inputs.items()}
    for name, gathered in order.gather.items():
        if isinstance(gathered, list):
            arguments[name] = values(gathered)
        else:
            arguments[name] = {tag: values(listed) for tag, listed in gathered.items()}
    if "params" in stage.function.__annotations__:
        arguments["params"] = stage.params.model_validate(order.params)
    if stage.uses_rng:
        arguments["rng"] = generator(order.seed, order.draws_as)
    if stage.uses_items:
        arguments["items"] = order.items
    if stage.uses_provenance:
        arguments["provenance"] = [_provenance(entry, store) for entry in order.upstream or ()]
    if stage.uses_checkpoints:
        checkpoints = store.checkpoints(stage.name, order.parts.key)
        if levels := checkpoints.levels():
            noted(f"{order.label}: goes on after scale {levels[0]} of an interrupted run")
        arguments["checkpoints"] = checkpoints
    return stage.function(**arguments)


def _provenance(entry: Upstream, store: Store) -> dict[str, Any]:
    artifact = Artifact(entry.stage, entry.key, store.folder(entry.stage, entry.key), {})
    return {"step": entry.step, "item": entry.item, **store.provenance(artifact)}


def check_same(order: Order) -> None:
    """`InputError` unless this process has the code and the files that the order was made with."""
    stage = find_stage(order.parts.stage)
    step = Step(order.step, stage, {}, stage.params.model_validate(order.params), draws_as=order.draws_as)
    ours = key_parts(step, order.seed, order.parts.inputs)
    if ours.key != order.parts.key:
        changes = ", ".join(ours.differences(order.parts.as_dict()))
        raise InputError(f"{order.label}: this is not the texloom, or not the files, of the run: {changes}")


def provenance_of(order: Order) -> dict[str, Any]:
    """What is filed beside the result."""
    return {**order.parts.as_dict(), "flow": order.flow, "step": order.step}
