"""What a flow is, once it has been checked."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from stages.declare import Params, Stage

Scope = Literal["shared", "item", "final"]
"""``item``: a step that runs once for each; ``final``: one that receives all, or follows one that does"""


@dataclasses.dataclass(frozen=True)
class Each:
    """A source that stands for every file of a pattern."""

    pattern: str
    """absolute; as in a shell, ``**`` for any folders"""
    pair: str | None = None
    """another such source, whose files are taken in step"""


@dataclasses.dataclass(frozen=True)
class Reference:
    """Where an input comes from: a source, or an output of a step."""

    name: str
    output: str | None = None

    def __str__(self) -> str:
        return self.name if self.output is None else f"{self.name}.{self.output}"


@dataclasses.dataclass(frozen=True)
class Step:
    """One stage with its inputs and parameters."""

    name: str
    stage: Stage
    inputs: Mapping[str, Reference]
    params: Params
    gather: Mapping[str, Reference | Mapping[str, Reference]] = dataclasses.field(default_factory=dict)
    """the inputs that receive all items, or all items by label"""
    scope: Scope = "shared"
    draws_as: str = ""
    """the name by which it draws random numbers; its own unless it came from another flow"""

    def __post_init__(self) -> None:
        if not self.draws_as:
            object.__setattr__(self, "draws_as", self.name)

    @property
    def references(self) -> list[Reference]:
        """All that it takes."""
        return [*self.inputs.values(), *flat(self.gather)]

    @property
    def needs(self) -> list[str]:
        """The steps whose outputs this one takes."""
        return sorted({reference.name for reference in self.references if reference.output is not None})


@dataclasses.dataclass(frozen=True)
class Flow:
    """A flow that has passed every check that needs no source."""

    name: str
    path: Path
    seeds: tuple[int, ...]
    """every item runs once with each"""
    sources: Mapping[str, str | Each]
    """name to reference; relative paths are absolute by now"""
    steps: Mapping[str, Step]
    """in an order in which they can run"""
    exports: Mapping[str, Reference]
    """file name to what is written to it"""

    @property
    def is_set(self) -> bool:
        """Whether it runs over items, be it only one."""
        several = len(self.seeds) > 1 or any(isinstance(source, Each) for source in self.sources.values())
        return several or any(step.gather for step in self.steps.values())

    def where(self, *place: str) -> str:
        """Names a place of the flow file in an error."""
        return f"{self.path}: {'.'.join(place)}"


@dataclasses.dataclass(frozen=True)
class Overrides:
    """What a command line changes in a flow."""

    sources: Mapping[str, str] = dataclasses.field(default_factory=dict)
    params: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """``STEP.PARAM`` to a YAML value"""
    seed: int | None = None
    seeds: int | None = None
    """how many, from ``seed`` or the flow's first one upwards"""


def flat(gather: Mapping[str, Reference | Mapping[str, Reference]]) -> list[Reference]:
    """All that is gathered, whatever its label."""
    nested = [[given] if isinstance(given, Reference) else list(given.values()) for given in gather.values()]
    return [reference for references in nested for reference in references]
