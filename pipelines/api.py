"""The Python interface: `synthesize`, `run` and `plan`. The command line opens flows as it does."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from texloom.pipelines.media.array_sources import PathOrArray, Picture, file_source, masked
from texloom.pipelines.store.location import cache_store, default_store, shared_store
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.arrays import Image, split_mask
from texloom.stages.vocabulary.declare import InputError

if TYPE_CHECKING:
    from texloom.pipelines.engine.events import Listener
    from texloom.pipelines.engine.run import Run, StepPlan
    from texloom.pipelines.flow.model import Flow, Reference
    from texloom.pipelines.request import RunRequest
    from texloom.pipelines.results import Result, Texture

__all__ = ["Event", "plan", "run", "synthesize"]

SEED = 7

Size = int | tuple[int, int] | str
"""(height, width), px, or one number for both; a text, as ``"768x512"``, is width x height"""
Progress = bool | Callable[["Event"], None] | None
"""true shows lines and bars on standard error; a function is called with every `Event`"""


@dataclasses.dataclass(frozen=True)
class Event:
    """What a run reports."""

    kind: Literal["started", "progress", "finished", "item", "note"]
    step: str = ""
    """the step, after its item's name over a set; the item of an ``item``"""
    done: float = 0.0
    """share of the step's work that is finished, 0..1"""
    text: str = ""
    """what a person is told: the state of the step, scale and iteration, why an item has failed, a note"""
    preview: Callable[[], Image] | None = None
    """makes a picture of the step's state so far, where it has one"""


# -- the three functions


def synthesize(
    image: Picture,
    *,
    size: Size | None = None,
    method: str | os.PathLike[str] = "self_tuning",
    tileable: bool | str = False,
    seed: int = SEED,
    preset: str | None = None,
    crop: str | None = None,
    reduce: float | str | None = None,
    mask: PathOrArray | None = None,
    params: Mapping[str, Any] | None = None,
    store: str | os.PathLike[str] | None = None,
    remote: str | None = None,
    progress: Progress = None,
) -> Texture:
    """Make a new texture that looks like ``image``, the exemplar.

    Parameters
    ----------
    image : an array (h, w), (h, w, 3) or (h, w, 4), the path of a picture or of a folder of material maps, or the
        maps as a dict of their names, as ``{"albedo": ..., "normal": ..., "roughness": ...}``. uint8 and uint16 are
        sRGB, floats linear light. Pixels whose alpha is below a half, or that a NumPy mask covers, are not used.
    size : (height, width) of the result, px, or one number for both; the default is the method's.
    method : a flow with a single source, by its name (``texloom flows`` lists them) or its file.
    tileable : whether the result repeats without seams: true or ``"both"``, ``"x"`` from left to right alone,
        ``"y"`` from top to bottom alone, false or ``"off"``.
    seed : equal seeds give equal results.
    preset : of the method's parameters, as ``fast``.
    crop, reduce : the part of the exemplar that is used, as ``"1024x768+200+0"`` (width x height + left + top), and
        the factor by which it is made smaller; ``mask`` with it.
    mask : what may be used: a boolean array (h, w), true there; or the path of a picture, white there. What is
        false or black is excluded.
    params : further parameters, of the flow or of a step: ``{"STEP.PARAM": value}``.
    store : folder that keeps the results, so that an equal call is answered from it; the default is TEXLOOM_STORE,
        else ``store`` in the user's cache folder for texloom. ``texloom store prune --days 0 --store FOLDER``
        empties it.
    remote : address of a shared store on object storage, see ``texloom run --help``; the default is TEXLOOM_REMOTE.
    progress : true shows progress on standard error; a function receives every `Event`.

    Raises
    ------
    InputError
        the request is wrong; it is a ValueError.
    StepFailedError
        a stage raised an exception.

    Examples
    --------
    >>> import skimage.data, texloom
    >>> made = texloom.synthesize(skimage.data.brick()[:48, :48], size=(64, 96), method="quilting", seed=3)
    >>> made.image.shape, made.image.dtype, made.source_map.shape
    ((64, 96), dtype('uint8'), (64, 96, 2))
    """
    from texloom.pipelines.engine.run import Run
    from texloom.pipelines.flow.loader import find_flow, load_flow
    from texloom.pipelines.flow.source_choice import absolute
    from texloom.pipelines.results import Texture

    opened_store = Store(Path(store or os.environ.get("TEXLOOM_STORE") or cache_store()))
    given = image if mask is None else masked(image, mask)
    with _references({}, opened_store.root):
        asked = _request(
            method, {}, params, size=size, tileable=tileable or None, preset=preset, seed=seed,
            crop=crop, reduce=_text(reduce), remote=remote,
        )  # fmt: skip
        opened_store = Store(opened_store.root, shared_store(asked.remote))
        flow = load_flow(find_flow(asked.flow), asked.overrides)
        source = _only_source(flow, method)
        flow, made = for_texture(flow, method)
    with _references({source: given}, opened_store.root, opened_store) as references:
        file = references[source]
        if not isinstance(file, str):
            raise InputError(f"image: {len(file)} pictures, of which it takes one; texloom.run takes several")
        files = {source: absolute(file, Path.cwd())}
        opened = Run(dataclasses.replace(flow, sources=files, missing=()), opened_store)
        result = _run(opened, opened_store.root, progress, _masked_notes({source: given}, flow))
        return Texture(result, made, opened.shared.source(source), image, str(method))


