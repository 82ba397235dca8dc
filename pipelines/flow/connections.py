"""What steps and exports take: references that name what is there, of the types that are wanted."""

from __future__ import annotations

import dataclasses
from collections.abc import Container, Mapping, Set
from typing import Any

from texloom.pipelines.errors import closest, hint, one_of, shown
from texloom.pipelines.flow.conditions import is_condition
from texloom.pipelines.flow.draft import Change, Draft, DraftStep, Entry, texts_of
from texloom.pipelines.flow.gone import INPUTS, OUTPUTS
from texloom.pipelines.flow.model import Reference
from texloom.pipelines.flow.presence import Alternatives, Presence, Taker
from texloom.pipelines.flow.schema import SETS, WRITTEN, FolderPart
from texloom.pipelines.media.writers.writer_registry import MODELS, writer_of
from texloom.pipelines.store.types import TEXT_NAMES, Hint
from texloom.stages.vocabulary.arrays import Image, Mesh
from texloom.stages.vocabulary.declare import Stage
from texloom.stages.vocabulary.voted_patches import VotedPatches

_EXPORTABLE = {
    "array": "a picture or field",
    "data": "a field",
    "picture": "a picture or field",
    "image": "an image",
    "value": "a table or number",
    **TEXT_NAMES,
}
"""what writers take, in words"""
_IMAGE = Hint.of(Image)
_MESH = Hint.of(Mesh)
_KINDS = {"patches": Hint.of(VotedPatches), "mesh": _MESH}


