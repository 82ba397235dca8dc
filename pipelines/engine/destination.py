"""Where the exports of a run go: a folder, or one picture."""

from __future__ import annotations

import dataclasses
import os
import re
from pathlib import Path

from texloom.pipelines.engine.run import Run
from texloom.pipelines.errors import refused
from texloom.pipelines.flow.items import MOST_NAMES, own_names
from texloom.pipelines.flow.model import Each, Flow, Reference
from texloom.pipelines.flow.source_files import is_pattern
from texloom.pipelines.media.writers.writer_registry import writer_of
from texloom.pipelines.store.types import Hint
from texloom.stages.vocabulary.arrays import Image

_MAIN = "texture."
_PICTURES = ("array", "picture", "image")


def placed(run: Run, out: Path | None) -> tuple[Run, Path]:
    """The run and the folder of its exports.

    Where ``out`` names a picture, as ``result.png``, the run exports its main result, ``texture.*``, alone. Without
    ``out`` the folder is named after the first source and the flow, in the working folder.

    Raises
    ------
    InputError : ``out`` names a picture, and the flow has no main result or one for each item of a set.
    """
    if out is None:
        return run, Path(default_name(run))
    if not names_picture(out):
        return run, out
    flow = _with_one_picture(run.flow, out)
    if run.items and run.scope_of(flow.exports[out.name]) == "item":
        raise refused(f"--out {out}: the flow runs over a set; give a folder for its pictures")
    return Run(flow, run.store), out.parent


def names_picture(out: Path) -> bool:
    """Whether a picture would be written to ``out``; what ends in a slash or is a folder is one."""
    writer = writer_of(out.name)
    return writer is not None and writer.takes in _PICTURES and not out.is_dir()


def _with_one_picture(flow: Flow, out: Path) -> Flow:
    exported = (reference for file, reference in flow.exports.items() if file.startswith(_MAIN))
    reference = next((one for one in exported if _is_image(flow, one)), None)
    if reference is None:
        listed = ", ".join(flow.exports) or "none"
        raise refused(f"--out {out}: {flow.name} has no main result texture.*; give a folder for {listed}")
    if (writer := writer_of(out.name)) is not None:
        writer.check_installed(f"--out {out}")
    alike = f"{_MAIN}{out.suffix[1:]}"
    likes = {out.name: flow.likes[alike]} if alike in flow.likes else {}
    surfaces = {out.name: flow.surfaces[alike]} if alike in flow.surfaces else {}
    return dataclasses.replace(
        flow, exports={out.name: reference}, likes=likes, surfaces=surfaces, of_maps=(), picture=out.name
    )


def _is_image(flow: Flow, reference: Reference) -> bool:
    step = flow.steps.get(reference.name)
    return step is not None and Hint.of(step.stage.outputs.get(reference.output or "")).plain is Image


def default_name(run: Run) -> str:
    """``<picture>_<flow>``: the stem of the first source, or of a set the folder in which it is."""
    name, given = next(iter(run.flow.sources.items()), ("", None))
    picture = ""
    if isinstance(given, Each):
        picture = _folder_of(given).name
    elif run.shared.has_source(name):
        picture = run.shared.source(name).picture
    return re.sub(r"[^\w.-]+", "_", f"{picture}_{run.flow.name}").strip("_.")


def name_of_pictures(run: Run) -> str:
    """The name of the exemplar, or else of the first source, nothing without one; of several the first three."""
    sources = run.flow.sources
    source = "exemplar" if "exemplar" in sources else next(iter(sources), "")
    if isinstance(sources.get(source), Each):
        paths = dict.fromkeys(item.sources[source] for item in run.items)
        names = list(own_names([*paths]).values())
        rest = len(names) - MOST_NAMES
        return "_".join(names[:MOST_NAMES]) + (f"_and_{rest}" if rest > 0 else "")
    return run.shared.source(source).picture if run.shared.has_source(source) else ""


def _folder_of(given: Each) -> Path:
    """The folder that holds all files of a set."""
    fixed = []
    for pattern in given.patterns:
        path = Path(pattern).parent
        while is_pattern(str(path)):
            path = path.parent
        fixed.append(path)
    return Path(os.path.commonpath(fixed))