def run(
    flow: str | os.PathLike[str],
    sources: Mapping[str, Picture | Sequence[Picture]] | None = None,
    params: Mapping[str, Any] | None = None,
    *,
    size: Size | None = None,
    seed: int | None = None,
    seeds: int | range | None = None,
    tileable: bool | str | None = None,
    preset: str | None = None,
    exports: Mapping[str, str] | None = None,
    item: str | None = None,
    crop: str | None = None,
    reduce: float | str | None = None,
    store: str | os.PathLike[str] | None = None,
    remote: str | None = None,
    out: str | os.PathLike[str] | None = None,
    force: bool = False,
    keep: str | None = None,
    runner: str | None = None,
    workers: int | None = None,
    address: str | None = None,
    layout: str | None = None,
    texel_size: str | None = None,
    color_space: str | None = None,
    udim: str | None = None,
    material: str | None = None,
    progress: Progress = None,
) -> Result:
    """Run a flow as ``texloom run`` does, with arrays in and out.

    Parameters
    ----------
    flow : the name of a flow that ships with texloom, or a YAML file.
    sources : name to an array, a path, a pattern as ``library/*.png``, a dict of maps, see `synthesize`, or a list
        of several, as ``{"exemplars": [grass, "gravel.png"]}``.
    params : of the flow, or of a step: ``{"STEP.PARAM": value}``.
    size, tileable, preset : the parameters that most flows have; see `synthesize`.
    seed : of the random numbers; the default is the flow's.
    seeds : so many from ``seed`` on, or a range, at most 1000: the flow then runs with each.
    exports : more files to write, name to ``STEP.OUTPUT``.
    item : the only item of a set that is wanted, without the steps that gather.
    crop, reduce : the part of the first source that is used, and how much smaller it is made; see `synthesize`.
    store : folder of the results; the default is TEXLOOM_STORE, else the folder ``artifacts`` if there is one here
        that is empty or a store, else ``store`` in the user's cache folder for texloom. Arrays are filed there too,
        under ``sources``, so that every runner can read them.
    remote : address of a shared store on object storage, see ``texloom run --help``; the default is TEXLOOM_REMOTE.
    out : folder of the exports, or a picture, as ``result.png``, for the main result alone; the default is the
        folder PICTURE_FLOW in the working folder, named after the first source, or of a set after its folder.
    force : whether files there that texloom did not write, or that were changed since, may be replaced.
    keep : ``"final"`` leaves intermediate results out of the store, see ``texloom run --help``.
    runner, workers, address : what computes the steps, see ``texloom run --help``.
    layout, texel_size, color_space, udim, material : how exports are written, see ``texloom run --help``.
    progress : true shows progress on standard error; a function receives every `Event`.

    Raises
    ------
    InputError
        the request is wrong; it is a ValueError.
    StepFailedError
        a stage raised an exception. Over a set, an item that fails stops no other; see `Result.problems`.

    Examples
    --------
    >>> import skimage.data, texloom
    >>> brick = skimage.data.brick()[:48, :48]
    >>> done = texloom.run("quilting", {"exemplar": brick}, {"texture.block": 16}, size=64, out="made")
    >>> done["texture"].image.shape
    (64, 64, 1)
    >>> sorted(done.exports)
    ['scores.json', 'texture.exr', 'texture.png']
    """
    from texloom.pipelines.engine.opening import open_request

    opened_store = Store(Path(store or default_store()))
    with _references(sources or {}, opened_store.root, opened_store) as references:
        asked = _request(
            flow, references, params, size=size, seed=seed, seeds=seeds, tileable=tileable, preset=preset,
            exports=exports or {}, item=item, crop=crop, reduce=_text(reduce), store=store, remote=remote,
            out=None if out is None else Path(out).expanduser(),
            force=force, keep=keep, runner=runner, workers=workers, address=address, layout=layout,
            texel_size=texel_size, color_space=color_space, udim=udim, material=material,
        )  # fmt: skip
        opened, folder = open_request(asked)
        return _run(opened, folder, progress, _masked_notes(sources or {}, opened.flow), force)


