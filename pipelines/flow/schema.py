"""The structure of flow files as pydantic models; their errors become lines that name the place."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn

import pydantic
from pydantic import BeforeValidator, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

from texloom.pipelines.errors import hint, refused, shown
from texloom.pipelines.flow.shipped import GROUPS
from texloom.pipelines.media.writers.writer_registry import SUFFIXES

NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")
EXPORT = re.compile(rf"[A-Za-z0-9][A-Za-z0-9._-]{{0,127}}({'|'.join(map(re.escape, SUFFIXES))}|/)")
WRITTEN = f"{', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}"
"""the ends of names of files that can be written, in words"""
FILE_NAME = f"a file name of letters, digits, '.', '_' and '-' that ends in {WRITTEN}, or in / for a folder"
"""what `EXPORT` matches"""
FORMAT = 1
"""of flow files: a file of a later one would mean something else here"""
REQUIRED = "required"
"""in place of a source's file: whoever runs the flow must give one"""
OPTIONAL = "optional"
"""in place of a source's file: whoever runs the flow may give one, else the inputs that take it are left out"""
SETS = "sets"
"""in ``only``: the step is left out where there is one item alone"""
MOST_ROUNDS = 100
_ONLY = f"must be an optional source, CHOICE.LABEL, STEP.PARAM=VALUE, STEP.PARAM!=VALUE or '{SETS}'"
SOURCE = f"must be a file, 'texloom:NAME', 'skimage:NAME', '{REQUIRED}' or '{OPTIONAL}'"
"""what a source is, in words"""
_SEEDS = 2**63


def _fail(problem: str, kind: Literal["expected", "key", "whole"] = "expected") -> NoReturn:
    """Refuse a value; `_explained` adds the value to the problem, unless the problem is ``whole``."""
    raise PydanticCustomError(kind, "{problem}", {"problem": problem})


def _name(value: Any) -> str:
    if not isinstance(value, str) or not NAME.fullmatch(value):
        _fail("is not a name; use small letters, digits and _", "key")
    return value


def _flow_name(value: Any) -> str:
    if not isinstance(value, str) or not NAME.fullmatch(value):
        _fail("must be a name like 'my_flow' (small letters, digits, _)")
    return value


def _export_name(value: Any) -> str:
    if not isinstance(value, str) or not EXPORT.fullmatch(value.replace("*", "x", 1)):
        _fail(f"is not {FILE_NAME}", "key")
    return value


def _group(value: Any) -> str:
    if value not in GROUPS:
        _fail(f"must be one of {', '.join(GROUPS)}")
    return str(value)


def _seeds(value: Any) -> list[int]:
    seeds = value if isinstance(value, list) and value else [value]
    for seed in seeds:
        if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < _SEEDS:
            _fail(f"must be a whole number from 0 to 2**63 - 1, got {shown(seed)}", "whole")
    if len(set(seeds)) < len(seeds):
        _fail(f"the same one twice in {shown(seeds)}", "whole")
    return seeds


KEEP = ("all", "final")
"""which results a run leaves in the store"""


def _keep(value: Any) -> str:
    if value not in KEEP:
        _fail(f"must be {' or '.join(KEEP)}")
    return str(value)


