"""Reading and writing of stage results: arrays in EXR, tables in JSON, pages in HTML, pictures in PNG.

A result's folder holds

``result.exr``
    all arrays, one part an output, named as the output, one plane a channel. The channels of an `Image` keep their
    names (``R G B A``, ``Y``, ...); those of other arrays begin with the output's name: ``strength``,
    ``match.row``, ``match.column``. The first part's header explains the file in JSON: ``texloom.provenance``,
    ``texloom.scalars`` (the outputs that are numbers or words, and those that were left out) and
    ``texloom.arrays`` (dtype, shape and channels of every array, and the facts of an `Image`; an array without
    elements is only there).
    Where no array has elements, a part ``texloom`` of one black pixel carries the header.
``tables.json``
    the outputs that are dicts or lists, where there are any.
``<output>.html``, ``<output>.csv``
    every `Page` and `Spreadsheet`.
``<output>.png``
    a preview of every array with two sides of at least 4 px, unless it has more than four planes; of one with more
    than 2048 x 2048 px every second, third ... row and column.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import os
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.store import exr
from texloom.pipelines.store.atomic import atomic_path, file_digest, write_atomically
from texloom.pipelines.store.capture import capture_output
from texloom.pipelines.store.outputs import Array, PlaneLayout, outputs_of, prepared
from texloom.pipelines.store.page import with_run
from texloom.pipelines.store.png_file import length_of, png, write_png
from texloom.pipelines.store.preview import picture
from texloom.pipelines.store.types import Hint, hints_of
from texloom.stages.kernels.core.threads import run_all
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import Facts
from texloom.stages.vocabulary.scratch import empty, release

__all__ = [
    "ArtifactError", "check_pictures", "describe", "digests", "export", "facts_in", "pictures", "read", "sizes",
    "texel_size_in", "window", "write",
]  # fmt: skip

ARRAYS = "result.exr"
TABLES = "tables.json"

_NO_ARRAYS = "texloom"
_CHUNK = 2**24  # bytes of an array that are hashed at a time
_MIN_SIDE = 4  # px of a preview
_MOST_OF_PREVIEW = 2**22  # px of one: to look at; more of a large exemplar takes longer than many steps
_MAX_PIXELS = 2**28  # of a file from elsewhere
_MAX_LABEL = 100  # characters of a layer's name in a file's


class ArtifactError(Exception):
    """A file is missing, broken, or not of the result's type. One line."""


# -- results


def digests(result: Any) -> dict[str, str]:
    """SHA-256 of every output's content: dtype, shape, channels, facts and values.

    Parameters
    ----------
    result : a dataclass of outputs, or its `Outputs`; `TypeError` if one does not have its type.
    """
    return {name: _digest(output) for name, output in outputs_of(result).items()}