def plan(
    flow: str | os.PathLike[str],
    sources: Mapping[str, Picture | Sequence[Picture]] | None = None,
    params: Mapping[str, Any] | None = None,
    *,
    size: Size | None = None,
    seed: int | None = None,
    seeds: int | range | None = None,
    tileable: bool | str | None = None,
    preset: str | None = None,
    item: str | None = None,
    crop: str | None = None,
    reduce: float | str | None = None,
    store: str | os.PathLike[str] | None = None,
    remote: str | None = None,
) -> list[StepPlan]:
    """What `run` would do with the same arguments: which steps are cached, which would run, and why.

    Runs nothing and writes nothing.

    Parameters
    ----------
    flow, sources, params, size, seed, seeds, tileable, preset, item, crop, reduce, store, remote : see
        `run`.

    Returns
    -------
    for each step, over a set for each step of each item: ``name``, ``stage``, ``state`` (``cached``, ``fetch`` from
    the shared store, ``run``, ``wait`` for others, ``refused``, ``skipped`` without an optional source),
    ``reasons`` why it is not cached or is skipped, ``key`` if it is known, ``item``, and ``fetched``, the bytes to
    fetch.

    Raises
    ------
    InputError
        the request is wrong; it is a ValueError.

    Examples
    --------
    >>> import texloom
    >>> [(step.name, step.state) for step in texloom.plan("quilting", store="empty")]
    [('tone', 'run'), ('texture', 'wait'), ('scores', 'wait')]
    """
    from texloom.pipelines.engine.opening import open_request

    with tempfile.TemporaryDirectory() as folder, _references(sources or {}, Path(folder)) as references:
        asked = _request(
            flow, references, params, size=size, seed=seed, seeds=seeds, tileable=tileable, preset=preset,
            item=item, crop=crop, reduce=_text(reduce), store=store, remote=remote,
        )  # fmt: skip
        opened = open_request(asked)[0]
        _masked_notes(sources or {}, opened.flow)
        return [*opened.plan(), *opened.skipped()]


# -- opening a flow


def _request(
    flow: str | os.PathLike[str], sources: Mapping[str, str | tuple[str, ...]], params: Mapping[str, Any] | None, *,
    size: Size | None, seeds: int | range | None = None, **fields: Any,
) -> RunRequest:  # fmt: skip
    """What the arguments of a function ask for."""
    from texloom.pipelines.request import request
    from texloom.pipelines.request_fields import MOST_SEEDS

    return request(
        flow=os.fspath(flow),
        sources=sources,
        params=_texts(params),
        size=size if size is None or isinstance(size, str) else _texts({"size": size})["size"],
        # One more than may be is enough for the request to be refused.
        seeds=tuple(seeds[: MOST_SEEDS + 1]) if isinstance(seeds, range) else seeds,
        **fields,
    )


def _text(value: float | str | None) -> str | None:
    return None if value is None else str(value)


def _texts(params: Mapping[str, Any] | None) -> dict[str, str | tuple[Any, ...]]:
    """Values of parameters as a request has them: texts of JSON, or tuples."""

    def plain(value: Any) -> Any:
        if isinstance(value, np.generic | np.ndarray):
            return value.tolist()
        if isinstance(value, os.PathLike):
            return os.fspath(value)
        raise InputError(f"--set {name}: a parameter cannot hold a value of type {type(value).__name__}")

    texts: dict[str, str | tuple[Any, ...]] = {}
    for name, value in (params or {}).items():
        text = json.dumps(value, default=plain)
        texts[name] = tuple(json.loads(text)) if isinstance(value, tuple) else text
    return texts


_OPTIONS = {"set": "params", "source": "sources"}


