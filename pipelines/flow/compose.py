"""Flow files put together: `include` takes the steps of another flow, `for` and `repeat` make variants of them.

The result is a `Draft`, whose values keep the file and place where they are written, for errors.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from texloom.pipelines.errors import closest, one_of, refused
from texloom.pipelines.flow.schema import (
    EXPORT,
    NAME,
    FlowPart,
    FolderPart,
    IncludePart,
    SetPart,
    StepPart,
    VariantPart,
    parse_flow,
)
from texloom.pipelines.yaml import read_document
from texloom.stages.declare import InputError

STRUCTURAL = ("include", "repeat")
"""the fields that a param of a flow may stand for, besides STEP.PARAM"""
_FORMER = "former."  # before a reference: to the round before
_EACH = "*"  # every variant's label
_DEEPEST = 8


@dataclasses.dataclass(frozen=True)
class Given:
    """A value and where it is written."""

    value: Any
    path: Path
    place: str

    def fail(self, problem: str, *more: object) -> InputError:
        """The error of this place, or of one inside of it."""
        return refused(f"{self.path}: {'.'.join([self.place, *map(str, more)])}: {problem}")


@dataclasses.dataclass(frozen=True)
class DraftStep:
    """A step before its stage is known."""

    at: Given
    stage: Given
    inputs: Mapping[str, Given]
    gather: Mapping[str, Given]
    """to a reference, or labels to references"""
    params: Mapping[str, Given]
    draws_as: str
    own: bool = True
    """written in the file itself; steps that are included run only if something needs them"""

    def references(self) -> list[str]:
        """All references."""
        found: list[str] = []
        waiting = [given.value for given in (*self.inputs.values(), *self.gather.values())]
        for value in waiting:
            if isinstance(value, dict):
                waiting += value.values()
            elif isinstance(value, str):
                found.append(value)
        return found

    @property
    def joins_variants(self) -> bool:
        """Whether it receives the results of all variants, by label."""
        return any(isinstance(given.value, dict) and _EACH in given.value for given in self.gather.values())

    def same(self, other: DraftStep) -> bool:
        """Whether both are written alike; names of files depend on the folder."""

        def content(step: DraftStep) -> list[Any]:
            taken = [{name: given.value for name, given in part.items()} for part in (step.inputs, step.gather)]
            params = {name: (given.value, given.path.parent) for name, given in step.params.items()}
            return [step.stage.value, step.draws_as, *taken, params]

        return content(self) == content(other)

    def with_references(self, change: Callable[[Given], Given | None]) -> DraftStep:
        """The step with every reference changed; inputs for which ``change`` gives none are left out."""

        def gathered(given: Given) -> Given | None:
            if not isinstance(given.value, dict):
                return change(given)
            changed = {label: change(dataclasses.replace(given, value=text)) for label, text in given.value.items()}
            return dataclasses.replace(given, value={label: new.value for label, new in changed.items() if new})

        inputs = {name: new for name, given in self.inputs.items() if (new := change(given)) is not None}
        gather = {name: new for name, given in self.gather.items() if (new := gathered(given)) is not None}
        return dataclasses.replace(self, inputs=inputs, gather=gather)


@dataclasses.dataclass
class Draft:
    """A flow put together, its names not yet checked."""

    name: str
    path: Path
    seed: tuple[int, ...] | None = None
    runner: Given | None = None
    sources: dict[str, Given] = dataclasses.field(default_factory=dict)
    steps: dict[str, DraftStep] = dataclasses.field(default_factory=dict)
    exports: dict[str, Given] = dataclasses.field(default_factory=dict)
    params: dict[str, Given] = dataclasses.field(default_factory=dict)
    """name to the list of STEP.PARAM that take its value"""
    spread: dict[str, dict[str, str]] = dataclasses.field(default_factory=dict)
    """name of a step that differs between variants to their labels and names there"""
    lacking: dict[str, list[str]] = dataclasses.field(default_factory=dict)
    """name of a step or param to the variants that have none"""
    included: list[Path] = dataclasses.field(default_factory=list)
    """the other files that it was read from"""


def find_flow(name: str) -> Path:
    """The file called ``name``, or the flow of that bare name that ships with texloom."""
    return _find(name, Path())


def _find(name: str, folder: Path) -> Path:
    path = folder / name
    try:
        if path.is_file():
            return path
    except OSError as error:
        raise refused(f"{name}: cannot be read: {error.strerror}") from None
    shipped = shipped_flows()
    if name in shipped:
        return shipped[name]
    hint = closest(name, shipped) or (
        f"; `texloom flows` lists those that ship: {', '.join(shipped)}" if "/" not in name else ""
    )
    if path.is_dir():
        raise refused(f"{name}: is a folder, not a flow file")
    raise refused(f"{name}: no such flow{hint}")


def shipped_flows() -> dict[str, Path]:
    """Name to file of the flows that ship with texloom."""
    folder = Path(__file__).parents[2] / "configs"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def compose(document: Any, path: Path, values: Mapping[str, Any], stack: tuple[Path, ...] = ()) -> Draft:
    """Put a flow together from a document and the files that it includes.

    Parameters
    ----------
    document : what the file at ``path`` holds.
    values : for the flow's params; those that stand for `STRUCTURAL` fields are used here.
    stack : the files that include this one, outermost first.

    Raises
    ------
    InputError : the structure of a file is wrong, or it includes what cannot be.
    """
    part = _with_structure(parse_flow(document, path), path, values)
    return _Composer(part, path, values, stack).draft()


def _with_structure(part: FlowPart, path: Path, values: Mapping[str, Any]) -> FlowPart:
    """The flow with `STRUCTURAL` fields changed by its params."""
    for name, target in part.params.items():
        if target not in STRUCTURAL or name not in values:
            continue
        value = values[name]
        if target == "include":
            flow = str(Path.cwd() / value) if isinstance(value, str) and Path(value).is_file() else value
            value = part.include.model_dump() | {"flow": flow} if isinstance(part.include, IncludePart) else flow
        checked = parse_flow({target: value}, Path(f"{path}: params.{name}"))
        part = part.model_copy(update={target: getattr(checked, target)})
    return part


class _Composer:
    """One file, with what it includes."""

    def __init__(self, part: FlowPart, path: Path, values: Mapping[str, Any], stack: tuple[Path, ...]):
        self.part = part
        self.path = path
        self.values = values
        self.stack = (*stack, path.resolve())
        self.has_variants = bool(part.for_) or part.repeat is not None

    def given(self, value: Any, *place: object) -> Given:
        return Given(value, self.path, ".".join(map(str, place)))

    def draft(self) -> Draft:
        part = self.part
        if part.for_ and part.repeat is not None:
            raise self.given(None, "repeat").fail("a flow has either 'for' or 'repeat'")
        if part.repeat is not None:
            rounds = [f"round_{index + 1}" for index in range(part.repeat)]
            draft = self.merged({label: self.variant(None, "", label == rounds[0]) for label in rounds})
        elif part.for_:
            draft = self.merged({label: self.variant(*more) for label, more in self.variants().items()})
        else:
            draft = self.variant(None, "")
            self.prune([draft])
            self.check_no_labels(draft)
        return draft

    @staticmethod
    def check_no_labels(draft: Draft) -> None:
        """Refuse `_EACH` where there are no variants."""
        problem = f"'{_EACH}' is for the labels of 'for' and 'repeat'; the flow has neither"
        for file, given in draft.exports.items():
            if not EXPORT.fullmatch(file):
                raise given.fail(problem)
        for step in draft.steps.values():
            if step.joins_variants or _EACH in step.draws_as:
                raise step.at.fail(problem)

    def variants(self) -> dict[str, tuple[VariantPart, str]]:
        """Label to what differs, and where that is written."""
        listed = {name: value for name, value in self.part.for_.items() if isinstance(value, list)}
        found: dict[str, tuple[VariantPart, str]] = {
            label: (part, f"for.{label}.")
            for label, part in self.part.for_.items()
            if isinstance(part, VariantPart)
        }
        if listed and found:
            raise self.given(None, "for", *found).fail("either lists of values or variants by label, not both")
        if listed:
            for values in itertools.product(*listed.values()):
                chosen = dict(zip(listed, values, strict=True))
                label = "_".join(_label(name, value) for name, value in chosen.items())
                included = {"include": chosen.pop("include")} if "include" in chosen else {}
                part = parse_flow({**included, "with": chosen}, Path(f"{self.path}: for"))
                if label in found:
                    raise self.given(None, "for").fail(f"two variants would be called '{label}'")
                found[label] = part, "for: "
        return found

    def variant(self, variant: VariantPart | None, place: str, first: bool = True) -> Draft:
        """The flow as one variant, or the only one, has it; references to the round before are left as they are."""
        part = self.part
        parts = [(part, ""), *([(variant, place)] if variant is not None else [])]
        draft = self.included(parts, first)
        self.set_params(draft, part.with_, "with")
        if self.has_variants and (part.exports or (variant is not None and variant.exports)):
            draft.exports = {}
        for name, targets in part.params.items():
            listed = [targets] if isinstance(targets, str) else targets
            draft.params[name] = self.given(listed, "params", name)
        for one, where in parts:
            if where:
                self.set_params(draft, one.with_, f"{where}with")
            for name, source in one.sources.items():
                draft.sources[name] = self.given(source, f"{where}sources", name)
            for name, step in one.steps.items():
                self.set_step(draft, name, step, f"{where}steps.{name}")
            for file, export in one.exports.items():
                if export is None and file in draft.exports:
                    del draft.exports[file]
                else:
                    draft.exports[file] = self.given(export, f"{where}exports", file)
        if part.repeat is not None and first:
            draft.steps = {name: step.with_references(_unless_former) for name, step in draft.steps.items()}
        return draft

    @staticmethod
    def prune(drafts: Iterable[Draft]) -> None:
        """Drop what is included and nothing needs."""
        steps = [step for draft in drafts for step in draft.steps.values()]
        references = itertools.chain(*(step.references() for step in steps))
        former = {_step_of(text.removeprefix(_FORMER)) for text in references if text.startswith(_FORMER)}
        for draft in drafts:
            needed = {name for name, step in draft.steps.items() if step.own} | former
            needed |= {_step_of(_image_of(given.value)) for given in draft.exports.values()}
            _keep(draft, _upstream(draft.steps, needed))

    def included(self, parts: list[tuple[Any, str]], first: bool) -> Draft:
        """The draft of the flow that is included, or an empty one."""
        part = self.part
        own = Draft(part.flow or self.path.stem, self.path, tuple(part.seed) if part.seed else None)
        own.runner = None if part.runner is None else self.given(part.runner, "runner")
        fields: dict[str, Any] = {}
        where = ""
        for one, place in parts:
            if one.include is not None:
                more = one.include if isinstance(one.include, IncludePart) else IncludePart(flow=one.include)
                fields |= {name: getattr(more, name) for name in more.model_fields_set}
                where = place
        if not fields:
            return own
        at = self.given(None, f"{where}include")
        if fields.get("flow") is None:
            raise at.fail("which flow? give its name or file as 'flow'")
        base = self.loaded(at, fields["flow"], [one.with_ for one, _ in parts])
        if fields.get("steps") is not None:
            _select(base, fields["steps"], at)
        _bind(
            base,
            {
                name: self.given(text, f"{where}include.inputs", name)
                for name, text in fields.get("inputs", {}).items()
            },
            first,
        )
        base.name, base.path = own.name, own.path
        base.seed, base.runner = own.seed or base.seed, own.runner or base.runner
        base.steps = {name: dataclasses.replace(step, own=False) for name, step in base.steps.items()}
        return base

    def loaded(self, at: Given, flow: str, values: list[dict[str, Any]]) -> Draft:
        try:
            path = _find(flow, self.path.parent)
        except InputError as error:
            raise at.fail(str(error)) from None
        if path.resolve() in self.stack or len(self.stack) > _DEEPEST:
            raise at.fail(f"{flow} includes itself" if path.resolve() in self.stack else "nested too deeply")
        known = dict(itertools.chain(self.values.items(), *(more.items() for more in values)))
        base = compose(read_document(path), path, known, self.stack)
        base.included = [path, *base.included]
        return base

    def set_params(self, draft: Draft, values: Mapping[str, Any], place: str) -> None:
        """Give values to the flow's params."""
        for name, value in values.items():
            given = self.given(value, place, name)
            if name not in draft.params:
                problem = f"the flow has no param '{name}'"
                raise given.fail(problem + (closest(str(name), draft.params) or one_of(draft.params)))
            for target in draft.params[name].value:
                step, _, param = target.partition(".")
                if step in draft.steps:
                    known = draft.steps[step]
                    draft.steps[step] = dataclasses.replace(known, params={**known.params, param: given})

    def set_step(self, draft: Draft, name: str, part: StepPart | None, place: str) -> None:
        """Add a step, or change one that is there."""
        at = self.given(None, place)
        before = draft.steps.get(name)
        if part is None:
            if before is None:
                raise at.fail("must be a mapping with 'stage', 'inputs' and 'params', got nothing")
            del draft.steps[name]
            return
        fields: dict[str, dict[str, Given]] = {
            field: {key: self.given(value, place, field, key) for key, value in getattr(part, field).items()}
            for field in ("inputs", "gather", "params")
        }
        if before is None or part.stage is not None:
            stage = self.given(part.stage, place, "stage")
            inputs, gather, params = fields.values()
            draft.steps[name] = DraftStep(at, stage, inputs, gather, params, part.draws_as or name)
            return
        taken = {key: given for key, given in fields["inputs"].items() if given.value is not None}
        gathered = {key: given for key, given in fields["gather"].items() if given.value is not None}
        changed = {*fields["inputs"], *fields["gather"]}
        draft.steps[name] = dataclasses.replace(
            before,
            inputs={**{key: given for key, given in before.inputs.items() if key not in changed}, **taken},
            gather={**{key: given for key, given in before.gather.items() if key not in changed}, **gathered},
            params={**before.params, **fields["params"]},
            draws_as=part.draws_as or before.draws_as,
        )

    def merged(self, drafts: dict[str, Draft]) -> Draft:
        """All variants as one flow: steps that are the same in all are there once, the others once for each."""
        labels = list(drafts)
        first = drafts[labels[0]]
        names = list(dict.fromkeys(name for draft in drafts.values() for name in draft.steps))
        once = self.shared(names, drafts)
        having = {name: [label for label in labels if name in drafts[label].steps] for name in names}
        having |= {
            name: [label for label in labels if name in drafts[label].params]
            for name in itertools.chain(*(draft.params for draft in drafts.values()))
        }
        self.prune(list(drafts.values()))
        chain = self.part.repeat is not None
        spread = {
            name: {label: f"{label}_{name}" for label in labels if name in drafts[label].steps}
            for name in names
            if name not in once
        }

        def resolved(label: str, text: Any) -> Any:
            if not isinstance(text, str):
                return text
            if chain and text.startswith(_FORMER):
                text, label = text.removeprefix(_FORMER), labels[max(labels.index(label) - 1, 0)]
            name, dot, output = text.partition(".")
            return f"{spread[name][label]}{dot}{output}" if dot and label in spread.get(name, ()) else text

        def rewritten(label: str, given: Given) -> Given:
            return dataclasses.replace(given, value=resolved(label, given.value))

        found = Draft(first.name, first.path, first.seed, first.runner)
        for label, draft in drafts.items():
            found.included += [path for path in draft.included if path not in found.included]
            found.sources = {**draft.sources, **found.sources}
            for name, step in draft.steps.items():
                if name in once:
                    if name not in found.steps:
                        found.steps[name] = self.joined(step, labels, resolved)
                    continue
                draws_as = step.draws_as.replace(_EACH, label)
                if chain and label != labels[0]:
                    draws_as = f"{label}_{draws_as}"
                changed = step.with_references(functools.partial(rewritten, label))
                new = spread[name][label]
                if new in found.steps or new in once or not NAME.fullmatch(new):
                    raise step.at.fail(f"as that of {label} it would be called '{new}', which cannot be")
                found.steps[new] = dataclasses.replace(changed, draws_as=draws_as)
        self.merge_exports(found, drafts, resolved)
        found.spread = spread
        for label, draft in drafts.items():
            for name, inner in draft.spread.items():
                for more, old in inner.items():
                    found.spread.setdefault(name, {})[f"{label}_{more}"] = resolved(label, f"{old}.")[:-1]
        for name, where in having.items():
            if len(where) < len(labels) and name not in once:
                found.lacking[name] = [label for label in labels if label not in where]
        for name in dict.fromkeys(itertools.chain(*(draft.params for draft in drafts.values()))):
            if name in found.lacking or isinstance(self.part.for_.get(name), list):
                continue
            given = {label: draft.params[name] for label, draft in drafts.items() if name in draft.params}
            targets = [resolved(label, target) for label, one in given.items() for target in one.value]
            found.params[name] = dataclasses.replace(next(iter(given.values())), value=list(dict.fromkeys(targets)))
        return found

    @staticmethod
    def shared(names: Iterable[str], drafts: Mapping[str, Draft]) -> set[str]:
        """The steps that are the same in all variants, or that receive the results of all."""
        steps = {name: [draft.steps[name] for draft in drafts.values() if name in draft.steps] for name in names}
        once = {
            name
            for name, variants in steps.items()
            if variants[0].joins_variants
            or (
                len(variants) == len(drafts)
                and all(variants[0].same(other) for other in variants[1:])
                and _EACH not in variants[0].draws_as
            )
        }
        while True:
            differing = {
                name
                for name in once
                if not steps[name][0].joins_variants
                and any(
                    _step_of(text) in steps and _step_of(text) not in once for text in steps[name][0].references()
                )
            }
            if not differing:
                return once
            once -= differing

    def joined(self, step: DraftStep, labels: list[str], resolved: Callable[[str, Any], Any]) -> DraftStep:
        """A step that is there once; where it receives the results of all variants, by their labels."""
        last = labels[-1]
        gather = {}
        for name, given in step.gather.items():
            value = given.value
            if isinstance(value, dict):
                value = {
                    new: text
                    for label, reference in value.items()
                    for new, text in (
                        [
                            (one, resolved(one, reference[one] if isinstance(reference, dict) else reference))
                            for one in labels
                        ]
                        if label == _EACH
                        else [(label, resolved(last, reference))]
                    )
                }
            else:
                value = resolved(last, value)
            gather[name] = dataclasses.replace(given, value=value)
        for given in step.inputs.values():
            if self.part.for_ and resolved(last, given.value) != given.value:
                raise given.fail(
                    f"the step runs once for all variants, but {given.value} is there for each; take it by 'gather'"
                )
        inputs = {
            name: dataclasses.replace(given, value=resolved(last, given.value))
            for name, given in step.inputs.items()
        }
        return dataclasses.replace(step, inputs=inputs, gather=gather)

    def merge_exports(self, found: Draft, drafts: Mapping[str, Draft], resolved: Callable[[str, Any], Any]) -> None:
        """Exports of the variants: of one file for all, the last round's, or with their labels before the name."""
        files = dict.fromkeys(file for draft in drafts.values() for file in draft.exports)
        for file in files:
            given = {label: draft.exports[file] for label, draft in drafts.items() if file in draft.exports}
            changed = {}
            for label, export in given.items():
                value = export.value
                if isinstance(value, FolderPart):
                    value = value.model_copy(update={"image": resolved(label, value.image)})
                else:
                    value = resolved(label, value)
                changed[label] = dataclasses.replace(export, value=value)
            values = [export.value for export in changed.values()]
            if _EACH in file:
                found.exports |= {file.replace(_EACH, label): export for label, export in changed.items()}
            elif self.part.repeat is not None or all(value == values[0] for value in values):
                found.exports[file] = list(changed.values())[-1]
            else:
                found.exports |= {f"{label}_{file}": export for label, export in changed.items()}


