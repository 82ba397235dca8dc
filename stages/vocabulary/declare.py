"""What a stage is: a typed pure function that the runner can find, check, call and cache.

A stage module holds a ``Params`` class, a frozen dataclass of results, and one function of the module's own name
under ``@stage``. The decorator reads the signature; nothing is declared twice.

Parameters of a stage function, by name and kind
------------------------------------------------
``params``
    the stage's ``Params``;
``rng``
    a ``numpy.random.Generator`` seeded by the runner from (flow seed, step name); its presence makes the seed part
    of the step's key;
``checkpoints``
    a `texloom.stages.vocabulary.checkpoints.Checkpoints` for work that is worth keeping half done;
``items``
    for a step that gathers: name, seed and sources of every item, in the order of the gathered lists;
``provenance``
    how the inputs came to be: a dict for every step upstream, in order;
anything else
    an input: the result of another step, or a source.
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import inspect
import itertools
import json
import textwrap
import typing
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, ParamSpec, TypeVar

import pydantic

from texloom.stages.vocabulary.libraries import single_threaded

P = ParamSpec("P")
R = TypeVar("R")

_PACKAGE = "texloom.stages"

RESERVED = ("params", "rng", "checkpoints", "items", "provenance")
"""parameters of a stage function that the runner provides"""


class InputError(ValueError):
    """The request cannot be met: a wrong file, size or parameter. One line that a user can act on."""


def first_problem(error: pydantic.ValidationError) -> str:
    """Place and reason of the first error of a model."""
    first = error.errors()[0]
    problem = f"{first['msg']}, got {first['input']!r:.80}"
    if first["type"] in ("value_error", "extra_forbidden"):
        problem = str(first["ctx"]["error"]) if "ctx" in first else "no such entry"
    return ": ".join(filter(None, (".".join(map(str, first["loc"])), problem)))


class Params(pydantic.BaseModel):
    """Parameters of one stage: immutable, unknown names refused, the line under a field is its help."""

    model_config = pydantic.ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=False)


def field_help(kind: type[Any]) -> dict[str, str]:
    """The text under each field of a ``Params`` class or dataclass and of its bases.

    It is read from the source when asked for: pydantic would do so at every import, a tenth of a cached run's time.
    """
    fields = kind.model_fields if issubclass(kind, Params) else {}
    texts = {name: field.description for name, field in fields.items() if field.description}  # of shared types
    for base in reversed(kind.__mro__):
        if not (dataclasses.is_dataclass(base) or issubclass(base, Params)):
            continue
        body = typing.cast(ast.ClassDef, ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]).body
        for field, text in itertools.pairwise(body):
            match field, text:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(value))):
                    texts[name] = inspect.cleandoc(value)
    return texts


class NoParams(Params):
    """For stages without knobs."""


def _odd(value: int) -> int:
    if value % 2 == 0:
        raise ValueError(f"must be odd, got {value}")
    return value


OddSize = Annotated[int, pydantic.Field(ge=1), pydantic.AfterValidator(_odd)]
"""a window's side in pixels that has a middle"""

InputFile = Annotated[Path, "content"]
"""a file named by a parameter; its content, not its name, enters the step's key"""


class Document(Params):
    """The content of a file of plain values; where a parameter is one, it is given as the file's path."""

    file: Path
    """for errors; does not enter the step's key"""
    content: Any
    """mappings, lists, texts and numbers"""
    pictures: dict[str, Path] = {}
    """the pictures that the content names, by these names; what is in them enters the key"""

    @pydantic.model_validator(mode="before")
    @classmethod
    def _of_path(cls, value: Any) -> Any:
        # the runner reads YAML; without it there is JSON, whose pictures stand beside it
        return dict(Document.of(Path(value), _json(Path(value)))) if isinstance(value, str | Path) else value

    @classmethod
    def of(cls, file: Path, content: Any) -> "Document":
        """The document that was read from ``file``."""
        named = {name: file.parent / name for name in _texts(content) if name.lower().endswith(_PICTURES)}
        return cls.model_construct(file=file, content=content, pictures=named)


_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp")


def _json(file: Path) -> Any:
    try:
        return json.loads(file.read_bytes())
    except OSError as error:
        raise ValueError(f"{file}: {error.strerror or 'cannot be read'}") from None
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{file}: is not JSON: {str(error).splitlines()[0]}") from None


def _texts(content: Any) -> list[str]:
    if isinstance(content, str):
        return [content]
    parts = content.values() if isinstance(content, dict) else content if isinstance(content, list) else ()
    return [text for part in parts for text in _texts(part)]


Check = Callable[[Any, Mapping[str, Any]], None]
"""``check(params, known)``: raises `InputError` before anything runs; ``known`` maps input names to what is known
then: outlines of what other steps return, headers of sources and, before the first step runs, their images"""


@dataclasses.dataclass(frozen=True)
class Outline:
    """Size and channels of an image or other array that is not computed yet."""

    height: int
    """rows"""
    width: int
    """columns"""
    channels: tuple[str, ...] = ()
    """one name a plane; none for other arrays"""
    levels: int = 0
    """number of levels, of a stack; else 0"""

    @property
    def shape(self) -> tuple[int, int, int]:
        """As of the array, or of a level of the stack."""
        return self.height, self.width, len(self.channels)