@contextlib.contextmanager
def _references(
    sources: Mapping[str, Any], folder: Path, store: Store | None = None
) -> Iterator[dict[str, str | tuple[str, ...]]]:
    """The files of sources, several of a list, with arrays below ``folder``, the root of ``store`` if it is given.

    Errors of the ``with`` block speak of arguments and arrays, not of options and the files of arrays.
    """
    references: dict[str, str | tuple[str, ...]] = {}
    written: list[tuple[str, Any]] = []

    def filed(place: str, given: Any) -> str:
        try:
            if store is not None and not isinstance(given, str | os.PathLike):
                store.ready("sources")
            reference = file_source(given, folder / "sources")
        except InputError as error:
            raise InputError(f"sources.{place}: {error}") from None
        except OSError as error:
            raise InputError(f"--store {folder}: cannot be written: {error.strerror}") from None
        if not isinstance(given, str | os.PathLike):
            written.append((reference, given))
        return reference

    try:
        for name, given in sources.items():
            several = isinstance(given, list | tuple)
            references[name] = (
                tuple(filed(f"{name}.{number}", one) for number, one in enumerate(given))
                if several
                else filed(name, given)
            )
        yield references
    except InputError as error:
        text = re.sub(r"^--(\w+)", lambda option: _OPTIONS.get(option[1], option[1]), str(error))
        text = text.replace(", or --force", ", or force=True")
        for reference, given in written:
            text = text.replace(reference, _described(given))
        for reference, _ in written:  # after all of them, as they may have one folder
            text = text.replace(f"{Path(reference).parent}/", "")
        # an argument in place of the command
        text = re.sub(r"(sources\.(\w+): required), as in: .*", r"\1, as in sources={'\2': 'picture.png'}", text)
        text = re.sub(r"(is used only with .*), as in: .*", r"\1", text)
        raise InputError(text) from None


def _masked_notes(sources: Mapping[str, Any], flow: Flow) -> list[str]:
    """What is said of masked arrays; `InputError` where another source than the exemplar is one."""
    exemplar = next(iter(flow.sources), None)
    notes = []
    for name, given in sources.items():
        if isinstance(given, np.ma.MaskedArray):
            if name != exemplar:
                raise InputError(f"sources.{name}: a masked array, which only '{exemplar}' may be; fill it first")
            usable = split_mask(given)[1]
            notes.append(f"{name}: {usable.size - int(np.count_nonzero(usable))} masked pixels are excluded")
    return notes


def _described(given: Any) -> str:
    if isinstance(given, Mapping):
        return f"maps {', '.join(map(str, given))}"
    return f"array of shape {tuple(given.shape)}"


def _only_source(flow: Flow, method: str | os.PathLike[str]) -> str:
    """The flow's exemplar."""
    if len(flow.sources) != 1 or flow.is_set:
        listed = ", ".join(flow.sources) or "none"
        raise InputError(
            f"method '{method}' does not take a single picture (its sources: {listed}); use texloom.run"
        )
    return next(iter(flow.sources))


def for_texture(flow: Flow, method: str | os.PathLike[str]) -> tuple[Flow, Reference]:
    """The steps that the texture and its scores need, without exports; and the texture."""
    from texloom.pipelines.results import main_image, scores_of

    made, scores = main_image(flow, method), scores_of(flow)
    needed = {made.name} if scores is None else {made.name, scores.name}
    for name in reversed(list(flow.steps)):
        if name in needed:
            needed.update(flow.steps[name].needs)
    steps = {name: step for name, step in flow.steps.items() if name in needed}
    return dataclasses.replace(flow, steps=steps, exports={}, likes={}, surfaces={}), made


# -- running


def _told(tell: Callable[[Event], None]) -> Listener:
    """Passes on what a run reports, each as one `Event`."""
    from texloom.pipelines.engine import events

    def listener(event: events.Event) -> None:
        match event:
            case events.StepStarted(step):
                tell(Event("started", step))
            case events.StepProgress(step, progress):
                tell(Event("progress", step, progress.done, events.describe_progress(progress), progress.preview))
            case events.StepReport():
                tell(Event("finished", event.label, 1.0, event.state))
            case events.ItemReport(item, number, count, problem):
                tell(Event("item", item, number / count, problem or ""))
            case events.Note(text, is_warning):
                text = f"warning: {text}" if is_warning else text
                tell(Event("note", text=text))

    return listener


def _run(opened: Run, out: Path, progress: Progress, notes: Sequence[str] = (), force: bool = False) -> Result:
    from texloom.pipelines.engine.events import Note, Recorder
    from texloom.pipelines.engine.preflight import Preflight
    from texloom.pipelines.engine.run_scores import choices_of, main_scores
    from texloom.pipelines.engine.scheduler import execute
    from texloom.pipelines.results import Result
    from texloom.pipelines.terminal import Terminal

    terminal = None
    listener: Listener = _ignore
    if progress is True:
        listener = terminal = Terminal(sys.stderr)
    elif callable(progress):
        listener = _told(progress)
    recorder = Recorder(listener)
    Preflight(opened).check(out, force)
    for note in notes:
        recorder(Note(note))
    try:
        exports = execute(opened, recorder, out)
    finally:
        if terminal is not None:
            terminal.close()
    if terminal is not None:
        terminal.summarise(main_scores(opened), out if exports else None, choices_of(opened))
    return Result(opened, exports, recorder)


def _ignore(_: object) -> None:
    """Tell nobody."""
