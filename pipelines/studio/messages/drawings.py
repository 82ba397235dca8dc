"""What is drawn on the layers of a material, with which they are drawn on again."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from texloom.pipelines.studio.messages.message import Message
from texloom.pipelines.studio.messages.recipes import Number, PhotoRecipe
from texloom.pipelines.studio.messages.requests import LatticeVertices

Angle = Annotated[float, Field(ge=-180, le=180)]


class DrawnPlace(Message):
    """A place of a picture, px; pixel 0 reaches from 0 to 1."""

    x: Number
    y: Number


class Piece(Message):
    """A piece of an exemplar, as `rectify_pieces` lays it."""

    outline: tuple[DrawnPlace, ...] = Field(min_length=3, max_length=4096)
    """in the exemplar"""
    at: DrawnPlace
    """where the middle of its bounding box lies in the result"""
    angle: Angle
    """degrees, counter-clockwise"""
    scale: float = Field(gt=0, le=100)


class DrawnCollage(Message):
    """The layer Collage."""

    pieces: tuple[Piece, ...] = Field(max_length=256)
    strength: int = Field(ge=0, le=100)
    """of what is kept of them, percent"""


Hit = tuple[Number, Number, Number, Number, Number, Number, Number, Number]
"""a place of a mesh: position, normal, and row and column in its texture, 0 to 1"""


class DrawnMesh(Message):
    """The layer Mesh."""

    mesh: str = Field(max_length=512)
    """its id"""
    side: int = Field(ge=16, le=8192)
    """of the texture, px"""
    control: str = Field(max_length=512)
    """id of the picture that says how much there is in the exemplar; empty: none"""
    strokes: tuple[tuple[Hit, ...], ...] = Field(max_length=4096)
    amounts: str = Field(max_length=2**19)
    """how much is painted, as the address of a grey PNG of 512 px; empty: nothing is"""


class DrawnPaint(Message):
    """The layer Paint."""

    control: str = Field(max_length=512)
    """id of the map that says what is where in the picture; empty: its brightness"""
    side: int = Field(ge=16, le=2048)
    """of the canvas, px"""
    map: str = Field(max_length=2**19)
    """what is painted, as the address of a grey PNG"""


class Drawing(Message):
    """What is drawn on all layers of a material that are no pictures themselves."""

    picture: str = Field("", max_length=512)
    """id of that on which it is drawn"""
    collage: DrawnCollage | None = None
    lattice: LatticeVertices | None = None
    mesh: DrawnMesh | None = None
    paint: DrawnPaint | None = None
    surfaces: PhotoRecipe | None = None
