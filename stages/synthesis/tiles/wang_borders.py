"""Borders of Wang tiles: strips of texture that are the same wherever their colour occurs."""

import dataclasses
import logging
import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Float32, Int64
from pydantic import Field

from texloom.stages.common.features.maps import MapWeights, check_weights
from texloom.stages.common.grids.size_checks import check_patch
from texloom.stages.common.grids.wang import Kind, WangSet
from texloom.stages.common.similarity.neighbourhoods import Rectangles
from texloom.stages.kernels.core.elementary_functions import log
from texloom.stages.numerics.matrices import matrix_product, pseudo_inverse
from texloom.stages.synthesis.edits.gradient_domain import GradientDomainParams, gradient_domain
from texloom.stages.synthesis.edits.revise import ReviseParams, Revision
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimisation.optimise import OptimiseParams, optimise
from texloom.stages.synthesis.stitching.overlap import compared
from texloom.stages.synthesis.stitching.seams import FILLED, FREE, KEPT, SeamCosts, cheapest_cut
from texloom.stages.synthesis.tiles.tile_materials import TileMaterials, band_points
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Outline, Params, stage
from texloom.stages.vocabulary.facts import TORUS
from texloom.stages.vocabulary.masks import fill_excluded
from texloom.stages.vocabulary.progress import part
from texloom.stages.vocabulary.sizes import SIDES

_SIDES = (64, 256)  # px of a tile, where none is asked for
_NEAR = (0.75, 1.5)  # of that side, among which one that fits the lattice is chosen
_CLOSE = 0.5  # px that the lattice may miss a tile's side by before one less near is preferred
Repeats: TypeAlias = Annotated[int, Field(ge=1, le=10)]
Lines: TypeAlias = Int64[np.ndarray, " lines"]  # type: ignore[name-defined]
_STARTS = 4  # of a band, among which one is chosen
_MOST_PIXELS = 2**28  # of an atlas, as of pictures that are read
_log = logging.getLogger(__name__)


class WangParams(Params):
    """Parameters of the main method that matter for tiles."""

    preset: Literal["kaspar2015", "default", "fast"] = "default"
    """see `optimise`"""
    patch_size: int = Field(10, ge=3, le=32)
    """side of a patch, px"""
    occurrence: float = Field(10.0, ge=0, le=1e4)
    """weight of spatial uniformity, see `optimise`"""
    weights: MapWeights = Field({})


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
    """`kind`, `colors` and `variants`; `size`, the side of a tile, and `border`, px"""


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
    own = generators.astype(np.float64)
    missed = np.zeros(len(sides))
    for axis in (0, 1):
        vectors = np.zeros((len(sides), 2))
        vectors[:, axis] = sides
        steps = matrix_product(vectors, pseudo_inverse(own))
        missed = np.maximum(missed, np.hypot(*matrix_product(np.rint(steps) - steps, own).T))
    cost = np.maximum(missed, _CLOSE) + 2.0 * np.abs(log(sides / wanted))
    best = int(np.argmin(cost))
    return int(sides[best]), float(missed[best])


@dataclasses.dataclass(frozen=True)
class Torus:
    """A texture that wraps around, and where each of its pixels comes from."""

    image: Image
    match: Correspondence

    def at(self, rows: np.ndarray, columns: np.ndarray) -> "Torus":
        """The torus of these pixels; rows and columns are broadcast and wrapped."""
        rows, columns = rows % self.image.height, columns % self.image.width
        pixels = np.ascontiguousarray(self.image.pixels[rows, columns])
        return Torus(self.image.elsewhere(pixels), np.ascontiguousarray(self.match[rows, columns]))


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