def _digest(output: Any) -> str:
    if not isinstance(output, Array):
        return hashlib.sha256(json.dumps(output, sort_keys=True).encode()).hexdigest()
    layout = output.layout
    facts = [output.facts.record()] if output.facts.record() else []
    head = json.dumps(["array", layout.dtype, layout.shape, layout.channels, *facts])
    content = hashlib.sha256(head.encode() + b"\0")
    values = np.atleast_1d(output.values)
    step = max(1, _CHUNK * len(values) // max(1, values.nbytes))
    for first in range(0, len(values), step):
        content.update(np.ascontiguousarray(values[first : first + step]).reshape(-1).view(np.uint8).data)
        release(values)
    return content.hexdigest()


def write(result: Any, folder: Path, provenance: Mapping[str, Any], previews: bool = True) -> list[str]:
    """Write a stage's result into an empty folder.

    Parameters
    ----------
    result : as for `digests`.
    provenance : of the result, ready for JSON.
    previews : also write the pictures of arrays.

    Returns
    -------
    the names of the files. Flushing them to the disk is left to the caller.
    """
    outputs = outputs_of(result)
    hints = hints_of(outputs.kind)
    arrays = {name: output for name, output in outputs.items() if isinstance(output, Array)}
    tables = {name: outputs[name] for name, hint in hints.items() if hint.is_table and outputs[name] is not None}
    texts = {name: outputs[name] for name, hint in hints.items() if hint.text and outputs[name] is not None}
    scalars = {name: outputs[name] for name in outputs if name not in {*arrays, *tables, *texts}}

    def write_others() -> list[str]:
        files: dict[str, bytes] = {}
        if tables:
            files[TABLES] = json.dumps(tables, indent=1).encode()
        files |= {f"{name}.{hints[name].text}": text.encode() for name, text in texts.items()}
        for name, array in arrays.items() if previews else ():
            sides = array.layout.sides
            step = math.ceil(math.sqrt(math.prod(sides) / _MOST_OF_PREVIEW))
            levels = array.picture(step) if len(sides) == 2 and min(sides) >= _MIN_SIDE else None
            if levels is not None:
                files[f"{name}.png"] = png(levels)
        for name, content in files.items():
            (folder / name).write_bytes(content)
        return list(files)

    def write_arrays() -> list[str]:
        _write_exr(folder / ARRAYS, arrays, scalars, provenance, "ZSTD")
        return [ARRAYS]

    written = run_all(lambda write: write(), [(write_arrays,), (write_others,)])
    return [name for names in written for name in names]


def _write_exr(
    path: Path,
    arrays: Mapping[str, Array],
    scalars: Mapping[str, Any],
    provenance: Mapping[str, Any],
    compression: str,
    more: Mapping[str, Any] | None = None,
) -> None:
    """``more``: attributes of the header beside those of texloom."""
    parts: dict[str, exr.Planes] = {}
    for output, array in arrays.items():
        if not array.layout.is_empty:
            parts[output] = dict(zip(array.layout.names(output), array.planes(), strict=True))
    records = {
        output: {
            "dtype": array.layout.dtype,
            "shape": array.layout.shape,
            "channels": array.layout.channels,
            **({"facts": array.facts.record()} if array.layout.is_image else {}),
        }
        for output, array in arrays.items()
    }
    about = {"provenance": provenance, "scalars": scalars, "arrays": records}
    attributes = {f"texloom.{name}": json.dumps(value) for name, value in about.items()} | dict(more or {})
    exr.write(path, parts or {_NO_ARRAYS: {"Y": np.zeros((1, 1), np.float16)}}, attributes, compression)


def read(kind: type[Any], folder: Path, names: Collection[str] | None = None) -> dict[str, Any]:
    """Read outputs that `write` has written. The caller has verified the digests of the files.

    Parameters
    ----------
    kind : the dataclass of the outputs.
    names : the outputs that are wanted; all if not given.

    Returns
    -------
    values by output, equal to those written in dtype, shape, channels and bits.

    Raises
    ------
    ArtifactError
        A file is missing, broken or does not fit ``kind``.
    """
    hints = hints_of(kind)
    wanted = {name: hints[name] for name in (hints if names is None else names)}
    path = folder / ARRAYS
    try:
        file = exr.Windows(path)
        scalars, records = json.loads(file.text("texloom.scalars")), json.loads(file.text("texloom.arrays"))
        if unknown := sorted({*scalars, *records} - set(hints)):
            raise ValueError(f"{kind.__name__} has no output {', '.join(unknown)}")
        values = {name: prepared(scalars[name], hint) for name, hint in wanted.items() if name in scalars}
        for name, hint in wanted.items():
            if hint.is_array and name not in values:
                values[name] = _restored(name, hint, records[name], file)
        path = folder / TABLES
        if tables := [name for name, hint in wanted.items() if hint.is_table and name not in values]:
            stored = json.loads(path.read_bytes())
            values |= {name: prepared(stored[name], hints[name]) for name in tables}
        for name, hint in wanted.items():
            if hint.text and name not in values:
                path = folder / f"{name}.{hint.text}"
                values[name] = path.read_bytes().decode()
        return {name: values[name] for name in wanted}
    except KeyError as error:
        raise ArtifactError(f"{path}: {error.args[0]} is missing") from None
    except (OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
        raise ArtifactError(f"{path}: {error}") from None


def _restored(output: str, hint: Hint, record: Mapping[str, Any], file: exr.Windows) -> Any:
    """An array from its part, band by band."""
    layout = PlaneLayout.of(record["dtype"], tuple(record["shape"]), hint, tuple(record["channels"]))
    values = empty(layout.shape, layout.dtype)
    array = Array(values, layout)
    wrong = ValueError(f"part {output} does not hold what texloom.arrays says")
    if not layout.is_empty:
        planes = array.planes()
        assert all(np.may_share_memory(plane, values) for plane in planes)
        if file.sizes().get(output) != planes[0].shape:
            raise wrong
        for rows in file.bands(output):
            stored = file.read(output, rows, slice(None))
            for name, plane in zip(layout.names(output), planes, strict=True):
                plane[rows] = exr.restored(name, stored, values.dtype)
            release(values)
            if stored:
                raise wrong
    return Image(values, layout.channels, Facts.of(record.get("facts", {}))) if layout.is_image else values


def sizes(folder: Path) -> dict[str, tuple[int, int]]:
    """Height and width of every array of a result that has elements; `ArtifactError` where there is none."""
    try:
        return exr.Windows(folder / ARRAYS).sizes()
    except ValueError as error:
        raise ArtifactError(f"{folder / ARRAYS}: {error}") from None


def window(folder: Path, output: str, rows: slice, columns: slice) -> exr.Planes:
    """The pixels of an output of a result inside a window, by channel; no others are decoded where it is large.

    An output without channels has one, the empty word. The digests of the files are not compared.

    Parameters
    ----------
    rows, columns : of pixels, without a step; at least one pixel of the output must be inside.

    Raises
    ------
    ArtifactError : there is no such output, or its file is missing or broken.
    """
    path = folder / ARRAYS
    try:
        file = exr.Windows(path)
        record = json.loads(file.text("texloom.arrays"))[output]
        stored = file.read(output, rows, columns)
        names = {channel: f"{output}.{channel}" for channel in record["channels"]} or {"": output}
        is_image = not any(plane.startswith(f"{output}.") or plane == output for plane in stored)
        dtype = np.dtype(record["dtype"])
        return {
            channel: exr.restored(channel if is_image else name, stored, dtype) for channel, name in names.items()
        }
    except KeyError as error:
        raise ArtifactError(f"{path}: {error.args[0]} is missing") from None
    except (OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
        raise ArtifactError(f"{path}: {error}") from None


# -- exports


def export(
    value: Any, hint: Any, path: Path, provenance: Mapping[str, Any], attributes: Mapping[str, Any] | None = None
) -> str:
    """Write one output to a file of its own, which is complete or absent.

    Parameters
    ----------
    value, hint : an output and its type; `TypeError` if they do not fit.
    path : ends in ``.exr``: all channels without loss, in ZIP compression, which every tool reads; ``.png``: 8
        bits, see `texloom.pipelines.store.preview.picture`; ``.html``: a `Page`; ``.csv``: a `Spreadsheet`; or
        ``.json``: tables, numbers and words.
    provenance : of the value, ready for JSON; stored in EXR and PNG. Its ``output`` (``strength``,
        ``edges.strength``), or the file's name, begins the names of channels that are not an `Image`'s. Its ``run``
        is written into a page, see `with_run`.
    attributes : more of an EXR's header.

    Returns
    -------
    SHA-256 of the file, 64 hexadecimal digits.

    Raises
    ------
    ArtifactError
        The value cannot be written in this form.
    """
    wanted = Hint.of(hint)
    output = prepared(value, wanted)
    if wanted.text and path.suffix == f".{wanted.text}" and output is not None:
        is_page = wanted.text == "html"
        content = (with_run(output, provenance.get("run", {})) if is_page else output).encode()
    elif path.suffix == ".json" and not isinstance(output, Array) and not wanted.text:
        try:
            content = (json.dumps(output, indent=2, allow_nan=False) + "\n").encode()
        except ValueError:
            raise ArtifactError(f"{path}: a value is not finite, which JSON cannot say") from None
    elif path.suffix == ".exr" and isinstance(output, Array):
        name = str(provenance.get("output", path.stem)).rpartition(".")[2]
        with atomic_path(path) as temporary:
            _write_exr(temporary, {name: output}, {}, provenance, "ZIP", attributes)
            return file_digest(temporary)
    elif path.suffix == ".png" and isinstance(output, Array) and output.is_large_color:
        height, width = output.layout.sides
        output.clipped.tell("colour")
        return write_png(path, height, width, output.color_strips(), output.explained(provenance))
    elif path.suffix == ".png" and isinstance(output, Array) and (levels := output.picture()) is not None:
        output.clipped.tell("colour")
        content = png(levels, output.explained(provenance))
    else:
        is_array = isinstance(output, Array)
        shown = f"{output.layout.dtype} of shape {output.layout.shape}" if is_array else f"{output!r:.40}"
        raise ArtifactError(f"{path}: {shown} cannot be written to {path.suffix or 'such a file'}")
    write_atomically(path, content)
    return hashlib.sha256(content).hexdigest()


# -- any EXR


def describe(path: Path) -> dict[str, Any]:
    """What an EXR holds, ready for JSON; `InputError` where it cannot be read.

    Returns
    -------
    ``compression``; ``layers``: each with ``part``, ``name``, ``height`` and ``width`` in px, and ``channels``,
    which maps names to dtypes; ``provenance`` and ``scalars`` where texloom has written the file.
    """
    header, layers = _layers(path)
    description: dict[str, Any] = {
        "compression": header["compression"].name.removesuffix("_COMPRESSION"),
        "layers": [],
    }
    for (part, name), planes in layers.items():
        height, width = next(iter(planes.values())).shape
        channels = {channel: plane.dtype.name for channel, plane in planes.items()}
        description["layers"].append(
            {"part": part, "name": name, "height": height, "width": width, "channels": channels}
        )
    for name in ("provenance", "scalars"):
        if f"texloom.{name}" in header:
            try:
                description[name] = json.loads(header[f"texloom.{name}"])
            except (ValueError, TypeError, RecursionError):
                raise InputError(f"{path}: texloom.{name} in its header is not JSON") from None
    return description


def pictures(path: Path, folder: Path) -> list[Path]:
    """Write a PNG of every layer of an EXR into a folder, made if need be.

    Raises
    ------
    InputError
        It cannot be read, or a file with another content has the name of one of the pictures. Nothing is written.
    """
    made = _pictures(path, folder)
    _check_free(made)
    folder.mkdir(parents=True, exist_ok=True)
    for target, content in made.items():
        if not target.exists():
            write_atomically(target, content)
    return list(made)


def check_pictures(path: Path, folder: Path) -> None:
    """Raise what `pictures` would raise, and write nothing."""
    _check_free(_pictures(path, folder) if folder.exists() else {})


def _pictures(path: Path, folder: Path) -> dict[Path, bytes]:
    """File to PNG, for every layer."""
    _, layers = _layers(path)
    several = len({part for part, _ in layers}) > 1
    made: dict[str, bytes] = {}
    for (part, name), planes in layers.items():
        levels = picture({channel.rpartition(".")[2]: plane for channel, plane in planes.items()})
        if levels is not None:
            label = f"{part}.{name}" if several and part != name else name
            made[_file_name(label, {other.lower() for other in made})] = png(levels)
    return {folder / name: content for name, content in made.items()}


def _file_name(label: str, taken: Collection[str]) -> str:
    """The file name of a layer's PNG; not one of those ``taken``, which are in lower case."""
    stem = re.sub(r"^\.|[^A-Za-z0-9._-]", "_", label[:_MAX_LABEL]) or "_"
    names = (f"{stem}.png" if count == 1 else f"{stem}_{count}.png" for count in itertools.count(1))
    return next(name for name in names if name.lower() not in taken)


def _check_free(made: Mapping[Path, bytes]) -> None:
    for target, content in made.items():
        if os.path.lexists(target) and not (target.is_file() and target.read_bytes() == content):
            raise InputError(f"{target}: is there already and holds something else; give another folder")


def facts_in(header: Mapping[str, Any], part: str, height: int, width: int) -> Facts:
    """What the header of an EXR says of the image in a part of this size; nothing where it is none of ours."""
    try:
        known = json.loads(header["texloom.arrays"])[part]
        return Facts.of(known["facts"]) if known["shape"][:2] == [height, width] else Facts()
    except (KeyError, TypeError, ValueError, RecursionError):
        return Facts()


def original_bits(header: Mapping[str, Any]) -> dict[str, int]:
    """Bits of what each map in an exported EXR was made from, by its role, 8, 16 or 32, where it says so."""
    try:
        bits = json.loads(header["texloom.provenance"])["bits"]
    except (KeyError, TypeError, ValueError, RecursionError):
        return {}
    return {role: own for role, own in bits.items() if own in (8, 16, 32)} if isinstance(bits, dict) else {}


def names_of_maps(header: Mapping[str, Any]) -> dict[str, str]:
    """What files the maps in an exported EXR came from, by role, without suffix, where it says so."""
    try:
        names = json.loads(header["texloom.provenance"])["names"]
    except (KeyError, TypeError, ValueError, RecursionError):
        return {}
    found = {role: str(own) for role, own in names.items()} if isinstance(names, dict) else {}
    is_safe = all(0 < len(own) <= _MAX_LABEL and re.fullmatch(r"\w[\w .()-]*", own) for own in found.values())
    return found if is_safe and len({own.lower() for own in found.values()}) == len(found) else {}


def texel_size_in(header: Mapping[str, Any], part: str, height: int, width: int) -> float | None:
    """The side of a pixel, m, that an exported EXR says of a part of this size; None where it says nothing."""
    try:
        shape = json.loads(header["texloom.arrays"])[part]["shape"][:2]
        return length_of(json.loads(header["texloom.provenance"])) if shape == [height, width] else None
    except (KeyError, TypeError, ValueError, RecursionError):
        return None


def layer_of(part: str, channel: str) -> str:
    """The layer of a channel: what is before its last dot, or the part for colour and alpha, or else itself."""
    prefix, _, last = channel.rpartition(".")
    return prefix or (part if last in [*"RGBAY"] else last)


def _layers(path: Path) -> tuple[dict[str, Any], dict[tuple[str, str], exr.Planes]]:
    """The header, and the layers: channels of a part with the same `layer_of`."""
    try:
        with capture_output():
            header, parts = exr.load(path, largest=_MAX_PIXELS)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    layers: dict[tuple[str, str], exr.Planes] = {}
    for part, planes in parts.items():
        for channel, plane in planes.items():
            layer = layers.setdefault((part, layer_of(part, channel)), {})
            if layer and next(iter(layer.values())).shape != plane.shape:  # chroma may be stored at half size
                layer = layers.setdefault((part, channel), {})
            layer[channel] = plane
    return header, layers
