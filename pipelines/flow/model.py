"""The data model of checked flows."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from texloom.pipelines.errors import refused
from texloom.pipelines.flow.shipped import flow_word
from texloom.pipelines.media.delivery import AS_IS, Delivery
from texloom.pipelines.media.part import Part
from texloom.stages.vocabulary.declare import Params, Stage

RUNNERS = {
    "local": "this process, one item after the other",
    "threads": "threads of this process, several steps at a time",
    "processes": "processes of this machine, several steps at a time",
    "dask": "workers of a Dask cluster: of this machine, or of the one at an address",
}
"""name to description"""
WITH_WORKERS = ("threads", "processes", "dask")
"""the runners that compute several steps at a time"""

Scope = Literal["shared", "item", "final"]
"""``item``: once for each item; ``final``: once, after all items, whose results it takes directly or indirectly"""


@dataclasses.dataclass(frozen=True)
class Each:
    """A source that is a set of files."""

    patterns: tuple[str, ...]
    """absolute files, and patterns as in a shell, ``**`` for any folders"""
    pair: str | None = None
    """another such source, whose files belong to these"""
    notes: tuple[str, ...] = ()
    """what the user should know of files that are not among them"""
    is_ordered: bool = False
    """whether they keep the order of ``patterns``, which are files then; else they are in that of their names"""


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
    draws_as: str = ""
    """the name from which its random numbers are seeded; its own unless it came from another flow"""
    scope: Scope = "shared"
    chosen: Reference | None = None
    """a choice and a label: the step runs only where that is taken"""

    def __post_init__(self) -> None:
        if not self.draws_as:
            object.__setattr__(self, "draws_as", self.name)

    @property
    def references(self) -> list[Reference]:
        """All inputs."""
        return [*self.inputs.values(), *flat(self.gather)]

    @cached_property
    def needs(self) -> list[str]:
        """The steps whose outputs this one takes, and the choice on which it depends."""
        conditions = [] if self.chosen is None else [self.chosen]
        taken = [*self.references, *conditions]
        return sorted({reference.name for reference in taken if reference.output is not None})


@dataclasses.dataclass(frozen=True)
class Skipped:
    """A step that is left out, as sources that it takes are not given."""

    stage: Stage
    params: Params
    lacks: tuple[str, ...]
    """the sources and conditions, or ``set``, without which it is left out; empty where nothing takes its result"""
    reason: str
    """in words, as ``no mask``"""


@dataclasses.dataclass(frozen=True)
class Runner:
    """What computes the steps."""

    name: str
    """one of `RUNNERS`"""
    workers: int | None = None
    """steps at a time; None where the machine or the cluster decides"""
    address: str | None = None
    """of the scheduler of a Dask cluster, as in ``tcp://head:8786``"""


@dataclasses.dataclass(frozen=True)
class Overrides:
    """Changes of a flow by the command line."""

    sources: Mapping[str, str | Sequence[str]] = dataclasses.field(default_factory=dict)
    """name to a file, folder or pattern, or to several of them"""
    params: Mapping[str, str | tuple[Any, ...]] = dataclasses.field(default_factory=dict)
    """a param of the flow, ``STEP.PARAM`` or ``STEP.PARAM.KEY`` to a YAML text, as on the command line; or to a
    tuple of Python, where a size is (height, width). Those of a `Flow` are texts"""
    seed: int | None = None
    seeds: int | Sequence[int] | None = None
    """the number of seeds, counted from ``seed`` or the flow's first one; or a list"""
    runner: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """name, workers and address, as far as they are specified"""
    pictures: Sequence[str] = ()
    """files, folders and patterns for the flow's first source"""
    exports: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """more files to write, each with the source or ``STEP.OUTPUT`` that goes into it"""
    delivery: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """options of `texloom.pipelines.media.delivery.parse_delivery`"""
    part: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """options of `texloom.pipelines.media.part.parse_part`"""
    item: str | None = None
    """the only item of a set that is wanted"""
    keep: str | None = None
    """which results stay in the store: ``all`` or ``final``; None as the file says"""

    @property
    def texts(self) -> dict[str, str]:
        """The params, where all are texts, as in a `Flow`."""
        return {name: str(text) for name, text in self.params.items()}


