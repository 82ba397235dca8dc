"""Over the socket, to the page."""

from __future__ import annotations

from typing import Literal

from texloom.pipelines.studio.messages.message import Message, Share
from texloom.pipelines.studio.messages.projects import MaterialChanged, ProjectSaved
from texloom.pipelines.studio.messages.recipes import Spots
from texloom.pipelines.studio.messages.requests import LatticeVertices
from texloom.pipelines.studio.messages.runs import Job


class Connected(Message):
    """The first message over a socket; it has no number."""

    kind: Literal["connected"] = "connected"
    is_new: bool
    """whether nothing is known of this page: what it asked for before has to be asked for again"""


class PreviewPicture(Message):
    """A preview so far; the payload are its pixels, R G B A in sRGB."""

    kind: Literal["preview_picture"] = "preview_picture"
    number: int
    height: int
    width: int
    scale: float
    """of the preview relative to the result"""
    done: Share
    is_final: bool


class AlternativePicture(Message):
    """What one seed makes of a region, with what is around it; the payload are pixels as of `PreviewPicture`."""

    kind: Literal["alternative_picture"] = "alternative_picture"
    number: int
    seed: int
    top: int
    """of the part in the texture, px"""
    left: int
    height: int
    width: int


class PaintProgress(Message):
    """How far the summary of a texture is."""

    kind: Literal["paint_progress"] = "paint_progress"
    number: int
    step: str
    done: Share


class PaintSummarised(Message):
    """A texture is summarised."""

    kind: Literal["paint_summarised"] = "paint_summarised"
    number: int


class PaintOpened(Message):
    """A canvas is ready; `PaintPicture` of all of it follows."""

    kind: Literal["paint_opened"] = "paint_opened"
    number: int
    control: str
    """id of the control map; of a draft as it was asked for"""


class PaintPicture(Message):
    """A part of the texture has changed; the payload are pixels as of `PreviewPicture`."""

    kind: Literal["paint_picture"] = "paint_picture"
    number: int
    top: int
    left: int
    height: int
    width: int


class PhotoPatch(Message):
    """A patch: what is wrong with it, if anything, and the parameters at which lines of a square grid run, 0..1."""

    name: str
    problem: str
    rows: tuple[float, ...]
    """down; empty while a patch of the photograph is invalid"""
    columns: tuple[float, ...]


class PhotoState(Message):
    """The patches of a photograph; the first answer to a `PhotoRequest`."""

    kind: Literal["photo_state"] = "photo_state"
    number: int
    patches: tuple[PhotoPatch, ...]


class PhotoProposal(Message):
    """Planes that are evident from the lines of the photograph, the best first."""

    kind: Literal["photo_proposal"] = "photo_proposal"
    number: int
    planes: tuple[Spots, ...]
    """corners"""


class PhotoPreview(Message):
    """A patch from the front; the payload are pixels as of `PreviewPicture`."""

    kind: Literal["photo_preview"] = "photo_preview"
    number: int
    height: int
    width: int


class PhotoArea(Message):
    """An area has changed; the payload are its pixels at a reduced size, one byte each, 255 inside."""

    kind: Literal["photo_area"] = "photo_area"
    number: int
    name: str
    height: int
    width: int


class PhotoLines(Message):
    """Lines along the texture; the payload are rows and columns of their points as float32, first lines down."""

    kind: Literal["photo_lines"] = "photo_lines"
    number: int
    lines: int
    """of each direction"""
    points: int
    """of a line"""


class LatticePicture(Message):
    """A lattice; the payload are the pixels of the straightened picture, as of `PreviewPicture`."""

    kind: Literal["lattice_picture"] = "lattice_picture"
    number: int
    lattice: LatticeVertices
    vertices: tuple[tuple[int, int, float, float], ...] = ()
    """all, also those that follow the placed ones"""
    problem: str = ""
    """what is wrong with the lattice; then nothing else is new"""
    height: int = 0
    width: int = 0


class PreviewFailed(Message):
    """A preview, alternatives, a canvas or what was asked of a photograph cannot be made."""

    kind: Literal["preview_failed"] = "preview_failed"
    number: int
    problem: str


class JobChanged(Message):
    """The state of a run."""

    kind: Literal["job_changed"] = "job_changed"
    job: Job


class JobPicture(Message):
    """What a run has made so far; the payload are pixels as of `PreviewPicture`."""

    kind: Literal["job_picture"] = "job_picture"
    job: str
    height: int
    width: int


ToPage = (
    AlternativePicture
    | MaterialChanged
    | ProjectSaved
    | Connected
    | LatticePicture
    | PaintOpened
    | PaintPicture
    | PaintProgress
    | PaintSummarised
    | PhotoArea
    | PhotoLines
    | PhotoPreview
    | PhotoProposal
    | PhotoState
    | PreviewPicture
    | PreviewFailed
    | JobChanged
    | JobPicture
)
