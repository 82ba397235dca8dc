"""Over the socket, to the server."""

from __future__ import annotations

from typing import Annotated, Literal

import pydantic
from pydantic import Field

from texloom.pipelines.studio.messages.message import CanvasSide, Message
from texloom.pipelines.studio.messages.recipes import PhotoRecipe, Recipe
from texloom.stages.vocabulary.sizes import SIDES


class PreviewRequest(Message):
    """Make a small picture of a recipe, then finer ones; an earlier preview of this page is cancelled."""

    kind: Literal["preview"] = "preview"
    number: int
    """is repeated in the answers"""
    recipe: Recipe
    attached: dict[Annotated[str, Field(pattern=r"^[a-z_]+\.(png|json)$")], int] = Field({}, max_length=16)
    """the bytes of each picture or document that the payload has, one after the other; ids as ``attached:NAME``"""
    largest: int = Field(0, ge=0, le=16384)
    """px of the longer side of the finest picture, or the full size where that takes seconds; 0: the first alone"""


class PreviewStopRequest(Message):
    """Make no finer pictures: the processors are wanted for something else."""

    kind: Literal["preview_stop"] = "preview_stop"


class AlternativesRequest(Message):
    """Synthesise a region of a texture again with other seeds; cancels as a preview does."""

    kind: Literal["alternatives"] = "alternatives"
    number: int
    recipe: Recipe
    """of the flow ``revise``"""
    seeds: tuple[Annotated[int, Field(ge=0, lt=2**53)], ...] = Field(max_length=16)


class PaintSummaryRequest(Message):
    """Summarise a texture with its control map, so that a canvas of them opens at once."""

    kind: Literal["paint_summary"] = "paint_summary"
    number: int
    texture: str
    """id of a picture"""
    control: str
    """id of its control map, a grey picture; empty: its brightness"""
    seed: int = Field(7, ge=0, lt=2**53)


class PaintOpenRequest(Message):
    """Open a canvas, with a summary of what is not summarised yet; the payload is its map, 8 bits a pixel."""

    kind: Literal["paint_open"] = "paint_open"
    number: int
    texture: str
    """as of `PaintSummaryRequest`"""
    control: str
    """likewise"""
    size: Annotated[tuple[CanvasSide, CanvasSide], SIDES]
    """``WIDTHxHEIGHT``, px"""
    seed: int = Field(7, ge=0, lt=2**53)
    scale: float = Field(1, gt=0, le=1)
    """to which texture and control map are reduced for a draft"""


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


class LatticeVertices(Message):
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
    lattice: LatticeVertices | None = None
    """None: detected"""


Answered = (
    AlternativesRequest
    | LatticeRequest
    | PaintDabRequest
    | PaintOpenRequest
    | PaintSummaryRequest
    | PhotoRequest
    | PreviewRequest
)
"""whose answers have their numbers"""
ToServer = Answered | PreviewStopRequest


TO_SERVER: pydantic.TypeAdapter[ToServer] = pydantic.TypeAdapter(Annotated[ToServer, Field(discriminator="kind")])