def _label(name: str, value: Any) -> str:
    """What a variant of a param's value is called."""
    if isinstance(value, str) and NAME.fullmatch(value):
        return value
    if name == "include":
        value = Path(str(value)).stem
    words = re.sub(r"[^a-z0-9]+", "_", str(value).lower()).strip("_")
    return words if NAME.fullmatch(words) else f"{name}_{words}"


def _step_of(text: Any) -> str:
    """The step that a reference names, or nothing."""
    name, dot, _ = text.partition(".") if isinstance(text, str) else ("", "", "")
    return name if dot else ""


def _image_of(export: Any) -> Any:
    return export.image if isinstance(export, FolderPart) else export


def _unless_former(given: Given) -> Given | None:
    former = isinstance(given.value, str) and given.value.startswith(_FORMER)
    return None if former else given


def _upstream(steps: Mapping[str, DraftStep], names: Iterable[str]) -> set[str]:
    """The steps called ``names`` and all whose results they take."""
    found: set[str] = set()
    waiting = [name for name in names if name in steps]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += [step for text in steps[name].references() if (step := _step_of(text)) in steps]
    return found


def _select(draft: Draft, names: list[str], at: Given) -> None:
    """Keep the steps called ``names``, those whose results they take, and what refers to them."""
    for index, name in enumerate(names):
        if name not in draft.steps:
            raise at.fail(f"no step '{name}'{closest(name, draft.steps) or one_of(draft.steps)}", "steps", index)
    kept = _upstream(draft.steps, names)
    draft.exports = {
        file: given for file, given in draft.exports.items() if _step_of(_image_of(given.value)) in kept
    }
    _keep(draft, kept)
    taken = {text for step in draft.steps.values() for text in step.references()}
    taken |= {given.value.pair for given in draft.sources.values() if isinstance(given.value, SetPart)}
    draft.sources = {name: given for name, given in draft.sources.items() if name in taken}


def _keep(draft: Draft, names: set[str]) -> None:
    """Drop all other steps, and what params have to do with them."""
    dropped = set(draft.steps) - names
    draft.steps = {name: step for name, step in draft.steps.items() if name in names}
    for name, given in list(draft.params.items()):
        targets = [target for target in given.value if _step_of(target) not in dropped]
        draft.params[name] = dataclasses.replace(given, value=targets)
        if not targets:
            del draft.params[name]


def _bind(draft: Draft, inputs: Mapping[str, Given], first: bool) -> None:
    """Replace sources of an included flow by other references."""
    bound = {}
    for name, given in inputs.items():
        if name not in draft.sources:
            hint = closest(str(name), draft.sources) or one_of(draft.sources)
            raise given.fail(f"the included flow has no source '{name}'{hint}")
        if not (first and _unless_former(given) is None):
            bound[name] = given
            del draft.sources[name]

    def change(given: Given) -> Given:
        return bound.get(given.value, given) if isinstance(given.value, str) else given

    draft.steps = {name: step.with_references(change) for name, step in draft.steps.items()}
    for file, given in draft.exports.items():
        if not isinstance(given.value, FolderPart):
            draft.exports[file] = change(given)
