"""Scopes: the sources and results of an item, or those that all items share, and what is kept of them in memory."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from texloom.pipelines.engine.events import label
from texloom.pipelines.engine.task_spec import Inputs, Output
from texloom.pipelines.errors import one_line
from texloom.pipelines.flow.items import Item
from texloom.pipelines.flow.model import Each, Flow, Reference, Step
from texloom.pipelines.media.known_files import KnownFiles, using
from texloom.pipelines.media.sources import Source, SourceError, SourceValue, open_mesh, open_patches, open_source
from texloom.pipelines.store.outputs import Array, Outputs, copied
from texloom.pipelines.store.store import Artifact, Store
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, Outline

_MAX_KEPT = 2**28  # bytes of results in memory for each scope
_LARGE = 2**26  # bytes of one that is not copied for its last two uses, but read again

_OPENERS: Mapping[str, Callable[[str, str, Store], Source]] = {
    "picture": lambda name, given, _: open_source(name, given),
    "mesh": lambda name, given, _: open_mesh(name, given),
    "patches": open_patches,
}


class Scope:
    """Where steps find what they take: the sources and artifacts of an item, or those that all items share."""

    def __init__(
        self,
        flow: Flow,
        store: Store,
        item: Item | None = None,
        shared: Scope | None = None,
        known: KnownFiles | None = None,
    ):
        """Open the sources and check what stages say of them; nothing is decoded or written.

        Parameters
        ----------
        store : where earlier results are found.
        known : files that need not be opened again, also for the items' scopes.

        Raises
        ------
        InputError : a source or param is not usable.
        """
        self._flow = flow
        self.item = item
        self.shared = shared
        self.name = None if item is None else item.name
        self.seed = flow.seeds[0] if item is None else item.seed
        self.artifacts: dict[str, Artifact] = {}
        self.lost: dict[str, str] = {}
        """step to why it has no result; those that would take it are lost with it"""
        self.passed_over: dict[str, str] = {}
        """step to why it has none though nothing failed: another one was chosen"""
        files = {name: path for name, path in flow.sources.items() if not isinstance(path, Each)}
        self.used: set[str] = used_sources(flow) if shared is None else shared.used
        opened = files if item is None else item.sources
        self._steps = [step for step in flow.steps.values() if (step.scope == "item") == (item is not None)]
        self._known: KnownFiles | None = known if shared is None else shared._known
        with using(self._known):
            self.sources = {
                name: _OPENERS[flow.kinds.get(name, "picture")](name, path, store)
                for name, path in opened.items()
                if name in self.used
            }
        self._take_parts(flow)
        self._values: dict[str, SourceValue] | None = None
        self._lock = threading.Lock()
        self._outlines: dict[Reference, Outline] = {}
        self.notes = [note for source in self.sources.values() for note in source.notes]
        """what the user should know of how the sources were understood"""
        if item is None:
            self.notes += [
                note for given in flow.sources.values() if isinstance(given, Each) for note in given.notes
            ]
            self.notes += [
                _of_own_example(name, flow.sources[name]) for name in flow.own_examples if name in self.used
            ]
        for step in self._steps:
            self._check(step)

    def _take_parts(self, flow: Flow) -> None:
        """Take the part that is asked for of the first source, and of those that belong to it and have its size."""
        first = next(iter(flow.parts), None)
        if first is None or not self.has_source(first):
            return
        of_whole = self.source(first).whole or self.source(first)
        for name, part in flow.parts.items():
            opened = self.sources.get(name)
            if opened is not None and (opened.height, opened.width) == (of_whole.height, of_whole.width):
                self.sources[name] = opened.taken(part)

    def _check(self, step: Step) -> None:
        """Check what is known of a step before anything runs, and note what it tells of its results."""
        stage = step.stage
        known = {name: self._outline(given) for name, given in step.inputs.items()}
        known = {name: value for name, value in known.items() if value is not None}
        try:
            if stage.check is not None:
                stage.check(step.params, known)
        except InputError as error:
            raise InputError(self._explained(step, error)) from None
        if stage.outlines is not None:
            for name, outline in stage.outlines(step.params, known).items():
                self._outlines[Reference(step.name, name)] = outline

    def _explained(self, step: Step, error: InputError) -> str:
        """What a check says, with the step and the file of the source that it names."""
        given = step.inputs.get(str(error).partition(":")[0])
        source = self.source(given.name) if given is not None and given.output is None else None
        what = f" ({source.name} is {source.reference})" if source is not None else ""
        return f"{self._flow.where('steps', step.name)}: {error}{what}"

    def _outline(self, given: Reference) -> Source | Outline | None:
        """The header of a source, or what is known of a result that is not computed yet."""
        if given.output is None:
            return self.source(given.name)
        if given in self._outlines or self.shared is None:
            return self._outlines.get(given)
        return self.shared._outline(given)

    def pixels_of(self, step: Step) -> int:
        """Number of pixels of a step's result, as far as its parameters and what it takes tell; else 0."""
        known = [self._outlines.get(Reference(step.name, name)) for name in step.stage.outputs]
        size = getattr(step.params, "size", None)
        own = size[0] * size[1] if isinstance(size, tuple) else 0
        return max(own, *(outline.height * outline.width for outline in known if outline is not None), 0)

    def source(self, name: str) -> Source:
        """An opened source of the item, or one that all share."""
        if name in self.sources or self.shared is None:
            return self.sources[name]
        return self.shared.source(name)

    def has_source(self, name: str) -> bool:
        """Whether a source is open here, or in the shared scope."""
        return name in self.sources or (self.shared is not None and self.shared.has_source(name))

    def artifact(self, name: str) -> Artifact | None:
        """The result of a step of the item, or of one that all share, if it is there."""
        if name in self.artifacts or self.shared is None:
            return self.artifacts.get(name)
        return self.shared.artifact(name)

    def why_passed_over(self, name: str) -> str | None:
        """Why a step of the item, or one that all share, was passed over, if it was."""
        if name in self.passed_over or self.shared is None:
            return self.passed_over.get(name)
        return self.shared.why_passed_over(name)

    @property
    def problem(self) -> str | None:
        """Why steps are lost, if any are."""
        return "; ".join(dict.fromkeys(self.lost.values())) or None

    def label(self, step: Step) -> str:
        """What a step is called here."""
        return label(step.name, self.name if step.scope == "item" else None)

    def values(self) -> Mapping[str, SourceValue]:
        """The decoded sources of this scope, kept until `forget_values`.

        Raises
        ------
        SourceError : one is broken, or not what a step takes; over a set, what items share is checked alone.
        """
        with self._lock:
            if self._values is None:
                values = {name: source.value() for name, source in self.sources.items()}
                if self.item is None:  # of an item only the steps that take it are lost
                    for step in self._steps:
                        self._check_values(step, values)
                self._values = values
            return self._values

    def _check_values(self, step: Step, values: Mapping[str, SourceValue]) -> None:
        """Check the content of the sources that a step takes."""
        sources = {name: values[given.name] for name, given in step.inputs.items() if given.output is None}
        if step.stage.check is None or not sources:
            return
        known = {name: self._outline(given) for name, given in step.inputs.items()} | sources
        try:
            step.stage.check(step.params, {name: value for name, value in known.items() if value is not None})
        except InputError as error:
            raise SourceError(self._explained(step, error)) from None

    def decoded(self, source: Source) -> SourceValue:
        """A decoded source, kept if it is one of this scope or of the shared one."""
        if self.sources.get(source.name) == source:
            value = self.values().get(source.name)
            return source.value() if value is None else value
        return source.value() if self.shared is None else self.shared.decoded(source)

    def forget_value(self, name: str) -> None:
        """Release the memory of a decoded source, which is decoded again if it is asked for."""
        with self._lock:
            if self._values is not None:
                self._values = {kept: value for kept, value in self._values.items() if kept != name}

    def forget_values(self) -> None:
        """Release the memory of the decoded sources."""
        self._values = None


