"""Borders of Wang tiles: strips of texture that are the same wherever their colour occurs."""

import dataclasses
import logging
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Float64, Int64
from pydantic import Field

from texloom.stages.analysis.structure.element_size import element_size
from texloom.stages.common.features.maps import check_weights
from texloom.stages.common.grids.pyramid import halved_size, resize
from texloom.stages.common.grids.size_checks import check_patch
from texloom.stages.common.grids.wang import Kind, WangSet
from texloom.stages.common.similarity.neighbourhoods import Rectangles
from texloom.stages.kernels.core.elementary_functions import log
from texloom.stages.numerics.matrices import matrix_product, pseudo_inverse
from texloom.stages.synthesis.tiles.border_waves import BorderWaves
from texloom.stages.synthesis.tiles.tile_corners import plain_places
from texloom.stages.synthesis.tiles.tile_materials import TileMaterials, band_points
from texloom.stages.synthesis.tiles.tile_synthesis import TileSynthesis, Torus, WangParams
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.declare import InputError, Outline, stage
from texloom.stages.vocabulary.progress import part
from texloom.stages.vocabulary.sizes import SIDES

_SIDES = (64, 256)  # px of a tile, where none is asked for
_NEAR = (0.75, 1.5)  # of that side, among which one that fits the lattice is chosen
_MOST_MISSED = 1 / 8  # of the shortest step of a lattice, by which a tile may miss whole cells
_CLOSE = 0.5  # px that the lattice may miss a tile's side by before one less near is preferred
Repeats: TypeAlias = Annotated[int, Field(ge=1, le=10)]
Lines: TypeAlias = Int64[np.ndarray, " lines"]  # type: ignore[name-defined]
_LARGEST_ELEMENT = 1 / 3  # of a tile's side; larger ones cannot lie in its interior
_MEASURED = 512  # px, above which elements are measured at half the size
_MOST_PIXELS = 2**28  # of an atlas, as of pictures that are read
_log = logging.getLogger(__name__)


class WangBordersParams(WangParams):
    """The set of tiles."""

    kind: Kind = "edges"
    """what has a colour: `edges`: tiles fit where the colours of their sides are the same, and all tiles have the
    same corners; `corners`: where those of their corners are, so that corners do not repeat"""
    colors: Literal[1, 2, 3] = 2
    """number of colours in each direction: a complete set has 1, 16 or 81 tiles"""
    variants: Annotated[tuple[Repeats, Repeats], SIDES] = (1, 1)
    """how often the complete set is repeated, columns x rows as 4x2, with the same borders and other interiors"""
    tile: int | None = Field(None, ge=24, le=2048)
    """side of a tile, px; null: half the exemplar's shorter side, between 64 and 256. With a lattice, the nearest
    side that contains whole cells"""
    border: int | None = Field(None, ge=4, le=256)
    """px on each side of a border that belong to it; null: a twelfth of the tile, at least a patch"""
    waves: float = Field(0.3, ge=0, le=0.5)
    """how far borders between materials wander off straight lines at most, as a share of the distance of points
    with materials: of a tile's side by corners, of half of it by edges"""


@dataclasses.dataclass(frozen=True)
class WangBorders:
    """An atlas whose tiles have borders only."""

    image: Image
    """each pixel continues the nearest border"""
    match: Correspondence
    """source of each pixel in the exemplar"""
    keep: Mask
    """true on the borders, which interiors are made to fit to"""
    filled: Mask
    """true there and as far again beside them, where interiors may begin"""
    table: dict[str, Any]
    """`kind`, `colors` and `variants`; `size`, the side of a tile, and `border`, px; with materials `waves`, and
    the seed of their `noise`"""


def check_size(params: WangBordersParams, known: Mapping[str, Any]) -> None:
    """The exemplar contains patches, a tile its borders, and the atlas not too many pixels."""
    image = known.get("image")
    if image is not None:
        check_weights(params.weights, image.channels)
        check_patch(image, params.patch_size)
        side = params.tile or _usual_side(min(image.height, image.width))
        border = _border(side, params)
        if side < 4 * border:
            raise InputError(
                f"tile: {side} px are too small for borders of {border} px; the minimum is {4 * border} px"
            )
        rows, columns = WangSet(params.colors, params.kind, params.variants).shape
        if rows * columns * side**2 > _MOST_PIXELS:
            raise InputError(
                f"tile: {rows * columns} tiles of {side} px are {rows * columns * side**2} px in all, at most "
                f"{_MOST_PIXELS}; take smaller ones, or fewer variants or colors"
            )


def outlines(params: WangBordersParams, known: Mapping[str, Any]) -> dict[str, Outline]:  # noqa: ARG001
    """Sizes follow from the lattice."""
    return {}


