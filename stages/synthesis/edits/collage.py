"""A rough collage: pieces of an exemplar, placed, turned and scaled as a file says."""

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
import pydantic
from jaxtyping import Int32
from pydantic import Field

from texloom.stages.kernels.core.elementary_functions import cos, sin
from texloom.stages.numerics.matrices import inverse_of, matrix_product
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Document, InputError, Outline, Params, first_problem, stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.masks import EXCLUSION_CHANNELS, fill_excluded, without_usable
from texloom.stages.vocabulary.normals import NORMAL
from texloom.stages.vocabulary.sizes import Size, format_size
from texloom.stages.vocabulary.tileable import Tileable

_MAX_PIECES = 1024
_MOST_PIXELS = 2**26  # around a piece, if the result has not more

_Number = Annotated[float, Field(ge=-1e5, le=1e5, allow_inf_nan=False)]
_Length = Annotated[float, Field(gt=0, le=1e5, allow_inf_nan=False)]
_Point = tuple[_Number, _Number]


class _Piece(pydantic.BaseModel, extra="forbid"):
    box: tuple[_Number, _Number, _Length, _Length] | None = None
    polygon: Annotated[list[_Point], Field(min_length=3, max_length=4096)] | None = None
    at: _Point
    angle: Annotated[_Number, Field(ge=-360, le=360)] = 0.0
    scale: Annotated[_Number, Field(ge=0.1, le=10)] = 1.0

    @pydantic.model_validator(mode="after")
    def _is_one_shape(self) -> "_Piece":
        if (self.box is None) == (self.polygon is None):
            raise ValueError("want either box or polygon")
        return self

    @property
    def corners(self) -> np.ndarray:
        """Rows and columns in the exemplar, px."""
        if self.polygon is not None:
            return np.array(self.polygon, np.float64)
        row, column, height, width = self.box or (0, 0, 0, 0)
        low, high = np.array([row, column]) - 0.5, np.array([row + height, column + width]) - 0.5
        return np.array([low, [low[0], high[1]], high, [high[0], low[1]]])


class _CollageFile(pydantic.BaseModel, extra="forbid"):
    pieces: Annotated[list[_Piece], Field(min_length=1, max_length=_MAX_PIECES)]


class CollageParams(Params):
    """The pieces, and the size of the collage."""

    pieces: Document | None = None
    """file with a list `pieces`, each with a `box` [row, column, height, width] or a `polygon` [[row, column], ...]
    in the exemplar, `at` [row, column], where the middle of its bounding box lies in the result, `angle`, degrees
    counter-clockwise, and `scale`; px. Later pieces lie over earlier ones"""
    size: Size = (512, 512)
    tileable: Tileable = NOWHERE
    """pieces that cross a border go on at the opposite one"""


@dataclasses.dataclass(frozen=True)
class Collage:
    """The collage."""

    image: Image
    """all channels of the exemplar, and alpha `A`: 0 where nothing is laid"""
    pieces: Int32[np.ndarray, "H W"]
    """number of the piece of each pixel, from 0; -1 where nothing is laid"""


def check_pieces(params: CollageParams, known: Mapping[str, Any]) -> None:
    """The file must list pieces that overlap the exemplar."""
    image = known.get("image")
    pieces = _read(params)
    for index, piece in enumerate(pieces):
        low, high = piece.corners.min(axis=0), piece.corners.max(axis=0)
        where = f"{params.pieces.file}: pieces.{index}" if params.pieces else ""
        if image is not None and ((high < 0).any() or (low > (image.height - 1, image.width - 1)).any()):
            raise InputError(f"pieces: {where}: lies outside the exemplar of {format_size(image)}")
        low, high = _place(piece, params)[2:]
        most = max(_MOST_PIXELS, params.size[0] * params.size[1])
        if (area := int(np.prod(np.maximum(high - low + 1, 0)))) > most:
            raise InputError(f"pieces: {where}: covers {area} px of a tileable result, at most {most}")


def outlines(params: CollageParams, known: Mapping[str, Any]) -> dict[str, Outline]:
    """The collage has the channels of the exemplar, and alpha."""
    image = known.get("image")
    channels = () if image is None else tuple(name for name in image.channels if name not in EXCLUSION_CHANNELS)
    return {"image": Outline(*params.size, (*channels, "A"))}


