"""Small flows and pictures to run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import PIL.Image

from texloom.pipelines.engine.events import Event, ItemReport, Note, StepProgress, StepReport, StepStarted
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Overrides, Runner
from texloom.pipelines.store.store import Store
from texloom.stages.progress import Progress

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
    params: {size: [96, 96]}
  texture:
    stage: synthesis.optimise
    inputs: {image: exemplar, start: start.match}
    params: {preset: default}
exports:
  texture.exr: texture.image
"""


def write_flow(folder: Path, text: str = ANALYSIS, side: int = 64) -> Path:
    """A flow file beside an exemplar of round spots."""
    row, column = np.indices((side, side))
    spots = np.hypot((row % 16) - 8, (column % 20) - 10) + np.random.default_rng(1).uniform(0, 3, (side, side))
    pixels = np.stack([spots * 14, 255 - spots * 12, 60 + spots * 5], axis=2)
    PIL.Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8)).save(folder / "exemplar.png")
    path = folder / "flow.yaml"
    path.write_text(text)
    return path


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
    """Run in this thread; what was reported."""
    listener = listener or Events()
    execute(run, Runner("local"), listener, out)
    return listener