def _usual_side(shorter: int) -> int:
    return int(np.clip(shorter // 2, *_SIDES))


def _border(side: int, params: WangBordersParams) -> int:
    return params.border or max(params.patch_size, side // 12)


def core(border: int) -> int:
    """Px beside a border that all tiles with its colour share, of the ``border`` px that interiors fit to."""
    return border // 2 + 1


def _reach(tile: int, border: int) -> int:
    """px on each side of a border up to which an interior may begin; the middle of a tile is beyond."""
    return min(max(2 * border, tile // 4), 3 * tile // 8)


def tile_side(wanted: int, generators: Vectors | None) -> tuple[int, float]:
    """The side near ``wanted`` that contains whole cells of a lattice, and the px by which it misses them."""
    if generators is None or not len(generators):
        return wanted, 0.0
    sides = np.arange(round(wanted * _NEAR[0]), round(wanted * _NEAR[1]) + 1)
    missed = _missed(sides, generators)
    cost = np.maximum(missed, _CLOSE) + 2.0 * np.abs(log(sides / wanted))
    best = int(np.argmin(cost))
    return int(sides[best]), float(missed[best])


def fitting(generators: Vectors | None, tile: int) -> Vectors | None:
    """The lattice, or None where tiles of this side do not contain whole cells of it, as where these are larger."""
    if generators is None or not len(generators):
        return None
    shortest = float(np.hypot(*generators.astype(np.float64).T).min())
    return generators if _missed(np.array([tile]), generators)[0] <= _MOST_MISSED * shortest else None


def _missed(
    sides: Int64[np.ndarray, " sides"],  # type: ignore[name-defined]
    generators: Vectors,
) -> Float64[np.ndarray, " sides"]:  # type: ignore[name-defined]
    """Px between each side of a tile, down and across, and the nearest step of a lattice; the larger of both."""
    own = generators.astype(np.float64)
    missed = np.zeros(len(sides))
    for axis in (0, 1):
        vectors = np.zeros((len(sides), 2))
        vectors[:, axis] = sides
        steps = matrix_product(vectors, pseudo_inverse(own))
        missed = np.maximum(missed, np.hypot(*matrix_product(np.rint(steps) - steps, own).T))
    return missed


def tell_large_elements(image: Image, rectangles: Rectangles | None, tile: int) -> None:
    """Warn of exemplars whose elements, as stones, are too large for the interior of a tile."""
    whole = np.array([[0, 0, image.height, image.width]])
    for number, (row, column, height, width) in enumerate(
        (whole if rectangles is None else rectangles).tolist(), 1
    ):
        own = image.elsewhere(np.ascontiguousarray(image.pixels[row : row + height, column : column + width]))
        while min(own.height, own.width) > _MEASURED:
            own = own.elsewhere(resize(own.pixels, *halved_size((own.height, own.width), 1), bilinear=True))
        size = element_size(own) * height / own.height
        if size > _LARGEST_ELEMENT * tile:
            _log.warning(
                "elements of about %d px in %s are larger than a third of tiles of %d px: they are cut, or return "
                "in every tile; take tiles of %d px or more",
                round(size), "the exemplar" if rectangles is None else f"exemplar {number}", tile,
                round(size / _LARGEST_ELEMENT),
            )  # fmt: skip


def offsets(length: int, tile: int) -> tuple[Lines, Lines]:
    """Number of the multiple of ``tile`` that each of ``length`` lines of pixels is nearest to, and px from it on.

    Multiples are the lines between pixels: the pixel after one is 0 px from it, that before it -1 px.
    """
    lines = np.arange(length)
    nearest = (lines + tile // 2) // tile
    return nearest % (length // tile), lines - nearest * tile


def to_borders(
    shape: tuple[int, int], tile: int
) -> tuple[Int64[np.ndarray, " rows"], Int64[np.ndarray, " columns"]]:  # type: ignore[name-defined]
    """Px between each row of an atlas and the nearest border across, and between each column and those down."""
    down, across = (
        np.where(offset < 0, -1 - offset, offset) for _, offset in (offsets(side, tile) for side in shape)
    )
    return down, across


@stage(version=2, check=check_size, outlines=outlines)
def wang_borders(
    image: Image,
    params: WangBordersParams,
    rng: np.random.Generator,
    structure: Mask | None = None,
    guidance: ScalarMap | None = None,
    weight: float = 1.0,
    generators: Vectors | None = None,
    rectangles: Rectangles | None = None,
) -> WangBorders:
    """Synthesise the borders of a complete set of Wang tiles, and lay them out as an atlas.

    Corners of each colour are squares of the exemplar as they are, from where it is least special; with a lattice,
    or where the exemplar has no such square, a first torus gives them. Two bands, one across and one down, contain
    each border once, between the corners at its ends, which are fixed while the main method synthesises the rest.
    The borders are then copied to wherever they occur in the atlas, a torus that contains every tile once, beside
    tiles that it fits.

    Parameters
    ----------
    image : the exemplar; its masked pixels are never copied.
    structure, guidance, weight, generators : of the exemplar, see `initialise` and `optimise`.
    rectangles : of two or three exemplars in one picture, see `exemplar_sheet`: corners or edges have the materials
        as colours, whatever ``colors`` is, and the texture leads from one to the other between them. Where edges
        have them, all corners have the first material, in which the others lie like paths.

    Raises
    ------
    InputError
        the exemplar does not contain a patch, or a tile not its borders.

    References
    ----------
    [Cohen2003]_ for coloured edges, where a tile is cut from four diamonds of the exemplar; [Lagae2006]_ for
    coloured corners; [Wei2004]_ for the atlas. Synthesis with fixed borders is ours.
    """
    materials = None
    layout = WangSet(params.colors, params.kind, params.variants)
    if rectangles is not None:
        if not 2 <= len(rectangles) <= 3:
            raise InputError(f"exemplars: tiles between materials need two or three, got {len(rectangles)}")
        materials = TileMaterials.of(image, rectangles)
        layout = WangSet(len(rectangles), params.kind, params.variants)
    wanted = params.tile or _usual_side(
        min(image.height, image.width) if rectangles is None else int(rectangles[:, 2:].min())
    )
    tile, missed = tile_side(wanted, generators)
    has_lattice = fitting(generators, tile) is not None
    if not has_lattice and generators is not None and len(generators):
        tile, generators = wanted, None
        _log.warning("no tile near %d px contains whole cells of the lattice, which tiles do not keep", wanted)
    elif tile != wanted and params.tile:
        _log.warning(
            "tiles of %d px, not %d: these contain whole cells of the lattice, to %.1f px", tile, wanted, missed
        )
    if not has_lattice:
        tell_large_elements(image, rectangles, tile)
    border = _border(tile, params)
    first, *randoms = rng.spawn(3)
    corners, numbers = layout.band
    # Of a band only what is near its line is used. Cells of a lattice and even use need whole tiles.
    colors, reach = int(corners.max() + 1), _reach(tile, border)
    height = tile if materials is None else min(tile, 2 * reach + 2 * params.patch_size)
    synthesis = TileSynthesis(
        image, guidance, weight, generators, tile, border, params, materials,
        kind=layout.kind, pixels=len(numbers) * tile * height,
    )  # fmt: skip
    points = band_points(layout)
    table: dict[str, Any] = {"kind": layout.kind, "colors": layout.colors, "variants": list(params.variants)}
    table |= {"size": tile, "border": border}
    if materials is not None:
        table |= {"waves": params.waves, "noise": int(first.integers(2**24))}
    waves = BorderWaves.of(table)
    shown = None if rectangles is None else rectangles[:colors]
    places = None if has_lattice else plain_places(image, shown, colors, reach)
    if places is not None:
        start = Torus.of_exemplar(image)
    else:
        with part(0.0, 0.3):
            start = synthesis.start(colors, height, structure, first)
        places = np.array([[0, color * height] for color in range(colors)])

    bands = []
    (corner, along), (_, across) = offsets(tile * len(numbers), tile), offsets(height, height)
    row_of, column_of = places[corners[corner]].T
    for axis, random in enumerate(randoms):
        if axis == 0:
            known = start.at(across[:, None] + row_of, column_of + along)
        else:
            known = start.at((row_of + along)[:, None], column_of[:, None] + across)
        # The bands have the same corners wherever interiors fit to them, so that all borders continue each other.
        widths = (2 * border - core(border), border, reach)
        lines = (across, along) if axis == 0 else (along, across)
        keep, shared, filled = (_squares(*lines, width) for width in widths)
        near = (across >= -border) & (across < border)
        parts = near[:, None] * (1 + np.arange(len(along)) // (tile // 2))
        with part(0.3 + 0.35 * axis, 0.65 + 0.35 * axis):
            line, halves = (points, parts) if axis == 0 else (points.T, parts.T)
            wandering = None if waves is None else waves.band(axis, height)
            bands.append(
                synthesis.completed(known, keep, shared, filled, line, random, halves, displacement=wandering)
            )

    down, across = (np.arange(tile * count) for count in layout.shape)
    (row, below), (column, beside) = (offsets(len(lines), tile) for lines in (down, across))
    upper, left = layout.borders
    place = np.argsort(numbers, kind="stable") * tile
    rows = bands[0].at(below[:, None], place[upper[row[:, None], across // tile]] + across % tile)
    columns = bands[1].at(place[left[down[:, None] // tile, column]] + (down % tile)[:, None], beside)
    to_row, to_column = to_borders((len(down), len(across)), tile)
    nearer, farther = np.minimum(to_row[:, None], to_column), np.maximum(to_row[:, None], to_column)
    is_row = to_row[:, None] <= to_column
    atlas = start.image.elsewhere(np.where(is_row[..., None], rows.image.pixels, columns.image.pixels))
    match = np.where(is_row[..., None], rows.match, columns.match)
    keep = nearer < border
    # Between two borders, at the diagonals, neither is continued.
    filled = keep | ((nearer < reach) & (farther > nearer + 1))
    return WangBorders(atlas, match, keep, filled, table)


def _squares(
    down: Int64[np.ndarray, " rows"],  # type: ignore[name-defined]
    across: Int64[np.ndarray, " columns"],  # type: ignore[name-defined]
    width: int,
) -> Mask:
    """True around the corners of tiles, to ``width`` px in each direction, from px after the corners."""
    rows, columns = ((line >= -width) & (line < width) for line in (down, across))
    return np.asarray(rows[:, None] & columns)
