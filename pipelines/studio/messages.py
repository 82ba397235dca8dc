"""The messages between the page and the server, of which `texloom.pipelines.studio.typescript` makes types."""

from __future__ import annotations

import struct
from typing import Annotated, Literal

import pydantic
from pydantic import Field

from texloom.stages.vocabulary.sizes import LENGTHS, SIDES

Side = Annotated[int, Field(ge=2, le=32768)]
"""px"""
CanvasSide = Annotated[int, Field(ge=2, le=2048)]
Share = Annotated[float, Field(ge=0, le=1)]

_LENGTH = struct.Struct("<I")


class Message(pydantic.BaseModel):
    """A message; unknown fields are refused."""

    model_config = pydantic.ConfigDict(extra="forbid", frozen=True)


# -- what there is


class Picture(Message):
    """A picture or a folder of material maps that a flow can start from."""

    id: str
    """``folder:PATH``, ``dropped:PATH``, ``run:PATH``, ``shipped:PATH``, ``texloom:NAME`` or ``skimage:NAME``"""
    name: str
    height: int
    width: int
    is_material: bool
    """whether it is a set of maps"""


class Method(Message):
    """A flow that makes a texture of one exemplar."""

    flow: str
    about: str
    size: Annotated[tuple[int, int], SIDES]
    """the default one, ``WIDTHxHEIGHT``, px"""
    can_tile: bool
    presets: tuple[str, ...]
    uniformity: str
    """the param of spatial uniformity, as ``texture.occurrence``; empty where there is none"""
    default_uniformity: float


class Start(Message):
    """What the page begins with."""

    folder: str
    store: str
    version: str
    pictures: tuple[Picture, ...]
    examples: tuple[Picture, ...]
    meshes: tuple[str, ...]
    """ids: ``folder:PATH``, ``dropped:PATH`` or ``texloom:NAME``"""
    mesh_suffixes: tuple[str, ...]
    """of files that are meshes, with the dot"""
    methods: tuple[Method, ...]
    layouts: tuple[str, ...]
    """programs that material sets can be written for"""


class Problem(Message):
    """Why a request is refused; one line."""

    problem: str


# -- making a texture


class Recipe(Message):
    """A flow with its sources and params: all that decides a result."""

    flow: str = Field(max_length=64)
    sources: dict[str, str]
    """name to the id of a picture"""
    mask: str | None = None
    """id of a picture, black where the first source must not be used"""
    size: Annotated[tuple[Side, Side], SIDES] | None = None
    """``WIDTHxHEIGHT``, px"""
    tileable: Literal["off", "x", "y", "both"] | None = None
    seed: int = Field(7, ge=0, lt=2**53)
    preset: str | None = Field(None, max_length=64)
    params: dict[str, float | int | bool | Literal["labels", "values"] | tuple[int, int]] = {}
    """``STEP.PARAM`` to its value"""
    files: dict[str, str] = {}
    """``STEP.PARAM`` to the id of a document, as of pieces or vertices"""
    layout: str | None = Field(None, max_length=64)
    """the program that the maps are written for, one of `Start`"""


# -- surfaces in photographs

Coordinate = Annotated[float, Field(ge=-1e5, le=1e5, allow_inf_nan=False)]
Spot = tuple[Coordinate, Coordinate]
"""row and column, px of the photograph"""
Spots = tuple[Spot, Spot, Spot, Spot]
Positive = Annotated[float, Field(gt=0, le=1e5, allow_inf_nan=False)]
Weights = tuple[Coordinate, Coordinate, Coordinate, Coordinate]


class PatchRecipe(Message):
    """A patch as a geometry file has it: a plane with corners, or a curved patch with controls and weights."""

    name: str = Field(min_length=1, max_length=64)
    corners: Spots | None = None
    controls: tuple[Spots, Spots, Spots, Spots] | None = None
    weights: tuple[Weights, Weights, Weights, Weights] | None = None
    size: Annotated[tuple[Positive, Positive], LENGTHS] | None = None
    """``WIDTHxHEIGHT`` in any unit, as of a geometry file"""
    edge: Positive | None = None


class BrushRecipe(Message):
    """A change of an area: a brush along points, a polygon, pixels like one, or all features of the photograph."""

    tool: Literal["stroke", "outline", "fill", "features"]
    erase: bool = False
    points: tuple[Spot, ...] = Field((), max_length=4096)
    radius: float = Field(8.0, gt=0, le=256)
    """px; of features their width"""
    tolerance: float = Field(8.0, ge=0, le=100)
    """difference of colour, CIELAB, up to which pixels are like the one, or from which features differ"""
    features: Literal["dark", "bright", "both"] = "dark"

    @pydantic.model_validator(mode="after")
    def _has_points(self) -> BrushRecipe:
        if len(self.points) < {"stroke": 1, "outline": 3, "fill": 1, "features": 0}[self.tool]:
            raise ValueError("too few points")
        return self


class PhotoRecipe(Message):
    """A photograph, patches on its surfaces, and areas as they were painted, by the names of a geometry file."""

    photo: str
    """id of a picture"""
    patches: tuple[PatchRecipe, ...] = Field((), max_length=64)
    areas: dict[str, Annotated[tuple[BrushRecipe, ...], Field(max_length=2000)]] = Field({}, max_length=16)
    """``region``, ``without``, ``hole`` or ``features.NAME`` to the changes that made it"""


