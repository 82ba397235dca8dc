"""What a worker process is asked to do, as messages; see `texloom.pipelines.studio.work_loop`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, TypeAdapter

from texloom.pipelines.studio.library import Library
from texloom.pipelines.studio.messages.catalogue import Picture
from texloom.pipelines.studio.messages.hosts import PixelFormat, ResultMap, Submitted
from texloom.pipelines.studio.messages.message import Message
from texloom.pipelines.studio.messages.recipes import PhotoRecipe, Recipe
from texloom.pipelines.studio.messages.requests import (
    AlternativesRequest,
    LatticeRequest,
    PaintDabRequest,
    PaintOpenRequest,
    PaintSummaryRequest,
    PhotoRequest,
    PreviewRequest,
)
from texloom.pipelines.studio.messages.runs import ExrContents


class Places(Message):
    """The folders of a studio."""

    folder: str
    store: str
    scratch: str
    """for what only previews need; removed at the end"""


def library_of(places: Places) -> Library:
    """The pictures of a studio."""
    return Library(Path(places.folder), Path(places.store))


class InsightWork(Message):
    """Look at the result of a recipe in the store; `Insight` comes back."""

    kind: Literal["insight"] = "insight"
    recipe: Recipe


class RunWork(Message):
    """Run a recipe at full size; `Running` comes back, with pictures, and `Ran` at the end."""

    kind: Literal["run"] = "run"
    recipe: Recipe


class Received(Message):
    """A picture that a program has sent."""

    path: str
    pixels: PixelFormat | None = None
    """of raw bytes; none of a file"""


class HostWork(Message):
    """Run what a program has submitted; `Running` comes back, with pictures, and `HostRan` at the end."""

    kind: Literal["host"] = "host"
    submitted: Submitted
    received: dict[str, Received]
    folder: str
    """for its results"""


class SaveWork(Message):
    """Write the exports of a recipe that has been run beside the pictures of the folder; `Saved` comes back."""

    kind: Literal["save"] = "save"
    recipe: Recipe
    name: str
    """of the folder"""


class ThumbnailWork(Message):
    """Make a small picture of the exports of a run; `Encoded` comes back with a PNG."""

    kind: Literal["thumbnail"] = "thumbnail"
    folder: str


class PictureWork(Message):
    """Decode a picture; `Encoded` comes back with a PNG."""

    kind: Literal["picture"] = "picture"
    picture: str
    side: int


class KeepWork(Message):
    """Take received files into the library; `Kept` comes back."""

    kind: Literal["keep"] = "keep"
    received: str
    name: str = ""
    is_mesh: bool = False


class LayersWork(Message):
    """Say what an EXR or another picture holds; `LayersRead` comes back."""

    kind: Literal["layers"] = "layers"
    file: str
    """as a flow file refers to it"""


class TileWork(Message):
    """Make a tile of a layer of an EXR, or of another picture; `Encoded` comes back with a PNG."""

    kind: Literal["tile"] = "tile"
    key: str
    """of `ExrContents`"""
    file: str
    layer: int = Field(ge=0)
    level: int = Field(ge=0, le=16)
    """0: full size; each further one has half the size of the one before"""
    row: int = Field(ge=0)
    column: int = Field(ge=0)


class EndlessWork(Message):
    """Make a tile of an endless texture; `Encoded` comes back with a PNG."""

    kind: Literal["endless"] = "endless"
    recipe: Recipe
    level: int = Field(ge=0, le=2)
    """as of `TileWork`"""
    row: int = Field(ge=-(2**20), lt=2**20)
    """the texture of the recipe begins at tile (0, 0)"""
    column: int = Field(ge=-(2**20), lt=2**20)


class MeshWork(Message):
    """Give a mesh texture coordinates; `Meshed` comes back."""

    kind: Literal["mesh"] = "mesh"
    mesh: str
    """its id"""
    side: int = Field(ge=64, le=8192)
    """of the texture, px"""


class KeepPhotoWork(Message):
    """Write the geometry file of a photograph; `KeptPhoto` comes back."""

    kind: Literal["keep_photo"] = "keep_photo"
    recipe: PhotoRecipe


Work = (
    KeepPhotoWork
    | TileWork
    | EndlessWork
    | MeshWork
    | PhotoRequest
    | PaintOpenRequest
    | PaintSummaryRequest
    | PaintDabRequest
    | AlternativesRequest
    | InsightWork
    | LatticeRequest
    | LayersWork
    | PreviewRequest
    | RunWork
    | HostWork
    | SaveWork
    | ThumbnailWork
    | PictureWork
    | KeepWork
)
"""requests of the page are passed on as they are; answers to these go back to it"""
WORK: TypeAdapter[Work] = TypeAdapter(Work)


class Running(Message):
    """How far a run is; the payload is what it has made so far, if ``height`` is not 0."""

    kind: Literal["running"] = "running"
    step: str
    text: str
    done: float
    height: int = 0
    width: int = 0


class Ran(Message):
    """A run has ended well."""

    kind: Literal["ran"] = "ran"
    out: str
    """the folder of its exports"""
    files: tuple[str, ...]
    scores: dict[str, float]
    texture: str
    exemplar: str
    maps: dict[str, str]


class HostRan(Message):
    """A run of a program has ended well; fields are as of `texloom.pipelines.studio.messages.hosts.HostRun`."""

    kind: Literal["host_ran"] = "host_ran"
    maps: tuple[ResultMap, ...]
    files: tuple[str, ...]
    notes: tuple[str, ...]
    scores: dict[str, float]


class Saved(Message):
    """Where exports have been saved."""

    kind: Literal["saved"] = "saved"
    out: str


class LayersRead(Message):
    """What there is to look at in a picture."""

    kind: Literal["layers_read"] = "layers_read"
    layers: ExrContents


class Encoded(Message):
    """The payload is a PNG."""

    kind: Literal["encoded"] = "encoded"


class Kept(Message):
    """A picture or mesh that can be used from now on."""

    kind: Literal["kept"] = "kept"
    id: str
    picture: Picture | None = None


class Meshed(Message):
    """A mesh; the payload are 8 values of each corner: position, normal, texture coordinates."""

    kind: Literal["meshed"] = "meshed"
    corners: int


class Ended(Message):
    """The work is done, cancelled, or refused with a problem."""

    kind: Literal["ended"] = "ended"
    problem: str = ""
    is_cancelled: bool = False
