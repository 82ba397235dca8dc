"""Stage results to files and back: arrays in EXR, tables in JSON, pictures in PNG.

A result's folder holds

``result.exr``
    all arrays, one part an output, named as the output, one plane a channel. The channels of an `Image` keep their
    names (``R G B A``, ``Y``, ...); those of other arrays begin with the output's name: ``strength``, ``match.row``,
    ``match.column``. The first part's header explains the file in JSON: ``texloom.provenance``, ``texloom.scalars``
    (the outputs that are numbers or words) and ``texloom.arrays`` (dtype, shape and channels of every array).
    A result without arrays that have elements is a single black pixel, in a part called ``texloom``.
``tables.json``
    the outputs that are dicts or lists, where there are any.
``<output>.png``
    a preview of every array that can be looked at.

EXR holds float16, float32 and uint32. Other types are stored without loss: bool as float16, small integers as uint32
(signed ones by their bits), 64-bit types as two uint32 planes, ``.low`` and ``.high``. An array without elements
stands in ``texloom.arrays`` alone.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import os
import re
import secrets
import types
import typing
import zlib
from collections.abc import Collection, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from stages.arrays import Channels, Image, Layers
from stages.color import linear_from_lab, srgb_from_linear
from stages.declare import InputError
from stages.kernels.threads import thread_count

ARRAYS = "result.exr"
TABLES = "tables.json"

_EMPTY = "texloom"  # the part of a file without arrays; its dotted attributes cannot clash with outputs
_AS_IS = ("float16", "float32", "uint32")
_SMALL = ("bool", "int8", "int16", "int32", "uint8", "uint16")
_SPLIT = ("float64", "int64", "uint64")
_LEAST_SIDE = 4  # px of a preview
_MOST_PLANES = 4  # side by side in a picture
_LARGEST = 2**28  # px of a file that `pictures` opens
_LONGEST = 255  # bytes of a channel's name
_COLOR = {"R", "G", "B"}


class ArtifactError(Exception):
    """A file is missing, broken, or not what the stage's result says. One line."""


@dataclasses.dataclass(frozen=True)
class _Hint:
    """A result's type, taken apart."""

    plain: Any
    names: Channels | Layers | None = None
    optional: bool = False

    @classmethod
    def of(cls, hint: Any) -> _Hint:
        if typing.get_origin(hint) in (types.UnionType, typing.Union):
            kept = [part for part in typing.get_args(hint) if part is not types.NoneType]
            if len(kept) == 1:
                return dataclasses.replace(cls.of(kept[0]), optional=True)
        if typing.get_origin(hint) is Annotated:
            plain, *notes = typing.get_args(hint)
            names = next((note for note in notes if isinstance(note, Channels | Layers)), None)
            return cls(plain, names)
        return cls(hint)

    @property
    def array(self) -> bool:
        return self.plain is Image or hasattr(self.plain, "dtypes")

    @property
    def table(self) -> bool:
        return self.plain in (dict, list) or typing.get_origin(self.plain) in (dict, list)


@dataclasses.dataclass(frozen=True)
class _Layout:
    """How an array is cut into planes."""

    dtype: str
    shape: tuple[int, ...]
    axis: int | None
    """the axis whose entries are planes; without it all is one plane"""
    channels: tuple[str, ...]
    """a name for each plane; none where there is one plane only"""
    image: bool = False

    def names(self, output: str) -> list[str]:
        """The planes' channels in a file."""
        if self.image:
            return list(self.channels)
        return [output] if self.axis is None else [f"{output}.{channel}" for channel in self.channels]

    @property
    def size(self) -> int:
        return int(np.prod(self.shape))


def _layout(dtype: str, shape: tuple[int, ...], hint: _Hint, channels: tuple[str, ...] = ()) -> _Layout:
    """The layout of an array, which must be what the hint says; `TypeError` if not."""
    if hint.plain is Image:
        fits, axis = dtype == "float32" and len(shape) == 3, 2
    else:
        axes, sizes = hint.plain.dim_str.split(), dict[str, int]()
        fits = dtype in hint.plain.dtypes and len(axes) == len(shape)
        fits = fits and all(
            size == (int(axis) if axis.isdigit() else sizes.setdefault(axis, size))
            for axis, size in zip(axes, shape, strict=True)
        )
        if isinstance(hint.names, Layers):
            axis = 0
        elif hint.names is not None or len(shape) == 3:
            axis = len(shape) - 1
        else:
            return _checked(fits, _Layout(dtype, shape, None, ()), hint)
        channels = (
            hint.names.names if hint.names else tuple(str(index) for index in range(shape[axis] if fits else 0))
        )
    fits = fits and len(set(channels)) == len(channels) == shape[axis]
    return _checked(fits, _Layout(dtype, shape, axis, tuple(channels), hint.plain is Image), hint)