class KeptPhoto(Message):
    """The geometry file of a `PhotoRecipe`."""

    kind: Literal["kept_photo"] = "kept_photo"
    geometry: str
    """its id"""


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


class Job(Message):
    """A run at full size."""

    id: str
    name: str
    recipe: Recipe
    state: JobState
    step: str = ""
    text: str = ""
    """what a person is told: scale and iteration, or why it failed"""
    done: Share = 0.0
    """of the current step"""
    seconds: float = 0.0
    """of the run, when it has ended"""
    files: tuple[str, ...] = ()
    """the exports, by their names"""
    saved: str = ""
    """the folder beside the pictures in which they have been saved"""
    scores: dict[str, float] = {}
    texture: str = ""
    """id of the result as a picture that flows can take"""
    maps: dict[str, str] = {}
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


class Layers(Message):
    """What an EXR holds."""

    key: str
    """for the addresses of tiles"""
    layers: tuple[Layer, ...]
    about: str
    """sizes, channels and provenance, as YAML"""


# -- over the socket: to the server


class PreviewRequest(Message):
    """Make a small picture of a recipe; an earlier preview of this page is cancelled."""

    kind: Literal["preview"] = "preview"
    number: int
    """is repeated in the answers"""
    recipe: Recipe
    attached: dict[Annotated[str, Field(pattern=r"^[a-z_]+\.(png|json)$")], int] = Field({}, max_length=16)
    """the bytes of each picture or document that the payload has, one after the other; ids as ``attached:NAME``"""


class AlternativesRequest(Message):
    """Synthesise a region of a texture again with other seeds; cancels as a preview does."""

    kind: Literal["alternatives"] = "alternatives"
    number: int
    recipe: Recipe
    """of the flow ``revise``"""
    seeds: tuple[Annotated[int, Field(ge=0, lt=2**53)], ...] = Field(max_length=16)


class PaintOpenRequest(Message):
    """Summarise a texture with its control map; the payload is the map to begin with, 8 bits a pixel."""

    kind: Literal["paint_open"] = "paint_open"
    number: int
    texture: str
    """id of a picture"""
    control: str
    """id of its control map, a grey picture; empty: its brightness"""
    size: Annotated[tuple[CanvasSide, CanvasSide], SIDES]
    """``WIDTHxHEIGHT``, px"""
    seed: int = Field(7, ge=0, lt=2**53)


class PaintDabRequest(Message):
    """Replace a rectangle of the map by the payload, 8 bits a pixel."""

    kind: Literal["paint_dab"] = "paint_dab"
    number: int
    top: int = Field(ge=0)
    left: int = Field(ge=0)
    height: int = Field(ge=1, le=2048)
    width: int = Field(ge=1, le=2048)


class PhotoRequest(Message):
    """Say what follows from patches and areas; a newer request of this page replaces one that waits."""

    kind: Literal["photo"] = "photo"
    number: int
    recipe: PhotoRecipe
    patch: str = Field("", max_length=64)
    """the one that is seen from the front"""
    side: int = Field(256, ge=16, le=1024)
    """the longer one of that picture, px"""
    streamlines: bool = False
    propose: bool = False
    """propose planes, and nothing else"""


class Lattice(Message):
    """A lattice, as a file of vertices has it."""

    vertices: tuple[tuple[int, int, float, float], ...] = Field(max_length=40_000)
    """that were placed: steps along the two generators, row and column, px"""
    generators: tuple[tuple[float, float], tuple[float, float]] | None = None
    """row and column, px"""


class LatticeRequest(Message):
    """Lay a lattice through the vertices that were placed in a picture, or detect one."""

    kind: Literal["lattice"] = "lattice"
    number: int
    picture: str
    lattice: Lattice | None = None
    """None: detected"""


ToServer = AlternativesRequest | LatticeRequest | PaintDabRequest | PaintOpenRequest | PhotoRequest | PreviewRequest

# -- over the socket: to the page


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


class PaintOpened(Message):
    """A canvas is ready; `PaintPicture` of all of it follows."""

    kind: Literal["paint_opened"] = "paint_opened"
    number: int
    control: str
    """id of the control map"""


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
    lattice: Lattice
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
    | LatticePicture
    | PaintOpened
    | PaintPicture
    | PaintProgress
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

TO_SERVER: pydantic.TypeAdapter[ToServer] = pydantic.TypeAdapter(ToServer)


def packed(message: Message, payload: bytes = b"") -> bytes:
    """A message as it is sent: the length of its JSON as 4 bytes, little-endian, the JSON, the payload."""
    header = message.model_dump_json().encode()
    return _LENGTH.pack(len(header)) + header + payload


def unpacked(frame: bytes) -> tuple[bytes, memoryview]:
    """The JSON and the payload of a message; `ValueError` where it is cut."""
    if len(frame) < _LENGTH.size:
        raise ValueError("a message of less than 4 bytes")
    (length,) = _LENGTH.unpack_from(frame)
    payload = _LENGTH.size + length
    if len(frame) < payload:
        raise ValueError("a message that is cut")
    return frame[_LENGTH.size : payload], memoryview(frame)[payload:]
