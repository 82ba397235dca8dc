"""Types of inputs and outputs: parsing, comparison and description."""

from __future__ import annotations

import dataclasses
import types
import typing
from typing import Annotated, Any

from texloom.pipelines.store import exr
from texloom.stages.vocabulary.arrays import (
    Channels,
    Glsl,
    GodotShader,
    GodotTileset,
    Hlsl,
    Image,
    Layers,
    MaterialX,
    Mesh,
    Osl,
    Page,
    Spreadsheet,
    TiledTileset,
    UnityAsset,
    UnityMeta,
)
from texloom.stages.vocabulary.voted_patches import VotedPatches

TEXTS = {
    "html": Page, "csv": Spreadsheet, "mtlx": MaterialX, "tsx": TiledTileset, "tres": GodotTileset,
    "asset": UnityAsset, "meta": UnityMeta, "glsl": Glsl, "hlsl": Hlsl, "gdshader": GodotShader, "osl": Osl,
}  # fmt: skip
"""kinds of text that are files of their own, by suffix"""

TEXT_NAMES = {
    "html": "a page", "csv": "a spreadsheet", "mtlx": "a MaterialX document",
    "tsx": "a tile set of Tiled", "tres": "a tile set of Godot",
    "asset": "an asset of Unity", "meta": "import settings of Unity",
    **dict.fromkeys(("glsl", "hlsl", "gdshader", "osl"), "a shader"),
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Hint:
    """The type of an input or output, taken apart."""

    plain: Any
    """without annotations and without the alternative None"""
    names: Channels | Layers | None = None
    text: str | None = None
    """``html`` of a `Page`, ``csv`` of a `Spreadsheet`, and so on: the suffix of its file"""
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
    def is_picture(self) -> bool:
        """An array with two sides besides its planes."""
        if self.plain is Image:
            return True
        planes = self.names is not None or len(self.plain.dims) == 3
        return len(self.plain.dims) - planes == 2

    @property
    def is_table(self) -> bool:
        """A dict or list."""
        return (typing.get_origin(self.plain) or self.plain) in (dict, list)

    @property
    def is_labelled(self) -> bool:
        """A dict of lists: all items' values, by label."""
        return typing.get_origin(self.plain) is dict and typing.get_origin(typing.get_args(self.plain)[1]) is list

    @property
    def element(self) -> Any:
        """The type of one item's value in a list, by label or not; None where there is no list."""
        listed = typing.get_args(self.plain)[1] if self.is_labelled else self.plain
        return typing.get_args(listed)[0] if typing.get_origin(listed) is list else None

    @property
    def _fixed_sizes(self) -> list[str]:
        return [axis if axis.isdigit() else "" for axis in self.plain.dim_str.split()]

    def fits(self, wanted: Hint) -> bool:
        """Whether a value of this type can be given where ``wanted`` is expected."""
        if hasattr(self.plain, "dtypes") and hasattr(wanted.plain, "dtypes"):
            same = set(self.plain.dtypes) == set(wanted.plain.dtypes)
            return same and self._fixed_sizes == wanted._fixed_sizes
        return self.plain in (float, int) if wanted.plain is float else bool(self.plain == wanted.plain)

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

    def __str__(self) -> str:
        """The type in a user's words."""
        if self.plain is Image:
            return "an image"
        if self.text:
            return TEXT_NAMES[self.text]
        if self == Hint.of(Mesh):
            return "a mesh"
        if self.plain is VotedPatches:
            return "an EXR of a run"
        if self.is_array:
            return f"{self.plain.dtypes[0]} array ({self.plain.dim_str})"
        if self.is_labelled:
            return f"by label, a list, each {Hint.of(self.element)}"
        if self.element is not None:
            return f"a list, each {Hint.of(self.element)}"
        if typing.get_origin(self.plain) is dict:
            return "a table"
        return getattr(self.plain, "__name__", str(self.plain))


def hints_of(kind: type[Any]) -> dict[str, Hint]:
    """The outputs of a result dataclass and their types."""
    return {name: Hint.of(hint) for name, hint in typing.get_type_hints(kind, include_extras=True).items()}