class Connections:
    """Reads the references of a draft.

    Parameters
    ----------
    dropped : the optional sources that an including flow leaves out for good.
    """

    def __init__(self, draft: Draft, stages: Mapping[str, Stage], dropped: Set[str]):
        self.draft = draft
        self.stages = stages
        self.dropped = dropped
        self.kinds = {name: kind for kind, hint in _KINDS.items() for name in self._sources_taken_as(hint)}
        """sources that are no pictures, and what they are instead, see `Flow`"""

    def of_step(self, name: str, step: DraftStep) -> Taker:
        """What a step takes, checked."""
        stage = self.stages[name]
        only: Alternatives = ()
        if step.only is not None and is_condition(step.only.value):
            only = (Reference(step.only.value),)
        elif step.only is not None and step.only.value != SETS:
            only = self._references(step.only)
        for change in step.when:
            for key, entry in change.inputs.items():
                if entry.value is not None:
                    self._check_input(entry, key, stage)
                    self._input(entry, Hint.of(stage.inputs[key]))
            for key, entry in change.params.items():
                if key not in stage.params.model_fields:
                    raise entry.fail(
                        f"stage {stage.name} has no param '{key}'{hint(key, stage.params.model_fields)}"
                    )
        required = {key for key in stage.inputs if key not in stage.optional}
        is_for_sets = step.only is not None and step.only.value == SETS
        gather = self._gather(name, step)
        return Taker(self._inputs(name, step), gather, required, only, self._chosen(step), is_for_sets)

    def of_export(self, file: str, entry: Entry) -> Taker:
        """What an export takes, checked."""
        image = entry.value
        inputs: dict[str, Alternatives] = {}
        only: Alternatives = ()
        if isinstance(entry.value, FolderPart):
            image, like, mesh = entry.value.image, entry.value.like, entry.value.mesh
            if entry.value.only is not None:
                only = self._references(dataclasses.replace(entry, value=entry.value.only), "only")
            if file.endswith("/") or (like is not None and (file.endswith(".png") or entry.value.if_maps)):
                if like is not None and (not isinstance(like, str) or like not in self.draft.sources):
                    raise entry.fail(f"no source {shown(like)}{hint(str(like), self.draft.sources)}", "like")
                if like is not None:
                    inputs["like"] = (Reference(like),)
                elif entry.value.if_maps:
                    raise entry.fail("needs 'like', the source that may be a map set", "if_maps")
            elif mesh is not None and file.endswith(MODELS):
                inputs["mesh"] = self._input(dataclasses.replace(entry, value=mesh), _MESH, "mesh")
            elif not (only or entry.value.if_made) or like is not None or mesh is not None:
                raise entry.fail(
                    "must be a source or STEP.OUTPUT, got a mapping, which a folder takes, a PNG with 'like', "
                    "a .glb, .usda or .mtlx with 'mesh'"
                )
        other = file.removesuffix("/") if file.endswith("/") else f"{file}/"
        files = list(self.draft.exports)
        if other in files[: files.index(file)]:
            raise entry.fail(f"'{other}' is another export; a file and a folder cannot have the same name")
        inputs["image"] = self._references(dataclasses.replace(entry, value=image))
        for reference in inputs["image"]:
            self._check_export(file, entry, reference)
        return Taker(inputs, required={"image", "mesh"}, only=only)

    def changed(self, name: str, step: DraftStep, there: Presence, sources: Container[str]) -> Taker:
        """What a step takes with the sources that are there; its params are changed in the draft."""
        taker = there.takers[name]
        for change in step.when:
            if not self._holds(change, there, sources):
                continue
            inputs = {
                key: None if entry.value is None else self._references(entry)
                for key, entry in change.inputs.items()
            }
            kept = {**taker.inputs, **inputs}
            taker = dataclasses.replace(taker, inputs={key: one for key, one in kept.items() if one is not None})
            step = dataclasses.replace(step, params={**step.params, **change.params})
        self.draft.steps[name] = step
        return taker

    def _holds(self, change: Change, there: Presence, sources: Container[str]) -> bool:
        """Whether the source of a change is there; a step that nothing takes is gone, and with it what it made."""
        texts = texts_of(change.source.value)
        known = [text for text in texts if _named(text) in self.stages or _named(text) in sources]
        return any(there.chosen((self._reference(change.source, text),)) for text in known)

    def _chosen(self, step: DraftStep) -> Alternatives:
        """The choice on which a step depends, and its label, checked."""
        if step.chosen is None:
            return ()
        name, _, label = str(step.chosen.value).partition(".")
        choices = [one for one, stage in self.stages.items() if stage.role == "choice"]
        if name not in choices:
            raise step.chosen.fail(f"no choice '{name}'{closest(name, choices) or one_of(choices)}")
        return (Reference(name, label),)

    def _inputs(self, name: str, step: DraftStep) -> dict[str, Alternatives]:
        stage = self.stages[name]
        references = {}
        for key, entry in step.inputs.items():
            self._check_input(entry, key, stage)
            references[key] = self._input(entry, Hint.of(stage.inputs[key]))
        taken = {*references, *step.gather}
        missing = [key for key in stage.inputs if key not in taken and key not in stage.optional]
        if missing:
            needed = f"'{missing[0]}' ({Hint.of(stage.inputs[missing[0]])})"
            raise step.at.fail(f"stage {stage.name} needs {needed}", "inputs")
        return references

    def _gather(self, name: str, step: DraftStep) -> dict[str, Alternatives | Mapping[str, Alternatives]]:
        """Inputs that receive a list of all items' values, or such a list by label."""
        stage = self.stages[name]
        gathered: dict[str, Alternatives | Mapping[str, Alternatives]] = {}
        for key, entry in step.gather.items():
            self._check_input(entry, key, stage)
            wanted = Hint.of(stage.inputs[key])
            if wanted.element is None or key in step.inputs:
                raise entry.fail(f"stage {stage.name} takes {wanted}: give it as an input")
            element = Hint.of(wanted.element)
            if not wanted.is_labelled:
                gathered[key] = self._input(entry, element)
            elif isinstance(entry.value, dict) and entry.value:
                gathered[key] = {
                    str(label): self._input(dataclasses.replace(entry, value=text), element, label)
                    for label, text in entry.value.items()
                }
            else:
                raise entry.fail(f"must map labels to STEP.OUTPUT, got {shown(entry.value)}")
        return gathered

    def _input(self, entry: Entry, wanted: Hint, *place: object) -> Alternatives:
        """The references in an entry, to values of the type ``wanted``."""
        references = self._references(entry, *place)
        for reference in references:
            kind = self.type_of(reference)
            if not kind.fits(wanted):
                raise entry.fail(f"must be {wanted}, but {reference} is {kind}", *place)
        return references

    @staticmethod
    def _check_input(entry: Entry, name: str, stage: Stage) -> None:
        if name not in stage.inputs:
            if name in INPUTS:
                raise entry.fail(f"is gone: {INPUTS[name]}")
            raise entry.fail(f"stage {stage.name} has no such input{hint(name, stage.inputs)}")

    def _references(self, entry: Entry, *place: object) -> Alternatives:
        """The references in an entry, of which the first that is there is taken."""
        texts = entry.value if isinstance(entry.value, list) else [entry.value]
        if not texts:
            raise entry.fail("must be a source or STEP.OUTPUT, got []", *place)
        return tuple(self._reference(entry, text, *place) for text in texts)

    def _reference(self, entry: Entry, text: Any, *place: object) -> Reference:
        """One of the references in an entry."""
        stages, sources = self.stages, {*self.draft.sources, *self.dropped}
        if not isinstance(text, str):
            raise entry.fail(f"must be a source or STEP.OUTPUT, got {shown(text)}", *place)
        name, dot, output = text.partition(".")
        if not dot:
            if name in sources:
                return Reference(name)
            if name in stages:
                outputs = stages[name].outputs
                which = ", ".join(f"{name}.{one}" for one in outputs)
                raise entry.fail(f"which output of step '{name}'? {which}", *place)
            listed = [one for one in self.draft.sources if one not in self.dropped]
            known = [*listed, *(f"{step}.{one}" for step, stage in stages.items() for one in stage.outputs)]
            raise entry.fail(f"no source '{name}'{closest(name, known) or one_of(listed)}", *place)
        if name not in stages:
            near = closest(name, [*stages, *self.draft.spread])
            raise entry.fail(f"no step '{name}'{near or one_of(stages)}", *place)
        if output not in stages[name].outputs:
            if output in OUTPUTS:
                raise entry.fail(f"{text} is gone: {OUTPUTS[output]}", *place)
            raise entry.fail(f"step '{name}' has no output '{output}'{hint(output, stages[name].outputs)}", *place)
        return Reference(name, output)

    def type_of(self, reference: Reference) -> Hint:
        """The type of what a reference names."""
        if reference.output is None:
            return _KINDS.get(self.kinds.get(reference.name, ""), _IMAGE)
        return Hint.of(self.stages[reference.name].outputs[reference.output])

    def _check_export(self, file: str, entry: Entry, reference: Reference) -> None:
        made = self.type_of(reference)
        if file.endswith("/"):
            if made.plain is not Image:
                raise entry.fail(f"must be an image, whose maps it will hold, but {reference} is {made}")
            return
        kind = made.text or ("array" if made.is_array else "value")
        writer = writer_of(file)
        if writer is None:
            raise entry.fail(f"must end in {WRITTEN}")
        takes = writer.takes
        if kind != ("array" if takes in ("data", "picture", "image") else takes):
            raise entry.fail(f"must be {_EXPORTABLE[takes]}, but {reference} is {made}")
        if takes == "picture" and not made.is_picture:
            raise entry.fail(f"must be a picture, but {reference} is {made}; export it as .exr")
        if takes == "data" and made.plain is Image:
            raise entry.fail(f"must be a field, but {reference} is an image; export it as .png")
        if takes == "image" and made.plain is not Image:
            raise entry.fail(f"must be an image, whose maps it will bind, but {reference} is {made}")
        writer.check_installed(entry.where())
        folder = f"{file.removesuffix(writer.suffix)}{writer.companions}"
        if writer.companions and {folder, f"{folder}/"} & set(self.draft.exports):
            raise entry.fail(f"its maps are written into '{folder}', which is another export")

    def _sources_taken_as(self, kind: Hint) -> set[str]:
        """The sources that a step takes as a mesh, or as an earlier result."""
        return {
            text
            for name, step in self.draft.steps.items()
            for key, entry in step.inputs.items()
            if key in self.stages[name].inputs and Hint.of(self.stages[name].inputs[key]) == kind
            for text in texts_of(entry.value)
            if text in self.draft.sources
        }


def _named(text: str) -> str:
    """The step or source of a reference."""
    return text.partition(".")[0]