def _format(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        _fail(f"must be the number of a format, up to {FORMAT}")
    if value > FORMAT:
        _fail(f"must be {FORMAT}, the newest that this texloom reads; update texloom")
    return value


def _rounds(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= MOST_ROUNDS:
        _fail(f"must be a whole number from 1 to {MOST_ROUNDS}")
    return value


def _factor(value: Any) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        _fail("must be a factor as 0.5")
    return str(value)


def _expect(kind: type[Any], problem: str) -> BeforeValidator:
    """Refuses what is not of ``kind``, or empty, with ``problem``."""

    def check(value: Any) -> Any:
        return value if isinstance(value, kind) and value != "" else _fail(problem)

    return BeforeValidator(check)


def _mapping_of(fields: str) -> BeforeValidator:
    return _expect(dict, f"must be a mapping with {fields}")


def _each(value: Any) -> Any:
    """A pattern, or a list of files."""
    listed = value if isinstance(value, list) and value else [value]
    if not all(isinstance(one, str) and one for one in listed):
        _fail("must be a pattern like 'folder/*.png'")
    return value


_optional = BeforeValidator(lambda value: {} if value is None else value)


def _tag(value: Any) -> str:
    return "<mapping>" if isinstance(value, dict) else "<plain>"


class _Part(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid", frozen=True, defer_build=True)


_Name = Annotated[str, BeforeValidator(_name)]


class WhenPart(_Part):
    """What changes in a step where a source is there."""

    inputs: Annotated[dict[str, Any], _optional] = {}
    params: Annotated[dict[str, Any], _optional] = {}


class StepPart(_Part):
    """A step, or what a file changes in a step of another."""

    stage: Any = None
    inputs: Annotated[dict[str, Any], _optional] = {}
    gather: Annotated[dict[str, Any], _optional] = {}
    params: Annotated[dict[str, Any], _optional] = {}
    draws_as: Annotated[str, _expect(str, "must be a step's name")] | None = None
    when: Annotated[dict[str, Annotated[WhenPart, _mapping_of("'inputs' and 'params'")]], _optional] = {}
    only: Annotated[str, _expect(str, _ONLY)] | None = None


class SetPart(_Part):
    """A source that is every file of a pattern or list, or the frame stack of a folder, pattern or EXR.

    Where it is ``ordered``, files that are given one by one keep that order; else they are in that of their names.
    Of fewer than ``least`` files nothing is made.

    With ``pair`` alone it is a required file, or as many as the other source has. With ``optional`` it has no file
    unless the caller gives one, or as many as the other source has.
    """

    optional: Annotated[str, _expect(str, "must be a text, what the source does")] | None = None

    each: Annotated[str | list[str], BeforeValidator(_each)] | None = None
    ordered: Annotated[bool, _expect(bool, "must be true or false")] = False
    least: Annotated[int, _expect(int, "must be a number of files")] = 1
    pair: Annotated[str, _expect(str, "must be another source")] | None = None
    stack: Annotated[str, _expect(str, f"must be a folder, pattern, EXR or '{REQUIRED}'")] | None = None

    @property
    def is_required(self) -> bool:
        """Whether it has no files of its own, and must be given some."""
        return self.pair is not None and self.each is None and self.stack is None and self.optional is None


class FolderPart(_Part):
    """An export that is a folder of maps, or a PNG, and is like a source; or a model, with the mesh it lies on.

    With ``only`` it is left out without that source; with ``if_made`` where its step gave nothing, without a word.
    """

    image: Any = None
    like: Any = None
    if_maps: Annotated[bool, _expect(bool, "must be true or false")] = False
    if_made: Annotated[bool, _expect(bool, "must be true or false")] = False
    mesh: Any = None
    only: Annotated[str, _expect(str, "must be an optional source")] | None = None


class IncludePart(_Part):
    """The flow whose steps are taken; with ``only``, a CHOICE.LABEL, they run only where that is chosen."""

    flow: Annotated[str, _expect(str, "must be a flow's name or file")] | None = None
    steps: Annotated[list[str], _expect(list, "must be a list of steps")] | None = None
    inputs: Annotated[dict[str, Any], _optional] = {}
    only: Annotated[str, _expect(str, "must be CHOICE.LABEL")] | None = None


_Source = Annotated[
    Annotated[None, Tag("<nothing>")]
    | Annotated[
        str,
        _expect(str, SOURCE),
        Tag("<plain>"),
    ]
    | Annotated[SetPart, Tag("<mapping>")],
    Discriminator(lambda value: "<nothing>" if value is None else _tag(value)),
]
_Include = Annotated[
    Annotated[str, _expect(str, "must be a flow's name or file"), Tag("<plain>")]
    | Annotated[IncludePart, Tag("<mapping>")],
    Discriminator(_tag),
]
_Export = Annotated[
    Annotated[Any, Tag("<plain>")] | Annotated[FolderPart, Tag("<mapping>")],
    Discriminator(_tag),
]
_Step = Annotated[StepPart, _mapping_of("'stage', 'inputs' and 'params'")] | None


class VariantPart(_Part):
    """What a file and its variants have in common."""

    include: _Include | None = None
    with_: Annotated[dict[str, Any], _optional] = Field({}, alias="with")
    sources: Annotated[dict[_Name, _Source], _optional] = {}
    steps: Annotated[dict[_Name, _Step], _optional] = {}
    exports: Annotated[dict[Annotated[str, BeforeValidator(_export_name)], _Export], _optional] = {}


_Targets = Annotated[
    Annotated[str, _expect(str, "must be STEP.PARAM, or a list of these"), Tag("<plain>")]
    | Annotated[list[Annotated[str, _expect(str, "must be STEP.PARAM")]], Tag("<list>")],
    Discriminator(lambda value: "<list>" if isinstance(value, list) else "<plain>"),
]
_Variants = Annotated[
    Annotated[list[Any], Tag("<list>")]
    | Annotated[VariantPart, _mapping_of("what differs, as in 'with', 'steps' or 'include'"), Tag("<mapping>")],
    Discriminator(lambda value: "<list>" if isinstance(value, list) else "<mapping>"),
]


_Text = Annotated[str, _expect(str, "must be a text")] | None


class DeliveryPart(_Part):
    """How exports are written; see `texloom.pipelines.media.delivery.parse_delivery`."""

    layout: _Text = None
    texel_size: _Text = None
    color_space: _Text = None
    udim: _Text = None
    material: _Text = None


class TakenPart(_Part):
    """What is taken of the first source; see `texloom.pipelines.media.part.parse_part`."""

    crop: _Text = None
    reduce: Annotated[str, BeforeValidator(_factor)] | None = None


class FlowPart(VariantPart):
    """A flow file."""

    format: Annotated[int, BeforeValidator(_format)] = FORMAT
    flow: Annotated[str, BeforeValidator(_flow_name)] | None = None
    group: Annotated[str, BeforeValidator(_group)] | None = None
    listed: Annotated[bool, _expect(bool, "must be true or false")] = True
    seed: Annotated[list[int], BeforeValidator(_seeds)] | None = None
    runner: Any = None
    delivery: (
        Annotated[DeliveryPart, _mapping_of("'layout', 'texel_size', 'color_space', 'udim' and 'material'")] | None
    ) = None
    part: Annotated[TakenPart, _mapping_of("'crop' and 'reduce'")] | None = None
    keep: Annotated[str, BeforeValidator(_keep)] | None = None
    params: Annotated[dict[_Name, _Targets], _optional] = {}
    for_: Annotated[dict[_Name, _Variants], _optional] = Field({}, alias="for")
    repeat: Annotated[int, BeforeValidator(_rounds)] | None = None


_FIELDS = (
    "format", "flow", "group", "listed", "seed", "runner", "delivery", "part", "keep", "include", "with", "for",
    "repeat", "sources", "steps", "params", "exports",
)  # fmt: skip
_VARIANT_FIELDS = ("include", "with", "sources", "steps", "exports")
_PARTS: dict[str, tuple[str, ...]] = {
    "steps": tuple(StepPart.model_fields),
    "when": tuple(WhenPart.model_fields),
    "sources": tuple(SetPart.model_fields),
    "exports": tuple(FolderPart.model_fields),
    "for": _VARIANT_FIELDS,
}


def is_optional(source: Any) -> bool:
    """Whether a source, as a file declares it, may be given and need not be."""
    return source == OPTIONAL or (isinstance(source, SetPart) and source.optional is not None)


def parse_flow(document: Any, path: Path) -> FlowPart:
    """The parts of a flow file; `InputError` names the first place whose structure is wrong."""
    if not isinstance(document, dict):
        fields = "a mapping with 'flow', 'sources', 'steps' and 'exports'"
        raise refused(f"{path}: must be {fields}, got {shown(document)}")
    for key in document:
        if key not in _FIELDS:
            raise refused(f"{path}: {key}: unknown{hint(str(key), _FIELDS)}")
    try:
        return FlowPart.model_validate(document)
    except pydantic.ValidationError as error:
        place, problem = _explained(error.errors()[0])
        raise refused(f"{path}: {'.'.join(place)}: {problem}") from None


def _explained(error: Any) -> tuple[list[str], str]:
    """The place and what is wrong there."""
    place = [str(part) for part in error["loc"] if not re.fullmatch(r"<\w+>|\[key\]", str(part))]
    kind, came = error["type"], shown(error["input"])
    if kind == "extra_forbidden":
        parent = place[-2] if len(place) > 1 else ""
        single: dict[str, type[_Part]] = {"include": IncludePart, "delivery": DeliveryPart, "part": TakenPart}
        known = tuple(single[parent].model_fields) if parent in single else _PARTS[place[-3]]
        return place, f"unknown{hint(place[-1], known)}"
    if kind == "key":
        return place[:-1], f"{came} {error['msg']}"
    if kind == "whole":
        return place, error["msg"]
    if kind == "dict_type":
        return place, f"must be a mapping, got {came}"
    if kind == "invalid_key" or place[-1] == came:
        return place[:-1], f"{came} is not a name"
    return place, f"{error['msg'] if kind == 'expected' else 'must be text'}, got {came}"
