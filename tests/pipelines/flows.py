"""Small flows and pictures to run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import PIL.Image

from tests.conftest import ROOT
from texloom.pipelines.engine.events import Event, ItemReport, Note, StepProgress, StepReport, StepStarted
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.progress import Progress

ANALYSIS = """
flow: small
sources:
  exemplar: exemplar.png
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}}
  structure: {stage: analysis.otsu, inputs: {strength: edges.strength}}
  distance: {stage: analysis.signed_distance, inputs: {structure: structure.structure}}
exports:
  structure.png: structure.structure
  distance.exr: distance.field
"""

SYNTHESIS = """
flow: synthesis
seed: 3
sources:
  exemplar: exemplar.png
steps:
  start:
    stage: synthesis.initialise
    inputs: {image: exemplar}
    params: {size: 96}
  texture:
    stage: synthesis.optimise
    inputs: {image: exemplar, start: start.match}
    params: {preset: default}
exports:
  texture.exr: texture.image
"""


SET = """
flow: set
seed: [1, 2]
sources:
  exemplar: {each: pictures/*.png}
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}}
  start: {stage: synthesis.initialise, inputs: {image: exemplar}, params: {size: 16, method: pixels}}
  scores: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: start.image, match: start.match}}
  all: {stage: evaluation.tabulate, gather: {tables: scores.table}}
exports:
  start.png: start.image
  all.json: all.table
  all.csv: all.csv
"""

BRANCHES = """
flow: branches
sources:
  exemplar: {each: pictures/*.png}
steps:
  density: {stage: analysis.autocorrelation, inputs: {image: exemplar}}
  lattice: {stage: analysis.lattice, inputs: {image: exemplar, density: density.density}}
  cells: {stage: analysis.deformed_lattice, inputs: {image: exemplar, generators: lattice.generators}}
  tiled:
    stage: synthesis.near_regular
    inputs: {image: exemplar, generators: lattice.generators, vertices: cells.vertices}
    params: {size: 32}
  tiled_scores: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: tiled.image}}
  start: {stage: synthesis.initialise, inputs: {image: exemplar}, params: {size: 16, method: pixels}}
  scores: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: start.image}}
  both: {stage: evaluation.compare, gather: {tables: {pixels: scores.table, tiles: tiled_scores.table}}}
  tiles: {stage: evaluation.tabulate, gather: {tables: tiled_scores.table}}
exports:
  start.png: start.image
  tiled.png: tiled.image
  both.json: both.table
  tiles.json: tiles.table
"""


def write_flow(folder: Path, text: str = ANALYSIS, side: int = 64) -> Path:
    """A flow file beside an exemplar of round spots, in a folder made if need be."""
    folder.mkdir(exist_ok=True)
    row, column = np.indices((side, side))
    spots = np.hypot((row % 16) - 8, (column % 20) - 10) + np.random.default_rng(1).uniform(0, 3, (side, side))
    pixels = np.stack([spots * 14, 255 - spots * 12, 60 + spots * 5], axis=2)
    PIL.Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8)).save(folder / "exemplar.png")
    path = folder / "flow.yaml"
    path.write_text(text)
    return path


def write_set(folder: Path, text: str = SET) -> Path:
    """A flow file beside a set of pictures of noise: a, b and c."""
    for index, name in enumerate(("b", "a", "c")):
        paint(folder / "pictures" / f"{name}.png", seed=index)
    path = folder / "flow.yaml"
    path.write_text(text)
    return path


def paint(path: Path, side: int = 24, seed: int = 0) -> None:
    """A picture of noise; `metrics` of one of 40 px takes thirty times as long."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(seed).integers(0, 255, (side, side, 3)).astype(np.uint8)
    PIL.Image.fromarray(pixels).save(path)


def files(folder: Path) -> dict[str, bytes]:
    """What the files below a folder hold."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def environment(home: Path) -> dict[str, str]:
    """The variables of a process, without those of Prefect and texloom; its store is in the working folder."""
    known = {name: value for name, value in os.environ.items() if not name.startswith(("PREFECT_", "TEXLOOM_"))}
    path = os.pathsep.join(map(str, (ROOT / ".import", ROOT)))  # this clone's, wherever another is installed
    return {**known, "PYTHONPATH": path, "PREFECT_HOME": str(home), "TEXLOOM_STORE": "artifacts"}


def start_run(path: Path, *options: object) -> subprocess.Popen[str]:
    """``texloom run`` in a process of its own, in the folder of the flow file."""
    return subprocess.Popen(
        [sys.executable, "-m", "texloom", "run", str(path), "--json", *map(str, options)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=path.parent, env=environment(path.parent),
    )  # fmt: skip


def open_run(path: Path, **params: str) -> Run:
    """The flow at ``path`` with a store beside it; params as ``step__param="value"``."""
    overrides = Overrides(params={name.replace("__", "."): value for name, value in params.items()})
    return Run(load_flow(path, overrides), Store(path.parent / "artifacts"))


class Events:
    """A listener that keeps what it is told."""

    def __init__(self) -> None:
        self.states: dict[str, str] = {}
        self.notes: list[str] = []
        self.items: dict[str, str | None] = {}
        self.progress: list[Progress] = []

    def __call__(self, event: Event) -> None:
        match event:
            case StepStarted(step):
                self.states[step] = "started"
            case StepProgress(_, progress):
                self.progress.append(progress)
            case StepReport():
                self.states[event.label] = event.state
            case ItemReport(item, problem=problem):
                self.items[item] = problem
            case Note(text):
                self.notes.append(text)


def run_local(run: Run, out: Path, listener: Events | None = None) -> Events:
    """Run with the flow's runner, by default in this thread; what was reported."""
    listener = listener or Events()
    execute(run, listener, out)
    return listener
