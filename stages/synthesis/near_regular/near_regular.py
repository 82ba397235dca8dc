"""Near-regular synthesis: tiles of an exemplar's lattice, drawn at random and cut along their joints."""

import dataclasses
import logging
from functools import partial

import numpy as np
from jaxtyping import Bool, Float64, Int64
from pydantic import Field

from texloom.stages.analysis.regularity.deformed_lattice import Points
from texloom.stages.analysis.regularity.straighten import Positions
from texloom.stages.numerics.matrices import inverse_of, matrix_product
from texloom.stages.synthesis.near_regular.cell_outline import course_outline
from texloom.stages.synthesis.near_regular.course_cells import course_cells
from texloom.stages.synthesis.near_regular.output_lattice import OutputLattice, torus_of
from texloom.stages.synthesis.near_regular.tile_set import COURSE_SHIFT, TileSource, tile_set
from texloom.stages.synthesis.stitching.exemplar import Exemplar, Stitched, StitchingParams, check_exemplar, lab_of
from texloom.stages.synthesis.stitching.seams import SeamCosts
from texloom.stages.vocabulary.arrays import Correspondence, Image, Vectors
from texloom.stages.vocabulary.declare import InputError, stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.normals import with_unit_normals
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.sizes import Size, format_size
from texloom.stages.vocabulary.tileable import Tileable

_LOG = logging.getLogger(__name__)

_MIN_TILES = 2  # complete ones, as the paper asks for
_MIN_SIDE = 8  # px of an exemplar's shorter side
_MIN_CHOICES = 3  # tiles that each is drawn from
_MAX_COMPARED = 500  # pixels of an overlap by which tiles are chosen
_ALIGNED = 1e-3  # of a direction, relative to its length: parallel to a border
_OFFSET = 8.0  # CIELAB units, added to gradients: else flat places outweigh broken contours
_NEIGHBOURS = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))


class NearRegularParams(StitchingParams):
    """Size of the result, and how tiles are chosen and joined."""

    size: Size = (1024, 1024)
    tileable: Tileable = NOWHERE
    """the result continues across its borders; the lattice is stretched and sheared a little to fit"""
    overlap: float = Field(0.2, gt=0, le=0.5)
    """width of the band along a tile's outline in which it is cut, as a share of its shorter side; at least 4 px"""
    choices: float = Field(0.2, gt=0, le=1)
    """each tile is drawn from this share of the tiles, those that match its neighbours best; at least three"""
    shift: int = Field(0, ge=0, le=16)
    """maximum shift of a tile from its lattice position to match its neighbours, px; makes the result less
    regular"""
    blend: int = Field(1, ge=0, le=16)
    """width of the blend on each side of a cut, px; 0 copies only"""


@dataclasses.dataclass(frozen=True)
class NearRegular(Stitched):
    """The texture; interpolated, with rounded ``match``, if the exemplar was straightened."""

    generators: Vectors
    """of the result's lattice, px: those of the exemplar, unless fitted to a tileable result"""
    tiles: int
    """number of whole tiles of the exemplar"""


def _moves(shift: int, along: np.ndarray | None) -> list[tuple[int, int]]:
    """Shifts of a tile that are tried, px, the shortest first.

    Parameters
    ----------
    along : direction of the courses, along which tiles may always move a little; none without courses.
    """
    reach = range(-shift, shift + 1)
    moves = {(i, j) for i in reach for j in reach}
    if along is not None:
        unit = along / np.hypot(*along)
        for step in range(-COURSE_SHIFT, COURSE_SHIFT + 1):
            row, column = np.rint(step * unit).astype(int)
            moves.add((int(row), int(column)))
    return sorted(moves, key=lambda move: (move[0] ** 2 + move[1] ** 2, move))


