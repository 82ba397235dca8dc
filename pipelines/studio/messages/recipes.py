"""What decides a result: flows with their sources and params, and surfaces in photographs."""

from __future__ import annotations

from typing import Annotated, Literal

import pydantic
from pydantic import Field

from texloom.pipelines.studio.messages.message import Message, Side
from texloom.stages.vocabulary.sizes import LENGTHS, SIDES

MOST_PICTURES = 16
"""of one source"""
Number = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
Grid = Annotated[str, Field(pattern=r"^[1-9]\d?x[1-9]\d?$")]
"""``COLUMNSxROWS`` of tiles"""
Params = dict[
    str,
    float
    | int
    | bool
    | Literal["labels", "values", "noise", "cells", "corners", "deep", "high"]
    | Grid
    | tuple[int, int],
]
"""``STEP.PARAM`` to its value"""
Lists = Annotated[
    dict[str, Annotated[tuple[Number, ...], Field(min_length=1, max_length=64)]], Field(max_length=16)
]
"""``STEP.PARAM`` to its numbers"""


class Recipe(Message):
    """A flow with its sources and params: all that decides a result."""

    flow: str = Field(max_length=64)
    sources: dict[str, str | Annotated[tuple[str, ...], Field(min_length=1, max_length=MOST_PICTURES)]]
    """name to the id of a picture, or to those of several, in their order"""
    mask: str | None = None
    """id of a picture, black where the first source must not be used"""
    size: Annotated[tuple[Side, Side], SIDES] | None = None
    """``WIDTHxHEIGHT``, px"""
    tileable: Literal["off", "x", "y", "both"] | None = None
    seed: int = Field(7, ge=0, lt=2**53)
    preset: str | None = Field(None, max_length=64)
    params: Params = Field({})
    lists: Lists = Field({})
    """of `texloom.pipelines.studio.methods.WEIGHTS`, one for each of several pictures"""
    files: dict[str, str] = Field({})
    """``STEP.PARAM`` to the id of a document, as of pieces or vertices"""
    layout: str | None = Field(None, max_length=64)
    """the program that the maps are written for, one of `Start`"""
    udim: Grid | None = None
    """tiles into which these are cut"""
    material: str | None = Field(None, max_length=64)
    """the name with which the files of a layout begin"""


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
