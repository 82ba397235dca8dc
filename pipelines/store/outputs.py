"""The outputs of a result by their types: arrays cut into planes, texts, all else as JSON has it."""

from __future__ import annotations

import dataclasses
import json
import types
import typing
from typing import Annotated, Any

import numpy as np

from texloom.pipelines.store import exr
from texloom.pipelines.store.preview import picture
from texloom.stages.arrays import Channels, Image, Layers, Page, Spreadsheet

TEXTS = {"html": Page, "csv": Spreadsheet}
"""kinds of text that are files of their own, by suffix"""


@dataclasses.dataclass(frozen=True)
class Hint:
    """The type of an output, taken apart."""

    plain: Any
    names: Channels | Layers | None = None
    text: str | None = None
    """``html`` of a `Page`, ``csv`` of a `Spreadsheet`: what the name of its file ends in"""
    optional: bool = False

    @classmethod
    def of(cls, hint: Any) -> Hint:
        """Take a type apart."""
        if typing.get_origin(hint) in (types.UnionType, typing.Union):
            kept = [part for part in typing.get_args(hint) if part is not types.NoneType]
            return dataclasses.replace(cls.of(kept[0]), optional=True) if len(kept) == 1 else cls(hint)
        if typing.get_origin(hint) is Annotated:
            plain, *notes = typing.get_args(hint)
            names = next((note for note in notes if isinstance(note, Channels | Layers)), None)
            text = next((suffix for suffix, kind in TEXTS.items() if hint == kind), None)
            return cls(plain, names, text)
        return cls(hint)

    @property
    def is_array(self) -> bool:
        """An `Image` or a jaxtyping array."""
        return self.plain is Image or hasattr(self.plain, "dtypes")

    @property
    def is_table(self) -> bool:
        """A dict or list."""
        return (typing.get_origin(self.plain) or self.plain) in (dict, list)

    def admits(self, dtype: str, shape: tuple[int, ...]) -> bool:
        """Whether this is the type of such arrays."""
        if self.plain is Image:
            return dtype == "float32" and len(shape) == 3
        axes, sizes = self.plain.dim_str.split(), dict[str, int]()
        return (
            dtype in self.plain.dtypes
            and dtype in exr.STORABLE
            and len(axes) == len(shape)
            and all(
                size == (int(axis) if axis.isdigit() else sizes.setdefault(axis, size))
                for axis, size in zip(axes, shape, strict=True)
            )
        )


def hints_of(kind: type[Any]) -> dict[str, Hint]:
    """The outputs of a result dataclass and their types."""
    return {name: Hint.of(hint) for name, hint in typing.get_type_hints(kind, include_extras=True).items()}


@dataclasses.dataclass(frozen=True)
class Layout:
    """How an array is cut into planes."""

    dtype: str
    shape: tuple[int, ...]
    axis: int | None
    """the axis whose entries are planes; without it all is one plane"""
    channels: tuple[str, ...]
    """a name for each entry"""
    is_image: bool

    @classmethod
    def of(cls, dtype: str, shape: tuple[int, ...], hint: Hint, channels: tuple[str, ...] = ()) -> Layout:
        """The layout of such an array; ``channels`` are those of an `Image`. `TypeError` if ``hint`` is another."""
        is_image, axis = hint.plain is Image, None
        if hint.admits(dtype, shape):
            if isinstance(hint.names, Layers):
                axis = 0
            elif isinstance(hint.names, Channels) or len(shape) == 3:
                axis = len(shape) - 1
            if axis is not None and not is_image:
                channels = hint.names.names if hint.names else tuple(map(str, range(shape[axis])))
            names_fit = axis is None or len(set(channels)) == len(channels) == shape[axis]
            if names_fit and all(0 < len(name.encode()) <= exr.LONGEST_NAME // 2 for name in channels):
                return cls(dtype, shape, axis, channels if axis is not None else (), is_image)
        wanted = "an image" if is_image else f"{hint.plain.dtypes[0]} ({hint.plain.dim_str})"
        named = f" with channels {', '.join(channels)}" if channels else ""
        raise TypeError(f"{dtype} of shape {shape}{named} is not {wanted}")

    @property
    def is_empty(self) -> bool:
        """Without elements, which EXR cannot hold."""
        return 0 in self.shape

    @property
    def sides(self) -> tuple[int, ...]:
        """The shape of an entry."""
        return tuple(size for axis, size in enumerate(self.shape) if axis != self.axis)

    def names(self, output: str) -> list[str]:
        """The planes' names in a file."""
        if self.is_image:
            return list(self.channels)
        return [output] if self.axis is None else [f"{output}.{channel}" for channel in self.channels]


@dataclasses.dataclass(frozen=True)
class Array:
    """An array and how it is cut."""

    values: np.ndarray
    layout: Layout

    def planes(self) -> list[np.ndarray]:
        """The entries, each 2-D; a line is a row."""
        rows = self.layout.sides[0] if len(self.layout.sides) > 1 else 1
        entries = self.values[None] if self.layout.axis is None else np.moveaxis(self.values, self.layout.axis, 0)
        return [entry.reshape(rows, -1) for entry in entries]

    def picture(self) -> np.ndarray | None:
        """What it looks like, see `texloom.pipelines.store.preview.picture`."""
        if self.layout.is_empty:
            return None
        return picture(dict(zip(self.layout.channels or ("",), self.planes(), strict=True)))


def filed(value: Any, hint: Hint) -> Any:
    """An output as it is filed: an `Array`, or what JSON gives back. `TypeError` if it is not as its type says."""
    if value is None and hint.optional:
        return None
    if hint.is_array:
        values = np.asarray(value.pixels if isinstance(value, Image) else value)
        values = values.astype(values.dtype.newbyteorder("="), copy=False)
        channels = value.channels if isinstance(value, Image) else ()
        return Array(values, Layout.of(values.dtype.name, values.shape, hint, tuple(channels)))
    if hint.is_table:
        return json.loads(json.dumps(value, default=_number))
    kept = _number(value) if isinstance(value, np.generic) else value
    if hint.plain is float and type(kept) is int:
        kept = float(kept)
    if hint.plain not in (float, int, bool, str) or type(kept) is not hint.plain:
        raise TypeError(f"{kept!r} is not {getattr(hint.plain, '__name__', hint.plain)}")
    if hint.text:
        _encoded(kept)
    return kept


def _number(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a {type(value).__name__} cannot stand in a table")


def _encoded(page: str) -> bytes:
    try:
        return page.encode()
    except UnicodeEncodeError as error:
        raise TypeError(f"a text cannot be written in UTF-8: {error.reason}") from None


def outputs_of(result: Any) -> dict[str, Any]:
    """All outputs of a result as they are `filed`; `TypeError` names the one that is not as its type says."""
    outputs = {}
    for name, hint in hints_of(type(result)).items():
        try:
            outputs[name] = filed(getattr(result, name), hint)
        except TypeError as error:
            raise TypeError(f"{type(result).__name__}.{name}: {error}") from None
    return outputs
