"""What a worker does for programs that speak the protocol of `texloom.pipelines.studio.messages.hosts`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from texloom.pipelines import api
from texloom.pipelines.engine.run import StepFailedError
from texloom.pipelines.errors import one_line
from texloom.pipelines.media.array_sources import Picture, file_source
from texloom.pipelines.media.conventions import COLORS
from texloom.pipelines.media.map_names import recognised
from texloom.pipelines.results import main_result
from texloom.pipelines.studio.full_size_runs import Reporter
from texloom.pipelines.studio.messages.hosts import OnePicture, OneSource, PixelFormat, ResultMap, space_of
from texloom.pipelines.studio.work import HostRan, HostWork, Places, Received
from texloom.stages.vocabulary.declare import InputError

MAP = "{}.raw"
"""the file of a map's pixels in the folder of a run"""
SENT = "sent"
EXPORTS = "exports"


def run(work: HostWork, places: Places, check: Callable[[], None], send: Callable[..., None]) -> None:
    """Run what was submitted, and write its maps as raw arrays and its exports into the folder of the run."""
    asked, folder = work.submitted, Path(work.folder)
    sources = {
        name: _several(name, given, work) if isinstance(given, list) else _source(name, given, work.received)
        for name, given in asked.sources.items()
    }
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
        elif event.kind == "item" and event.text:
            notes.append(f"{event.step}: {event.text}")

    def told(text: str) -> str:
        """Without the folders of what was sent, which the program does not know."""
        for one in work.received.values():
            text = text.replace(f"{Path(one.path).parent}/", "")
        text = re.sub(rf"{re.escape(places.store)}/sources/\S+?: ", "", text)
        return re.sub(rf"{re.escape(str(folder / SENT))}/[^/]+/", "", text)

    try:
        made = api.run(
            asked.flow, sources, asked.params, size=size, **options,
            store=places.store, out=folder / EXPORTS, progress=listen,
        )  # fmt: skip
    except StepFailedError as error:
        raise InputError(str(error)) from None
    except InputError as error:
        raise InputError(told(str(error))) from None
    arrays, scores = main_result(made, sources)
    if made.problems and not arrays:
        raise InputError(told("; ".join(f"{item}: {problem}" for item, problem in made.problems.items())))
    maps = tuple(_written(name, values, folder) for name, values in arrays.items())
    notes = [told(note) for note in dict.fromkeys(notes)]
    send(HostRan(maps=maps, files=_files(folder / EXPORTS), notes=tuple(notes), scores=scores))


def _several(name: str, given: Sequence[OneSource], work: HostWork) -> list[Picture]:
    """The pictures of a set. What has no name of its own has its number, from 1, by which weights can name it."""
    folder = Path(work.folder) / SENT / name
    files: list[Picture] = []
    for number, one in enumerate(given, 1):
        picture = _source(name, one, work.received)
        if not isinstance(picture, str):
            try:
                file = Path(file_source(picture, folder))
            except InputError as error:
                raise InputError(f"sources.{name}.{number}: {error}") from None
            if file.parent == folder:
                picture = str(file.rename(folder / f"{number}{file.suffix}"))
            else:  # maps, in a folder of their own
                picture = str(file.parent.rename(folder / str(number)) / file.name)
        files.append(picture)
    return files


def _source(name: str, given: OneSource, received: Mapping[str, Received]) -> Picture:
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
