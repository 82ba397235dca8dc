"""Wang tiles: interiors between borders that fit, and the table that tells which tile fits where."""

import dataclasses
import logging
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Literal

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.analysis.control.guide import contrast
from texloom.stages.common.grids.wang import CORNERS, SIDES, WangSet
from texloom.stages.common.similarity.neighbourhoods import Rectangles, numbers_in
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.synthesis.tiles.border_waves import BorderWaves
from texloom.stages.synthesis.tiles.tile_materials import TileMaterials, edges_shown, material_points
from texloom.stages.synthesis.tiles.tile_synthesis import TileSynthesis, Torus, WangParams
from texloom.stages.synthesis.tiles.wang_borders import core, fitting, to_borders
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask, Vectors
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Outline, stage
from texloom.stages.vocabulary.masks import fill_excluded
from texloom.stages.vocabulary.progress import part

_LAYOUT = 1.0  # deviation of slow colours as a guide, in deviations of the exemplar's colours
_MOST_LAYOUT = 6.0  # times that slow colours are made stronger for it
_SHOWN = 0.5  # share of an edge's middle that has its material, from which on the edge shows it

_LOG = logging.getLogger(__name__)


class WangTilesParams(WangParams):
    """Parameters of the main method that matter for tiles, and how much variants differ."""

    strength: float = Field(1.0, ge=0, le=1)
    """how much variants differ from the first one, 0..1: from the same layout of colours with other details, to new
    ones"""
    layout_scale: float = Field(6.0, ge=1, le=256)
    """deviation of the blur, px, in which variants are like the first one where ``strength`` is below 1"""


@dataclasses.dataclass(frozen=True)
class WangTiles:
    """The complete set."""

    image: Image
    """the atlas, a torus of tiles that fit"""
    match: Correspondence
    """source of each pixel in the exemplar"""
    table: dict[str, Any]
    """`size` of a tile, px; `kind`, `colors` and `variants`; `tiles`, in the order of their colours: for each `x`,
    `y`, the left and upper pixel in the atlas, and the colours of its sides `north`, `east`, `south`, `west`; of
    coloured corners also `northwest`, `northeast`, `southeast`, `southwest`, where sides have a colour for each
    pair"""


def outlines(params: WangTilesParams, known: Mapping[str, Any]) -> dict[str, Outline]:  # noqa: ARG001
    """The image is as the borders'."""
    borders = known.get("borders")
    return {} if borders is None else {"image": Outline(borders.height, borders.width, borders.channels)}