@stage(version=1, check=check_pieces, outlines=outlines)
def collage(image: Image, params: CollageParams) -> Collage:
    """Lay pieces of an exemplar as a file says; nothing is blended.

    Parameters
    ----------
    image : the exemplar; normals turn with their piece.

    Raises
    ------
    InputError
        the file is missing or names no pieces, or a piece lies outside the exemplar.

    References
    ----------
    [Zhou2024]_ section 3: a rough collage as the layout of a texture. The file is ours.
    """
    from texloom.stages.kernels.core.resample import sampled

    plain = without_usable(fill_excluded(image))
    kept = [index for index, name in enumerate(plain.channels) if name != "A"]
    own = np.ascontiguousarray(plain.pixels[..., kept])
    channels = tuple(plain.channels[index] for index in kept)
    height, width = params.size
    pixels = np.zeros((height, width, len(channels) + 1), np.float32)
    numbers = np.full(params.size, -1, np.int32)
    for number, piece in enumerate(_read(params)):
        corners = piece.corners
        rotation, middle, low, high = _place(piece, params)
        if (high < low).any():
            continue
        grid = np.moveaxis(np.mgrid[low[0] : high[0] + 1, low[1] : high[1] + 1], 0, 2)
        source = matrix_product(grid - piece.at, rotation / piece.scale) + middle
        limits = np.array(own.shape[:2]) - 0.5
        inside = _inside(corners, source) & ((source >= -0.5) & (source <= limits)).all(axis=2)
        if not inside.any():
            continue
        values = sampled(own, np.ascontiguousarray(source))[inside]
        if set(NORMAL) <= set(channels):
            x, y = channels.index(NORMAL[0]), channels.index(NORMAL[1])
            values[:, [x, y]] = matrix_product(values[:, [x, y]], rotation.T.astype(np.float32))
        rows, columns = np.moveaxis(grid[inside] % params.size, 1, 0)
        pixels[rows, columns, :-1] = values
        pixels[rows, columns, -1] = 1
        numbers[rows, columns] = number
    if (numbers < 0).all():
        raise InputError("pieces: none of them lies in the result")
    return Collage(image.elsewhere(pixels, (*channels, "A")).wrapping(params.tileable), numbers)


def _place(piece: _Piece, params: CollageParams) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The rotation of a piece, its middle in the exemplar, and its first and last pixel in the result.

    Offsets in the result, row and column, @ rotation / scale are those in the exemplar. The pixels are within a
    result along axes that do not tile.
    """
    corners = piece.corners
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    angle = np.deg2rad(piece.angle)
    cosine, sine = cos(angle), sin(angle)
    rotation = np.array([[cosine, -sine], [sine, cosine]])  # rows grow downwards
    placed = matrix_product(corners - middle, inverse_of(rotation / piece.scale)) + piece.at
    low, high = np.floor(placed.min(axis=0)).astype(int), np.ceil(placed.max(axis=0)).astype(int)
    around = np.array(params.tileable)
    low = np.where(around, low, np.maximum(low, 0))
    high = np.where(around, high, np.minimum(high, np.array(params.size) - 1))
    return rotation, middle, low, high


def _inside(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether points, (m, n, 2), lie in a polygon, by the number of edges to one side."""
    inside = np.zeros(points.shape[:2], bool)
    for first, second in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        crosses = (first[0] > points[..., 0]) != (second[0] > points[..., 0])
        if first[0] == second[0]:
            continue
        column = first[1] + (points[..., 0] - first[0]) / (second[0] - first[0]) * (second[1] - first[1])
        inside ^= crosses & (points[..., 1] < column)
    return inside


def _read(params: CollageParams) -> list[_Piece]:
    if params.pieces is None:
        raise InputError("pieces: give the file that lists them, as --set collage.pieces=pieces.yaml")
    try:
        return _CollageFile.model_validate(params.pieces.content).pieces
    except pydantic.ValidationError as error:
        raise InputError(f"pieces: {params.pieces.file}: {first_problem(error)}") from None