@dataclasses.dataclass(frozen=True)
class Flow:
    """A flow that has passed every check that needs no source."""

    name: str
    path: Path
    seeds: tuple[int, ...]
    """every item runs once with each"""
    sources: Mapping[str, str | Each]
    """name to reference; paths are absolute; the first is the one that pictures on the command line replace"""
    steps: Mapping[str, Step]
    """in an order in which they can run"""
    exports: Mapping[str, Reference]
    """file name to what is written to it; a name that ends in / is a folder of maps"""
    runner: Runner = Runner("local")
    """from the file or the command line"""
    likes: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """folder of maps, or PNG, to the source whose file names and formats it takes"""
    surfaces: Mapping[str, Reference] = dataclasses.field(default_factory=dict)
    """model to the mesh on which its picture lies"""
    kinds: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """the sources that are no pictures: ``mesh``, or ``patches`` of an earlier result"""
    of_maps: tuple[str, ...] = ()
    """the exports that are written only where the source that they are like is a map set"""
    if_made: tuple[str, ...] = ()
    """the exports of which nothing is said where their step gave nothing"""
    own_examples: tuple[str, ...] = ()
    """the sources that keep the file's example although others are replaced"""
    more_paths: tuple[Path, ...] = ()
    """the included files"""
    params: Mapping[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    """name to the ``STEP.PARAM`` that take its value, or to the field of the file that it changes"""
    missing: tuple[str, ...] = ()
    """the required sources that have no file"""
    left_out: tuple[str, ...] = ()
    """the optional sources that have no file"""
    overrides: Overrides = Overrides()
    """the changes that are already applied"""
    compared: tuple[Path, ...] = ()
    """the files of the flows that it compares, where it has none of its own"""
    against: Mapping[str, Path] = dataclasses.field(default_factory=dict)
    """name to folder of the finished results that it compares"""
    delivery: Delivery = AS_IS
    """how exports are written"""
    parts: Mapping[str, Part] = dataclasses.field(default_factory=dict)
    """what is taken of the first source and, where they have its size, of those that belong to it"""
    item: str | None = None
    """the only item that runs"""
    intermediate: frozenset[str] = frozenset()
    """the steps whose results are not kept once they are not needed any more, see `intermediate_steps`"""
    picture: str | None = None
    """the only file that it exports, where the caller names one"""
    skipped: Mapping[str, Skipped] = dataclasses.field(default_factory=dict)
    """the steps that are left out of this run"""
    unwritten: Mapping[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    """the exports that are left out, with the sources that they lack, as in `Skipped`"""
    optional: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """all optional sources, with what each does, as the file says it"""

    @property
    def is_set(self) -> bool:
        """Whether it runs over items."""
        several = (
            self.item is not None
            or len(self.seeds) > 1
            or any(isinstance(source, Each) for source in self.sources.values())
        )
        return several or any(step.gather for step in self.steps.values())

    def check_sources(self) -> None:
        """`InputError` where a required source has no file."""
        if self.missing:
            example = " ".join(["texloom run", flow_word(self.path), *self._example_sources()])
            raise refused(f"{self.where('sources', self.missing[0])}: required, as in: {example}")

    def _example_sources(self) -> list[str]:
        """Arguments that give the sources which are required or were given."""
        given = {
            name: value if isinstance(value, str) else value[0] for name, value in self.overrides.sources.items()
        }
        first, *others = self.sources
        if self.overrides.pictures or first in self.missing:
            given[first] = [*self.overrides.pictures, f"{first}.png"][0]
        given |= {name: f"{name}.png" for name in others if name in self.missing}
        return [
            shlex.quote(given[name]) if name == first else f"--source {shlex.quote(f'{name}={given[name]}')}"
            for name in self.sources
            if name in given
        ]

    def where(self, *place: str) -> str:
        """The name of a place of the flow file, for errors."""
        return f"{flow_word(self.path)}: {'.'.join(place)}"


def flat(gather: Mapping[str, Reference | Mapping[str, Reference]]) -> list[Reference]:
    """All gathered references."""
    nested = [[values] if isinstance(values, Reference) else list(values.values()) for values in gather.values()]
    return [reference for references in nested for reference in references]


def intermediate_steps(steps: Mapping[str, Step], written: Iterable[Reference]) -> frozenset[str]:
    """The steps that only others take: nothing of them is ``written`` or gathered, and none is a choice."""
    taken = {name for step in steps.values() for name in step.needs}
    gathered = [reference for step in steps.values() for reference in flat(step.gather)]
    choices = [step.chosen for step in steps.values() if step.chosen is not None]
    final = {reference.name for reference in (*written, *gathered, *choices)}
    return frozenset(taken & steps.keys() - final)
