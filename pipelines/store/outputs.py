"""Outputs of a result prepared for storage: arrays as planes, texts, everything else as JSON values."""

from __future__ import annotations

import copy
import dataclasses
import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from texloom.pipelines.store import exr
from texloom.pipelines.store.clipping import Clipped
from texloom.pipelines.store.png_file import LARGE, with_facts
from texloom.pipelines.store.preview import color_strips, colors_of, picture
from texloom.pipelines.store.types import Hint, hints_of
from texloom.stages.vocabulary.arrays import Channels, Image, Layers
from texloom.stages.vocabulary.facts import UNKNOWN, Facts
from texloom.stages.vocabulary.scratch import bands, release

_ROWS = 64  # of a smaller picture that are copied at a time


@dataclasses.dataclass(frozen=True)
class PlaneLayout:
    """How an array is divided into planes."""

    dtype: str
    shape: tuple[int, ...]
    axis: int | None
    """the axis whose entries are planes; None where the array is one plane"""
    channels: tuple[str, ...]
    """one name an entry"""
    is_image: bool

    @classmethod
    def of(cls, dtype: str, shape: tuple[int, ...], hint: Hint, channels: tuple[str, ...] = ()) -> PlaneLayout:
        """The layout of an array; ``channels`` are those of an `Image`. `TypeError` if ``hint`` does not match."""
        is_image, axis = hint.plain is Image, None
        if hint.admits(dtype, shape):
            if isinstance(hint.names, Layers):
                axis = 0
            elif isinstance(hint.names, Channels) or len(shape) == 3:
                axis = len(shape) - 1
            if axis is not None and not is_image:
                channels = hint.names.names if hint.names else tuple(map(str, range(shape[axis])))
            names_fit = axis is None or len(set(channels)) == len(channels) == shape[axis]
            if names_fit and all(0 < len(name.encode()) <= exr.MAX_NAME // 2 for name in channels):
                return cls(dtype, shape, axis, channels if axis is not None else (), is_image)
        wanted = "an image" if is_image else f"{hint.plain.dtypes[0]} ({hint.plain.dim_str})"
        named = f" with channels {', '.join(channels)}" if channels else ""
        raise TypeError(f"{dtype} of shape {shape}{named} is not {wanted}")

    @property
    def is_empty(self) -> bool:
        """Whether the array has no elements, which EXR cannot store."""
        return 0 in self.shape

    @property
    def sides(self) -> tuple[int, ...]:
        """The shape of an entry."""
        return tuple(size for axis, size in enumerate(self.shape) if axis != self.axis)

    def names(self, output: str) -> list[str]:
        """Channel names in a file."""
        if self.is_image:
            return list(self.channels)
        return [output] if self.axis is None else [f"{output}.{channel}" for channel in self.channels]


@dataclasses.dataclass(frozen=True)
class Array:
    """An array and its layout."""

    values: np.ndarray
    layout: PlaneLayout
    facts: Facts = UNKNOWN
    """of an `Image`"""

    def planes(self) -> list[np.ndarray]:
        """The planes, each 2-D; a 1-D entry becomes a row."""
        rows = self.layout.sides[0] if len(self.layout.sides) > 1 else 1
        entries = self.values[None] if self.layout.axis is None else np.moveaxis(self.values, self.layout.axis, 0)
        return [entry.reshape(rows, -1) for entry in entries]

    def explained(self, provenance: Mapping[str, Any]) -> Mapping[str, Any] | None:
        """Provenance for a PNG, with the facts."""
        if not self.layout.is_image:
            return provenance
        height, width = self.layout.sides
        return with_facts(provenance, self.facts, height, width)

    @property
    def is_large_color(self) -> bool:
        """Whether its picture is of colours, and larger than what is best made at once."""
        return math.prod(self.layout.sides) > LARGE and bool(colors_of(self.layout.channels))

    def color_strips(self) -> Iterator[np.ndarray]:
        """The 8-bit picture of colours, see `texloom.pipelines.store.preview.color_strips`."""
        planes = dict(zip(self.layout.channels, self.planes(), strict=True))
        return color_strips(planes, colors_of(planes))

    @property
    def clipped(self) -> Clipped:
        """The values of an image's colour that 8 bits cannot hold, as they are outside of 0..1."""
        colors = colors_of(self.layout.channels) if self.layout.is_image else ""
        lost = Clipped(8)
        for name in colors:
            plane = self.values[..., self.layout.channels.index(name)]
            for band in bands(len(plane), self.values):
                lost.add(plane[band], encoded=True)
        return lost

    def _every(self, step: int, plane: np.ndarray) -> np.ndarray:
        rows = []
        for top in range(0, len(plane), step * _ROWS):
            rows.append(plane[top : top + step * _ROWS : step, ::step].copy())
            release(self.values)
        return np.concatenate(rows)

    def picture(self, step: int = 1) -> np.ndarray | None:
        """An 8-bit picture of every ``step``-th pixel, see `texloom.pipelines.store.preview.picture`."""
        if self.layout.is_empty:
            return None
        planes = self.planes() if step == 1 else [self._every(step, plane) for plane in self.planes()]
        return picture(dict(zip(self.layout.channels or ("",), planes, strict=True)))


def prepared(value: Any, hint: Hint) -> Any:
    """An output for storage: an `Array` or a JSON value; `TypeError` if it does not have its type."""
    if value is None and hint.optional:
        return None
    if hint.is_array:
        values = np.asarray(value.pixels if isinstance(value, Image) else value)
        values = values.astype(values.dtype.newbyteorder("="), copy=False)
        channels, facts = (value.channels, value.facts) if isinstance(value, Image) else ((), Facts())
        return Array(values, PlaneLayout.of(values.dtype.name, values.shape, hint, tuple(channels)), facts)
    if hint.is_table:
        return json.loads(json.dumps(value, default=_number))
    kept = _number(value) if isinstance(value, np.generic) else value
    if hint.plain is float and type(kept) is int:
        kept = float(kept)
    if hint.plain not in (float, int, bool, str) or type(kept) is not hint.plain:
        raise TypeError(f"{kept!r} is not {getattr(hint.plain, '__name__', hint.plain)}")
    if hint.text:
        try:
            kept.encode()
        except UnicodeEncodeError as error:
            raise TypeError(f"a text cannot be written in UTF-8: {error.reason}") from None
    return kept


def _number(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a {type(value).__name__} cannot be an entry of a table")


class Outputs(dict[str, Any]):
    """All `prepared` outputs of a result, by name."""

    def __init__(self, kind: type[Any]):
        """``kind``: the dataclass of the result."""
        super().__init__()
        self.kind = kind

    def as_read(self, name: str) -> Any:
        """A copy of an output, equal in type, dtype and memory layout to what is read back from its file."""
        output = self[name]
        if isinstance(output, Array) and output.layout.is_image:
            output = Image(output.values, output.layout.channels, output.facts)
        return copied(output.values if isinstance(output, Array) else output)


def copied(value: Any) -> Any:
    """A copy of an output that shares nothing with it; arrays are in C order."""
    if isinstance(value, Image):
        return value.with_pixels(np.array(value.pixels, order="C"))
    return np.array(value, order="C") if isinstance(value, np.ndarray) else copy.deepcopy(value)


def outputs_of(result: Any) -> Outputs:
    """The prepared outputs of a result, or of its `Outputs`; `TypeError` names one that does not have its type."""
    if isinstance(result, Outputs):
        return result
    outputs = Outputs(type(result))
    for name, hint in hints_of(type(result)).items():
        try:
            outputs[name] = prepared(getattr(result, name), hint)
        except TypeError as error:
            raise TypeError(f"{type(result).__name__}.{name}: {error}") from None
    return outputs