@stage(version=2, outlines=outlines)
def wang_tiles(
    image: Image,
    borders: Image,
    match: Correspondence,
    keep: Mask,
    filled: Mask,
    layout: dict[str, Any],
    params: WangTilesParams,
    rng: np.random.Generator,
    guidance: Float32[np.ndarray, "_ _"] | None = None,
    weight: float = 1.0,
    generators: Vectors | None = None,
    rectangles: Rectangles | None = None,
) -> WangTiles:
    """Synthesise the interiors of Wang tiles between their borders.

    The whole atlas is one torus for the main method, to which the borders are given, so that interiors differ as
    much as other parts of a result. Beyond its innermost pixels, which tiles share, each border passes into the
    interiors along minimum cuts. Tiles are then cut apart along the lines, inside the borders, across which the
    texture changes least; any of these gives tiles that fit. Variants that are to be alike follow the slow colours
    of the first one, as a guide.

    Parameters
    ----------
    image : the exemplar; its masked pixels are never copied.
    borders, match, keep, filled, layout : see `wang_borders`.
    guidance, weight, generators : of the exemplar, see `optimise`.
    rectangles : of several exemplars, see `wang_borders`.

    Raises
    ------
    InputError
        there are several exemplars, and ``strength`` is not 1.

    References
    ----------
    [Cohen2003]_ and [Lagae2006]_; [Wei2004]_ for the atlas; [Kwatra2003]_ for the cuts. [Wei2008]_ section 7
    proposes tiles for compactions. Variants like the first one are ours.
    """
    tiles, size = WangSet.of(layout), int(layout["size"])
    border, generators = int(layout["border"]), fitting(generators, size)
    materials = None if rectangles is None else TileMaterials.of(image, rectangles)
    to_row, to_column = to_borders((borders.height, borders.width), size)
    shared = np.minimum(to_row[:, None], to_column) < core(border)
    known = Torus(borders, match)
    begun = (known, keep, shared, filled)
    synthesis = partial(
        TileSynthesis, image, guidance, weight, generators, size, border, params, materials,
        kind=tiles.kind, pixels=borders.height * borders.width,
    )  # fmt: skip
    if params.strength == 1 or tiles.variants == (1, 1):
        waves = BorderWaves.of(layout)
        displacement = None if waves is None else waves.atlas()
        made = synthesis().completed(*begun, material_points(tiles), rng, displacement=displacement)
    elif materials is not None:
        raise InputError("strength: variants of tiles between materials are new ones; leave it at 1")
    else:
        made = _like_the_first(image, synthesis, begun, tiles, size, params, rng)
    down, across = (_least_change(made.image, axis, size, border // 2) for axis in (0, 1))
    shifted = made.at(np.arange(borders.height)[:, None] + down, np.arange(borders.width) + across)
    if rectangles is not None and tiles.kind == "edges":
        _tell_edges(numbers_in(rectangles, image.height, image.width), shifted.match, tiles, size)
    return WangTiles(shifted.image.wrapping(True), shifted.match, _table(tiles, size))


def _like_the_first(
    image: Image,
    synthesis: Callable[..., TileSynthesis],
    begun: tuple[Torus, Mask, Mask, Mask],
    tiles: WangSet,
    size: int,
    params: WangTilesParams,
    rng: np.random.Generator,
) -> Torus:
    """The atlas whose first variant is synthesised alone, and the others under a guide of its slow colours."""
    first, others = rng.spawn(2)
    known, keep, shared, filled = begun
    one = np.s_[: size * tiles.side, : size * tiles.side]
    alone = known.at(*np.ogrid[one])
    with part(0.0, 0.2):
        corners = tiles.corners[: tiles.side, : tiles.side]
        base = synthesis().completed(alone, keep[one], shared[one], filled[one], corners, first)
    own, wanted = _slow(image, params.layout_scale, "reflect"), _slow(base.image, params.layout_scale, "wrap")
    deviation = float(np.sqrt(own.var(axis=(0, 1), dtype=np.float64).sum()))
    factor = np.float32(
        min(_LAYOUT * contrast(image) / max(deviation, 1e-6), _MOST_LAYOUT) * (1 - params.strength) ** 2
    )
    everywhere = np.tile(wanted * factor, (*tiles.variants, 1))
    with part(0.2, 1.0):
        made = synthesis(guide=own * factor).completed(*begun, tiles.corners, others, wanted=everywhere)
    made.image.pixels[one], made.match[one] = base.image.pixels, base.match
    return made


def _slow(image: Image, deviation: float, beyond: Literal["reflect", "wrap"]) -> Float32[np.ndarray, "h w 3"]:
    """Blurred colours, CIELAB units."""
    lab = lab_from_linear(fill_excluded(image).color)
    margin = min(round(4 * deviation), *(side - 1 for side in lab.shape[:2]))
    around = np.pad(lab, [(margin, margin), (margin, margin), (0, 0)], beyond)
    return np.ascontiguousarray(gaussian_blur(around, deviation)[margin:-margin, margin:-margin])


def _tell_edges(numbers: np.ndarray, match: Correspondence, tiles: WangSet, size: int) -> None:
    """Warn where paths end before the edges that they are to cross."""
    shares = edges_shown(numbers[match[..., 0], match[..., 1]].astype(np.int64) - 1, tiles, size)
    if missing := int((shares[:, 1:] < _SHOWN).sum()):
        _LOG.warning(
            "%d of %d edges that others than the first material cross do not show them: paths end before them; try "
            "larger tiles, the preset default, or another first material",
            missing, shares[:, 1:].size,
        )  # fmt: skip


def _least_change(image: Image, axis: int, size: int, reach: int) -> int:
    """By how many px tiles should begin later, so that colour changes least across their borders."""
    lab = lab_from_linear(fill_excluded(image).color)
    change = np.abs(lab - np.roll(lab, 1, axis=axis)).mean(axis=(1 - axis, 2))
    shifts = np.arange(-reach, reach + 1)
    costs = [change[shift % size :: size].mean() for shift in shifts]
    return int(shifts[int(np.argmin(costs))])


def _table(tiles: WangSet, size: int) -> dict[str, Any]:
    rows = []
    for row, column in tiles.places.tolist():
        colors = dict(zip(SIDES, tiles.tiles[row, column].tolist(), strict=True))
        if tiles.kind == "corners":
            colors |= dict(zip(CORNERS, tiles.tile_corners[row, column].tolist(), strict=True))
        rows.append({"x": column * size, "y": row * size, **colors})
    about = {"size": size, "kind": tiles.kind, "colors": tiles.colors, "variants": list(tiles.variants)}
    return {**about, "tiles": rows}