class _Tiling:
    """The result during synthesis."""

    def __init__(
        self,
        image: Image,
        source: Positions | None,
        generators: np.ndarray,
        vertices: np.ndarray,
        courses: bool,
        params: NearRegularParams,
        rng: np.random.Generator,
    ):
        self.params, self.rng = params, rng
        exemplar = Exemplar(image, lab_of, 100.0, params.weights)
        self.exemplar = exemplar.image
        self.tile_source = TileSource(exemplar, source)
        self.feature_count = self.tile_source.features.shape[2]
        self.elements = None
        if courses:
            features, valid = self.tile_source.features, self.tile_source.valid
            outline = course_outline(features, valid, vertices, generators)
            self.elements = course_cells(features, valid, vertices[0], outline)
        known = None
        if self.elements is not None:
            courses, known, vertices = False, self.elements.outline, self.elements.vertices
            generators = known.generators
        is_torus, torus = bool(params.tileable), torus_of(generators, params.size, params.tileable)
        own = OutputLattice.of(generators, torus, True).generators if is_torus else generators
        self.tiles, outline = tile_set(
            self.tile_source, generators, vertices, own, courses, known, params.overlap, params.shift, rng
        )
        if self.tiles.count < _MIN_TILES:
            _LOG.warning(
                "the exemplar holds %d complete tile, fewer than two: every tile of the result will be the same. "
                "Use a larger part of the texture",
                self.tiles.count,
            )
        self.window = self.tiles.window
        low, high = self.window.offsets.min(axis=0), self.window.offsets.max(axis=0) + 1
        self.low, self.box = low, (int(high[0] - low[0]), int(high[1] - low[1]))
        # The box of a tile with a pixel around, to which cuts are compared.
        self.frame = np.moveaxis(np.indices((self.box[0] + 2, self.box[1] + 2)), 0, -1) + (low - 1)
        self.at = tuple((self.window.offsets - (low - 1)).T)
        self.costs = SeamCosts(self.tile_source.features, gradients=True, squared=True, offset=_OFFSET)
        height, width = params.size
        if is_torus and (self.box[0] > torus[0] or self.box[1] > torus[1]):
            raise InputError(
                f"size: {format_size((height, width))} is smaller than a tile, {format_size(self.box)}"
            )
        # Tiles may extend by a whole tile beyond the result.
        self.margin = (0, 0) if is_torus else self.box
        self.canvas = torus if is_torus else (height + 2 * self.box[0], width + 2 * self.box[1])
        self.lattice = OutputLattice.of(generators, self.canvas, is_torus)
        self.result = np.zeros((self.canvas[0] * self.canvas[1], self.tile_source.pixels.shape[2]), np.float32)
        self.match = np.zeros((self.canvas[0] * self.canvas[1], 2), np.uint32)
        self.filled = np.zeros(self.canvas[0] * self.canvas[1], bool)
        self.cell_of = np.full(len(self.lattice.steps), -1)
        self.uses = np.zeros(self.tiles.count, np.int64)
        self.moves = _moves(params.shift, generators[1] if courses else None)
        # Rows of tiles follow the base.
        frame = inverse_of(np.array([outline.side, outline.base]))
        row, along = matrix_product(matrix_product(self.lattice.steps, generators), frame).T
        self.order = np.lexsort((along, np.rint(row)))

    def run(self) -> None:
        """Lay all tiles that reach into the result."""
        neighbours = self.lattice.neighbours(_NEIGHBOURS)
        # The phase of the result within a cell is random.
        begin = matrix_product(self.rng.random(2), self.lattice.generators)
        corners = np.rint(self._places() + begin).astype(np.int64)
        if self.lattice.tileable:
            corners %= self.canvas
        low = corners + self.low - self.margin
        reaches = ((low < self.params.size) & (low + self.box > 0)).all(axis=1) | self.lattice.tileable
        order = self.order[reaches[self.order]]
        for number, node in enumerate(order.tolist()):
            self._lay(node, corners[node], neighbours[node])
            if number % 64 == 0:
                report(Progress(number / len(order)))
        report(Progress(1.0))

    def _places(self) -> Float64[np.ndarray, "nodes 2"]:
        """Of the nodes; elements of courses have a phase of their own in each."""
        lattice = self.lattice
        if self.elements is None:
            return lattice.places
        base = lattice.generators[1]
        if lattice.tileable and np.abs(base).min() > _ALIGNED * np.abs(base).max():
            return lattice.places  # such courses continue each other across borders
        position = matrix_product(lattice.places, inverse_of(lattice.generators))
        rows = np.rint(position[:, 0]).astype(np.int64)
        return lattice.places + self.elements.offsets(rows, self.rng)[:, None] * base

    def _lay(self, node: int, corner: np.ndarray, neighbours: np.ndarray) -> None:
        at = matrix_product((corner + self.window.offsets) % self.canvas, [self.canvas[1], 1])
        filled = self.filled[at]
        existing = self.result[at, -self.feature_count :]
        beside = self.cell_of[neighbours[neighbours >= 0]]
        tile = self._choose(existing, filled, beside[beside >= 0])
        self.cell_of[node] = self.tiles.cells[tile]
        self.uses[self.tiles.cells[tile]] += 1
        source = self._moved(self.tiles.sources[tile], existing, filled)
        values = self.tile_source.pixels[source[:, 0], source[:, 1]]
        weight = self._weight(corner, source, filled)[:, None]
        self.result[at] = np.where(weight == 1, values, self.result[at] + weight * (values - self.result[at]))
        self.match[at] = np.where(weight >= 0.5, source, self.match[at])
        self.filled[at] = True

    def _choose(self, existing: np.ndarray, filled: Bool[np.ndarray, "p"], neighbours: np.ndarray) -> int:  # type: ignore[name-defined]
        """A random one of the least used tiles that match their overlap best; not from a neighbour's cell."""
        count, cells = len(self.tiles.cells), self.tiles.cells
        if not filled.any():
            return int(self.rng.integers(count))
        inside = np.flatnonzero(filled)
        inside = inside[:: -(-len(inside) // _MAX_COMPARED)]
        difference = self.tiles.features[:, inside] - existing[inside]
        errors = np.einsum("kpc,kpc->k", difference, difference)
        free = np.flatnonzero(~np.isin(cells, neighbours))
        if not len(free):
            free = np.arange(count)
        choices = min(len(free), max(_MIN_CHOICES, round(self.params.choices * len(self.uses))))
        good = free[np.argsort(errors[free], kind="stable")[:choices]]
        good = good[self.uses[cells[good]] == self.uses[cells[good]].min()]
        return int(good[self.rng.integers(len(good))])

    def _moved(
        self, source: Int64[np.ndarray, "p 2"], existing: np.ndarray, filled: np.ndarray
    ) -> Int64[np.ndarray, "p 2"]:
        """The tile's source at the shift that matches its overlap best."""
        inside = np.flatnonzero(filled)
        if not len(inside) or len(self.moves) == 1:
            return source
        inside = inside[:: -(-len(inside) // _MAX_COMPARED)]
        best, best_error = source, np.inf
        for move in self.moves:
            rows, columns = (source[inside] + move).T
            error = float(((self.tile_source.features[rows, columns] - existing[inside]) ** 2).sum())
            if error < best_error:
                best, best_error = source + move, error
        return best

    def _weight(self, corner: np.ndarray, source: Int64[np.ndarray, "p 2"], filled: np.ndarray) -> np.ndarray:
        """Blending weight of each pixel of a tile: 1 inside the cut, 0 outside."""
        import cv2

        from texloom.stages.kernels.seams.minimum_cut import NO_CELLS, NO_PRICE, cut_window
        from texloom.stages.kernels.seams.window_state import ABSENT, FILLED, FREE, KEPT

        at = matrix_product((corner + self.frame) % self.canvas, [self.canvas[1], 1])
        old = self.match[at].astype(np.int32)
        new = np.zeros_like(old)
        new[self.at] = source
        state = np.where(self.filled[at], KEPT, ABSENT).astype(np.int8)
        depth, band = self.window.depth, self.window.band
        state[self.at] = np.where(filled & (depth <= band), FREE, FILLED)
        taken = np.zeros(state.shape, bool)
        cut_window(self.costs.given, NO_CELLS, NO_PRICE, old, new, state, taken)
        weight = taken.astype(np.float32)
        if self.params.blend:
            side = 2 * self.params.blend + 1
            weight = cv2.blur(weight, (side, side), borderType=cv2.BORDER_REPLICATE)
        return np.where(filled, weight[self.at], np.float32(1))

    def output(self) -> tuple[Image, Correspondence]:
        """The result without its margin, and the sources of its pixels."""
        height, width = self.params.size
        top, left = self.margin
        inside = np.s_[top : top + height, left : left + width]
        pixels = self.result.reshape(*self.canvas, -1)[inside][..., : -self.feature_count]
        image = self.exemplar.elsewhere(with_unit_normals(np.ascontiguousarray(pixels), self.exemplar.channels))
        match = self.match.reshape(*self.canvas, 2)[inside]
        return image, np.ascontiguousarray(self.tile_source.places[match[..., 0], match[..., 1]])


@stage(version=2, check=partial(check_exemplar, min_side=_MIN_SIDE))
def near_regular(
    image: Image,
    generators: Vectors,
    vertices: Points,
    params: NearRegularParams,
    rng: np.random.Generator,
    source: Positions | None = None,
    courses: bool = False,
) -> NearRegular:
    """Lay tiles of a near-regular exemplar on its lattice.

    Every whole cell of the exemplar becomes a tile. Its outline is the one along which joints of cells show least,
    of any shape: it follows the joints of tiles, hexagons, planks of a herringbone, the ground between ornaments.
    Cells of the result are filled row by row; each tile is drawn from those that match their neighbours best,
    shifted by a few pixels at most, and cut out by a minimum cut within a band along its outline, so that it keeps
    its colour.
    The lattice of the result is exact, so that errors do not accumulate. Tiles are compared by all maps and contain
    no masked pixel; see `usable`. Blended normals keep unit length.

    Courses have cells of any phase. Where their elements are equally long, as blocks are, tiles are whole elements,
    and courses of the result are shifted against each other as those of the exemplar. Else tiles are cut from
    anywhere along courses, and those that match their neighbours best continue the pattern; their ends may be cut
    within a fifth of their length, where joints lie.

    Displaced cells do not fit each other. With ``source`` tiles are cut from the straightened exemplar.

    Parameters
    ----------
    image : the exemplar; all channels are copied together.
    generators : of the lattice, (2, 2) px; no rows where the exemplar has none.
    vertices : of the lattice, px: ``vertices`` of `deformed_lattice`, in the exemplar; with ``source`` its
        ``regular``, in the straightened exemplar.
    source : for every pixel of the straightened exemplar its position in the exemplar, px; see `straighten`.
    courses : tiles may begin anywhere along the second generator; see `deformed_lattice`.

    Raises
    ------
    InputError
        the exemplar has no lattice, shows no whole cell of it, is smaller than 8 x 8 px or holds values that are
        not finite; ``weights`` names a map that it lacks; a tileable result is smaller than a tile.
    ValueError
        ``source`` does not have the exemplar's size.

    References
    ----------
    [LiuTsin2004]_; [Lin2004]_ section 2.2. Tiles are chosen by their overlaps and used evenly, where the paper
    draws them at random; the paper's are parallelograms. Cuts are those of [Kwatra2003]_, within the band. The
    paper's exemplars are straight; straightening others is ours. The lattice of a tileable result is fitted to it,
    and its tiles are sampled at the nearest pixel.
    """
    if source is not None and source.shape[:2] != (image.height, image.width):
        raise ValueError(f"near_regular: source {source.shape} is not of an exemplar {image.pixels.shape}")
    if len(generators) != 2 or not len(vertices):
        raise InputError("generators: the exemplar shows no lattice, without which there are no tiles to lay")
    tiling = _Tiling(
        image, source, generators.astype(np.float64), vertices.astype(np.float64), courses, params, rng
    )
    tiling.run()
    result, match = tiling.output()
    result_generators = tiling.lattice.generators.astype(np.float32)
    return NearRegular(result.wrapping(params.tileable), match, result_generators, len(tiling.uses))
