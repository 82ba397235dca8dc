"""Types of inputs and outputs: which fits which, and what they are called."""

from __future__ import annotations

import types
import typing
from typing import Annotated, Any

from texloom.pipelines.store.outputs import Hint
from texloom.stages.arrays import Channels, Image, Layers


def plain_type(hint: Any) -> Any:
    """A type without notes and without the alternative of being left out."""
    if typing.get_origin(hint) is Annotated:
        return plain_type(typing.get_args(hint)[0])
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        kept = [part for part in typing.get_args(hint) if part is not types.NoneType]
        return plain_type(kept[0]) if len(kept) == 1 else hint
    return hint


def text_of(hint: Any) -> str | None:
    """``html`` for a page, ``csv`` for a spreadsheet."""
    return Hint.of(hint).text


def is_array(hint: Any) -> bool:
    """Whether values of this type are pictures, fields or other arrays."""
    plain = plain_type(hint)
    return plain is Image or hasattr(plain, "dtypes")


def is_picture(hint: Any) -> bool:
    """Whether an array has two sides besides its planes."""
    plain = plain_type(hint)
    if plain is Image:
        return True
    planes = any(isinstance(part, Channels | Layers) for part in getattr(hint, "__metadata__", ()))
    return len(plain.dims) - (planes or len(plain.dims) == 3) == 2


def _fixed(array: Any) -> list[str]:
    """The sizes of an array's axes where they are fixed."""
    return [axis if axis.isdigit() else "" for axis in array.dim_str.split()]


def fits(given: Any, wanted: Any) -> bool:
    """Whether a value of the one type can be given where the other is wanted."""
    one, other = plain_type(given), plain_type(wanted)
    if hasattr(one, "dtypes") and hasattr(other, "dtypes"):
        return set(one.dtypes) == set(other.dtypes) and _fixed(one) == _fixed(other)
    if other is float:
        return one in (float, int)
    return bool(one == other)


def described(hint: Any) -> str:
    """A type in a user's words."""
    plain = plain_type(hint)
    if plain is Image:
        return "an image"
    if text_of(hint):
        return {"html": "a page", "csv": "a spreadsheet"}[str(text_of(hint))]
    if hasattr(plain, "dtypes"):
        return f"{plain.dtypes[0]} array ({plain.dim_str})"
    if typing.get_origin(plain) is list:
        return f"a list, each {described(typing.get_args(plain)[0])}"
    if typing.get_origin(plain) is dict:
        values = typing.get_args(plain)[1]
        return f"by label, {described(values)}" if typing.get_origin(values) is list else "a table"
    return getattr(plain, "__name__", str(plain))