class Synthesis:
    """The main method on one exemplar, which continues what is fixed."""

    def __init__(
        self,
        image: Image,
        guidance: ScalarMap | None,
        weight: float,
        generators: Vectors | None,
        tile: int,
        border: int,
        params: WangParams,
        materials: TileMaterials | None = None,
        guide: Float32[np.ndarray, "h w k"] | None = None,
    ):
        self.image, self.tile, self.materials = image, tile, materials
        self.colors = lab_from_linear(fill_excluded(image).color)
        self.inputs = (guidance, weight, generators)
        self.chosen = {name: getattr(params, name) for name in WangParams.model_fields} | {"period": (tile, tile)}
        # What is fixed would not be continued if it were narrower than a patch at the first scale, nor if a
        # stronger penalty outweighed it there.
        coarsest = min(image.height, image.width) * min(1.0, params.patch_size / (2 * border))
        options = ReviseParams(
            **self.chosen, occurrence_coarse=params.occurrence, coarsest=max(8, math.ceil(coarsest))
        )
        own = guide if materials is None else materials.exemplar
        self.revision = Revision(image, guidance, weight, generators, options, own)

    def start(self, count: int, structure: Mask | None, rng: np.random.Generator) -> Torus:
        """A torus of ``count`` tiles side by side, of the materials one after another."""
        guidance, weight, generators = self.inputs
        starting, optimising = rng.spawn(2)
        guides: dict[str, Any] = {}
        if self.materials is not None:
            wanted = self.materials.between(np.arange(count)[None], self.tile, self.tile * count)
            guides = {"exemplar_guide": self.materials.exemplar, "target_guide": wanted}
        size = InitialiseParams(size=(self.tile, self.tile * count))
        start = initialise(self.image, size, starting, structure, generators, **guides)
        params = OptimiseParams(**self.chosen, tileable=True)
        made = optimise(self.image, start.match, params, optimising, guidance, weight, generators, **guides)
        return self._level(made.image, made.match, None)

    def completed(
        self,
        known: Torus,
        keep: Mask,
        shared: Mask,
        filled: Mask,
        points: Int64[np.ndarray, "m n"],
        rng: np.random.Generator,
        parts: Int64[np.ndarray, "H W"] | None = None,
        wanted: Float32[np.ndarray, "H W k"] | None = None,
    ) -> Torus:
        """A torus that fits to the pixels of ``keep``, and has those of ``shared`` among them unchanged.

        From there on it continues what is known, where ``filled`` is true at most, up to the line along which this
        differs least from what the main method has made: the border of ``keep`` itself would show as a straight
        line, since patches across it are averaged on one side only.

        Of several starts it is the one with least difference between the mean colours of its ``parts``, numbers
        from 1, and that of the exemplar; not where there are several, whose materials ``points`` has. ``wanted``
        is what the guide of the exemplar is to be where.
        """
        if self.materials is not None:
            wanted, parts = self.materials.between(points, known.image.height, known.image.width), None
        block = min(self.tile, self.image.height, self.image.width) // 2
        *placing, optimising = rng.spawn(2 if parts is None else _STARTS + 1)
        with part(0.0, 0.2):
            starts = [
                self.revision.start(
                    known.image, ~keep, known.match, TORUS, random, random, filled, block, parts is None, wanted
                )
                for random in placing
            ]
        if parts is not None:
            starts.sort(key=lambda start: self._deviation(start, parts))
        with part(0.2, 1.0):
            made = self.revision.optimised(known.image, starts[0], keep, TORUS, optimising, keep & ~shared, wanted)
        own = self._cut(known.image, made.image, shared, filled)[..., None]
        joined = known.image.elsewhere(np.where(own, made.image.pixels, known.image.pixels))
        return self._level(joined, np.where(own, made.match, known.match), shared)

    def _cut(self, known: Image, made: Image, shared: Mask, filled: Mask) -> Mask:
        """Where ``made`` is shown and not ``known``, joined along minimum cuts.

        Each tile is cut by itself: those whose lines between them are shared as they are, others from middle to
        middle.
        """
        shift = 0 if shared[0].all() else self.tile // 2
        state = np.where(shared, KEPT, np.where(filled, FREE, FILLED)).astype(np.int8)
        first, second, state = (
            np.roll(plane, shift, (0, 1))
            for plane in (compared(fill_excluded(known)), compared(fill_excluded(made)), state)
        )
        costs = SeamCosts(np.concatenate([first, second]), gradients=False)
        old = np.moveaxis(np.indices(state.shape, np.int32), 0, 2)
        new = old + np.array([state.shape[0], 0], np.int32)
        taken = np.zeros(state.shape, bool)
        for row in range(0, state.shape[0], self.tile):
            for column in range(0, state.shape[1], self.tile):
                at = np.s_[row : row + self.tile, column : column + self.tile]
                taken[at], _ = cheapest_cut(costs, old[at], new[at], state[at])
        return np.roll(taken, -shift, (0, 1))

    def _deviation(self, match: Correspondence, parts: Int64[np.ndarray, "H W"]) -> float:
        """Sum of squared differences of mean colours, CIELAB units."""
        own = self.colors[match[..., 0], match[..., 1]]
        counts = np.bincount(parts.ravel())[1:]
        means = [np.bincount(parts.ravel(), own[..., plane].ravel())[1:] / counts for plane in range(3)]
        return float(((np.stack(means, axis=1) - self.colors.mean(axis=(0, 1))) ** 2).sum())

    def _level(self, image: Image, match: Correspondence, keep: Mask | None) -> Torus:
        """Heights, normals and occlusion without steps at seams."""
        smooth = gradient_domain(self.image, image.wrapping(True), match, GradientDomainParams(), keep)
        return Torus(smooth.image, match)


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

    A first torus gives a corner of each colour. Two bands, one across and one down, contain each border once,
    between the corners at its ends, which are fixed while the main method synthesises the rest. The borders are
    then copied to wherever they occur in the atlas, a torus that contains every tile once, beside tiles that it
    fits.

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
    if tile != wanted and params.tile:
        _log.warning(
            "tiles of %d px, not %d: these contain whole cells of the lattice, to %.1f px", tile, wanted, missed
        )
    border = _border(tile, params)
    synthesis = Synthesis(image, guidance, weight, generators, tile, border, params, materials)
    first, *randoms = rng.spawn(3)
    corners, numbers = layout.band
    points = band_points(layout)
    with part(0.0, 0.3):
        start = synthesis.start(int(corners.max() + 1), structure, first)

    bands = []
    (corner, along), (_, across) = offsets(tile * len(numbers), tile), offsets(tile, tile)
    colors = corners[corner] * tile
    for axis, random in enumerate(randoms):
        if axis == 0:
            known = start.at(across[:, None], colors + along)
        else:
            known = start.at(along[:, None], colors[:, None] + across)
        # The bands have the same corners wherever interiors fit to them, so that all borders continue each other.
        widths = (2 * border - core(border), border, _reach(tile, border))
        keep, shared, filled = (_squares(known, tile, width) for width in widths)
        near = (across >= -border) & (across < border)
        parts = near[:, None] * (1 + np.arange(len(along)) // (tile // 2))
        with part(0.3 + 0.35 * axis, 0.65 + 0.35 * axis):
            line, halves = (points, parts) if axis == 0 else (points.T, parts.T)
            bands.append(synthesis.completed(known, keep, shared, filled, line, random, halves))

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
    filled = keep | ((nearer < _reach(tile, border)) & (farther > nearer + 1))
    table: dict[str, Any] = {"kind": layout.kind, "colors": layout.colors, "variants": list(params.variants)}
    table |= {"size": tile, "border": border}
    return WangBorders(atlas, match, keep, filled, table)


def _squares(torus: Torus, tile: int, width: int) -> Mask:
    """True around the corners of tiles, to ``width`` px in each direction."""
    down, across = (
        (offset >= -width) & (offset < width)
        for _, offset in (offsets(side, tile) for side in (torus.image.height, torus.image.width))
    )
    return np.asarray(down[:, None] & across)