def _checked(fits: bool, layout: _Layout, hint: _Hint) -> _Layout:
    if not fits:
        wanted = "Image" if hint.plain is Image else f"{'|'.join(hint.plain.dtypes)} ({hint.plain.dim_str})"
        raise TypeError(f"{layout.dtype} {layout.shape} with channels {list(layout.channels)} is not {wanted}")
    if layout.dtype not in (*_AS_IS, *_SMALL, *_SPLIT):
        raise TypeError(f"arrays of {layout.dtype} cannot be stored")
    if any(not 0 < len(channel.encode()) <= _LONGEST - 64 for channel in layout.channels):
        raise TypeError(f"channels {list(layout.channels)}: a name is empty or too long")
    return layout


def _array(value: Any, hint: _Hint) -> tuple[np.ndarray, _Layout]:
    array = np.asarray(value.pixels if isinstance(value, Image) else value)
    array = array.astype(array.dtype.newbyteorder("="), copy=False)
    channels = value.channels if isinstance(value, Image) else ()
    return array, _layout(array.dtype.name, array.shape, hint, channels)


def _planes(array: np.ndarray, layout: _Layout) -> list[np.ndarray]:
    """Contiguous 2-D planes."""
    parts = array[None] if layout.axis is None else np.moveaxis(array, layout.axis, 0)
    return [np.ascontiguousarray(part.reshape(part.shape[0] if part.ndim > 1 else 1, -1)) for part in parts]


def _scalar(value: Any, hint: _Hint) -> Any:
    if hint.plain not in (float, int, bool, str):
        raise TypeError(f"values of type {hint.plain} cannot be stored")
    return hint.plain(value)


def _table(value: Any) -> Any:
    """What JSON makes of a table: tuples are lists, keys are words."""
    return json.loads(json.dumps(value, default=_number))


