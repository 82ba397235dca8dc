"""Runs at full size, as the command line does them, in the store of the user."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from texloom.pipelines.engine.events import Event, StepProgress, StepStarted, describe_progress
from texloom.pipelines.engine.preflight import Preflight
from texloom.pipelines.engine.run_scores import main_scores
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.media.map_names import read_names
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.page_images import rgba, small
from texloom.pipelines.studio.recipe_flows import open_recipe
from texloom.pipelines.studio.work import Places, Ran, Running, RunWork, Saved, SaveWork, library_of
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

_MAPS, _PICTURE, _EXR = "maps", "texture.png", "texture.exr"
_MADE_OF = ("exemplar.exr", "estimated")  # of what the result is made, where that is not the picture as it was
_INTERVAL = 0.2  # seconds between reports of one step
_PICTURES = 1.0  # seconds between pictures
_LARGEST = 640  # px of a picture of a run that goes on
_KNOWN = 2.0  # seconds of a step after which the time that is left can be told


class Reporter:
    """Sends how far a run is, not more often than a person can read it."""

    def __init__(self, send: Callable[..., None]):
        self._send = send
        self._told = self._shown = self._began = 0.0

    def started(self, step: str) -> None:
        """A step begins."""
        self._began = time.perf_counter()
        self._send(Running(step=step, text="", done=0.0))

    def progressed(self, step: str, done: float, text: str, preview: Callable[[], Image] | None) -> None:
        """A step goes on."""
        now, picture = time.perf_counter(), None
        if now - self._told < _INTERVAL:
            return
        self._told = now
        if preview is not None and now - self._shown >= _PICTURES:
            self._shown, picture = now, small(preview(), _LARGEST)
        report = Running(
            step=step, text=_left(now - self._began, done) or text, done=min(1.0, done),
            height=picture.height if picture else 0, width=picture.width if picture else 0,
        )  # fmt: skip
        self._send(report, rgba(picture) if picture else b"")


def run(work: RunWork, places: Places, check: Callable[[], None], send: Callable[..., None]) -> None:
    """Run a recipe and export what its flow exports."""
    opened = open_recipe(work.recipe, library_of(places), Store(Path(places.store)))
    out = opened.new_out()
    Preflight(opened).check(out)
    reporter = Reporter(send)

    def listen(event: Event) -> None:
        check()
        if isinstance(event, StepStarted):
            reporter.started(event.step)
        elif isinstance(event, StepProgress):
            progress = event.progress
            reporter.progressed(event.step, progress.done, describe_progress(progress), progress.preview)

    exports = execute(opened, listen, out)
    folder = opened.out_folder(out)
    made = next((name for name in (_MAPS, _EXR) if (folder / name).exists()), None)
    texture = f"run:{folder.name}/{made}" if made else ""
    of = next((name for name in _MADE_OF if (folder / name).exists()), None)
    exemplar = f"run:{folder.name}/{of}" if of else ""
    scores, maps = main_scores(opened), maps_of(folder)
    send(Ran(out=str(folder), files=tuple(exports), scores=scores, texture=texture, exemplar=exemplar, maps=maps))


def save(work: SaveWork, places: Places, check: Callable[[], None], send: Callable[..., None]) -> None:
    """Write the exports into a folder beside the pictures.

    Raises
    ------
    InputError : there are files that texloom did not write.
    """
    opened = open_recipe(work.recipe, library_of(places), Store(Path(places.store)))
    out = Path(places.folder) / work.name
    try:
        Preflight(opened).check(out)
    except InputError as error:
        raise InputError(str(error).replace("; give another place, or --force", "; move it away")) from None
    execute(opened, lambda _: check(), out)
    send(Saved(out=str(out)))


def _left(seconds: float, done: float) -> str:
    """How long a step takes after so many seconds; nothing where that cannot be told yet."""
    if seconds < _KNOWN or not 0.02 < done < 1:
        return ""
    left = seconds * (1 - done) / done
    return f"about {left / 60:.0f} min left" if left > 90 else f"about {max(1, round(left))} s left"


def maps_of(folder: Path) -> dict[str, str]:
    """The PNGs of a material among exports, by role; or the picture alone."""
    named = read_names(sorted((folder / _MAPS).glob("*.png")), lambda _: None)
    found = {
        "normal_dx" if role == "normal" and claims[0].green == "down" else role: f"{_MAPS}/{claims[0].path.name}"
        for role, claims in named.claims.items()
        if not claims[0].plane and not claims[0].inverted
    }
    if not found and (folder / _PICTURE).is_file():
        found["albedo"] = _PICTURE
    return found
