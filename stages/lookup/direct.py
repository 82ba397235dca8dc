"""Stages called directly: arrays and keyword arguments in, the stage's result out."""

from __future__ import annotations

import difflib
import functools
import inspect
import typing
from collections.abc import Callable
from typing import Any

import numpy as np
import pydantic

from texloom.stages.lookup.registry import find_stage, shipped_stages, stage_names
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.checkpoints import NoCheckpoints
from texloom.stages.vocabulary.declare import InputError, Params, Stage, first_problem

SEED = 7
"""of the random numbers, unless another is given"""

_MAY_BE_MASKED = ("image", "exemplar")

DirectCall = Callable[..., Any]


def direct_call(name: str) -> DirectCall:
    """The function that calls a stage directly; `AttributeError` where there is no stage of this name.

    Parameters
    ----------
    name : of the stage, without its group.

    Returns
    -------
    a function that takes the stage's inputs, by position or name, and by name

    - each of the stage's params, or all of them as ``params``;
    - ``seed`` or ``rng``, a ``numpy.random.Generator``, where the stage draws random numbers.

    An input that is an `Image` may be an array: integers are sRGB and decoded, floats are linear light, see
    `Image.of`. It raises `InputError` where the stage cannot be computed from what it is given.

    Examples
    --------
    >>> import skimage.data, texloom
    >>> texloom.stages.thumbnail(skimage.data.brick(), side=64).image.shape
    (64, 64, 3)
    """
    known = {full.rpartition(".")[2]: full for full in shipped_stages()}
    if name not in known:
        known = {full.rpartition(".")[2]: full for full in stage_names()} | known
    if name not in known:
        close = difflib.get_close_matches(name, known, n=1)
        hint = f"; did you mean '{close[0]}'?" if close else "; `texloom stages` lists them"
        raise AttributeError(f"texloom.stages: there is no stage '{name}'{hint}")
    return _direct(find_stage(known[name]))


def _direct(stage: Stage) -> DirectCall:
    label = stage.name.rpartition(".")[2]
    has_params = "params" in stage.function.__annotations__
    own = inspect.signature(stage.function).parameters
    fixed = [name for name in own if name not in {*stage.inputs, "params", "rng", "checkpoints"}]

    def call(*args: Any, params: Params | None = None, **named: Any) -> Any:
        if len(args) > len(stage.inputs):
            raise TypeError(f"{label}() takes at most {len(stage.inputs)} inputs by position, got {len(args)}")
        values = dict(zip(stage.inputs, args, strict=False))
        if twice := next((name for name in values if name in named), None):
            raise TypeError(f"{label}() got multiple values for '{twice}'")
        values |= {name: named.pop(name) for name in [*named] if name in {*stage.inputs, *fixed}}
        if missing := [name for name in stage.inputs if name not in stage.optional and values.get(name) is None]:
            raise InputError(f"{label}: needs '{missing[0]}'")
        for name, hint in stage.inputs.items():
            if name in values:
                if isinstance(values[name], np.ma.MaskedArray) and (
                    name not in _MAY_BE_MASKED or hint is not Image
                ):
                    raise InputError(
                        f"{label}: {name}: a masked array, which only an exemplar may be; fill it first"
                    )
                try:
                    values[name] = _converted(values[name], hint)
                except InputError as error:
                    raise InputError(f"{label}: {name}: {error}") from None
        if stage.uses_rng:
            seed, rng = named.pop("seed", SEED), named.pop("rng", None)
            values["rng"] = np.random.default_rng(seed) if rng is None else rng
        if stage.uses_checkpoints:
            values["checkpoints"] = NoCheckpoints()
        chosen = _params(stage, label, params, named)
        if has_params:
            values["params"] = chosen
        try:
            return stage.function(**values)
        except InputError as error:
            raise InputError(f"{label}: {error}") from None

    functools.update_wrapper(call, stage.function, assigned=("__doc__", "__module__", "__name__", "__qualname__"))
    call.__signature__ = _signature(stage, own, fixed)  # type: ignore[attr-defined]
    return call


def _signature(stage: Stage, own: typing.Mapping[str, inspect.Parameter], fixed: list[str]) -> inspect.Signature:
    """What help shows: the inputs, then by name all params and the seed."""
    kind = inspect.Parameter
    # A stage's function may have optional inputs after its params.
    ordered = sorted((own[name] for name in stage.inputs), key=lambda one: one.name in stage.optional)
    fields = {
        name: kind(name, kind.KEYWORD_ONLY, default=info.get_default(call_default_factory=True))
        for name, info in stage.params.model_fields.items()
    }
    extra = [own[name].replace(kind=kind.KEYWORD_ONLY) for name in fixed]
    seed = [kind("seed", kind.KEYWORD_ONLY, default=SEED)] if stage.uses_rng else []
    places = [one.replace(kind=kind.POSITIONAL_OR_KEYWORD) for one in ordered]
    return inspect.Signature([*places, *extra, *fields.values(), *seed], return_annotation=stage.result)


def _params(stage: Stage, label: str, params: Params | None, named: dict[str, Any]) -> Params:
    fields = stage.params.model_fields
    if unknown := next((name for name in named if name not in fields), None):
        close = difflib.get_close_matches(unknown, [*stage.inputs, *fields], n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"it takes {', '.join([*stage.inputs, *fields])}"
        raise InputError(f"{label}: no input or param '{unknown}'; {hint}")
    if params is not None and not isinstance(params, stage.params):
        raise InputError(f"{label}: params: {type(params).__name__} given, {stage.params.__name__} expected")
    values = {
        **({} if params is None else {name: getattr(params, name) for name in params.model_fields_set}),
        **named,
    }
    try:
        return stage.params.model_validate(values)
    except pydantic.ValidationError as error:
        raise InputError(f"{label}: {first_problem(error)}") from None


def _converted(value: Any, hint: Any) -> Any:
    """An argument as a stage takes it."""
    if value is None:
        return None
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        return _converted(value, parts[0])
    if origin is list and isinstance(value, list | tuple):
        return [_converted(one, parts[0]) for one in value]
    if origin is dict and isinstance(value, dict):
        return {name: _converted(one, parts[1]) for name, one in value.items()}
    if origin not in (None, list, dict):  # an optional input
        return _converted(value, next(part for part in parts if part is not type(None)))
    if hint is Image and isinstance(value, np.ndarray):
        return Image.of(value)
    if hint is Image and not isinstance(value, Image):
        raise InputError(f"a {type(value).__name__} given, an array (h, w) or (h, w, 3) or an Image expected")
    dtypes = getattr(hint, "dtypes", None)
    if dtypes and isinstance(value, np.ndarray) and value.dtype.name not in dtypes:
        if not np.can_cast(value.dtype, dtypes[0], "same_kind"):
            raise InputError(f"an array of {value.dtype} given, of {dtypes[0]} expected")
        return value.astype(dtypes[0])
    return value