def _number(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a {type(value).__name__} in a table cannot be stored")


# -- digests


def digests(result: Any) -> dict[str, str]:
    """SHA-256 of every output's content: dtype, shape, channels and values, however they are filed.

    Parameters
    ----------
    result : a dataclass of a stage's outputs. An output that is not what its type says is a `TypeError`.
    """
    return {name: _digest(getattr(result, name), hint) for name, hint in _hints(type(result)).items()}


def _digest(value: Any, hint: _Hint) -> str:
    content = hashlib.sha256()
    if value is None and hint.optional:
        content.update(b"none")
    elif hint.array:
        array, layout = _array(value, hint)
        head = [layout.dtype, layout.shape, layout.channels]
        content.update(json.dumps(head).encode() + b"\0")
        content.update(np.ascontiguousarray(array).data)
    else:
        value = _table(value) if hint.table else _scalar(value, hint)
        content.update(f"{hint.plain}\0{json.dumps(value, sort_keys=True)}".encode())
    return content.hexdigest()


@cache
def _hints(kind: type[Any]) -> dict[str, _Hint]:
    return {name: _Hint.of(hint) for name, hint in typing.get_type_hints(kind, include_extras=True).items()}


# -- folders


def write(result: Any, folder: Path, provenance: Mapping[str, Any]) -> list[str]:
    """Write a stage's result into an empty folder.

    Parameters
    ----------
    result : a dataclass of outputs. One that is not what its type says is a `TypeError`.
    provenance : how the result came to be, ready for JSON.

    Returns
    -------
    the names of the files, all on the disk when this returns.
    """
    arrays: dict[str, tuple[np.ndarray, _Layout]] = {}
    scalars, tables, previews = {}, {}, {}
    for name, hint in _hints(type(result)).items():
        value = getattr(result, name)
        if value is None and hint.optional:
            scalars[name] = None
        elif hint.array:
            arrays[name] = _array(value, hint)
            previews[f"{name}.png"] = _preview(*arrays[name])
        elif hint.table:
            tables[name] = _table(value)
        else:
            scalars[name] = _scalar(value, hint)
    files = {ARRAYS: _exr(arrays, scalars, provenance, "ZSTD")}
    if tables:
        files[TABLES] = json.dumps(tables, indent=1).encode()
    files |= {name: _png(picture) for name, picture in previews.items() if picture is not None}
    for name, content in files.items():
        _save(folder / name, content)
    return list(files)


def read(kind: type[Any], folder: Path, names: Collection[str] | None = None) -> dict[str, Any]:
    """Read outputs that `write` has written; whoever calls has verified the files' digests.

    Parameters
    ----------
    kind : the dataclass of the outputs.
    names : the outputs that are wanted, all if not given.

    Returns
    -------
    values by output. Arrays, dtypes, shapes and channels are exactly those that were written; what is not as ``kind``
    says is an `ArtifactError`.
    """
    hints = {name: hint for name, hint in _hints(kind).items() if names is None or name in names}
    path = folder / ARRAYS
    try:
        header, parts = _open(path, pixels=any(hint.array for hint in hints.values()))
        records, scalars = json.loads(header["texloom.arrays"]), json.loads(header["texloom.scalars"])
        tables = {}
        if any(hint.table and name not in scalars for name, hint in hints.items()):
            path = folder / TABLES
            tables = json.loads(path.read_bytes())
        values: dict[str, Any] = {}
        for name, hint in hints.items():
            if hint.optional and name in scalars and scalars[name] is None:
                values[name] = None
            elif hint.array:
                values[name] = _restored(name, hint, records[name], parts.get(name, {}))
            elif hint.table:
                values[name] = tables[name]
            else:
                values[name] = _scalar(scalars[name], hint)
    except (OSError, RuntimeError, ValueError, TypeError, KeyError, AttributeError) as error:
        what = f"{error.args[0]} is missing" if isinstance(error, KeyError) else str(error).partition("\n")[0]
        raise ArtifactError(f"{path}: {what}") from error
    return values


def _restored(output: str, hint: _Hint, record: Mapping[str, Any], found: Mapping[str, np.ndarray]) -> Any:
    """An array from the planes of its part."""
    layout = _layout(record["dtype"], tuple(record["shape"]), hint, tuple(record["channels"]))
    dtype = np.dtype(layout.dtype)
    if layout.size == 0:
        array = np.zeros(layout.shape, dtype)
    else:
        planes = [_decoded(found, name, dtype) for name in layout.names(output)]
        if len(found) != len(planes) * (2 if layout.dtype in _SPLIT else 1):
            raise ValueError(f"part {output} has channels {sorted(found)}")
        if layout.axis is None:
            array = planes[0].reshape(layout.shape)
        else:
            rest = layout.shape[: layout.axis] + layout.shape[layout.axis + 1 :]
            array = np.stack([plane.reshape(rest) for plane in planes], axis=layout.axis)
    return Image(array, layout.channels) if layout.image else array


# -- pictures


def export(value: Any, hint: Any, path: Path, provenance: Mapping[str, Any]) -> None:
    """Write one output to a file of its own, whole or not at all.

    Parameters
    ----------
    value, hint : an output and its type.
    path : ``.exr``: all channels as float32, or as described above, in ZIP compression, which every tool reads and
        which finds damage. Channels of an array that is no `Image` begin with the provenance's ``output`` if it has
        one, else with the file's name. ``.png``: 8 bits; an `Image` in sRGB, light above 1 clipped, channels beyond
        colour and alpha left out; other arrays stretched from their least to their highest value. ``.json``:
        tables and numbers.
    provenance : how the value came to be, ready for JSON; kept in EXR and PNG.
    """
    taken = _Hint.of(hint)
    if path.suffix == ".json":
        plain = _table(value)
        try:
            content = (json.dumps(plain, indent=2, allow_nan=False) + "\n").encode()
        except ValueError:
            raise ArtifactError(f"{path}: a value is not a finite number, which JSON cannot hold") from None
    elif path.suffix == ".exr":
        name = str(provenance.get("output", path.stem))
        content = _exr({name: _array(value, taken)}, {}, provenance, "ZIP")
    elif path.suffix == ".png":
        array, layout = _array(value, taken)
        picture = _picture(_by_channel(array, layout)) if layout.size else None
        if picture is None:
            raise ArtifactError(f"{path}: {layout.dtype} {layout.shape} cannot be shown as a picture")
        content = _png(picture, provenance)
    else:
        raise ArtifactError(f"{path}: not a name that ends in .exr, .png or .json")
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(6)}")
    try:
        _save(temporary, content)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _by_channel(array: np.ndarray, layout: _Layout) -> dict[str, np.ndarray]:
    return dict(zip(layout.channels or ("",), _planes(array, layout), strict=True))


def _preview(array: np.ndarray, layout: _Layout) -> np.ndarray | None:
    """A picture of an array, if there is something to see."""
    sides = [size for axis, size in enumerate(layout.shape) if axis != layout.axis]
    return _picture(_by_channel(array, layout)) if len(sides) == 2 and min(sides) >= _LEAST_SIDE else None


