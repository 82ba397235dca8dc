"""What the store holds, as the page shows it: runs, their steps, and the pictures of both."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from texloom.pipelines.store import run_log
from texloom.pipelines.store.result_files import BrokenArtifactError, read_manifest
from texloom.pipelines.store.run_log import LoggedRun
from texloom.pipelines.studio.messages.runs import PastRun, PastRuns, PastStep
from texloom.stages.vocabulary.declare import InputError

_MOST = 200  # runs that are listed
_CORRECTION = "revise"
_MAIN = ("texture", "result", "revised", "refined", "filled")  # what makes the picture, the likeliest first
_PICTURES = ("image", "texture")  # outputs likewise


def past_runs(store: Path) -> PastRuns:
    """The runs of a store, the last one first; corrections of results of the page belong to their materials."""
    logged = run_log.read(store)
    listed = [run for run in logged if not _corrects(store, run)]
    return PastRuns(
        runs=tuple(_described(store, run) for run in listed[:_MOST]),
        found=len(listed),
        corrections=len(logged) - len(listed),
    )


def _corrects(store: Path, run: LoggedRun) -> bool:
    """Whether a run has corrected a result of the page, or was one of the versions to choose from."""
    return run.flow == _CORRECTION and Path(run.sources.get("texture", "")).is_relative_to(store / "runs")


def _described(store: Path, run: LoggedRun) -> PastRun:
    names = sorted(run.steps, key=lambda name: _rank(name.rpartition("/")[2]))
    cover = next((picture for name in names if (picture := _cover(store, run.steps[name]))), "")
    content = f"{run.flow}{sorted(run.sources.items())}{run.seeds}{sorted(run.steps.items())}"
    return PastRun(
        id=hashlib.sha256(content.encode()).hexdigest()[:16],
        flow=run.flow,
        sources={name: Path(given).name for name, given in run.sources.items()},
        seeds=run.seeds,
        used=run.used,
        cover=cover,
    )


def _rank(step: str) -> tuple[int, str]:
    return (_MAIN.index(step) if step in _MAIN else len(_MAIN), step)


def _cover(store: Path, key: str) -> str:
    folder = _folder(store, key)
    shown = pictures_of(folder) if folder is not None else []
    best = next((name for name in _PICTURES if name in shown), None)
    return f"{key}/{best}" if best else ""


def steps_of(store: Path, run: str) -> list[PastStep]:
    """The steps of a run by its id; `InputError` where the store no longer has it."""
    for logged in run_log.read(store):
        if _described(store, logged).id == run:
            return [_step(store, name, key) for name, key in logged.steps.items()]
    raise InputError("the store no longer has this run")


def _step(store: Path, name: str, key: str) -> PastStep:
    folder = _folder(store, key)
    if folder is None:
        return PastStep(name=name, stage="", key=key, seconds=0.0, pictures=(), params={})
    try:
        manifest, _ = read_manifest(folder)
    except BrokenArtifactError:
        manifest = {}
    shown = {name: str(value) for name, value in dict(manifest.get("params") or {}).items()}
    return PastStep(
        name=name,
        stage=folder.parent.name,
        key=key,
        seconds=float(manifest.get("seconds") or 0.0),
        pictures=tuple(pictures_of(folder)),
        params=shown,
    )


def pictures_of(folder: Path) -> list[str]:
    """The outputs of a result that have a picture."""
    return sorted(path.stem for path in folder.glob("*.png"))


def artifact_file(store: Path, key: str, name: str) -> Path:
    """A file of a result; `InputError` where there is none."""
    folder = _folder(store, key)
    if folder is None or not re.fullmatch(r"[A-Za-z0-9_]+\.(png|exr)", name) or not (folder / name).is_file():
        raise InputError("the store no longer has this result")
    return folder / name


def _folder(store: Path, key: str) -> Path | None:
    """Where the result of a key is."""
    if not re.fullmatch(r"[0-9a-f]{64}", key):
        return None
    return next((store / "cache").glob(f"*/{key}"), None)
