"""Runs at full size and earlier ones, and what there is to see of their results."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from texloom.pipelines.studio.messages.message import Message, Share
from texloom.pipelines.studio.messages.recipes import Recipe


class Described(Message):
    """A recipe as a flow file, as a command, and what a run would do."""

    yaml: str
    file: str
    """a name for the flow file"""
    command: str
    steps: tuple[PlannedStep, ...]


class PlannedStep(Message):
    """What a run would do with a step, and why."""

    name: str
    state: Literal["cached", "run", "wait", "refused"]
    reasons: tuple[str, ...]


JobState = Literal["waiting", "running", "done", "failed", "cancelled"]


class Queued(Message):
    """How far a run is that waits for its turn, goes on, or has ended."""

    id: str
    state: JobState
    step: str = ""
    text: str = ""
    """what a person is told: scale and iteration, or why it failed"""
    done: Share = 0.0
    """of the current step"""
    seconds: float = 0.0
    """of the run, when it has ended"""


class Job(Queued):
    """A run at full size."""

    name: str
    recipe: Recipe
    files: tuple[str, ...] = ()
    """the exports, by their names"""
    saved: str = ""
    """the folder beside the pictures in which they have been saved"""
    scores: dict[str, float] = Field({})
    texture: str = ""
    """id of the result as a picture that flows can take"""
    exemplar: str = ""
    """id of the maps that it was made of, where they are estimated; empty: its picture"""
    maps: dict[str, str] = Field({})
    """role, as ``albedo`` or ``normal``, or ``normal_dx`` where green points down, to the file of that map"""


# -- looking at results


class PastStep(Message):
    """A step of a run that the store knows."""

    name: str
    stage: str
    """empty where its result has been removed"""
    key: str
    seconds: float
    """that it took when it was computed"""
    pictures: tuple[str, ...]
    """the outputs that have one"""
    params: dict[str, str]


class PastRun(Message):
    """A run that the store knows."""

    id: str
    flow: str
    sources: dict[str, str]
    """name to the name of its file"""
    seeds: tuple[int, ...]
    used: float
    """when it was last run, seconds since 1970"""
    cover: str
    """``KEY/OUTPUT`` of its picture; empty where there is none"""


class PastRuns(Message):
    """The runs that the store knows."""

    runs: tuple[PastRun, ...]
    """the last ones first"""
    found: int
    """how many there are of these"""
    corrections: int
    """versions of spots of results, which are not among them"""


class FlowEntry(Message):
    """A flow that ships."""

    name: str
    about: str


class BadPlace(Message):
    """A pixel of a result about which the texture is unlike the exemplar."""

    row: int
    column: int
    value: float


class Insight(Message):
    """What a result tells; the payload are row and column of each pixel's exemplar pixel, in 16 bits."""

    height: int
    """px; 0 where it is not known where pixels come from"""
    width: int
    places: tuple[BadPlace, ...]
    """the worst first"""


class Layer(Message):
    """What is shown as one picture."""

    name: str
    height: int
    width: int


class ExrContents(Message):
    """What an EXR holds."""

    key: str
    """for the addresses of tiles"""
    layers: tuple[Layer, ...]
    about: str
    """sizes, channels and provenance, as YAML"""