Outlines = Callable[[Any, Mapping[str, Any]], Mapping[str, Outline]]
"""``outlines(params, known)``: output name to outline, as far as params and ``known``, see `Check`, tell it"""


Role = Literal["", "scores", "choice"]
"""what runs show of a stage's ``table``: the scores of a result, or a choice between results; else nothing"""
EXEMPLAR_BYTES = 24  # the exemplar and a copy of it
RESULT_BYTES = 40
SECONDS = (0.2, 0.5)


@dataclasses.dataclass(frozen=True)
class Stage:
    """One stage as the runner sees it."""

    name: str
    """group and module without its room, as in ``analysis.otsu``; of a plug-in its module"""
    module: str
    """the module that holds the stage"""
    version: int
    """raised when the result changes though the code does not, as when a library does"""
    function: Callable[..., Any]
    params: type[Params]
    inputs: Mapping[str, Any]
    """input name to type"""
    optional: frozenset[str]
    """the inputs that may be left out"""
    outputs: Mapping[str, Any]
    """output name to type, with its metadata"""
    result: type[Any]
    """the dataclass of the outputs"""
    uses_rng: bool
    uses_checkpoints: bool
    uses_items: bool
    uses_provenance: bool
    check: Check | None
    outlines: Outlines | None = None
    in_bands: bool = False
    """arrays of the result's size may be larger than the memory, see `texloom.stages.vocabulary.scratch`"""
    exemplar_bytes: int = EXEMPLAR_BYTES
    """memory that it takes at least for a pixel of an exemplar of three channels"""
    result_bytes: int = RESULT_BYTES
    """the same for a pixel of the result"""
    seconds: tuple[float, float] = SECONDS
    """of one processor, for a million pixels of a large exemplar and of the result, roughly"""
    role: Role = ""
    origin: str = ""
    """distribution and version of the plug-in that it comes from"""

    @property
    def summary(self) -> str:
        """The first line of the docstring."""
        return (inspect.getdoc(self.function) or "").partition("\n")[0]


declared: dict[str, Stage] = {}
"""the stages whose modules have been imported, by name"""


def stage(
    version: int,
    check: Check | None = None,
    outlines: Outlines | None = None,
    in_bands: bool = False,
    exemplar_bytes: int = EXEMPLAR_BYTES,
    result_bytes: int = RESULT_BYTES,
    seconds: tuple[float, float] = SECONDS,
    role: Role = "",
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Declare the decorated function a stage; it remains an ordinary function.

    Parameters
    ----------
    version : raise it when results change for a reason that is not in the code.
    check : checks params and sources before anything runs, see `Check`; also all inputs of every call.
    outlines : tells the sizes of results before anything runs, for the checks of the stages that take them.
    in_bands : arrays of the result's size may be larger than the memory, see `texloom.stages.vocabulary.scratch`.
    exemplar_bytes, result_bytes : memory for a pixel of an exemplar of three channels and of the result, at least:
        the growth of the largest from 1024 x 1024 to 2048 x 2048 px. They decide what is refused, not results.
    seconds : of one processor, for a million pixels of a large exemplar and of the result, roughly.
    role : what runs show of its ``table``.
    """

    def register(function: Callable[P, R]) -> Callable[P, R]:
        module = function.__module__
        name = stage_name(module)
        if name.rpartition(".")[2] != function.__name__:
            raise TypeError(f"stage {function.__name__} must stand in a module of its own name, not {name}")
        hints = typing.get_type_hints(function, include_extras=True)
        result = hints.pop("return")
        signature = inspect.signature(function).parameters
        inputs = {key: hint for key, hint in hints.items() if key not in RESERVED}
        function = single_threaded()(function if check is None else _checked(function, check, list(inputs)))
        declared[name] = Stage(
            name=name,
            module=module,
            version=version,
            function=function,
            params=hints.get("params", NoParams),
            inputs=inputs,
            optional=frozenset(key for key in inputs if signature[key].default is not inspect.Parameter.empty),
            outputs=typing.get_type_hints(result, include_extras=True),
            result=result,
            uses_rng="rng" in hints,
            uses_checkpoints="checkpoints" in hints,
            uses_items="items" in hints,
            uses_provenance="provenance" in hints,
            check=check,
            outlines=outlines,
            in_bands=in_bands,
            exemplar_bytes=exemplar_bytes,
            result_bytes=result_bytes,
            seconds=seconds,
            role=role,
        )
        return function

    return register


def stage_name(module: str) -> str:
    """The name of the stage in ``module``: its group and its own name, not its room; of a plug-in its module."""
    own = module.removeprefix(f"{_PACKAGE}.")
    return module if own == module else f"{own.partition('.')[0]}.{own.rpartition('.')[2]}"


def _checked(function: Callable[P, R], check: Check, inputs: list[str]) -> Callable[P, R]:
    """The function with its check of each call's inputs."""
    signature = inspect.signature(function)

    @functools.wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        arguments = signature.bind(*args, **kwargs).arguments
        known = {name: arguments[name] for name in inputs if arguments.get(name) is not None}
        check(arguments.get("params", NoParams()), known)
        return function(*args, **kwargs)

    return checked