def _picture(planes: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """8 bits of grey, grey and alpha, RGB or RGBA, whatever the channels' names suggest; none for too many."""
    colors = next((names for names in ("RGB", "Y") if set(names) <= set(planes)), "")
    if colors:
        light = np.stack([_finite(planes[name]) for name in colors], axis=-1)
        levels = srgb_from_linear(light)
        if "A" in planes:
            levels = np.concatenate([levels, np.clip(_finite(planes["A"]), 0, 1)[..., None]], axis=-1)
    elif set(planes) == {"L", "a", "b"}:
        lab = np.stack([_finite(planes[name]) for name in "Lab"], axis=-1)
        levels = srgb_from_linear(linear_from_lab(lab))
    elif set(planes) == {"row", "column"}:
        row, column = (_finite(planes[name]) / max(1, planes[name].max()) for name in ("row", "column"))
        levels = np.stack([row, column, np.zeros_like(row)], axis=-1)
    elif len(planes) <= _MOST_PLANES:
        levels = np.concatenate([_stretched(plane) for plane in planes.values()], axis=1)
    else:
        return None
    picture = np.rint(levels * levels.dtype.type(255)).astype(np.uint8)
    return picture[..., 0] if picture.shape[2:] == (1,) else picture


def _finite(plane: np.ndarray) -> np.ndarray:
    return np.nan_to_num(plane.astype(np.float32, copy=False), nan=0, posinf=1, neginf=0)


def _stretched(plane: np.ndarray) -> np.ndarray:
    """Values from 0 for the least to 1 for the highest; what is constant stays as it is, clipped."""
    values = plane.astype(np.float64)
    finite = values[np.isfinite(values)]
    low, high = (finite.min(), finite.max()) if finite.size else (0.0, 0.0)
    if high > low:
        values = values / 2 - low / 2  # halves, since the range of 64-bit numbers is wider than they are
        values /= high / 2 - low / 2
    return np.clip(np.nan_to_num(values, nan=0, posinf=1, neginf=0), 0, 1)


def _png(picture: np.ndarray, provenance: Mapping[str, Any] | None = None) -> bytes:
    import PIL.Image
    import PIL.PngImagePlugin

    notes = PIL.PngImagePlugin.PngInfo()
    if provenance:
        notes.add_itxt("texloom.provenance", json.dumps(provenance))
    buffer = io.BytesIO()
    # Textures hardly shrink by more effort.
    PIL.Image.fromarray(picture).save(buffer, "PNG", compress_level=1, compress_type=zlib.Z_RLE, pnginfo=notes)
    return buffer.getvalue()


# -- OpenEXR


@cache
def _openexr() -> Any:
    import OpenEXR

    OpenEXR.set_global_thread_count(thread_count())
    return OpenEXR


def _exr(
    arrays: Mapping[str, tuple[np.ndarray, _Layout]],
    scalars: Mapping[str, Any],
    provenance: Mapping[str, Any],
    compression: str,
) -> bytes:
    openexr = _openexr()
    records = {
        name: {"dtype": layout.dtype, "shape": layout.shape, "channels": layout.channels}
        for name, (_, layout) in arrays.items()
    }
    channels = {
        name: dict(_encoded(array, layout, name)) for name, (array, layout) in arrays.items() if layout.size
    } or {_EMPTY: {"Y": np.zeros((1, 1), np.float16)}}
    first = next(iter(next(iter(channels.values())).values()))
    header: dict[str, Any] = {
        "texloom.provenance": json.dumps(provenance),
        "texloom.scalars": json.dumps(scalars),
        "texloom.arrays": json.dumps(records),
    }
    parts = []
    for name, planes in channels.items():
        header |= {
            "type": openexr.scanlineimage,
            "compression": getattr(openexr, f"{compression}_COMPRESSION"),
            "displayWindow": _window(first),  # the same for all parts, as the format demands
            "dataWindow": _window(next(iter(planes.values()))),
        }
        parts.append(openexr.Part(header, planes, name))
        header = {}
    buffer = io.BytesIO()
    openexr.File(parts).write(buffer)
    return buffer.getvalue()


def _window(plane: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros(2, np.int32), np.array([plane.shape[1] - 1, plane.shape[0] - 1], np.int32)


def _encoded(array: np.ndarray, layout: _Layout, output: str) -> Iterator[tuple[str, np.ndarray]]:
    for name, plane in zip(layout.names(output), _planes(array, layout), strict=True):
        if layout.dtype in _AS_IS:
            yield name, plane
        elif layout.dtype in _SPLIT:
            bits = plane.view(np.uint64)
            yield f"{name}.low", (bits & 0xFFFFFFFF).astype(np.uint32)
            yield f"{name}.high", (bits >> 32).astype(np.uint32)
        elif layout.dtype == "bool":
            yield name, plane.astype(np.float16)
        elif layout.dtype.startswith("u"):
            yield name, plane.astype(np.uint32)
        else:
            yield name, plane.astype(np.int32).view(np.uint32)


def _decoded(found: Mapping[str, np.ndarray], name: str, dtype: np.dtype) -> np.ndarray:
    """A plane as it was before `_encoded`."""
    if dtype.name in _SPLIT:
        low, high = (_of_type(found, f"{name}.{half}", "uint32").astype(np.uint64) for half in ("low", "high"))
        return (low | high << 32).view(dtype)
    if dtype.name in _AS_IS:
        return _of_type(found, name, dtype.name)
    if dtype.name == "bool":
        return _of_type(found, name, "float16") != 0
    stored = _of_type(found, name, "uint32")
    return (stored if dtype.kind == "u" else stored.view(np.int32)).astype(dtype)


def _of_type(found: Mapping[str, np.ndarray], name: str, dtype: str) -> np.ndarray:
    plane = found[name]
    if plane.dtype != dtype:
        raise ValueError(f"channel {name} is {plane.dtype}, not {dtype}")
    return plane


def _open(path: Path, pixels: bool = True) -> tuple[dict[str, Any], dict[str, dict[str, np.ndarray]]]:
    """The first part's header, and the planes by part and channel; anything wrong is an error of any kind."""
    openexr = _openexr()
    head = openexr.File(str(path), header_only=True).parts
    parts: dict[str, dict[str, np.ndarray]] = {}
    if pixels:
        found = openexr.File(str(path), separate_channels=True).parts
        parts = {
            part.name() or "image": {name: channel.pixels for name, channel in part.channels.items()}
            for part in found
        }
        if len(parts) < len(head):  # OpenEXR leaves out parts that it cannot read, without an error
            raise ValueError("cut short or damaged")
    return head[0].header, parts


def describe(path: Path) -> dict[str, Any]:
    """What an EXR file holds, ready for JSON; `InputError` where it cannot be read.

    Returns
    -------
    ``compression``; ``layers``, each with ``part``, ``name``, ``height``, ``width`` in px and ``channels``, a dtype by
    name; ``provenance`` and ``scalars`` where texloom wrote the file.
    """
    header, layers = _layers(path)
    known = {
        name: json.loads(header[f"texloom.{name}"])
        for name in ("provenance", "scalars")
        if f"texloom.{name}" in header
    }
    return {
        "compression": header["compression"].name.removesuffix("_COMPRESSION"),
        "layers": [
            {
                "part": part,
                "name": name,
                "height": next(iter(planes.values())).shape[0],
                "width": next(iter(planes.values())).shape[1],
                "channels": {channel: plane.dtype.name for channel, plane in planes.items()},
            }
            for (part, name), planes in layers.items()
        ],
        **known,
    }


def pictures(path: Path, folder: Path) -> list[Path]:
    """Write a PNG of every layer of an EXR file into a folder, which is made; `InputError` where it cannot be read."""
    _, layers = _layers(path)
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for (part, name), planes in layers.items():
        picture = _picture({channel.rpartition(".")[2]: plane for channel, plane in planes.items()})
        label = name if name == part or len({part for part, _ in layers}) == 1 else f"{part}.{name}"
        target = folder / (re.sub(r"[^A-Za-z0-9._-]", "_", label) + ".png")
        if picture is not None:
            _save(target, _png(picture))
            written.append(target)
    return written


def _layers(path: Path) -> tuple[dict[str, Any], dict[tuple[str, str], dict[str, np.ndarray]]]:
    """Channels that belong together: by part, and by what stands before the last dot of their names."""
    try:
        for part in _openexr().File(str(path), header_only=True).parts:
            if part.width() * part.height() > _LARGEST:
                raise InputError(f"{path}: {part.height()}x{part.width()} px is more than {_LARGEST} px")
        header, parts = _open(path)
    except (OSError, RuntimeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: not a readable EXR file") from None
    layers: dict[tuple[str, str], dict[str, np.ndarray]] = {}
    for part_name, planes in parts.items():
        for channel, plane in planes.items():
            prefix, _, last = channel.rpartition(".")
            name = prefix or (part_name if last in {*"RGBAY"} else last)
            layers.setdefault((part_name, name), {})[channel] = plane
    return header, layers


def _save(path: Path, content: bytes) -> None:
    with path.open("xb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
