"""Checks of annotations in all calls of stages: those of `jaxtyping.jaxtyped`, in a fraction of its time.

That one makes two checks of every function: of the parameters before a call, and of these and the result after it.
It also binds arguments to signatures, for its messages, and keeps sizes of axes for functions without any. And it
makes the check of a function inside another one anew whenever that one runs, which takes longer than many a call.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import types
import typing
from collections.abc import Callable
from typing import Any

import jaxtyping
from beartype import beartype

_hooked = jaxtyping.jaxtyped
_FUNCTION = "__beartype_func"  # the default by which a check knows its function
_made: dict[int, tuple[Callable[..., Any], bool]] = {}  # by identity of code: equal code may have other annotations


def check_annotations() -> None:
    """Let `checked` be the decorator that ``--jaxtyping-packages`` inserts, ``jaxtyping.jaxtyped``."""
    jaxtyping.jaxtyped = lambda *, typechecker: checked


def checked(subject: Any) -> Any:
    """A function, or a dataclass, that refuses calls whose arguments or result do not match the annotations."""
    if inspect.isclass(subject):
        if dataclasses.is_dataclass(subject) and "__init__" in vars(subject):
            subject.__init__ = checked(subject.__init__)  # type: ignore[misc]
        return subject
    if isinstance(subject, (classmethod, staticmethod)):
        return type(subject)(checked(subject.__func__))
    if isinstance(subject, property):
        return property(*(part and checked(part) for part in (subject.fget, subject.fset, subject.fdel)))
    if inspect.isgeneratorfunction(subject):
        return _hooked(subject, typechecker=beartype)

    check: Callable[..., Any] | None = None
    axes = False

    @functools.wraps(subject)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal check, axes
        if check is None:  # at the first call: many functions have none, and all names are defined by then
            check, axes = _check(subject)
        if not axes:
            return check(*args, **kwargs)
        with _hooked("context"):  # names of axes stand for the same sizes in all parameters and the result
            return check(*args, **kwargs)

    return call


def _check(function: Any) -> tuple[Callable[..., Any], bool]:
    """A function with its checks, and whether these know axes; of a function inside another, a copy."""
    made = _made.get(id(function.__code__))
    if made is None:
        annotated = _annotated(function)
        made = beartype(annotated), any(map(_is_array, annotated.__annotations__.values()))
        _made[id(function.__code__)] = made
        return made
    check, axes = made
    if _FUNCTION not in (check.__kwdefaults__ or {}):  # nothing is annotated
        return function, axes
    copy = types.FunctionType(check.__code__, check.__globals__, check.__name__)
    copy.__kwdefaults__ = {**check.__kwdefaults__, _FUNCTION: function}
    return copy, axes


def _annotated(function: Any) -> types.FunctionType:
    """A copy with annotations that are no strings."""
    copy = types.FunctionType(
        function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
    )
    copy.__kwdefaults__, copy.__module__, copy.__qualname__ = (
        function.__kwdefaults__, function.__module__, function.__qualname__
    )  # fmt: skip
    copy.__annotations__ = {name: _evaluated(hint, function) for name, hint in function.__annotations__.items()}
    return copy


def _evaluated(hint: Any, function: Any) -> Any:
    """`Any` where names are known only to type checkers, as `jaxtyping.jaxtyped` has it."""
    holder = types.SimpleNamespace(__annotations__={"hint": hint})
    try:
        return typing.get_type_hints(holder, function.__globals__, include_extras=True)["hint"]
    except NameError:
        return Any


def _is_array(hint: Any) -> bool:
    if inspect.isclass(hint) and issubclass(hint, jaxtyping.AbstractArray):
        return True
    hint = getattr(hint, "__value__", hint)  # of an alias
    return any(map(_is_array, typing.get_args(hint)))
