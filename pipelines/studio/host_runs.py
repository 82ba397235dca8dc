"""What a worker does for programs that speak the protocol of `texloom.pipelines.studio.messages.hosts`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from texloom.pipelines import api
from texloom.pipelines.engine.run import StepFailedError
from texloom.pipelines.errors import one_line
from texloom.pipelines.media.arrays import Picture
from texloom.pipelines.media.conventions import COLORS
from texloom.pipelines.media.map_names import recognised
from texloom.pipelines.results import main_result
from texloom.pipelines.studio.messages.hosts import Maps, OnePicture, PixelFormat, ResultMap, space_of
from texloom.pipelines.studio.runs import Reporter
from texloom.pipelines.studio.work import HostRan, HostWork, Places, Received
from texloom.stages.vocabulary.declare import InputError

MAP = "{}.raw"
"""the file of a map's pixels in the folder of a run"""
EXPORTS = "exports"


def run(work: HostWork, places: Places, check: Callable[[], None], send: Callable[..., None]) -> None:
    """Run what was submitted, and write its maps as raw arrays and its exports into the folder of the run."""
    asked, folder = work.submitted, Path(work.folder)
    sources = {name: _source(name, given, work.received) for name, given in asked.sources.items()}
    options = asked.model_dump(exclude={"flow", "sources", "params", "size"}, exclude_none=True)
    size = None if asked.size is None else str(asked.size)
    notes: list[str] = []
    reporter = Reporter(send)

    def listen(event: api.Event) -> None:
        check()
        if event.kind == "started":
            reporter.started(event.step)
        elif event.kind == "progress":
            reporter.progressed(event.step, event.done, event.text, event.preview)
        elif event.kind == "note":
            notes.append(event.text)

    try:
        made = api.run(
            asked.flow, sources, asked.params, size=size, **options,
            store=places.store, out=folder / EXPORTS, progress=listen,
        )  # fmt: skip
    except StepFailedError as error:
        raise InputError(str(error)) from None
    except InputError as error:
        text = str(error)
        for one in work.received.values():  # which the program does not know
            text = text.replace(f"{Path(one.path).parent}/", "")
        raise InputError(text) from None
    arrays, scores = main_result(made, sources)
    maps = tuple(_written(name, values, folder) for name, values in arrays.items())
    told = [re.sub(rf"{re.escape(places.store)}/sources/\S+?: ", "", note) for note in dict.fromkeys(notes)]
    send(HostRan(maps=maps, files=_files(folder / EXPORTS), notes=tuple(told), scores=scores))


def _source(name: str, given: str | OnePicture | Maps, received: Mapping[str, Received]) -> Picture:
    if isinstance(given, str):
        return given
    ids = {"": given.picture} if isinstance(given, OnePicture) else given.maps
    pictures = {}
    for plane, identity in ids.items():
        if identity not in received:
            raise InputError(one_line(f"sources.{name}: {identity}: no such picture was sent; send it again"))
        pictures[plane] = _read(received[identity])
    return pictures[""] if isinstance(given, OnePicture) else pictures


def _read(one: Received) -> str | np.ndarray:
    """The array that was received; a file remains one."""
    if one.pixels is None:
        return one.path
    values = np.fromfile(one.path, np.dtype(one.pixels.dtype).newbyteorder("<"))
    return values.astype(one.pixels.dtype, copy=False).reshape(one.pixels.shape)


def _written(name: str, values: np.ndarray, folder: Path) -> ResultMap:
    kept = values if values.dtype.kind == "u" else values.astype(np.float32, copy=False)
    kept.astype(kept.dtype.newbyteorder("<"), copy=False).tofile(folder / MAP.format(name))
    role = (recognised(name) or (name,))[0]
    space = space_of(kept.dtype.name) if role in COLORS else "data"
    pixels = PixelFormat.model_validate({"shape": kept.shape, "dtype": kept.dtype.name, "color_space": space})
    return ResultMap(name=name, pixels=pixels)


def _files(folder: Path) -> tuple[str, ...]:
    """The exports, by their names."""
    return tuple(sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()))