class ScopeInputs(Inputs):
    """What the tasks of one scope take, kept in memory for as long as one of them or an export still needs it.

    Each task receives a copy of its own, equal to what it would read from the store.
    """

    def __init__(self, store: Store, scope: Scope, uses: Iterable[Reference]):
        """``uses``: what is taken, once for each time that it is taken; sources that others take too left out."""
        super().__init__(store)
        self.scope = scope
        self._uses = Counter(uses)
        self._values: dict[Reference, Any] = {}
        self._lock = threading.Lock()

    def source(self, source: Source) -> SourceValue:
        """See `Inputs`."""
        return self.scope.decoded(source)

    def output(self, given: Output) -> Any:
        """See `Inputs`."""
        reference = given.reference
        with self._lock:
            is_kept, is_last = reference in self._values, self._uses[reference] <= 1
            if is_kept and self._uses[reference] == 2 and _size(self._values[reference]) > _LARGE:
                return self._values.pop(reference)
            value = self._values.pop(reference) if is_kept and is_last else self._values.get(reference)
        if not is_kept:
            value = super().output(given)
            if _size(value) > _MAX_KEPT:
                return value
            if not is_last:
                self._keep(reference, value)
        return value if is_last else copied(value)

    def keep(self, step: str, outputs: Outputs) -> None:
        """See `Inputs`."""
        for name in outputs:
            reference = Reference(step, name)
            if self._uses[reference] > 0 and _size(outputs[name]) <= _MAX_KEPT:
                self._keep(reference, outputs.as_read(name))

    def _keep(self, reference: Reference, value: Any) -> None:
        with self._lock:
            self._values[reference] = value
            while sum(map(_size, self._values.values())) > _MAX_KEPT:
                del self._values[next(iter(self._values))]

    def release(self, references: Iterable[Reference]) -> None:
        """Count uses that are over, and drop what is not needed any more."""
        with self._lock:
            for reference in references:
                if reference.output is None and reference not in self._uses:
                    continue
                self._uses[reference] -= 1
                if self._uses[reference] <= 0:
                    self._values.pop(reference, None)
                    if reference.output is None and reference.name in self.scope.sources:
                        self.scope.forget_value(reference.name)


def _size(value: Any) -> int:
    """Bytes of an array or image; tables and numbers are small."""
    pixels = value.pixels if isinstance(value, Image) else value.values if isinstance(value, Array) else value
    return int(getattr(pixels, "nbytes", 0))


def used_sources(flow: Flow) -> set[str]:
    """The sources that steps and exports take."""
    references = [*flow.exports.values(), *(given for step in flow.steps.values() for given in step.references)]
    return {reference.name for reference in references if reference.output is None} | set(flow.likes.values())


def _of_own_example(name: str, source: str | Each) -> str:
    """Tells who gave one source of a flow, as its texture, that another, as its control map, is not theirs."""
    reference = source.patterns[0] if isinstance(source, Each) else source
    return one_line(f"sources.{name}: {reference}: the flow's own example; give yours with --source {name}=...")
