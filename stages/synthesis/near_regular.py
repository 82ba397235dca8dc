"""Near-regular synthesis: tiles of an exemplar's lattice, drawn and laid on a lattice, cut along its directions."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int64
from pydantic import Field

from texloom.stages.analysis.deformed_lattice import Points
from texloom.stages.analysis.straighten import Positions
from texloom.stages.arrays import Correspondence, Image, Vectors
from texloom.stages.common.maps import check_weights
from texloom.stages.common.sizes import check_side
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.normals import with_unit_normals
from texloom.stages.progress import Progress, report
from texloom.stages.sizes import Size
from texloom.stages.synthesis._lattice.output_lattice import OutputLattice
from texloom.stages.synthesis._lattice.tiles import Shape, Window, best_shape, whole
from texloom.stages.synthesis._seams.cuts import Strips, laid_over
from texloom.stages.synthesis._seams.exemplar import Exemplar, Weights
from texloom.stages.synthesis._seams.overlap import compared

_LEAST = 8  # px of an exemplar's shorter side
_MOST_TILES = 256
_MOST_VALUES = 1 << 25  # of all tiles together
_COMPARED = 500  # pixels of an overlap by which tiles are chosen
_AROUND = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))


class NearRegularParams(Params):
    """How large the result is, and how tiles are chosen and joined."""

    size: Size = (1024, 1024)
    """height and width of the result, px"""
    tileable: bool = False
    """the result continues across its borders; the lattice is stretched and sheared a little to fit"""
    overlap: float = Field(0.35, gt=0, le=0.5)
    """how much of a tile lies over each of its neighbours, as a share of its shorter side; 4 px at least"""
    choices: float = Field(0.2, gt=0, le=1)
    """share of the tiles, those that continue their neighbours best, of which each is drawn; three at least"""
    shift: int = Field(0, ge=0, le=16)
    """how far a tile may be moved from its place on the lattice to continue its neighbours, px, at the price of
    evenness"""
    blend: int = Field(1, ge=0, le=16)
    """how far tiles are blended on both sides of a cut, px; 0 copies only"""
    weights: Weights = Field({})
    """how much a map besides colour counts, by the name of the map or of one of its channels; 1 if not given: all
    maps together then count as much as colour"""


@dataclasses.dataclass(frozen=True)
class NearRegular:
    """The texture."""

    image: Image
    """the exemplar's pixels, blended beside cuts; copies, unless it was straightened"""
    match: Correspondence
    """for every pixel of the result the exemplar pixel that it comes from, or the nearest if it is read between
    pixels; of blended ones that of more weight"""
    tileable: bool
    """whether it wraps around"""
    generators: Vectors
    """of the result's lattice, px: those of the exemplar unless it was made to fit a tileable result"""
    tiles: int
    """whole tiles of the exemplar that there were to draw from"""


def check_exemplar(params: NearRegularParams, known: Mapping[str, Any]) -> None:
    """The exemplar must be large enough."""
    image = known.get("image")
    if image is not None:
        check_weights(params.weights, image.channels)
        check_side(image, _LEAST)


class _Ground:
    """What tiles are cut from: the exemplar, as it is or straightened."""

    pixels: Float32[np.ndarray, "h w k"]
    """all channels of the image, then what they are compared by"""
    features: Float32[np.ndarray, "h w c"]
    places: Correspondence
    """the exemplar pixel that each pixel comes from, or the nearest"""
    known: Bool[np.ndarray, "h w"]
    """false where a pixel would come from beyond the exemplar or from what is masked"""
    masked: bool
    """whether some of the exemplar is"""

    def __init__(self, exemplar: Exemplar, source: Positions | None):
        self.pixels = np.concatenate([exemplar.image.pixels, exemplar.features], axis=2)
        self.places = np.ascontiguousarray(np.moveaxis(np.indices(exemplar.shape), 0, -1), np.uint32)
        self.masked = exemplar.usable is not None
        self.known = np.ones(exemplar.shape, bool) if exemplar.usable is None else exemplar.usable
        if source is not None:
            last = np.array(exemplar.shape) - 1
            inside = ((source >= -0.5) & (source <= last + 0.5)).all(axis=2)
            self.places = np.rint(np.clip(source, 0, last)).astype(np.uint32)
            self.known = inside & self._clear(self.known)[self.places[..., 0], self.places[..., 1]]
            self.pixels = self._read(source)
        self.features = np.ascontiguousarray(self.pixels[..., len(exemplar.image.channels) :])

    @staticmethod
    def _clear(known: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
        """Where all pixels are known that are read between."""
        import cv2

        eroded = cv2.erode(known.astype(np.uint8), np.ones((5, 5), np.uint8))
        return np.asarray(eroded > 0)

    def _read(self, source: Positions) -> Float32[np.ndarray, "h w k"]:
        from texloom.stages.kernels.core.resample import sampled

        return sampled(self.pixels, source.astype(np.float64))


@dataclasses.dataclass(frozen=True)
class _TileSet:
    """The tiles to draw from."""

    window: Window
    sources: Int64[np.ndarray, "k p 2"]
    """pixel, of what tiles are cut from, of every pixel of every tile"""
    features: Float32[np.ndarray, "k p c"]


def _tile_set(
    ground: _Ground,
    generators: np.ndarray,
    vertices: np.ndarray,
    own: np.ndarray,
    params: NearRegularParams,
    rng: np.random.Generator,
) -> tuple[_TileSet, Shape]:
    """All whole tiles, or as many as memory allows, for a result whose generators are ``own``."""
    to_exemplar = np.linalg.inv(own) @ generators
    shape, features = ground.known.shape, ground.features
    longest = float(np.hypot(*generators.T).min())
    overlap = max(4, round(params.overlap * longest))
    # Exemplars of very few cells may show none that is whole with its overlap; a narrower one is better than none.
    while True:
        chosen = best_shape(features, vertices, generators, overlap)
        window = Window.of(chosen.moved(np.linalg.inv(to_exemplar)), overlap)
        corners = vertices + chosen.phase
        kept = np.flatnonzero(whole(window, corners, to_exemplar, ground.known, params.shift))
        if len(kept) or overlap <= 4:
            break
        overlap = max(4, overlap // 2)
    if not len(kept):
        masked = " that its mask leaves" if ground.masked else ""
        raise InputError(
            f"image: {shape[0]}x{shape[1]} px show no whole cell of the lattice{masked}, whose generators are "
            f"{' and '.join(f'({row:.0f}, {column:.0f})' for row, column in generators)} px"
        )
    most = int(np.clip(_MOST_VALUES // (features.shape[2] * len(window.offsets)), 1, _MOST_TILES))
    if len(kept) > most:
        kept = np.sort(rng.choice(kept, most, replace=False))
    moved = window.offsets @ to_exemplar
    sources = np.rint(corners[kept][:, None] + moved[None]).astype(np.int64)
    return _TileSet(window, sources, features[sources[..., 0], sources[..., 1]]), chosen


class _Tiling:
    """A result being laid."""

    def __init__(
        self,
        image: Image,
        source: Positions | None,
        generators: np.ndarray,
        vertices: np.ndarray,
        params: NearRegularParams,
        rng: np.random.Generator,
    ):
        self.params, self.rng = params, rng
        exemplar = Exemplar(image, compared, 1.0, params.weights)
        self.channels = exemplar.image.channels
        self.ground = _Ground(exemplar, source)
        self.compared = self.ground.features.shape[2]
        own = OutputLattice.of(generators, params.size, True).generators if params.tileable else generators
        self.tiles, shape = _tile_set(self.ground, generators, vertices, own, params, rng)
        self.window = self.tiles.window
        low, high = self.window.offsets.min(axis=0), self.window.offsets.max(axis=0) + 1
        self.low, self.box = low, (int(high[0] - low[0]), int(high[1] - low[1]))
        height, width = params.size
        if params.tileable and (self.box[0] > height or self.box[1] > width):
            raise InputError(f"size: {height}x{width} px is smaller than a tile, {self.box[0]}x{self.box[1]} px")
        # Tiles may begin, and end, a whole tile beyond the result.
        self.margin = (0, 0) if params.tileable else self.box
        self.canvas = (height + 2 * self.margin[0], width + 2 * self.margin[1])
        self.lattice = OutputLattice.of(generators, self.canvas, params.tileable)
        self.result = np.zeros((self.canvas[0] * self.canvas[1], self.ground.pixels.shape[2]), np.float32)
        self.match = np.zeros((self.canvas[0] * self.canvas[1], 2), np.uint32)
        self.placed = np.zeros(self.canvas[0] * self.canvas[1], bool)
        self.which = np.full(len(self.lattice.steps), -1)
        self.uses = np.zeros(len(self.tiles.sources), np.int64)
        # Rows of tiles run along the base.
        frame = np.linalg.inv(np.array([shape.side, shape.base]))
        row, along = (self.lattice.steps @ generators @ frame).T
        self.order = np.lexsort((along, np.rint(row)))

    def run(self) -> None:
        """Lay all tiles that reach into the result."""
        around = self.lattice.neighbours(_AROUND)
        # Where in a cell the result begins is left to chance.
        begin = self.rng.random(2) @ self.lattice.generators
        corners = np.rint(self.lattice.places + begin).astype(np.int64)
        low = corners + self.low - self.margin
        reaches = ((low < self.params.size) & (low + self.box > 0)).all(axis=1) | self.params.tileable
        order = self.order[reaches[self.order]]
        for number, node in enumerate(order.tolist()):
            self._lay(node, corners[node], around[node])
            if number % 64 == 0:
                report(Progress(number / len(order)))
        report(Progress(1.0))

    def _lay(self, node: int, corner: np.ndarray, around: np.ndarray) -> None:
        at = (corner + self.window.offsets) % self.canvas @ [self.canvas[1], 1]
        stands = self.placed[at]
        before = self.result[at, -self.compared :]
        neighbours = self.which[around[around >= 0]]
        tile = self._choose(before, stands, neighbours[neighbours >= 0])
        self.which[node] = tile
        self.uses[tile] += 1
        source = self._moved(self.tiles.sources[tile], before, stands)
        values = self.ground.pixels[source[:, 0], source[:, 1]]
        weight = self._weight(((values[:, -self.compared :] - before) ** 2).sum(axis=1), stands)[:, None]
        self.result[at] = np.where(weight == 1, values, self.result[at] + weight * (values - self.result[at]))
        self.match[at] = np.where(weight >= 0.5, source, self.match[at])
        self.placed[at] = True

    def _choose(self, before: np.ndarray, stands: Bool[np.ndarray, "p"], neighbours: np.ndarray) -> int:  # type: ignore[name-defined]
        """One of those that continue what stands best, the least used first, and none that lies beside."""
        count = len(self.uses)
        if not stands.any():
            return int(self.rng.integers(count))
        inside = np.flatnonzero(stands)
        inside = inside[:: -(-len(inside) // _COMPARED)]
        difference = self.tiles.features[:, inside] - before[inside]
        errors = np.einsum("kpc,kpc->k", difference, difference)
        free = np.setdiff1d(np.arange(count), neighbours)
        if not len(free):
            free = np.arange(count)
        wanted = min(len(free), max(3, round(self.params.choices * count)))
        good = free[np.argsort(errors[free], kind="stable")[:wanted]]
        good = good[self.uses[good] == self.uses[good].min()]
        return int(good[self.rng.integers(len(good))])

    def _moved(
        self, source: Int64[np.ndarray, "p 2"], before: np.ndarray, stands: np.ndarray
    ) -> Int64[np.ndarray, "p 2"]:
        """The tile a little aside, where it continues what stands best."""
        inside = np.flatnonzero(stands)
        if not len(inside) or not self.params.shift:
            return source
        inside = inside[:: -(-len(inside) // _COMPARED)]
        reach = np.arange(-self.params.shift, self.params.shift + 1)
        best, least = source, np.inf
        for move in sorted(((i, j) for i in reach for j in reach), key=lambda pair: pair[0] ** 2 + pair[1] ** 2):
            some = source[inside] + move
            error = float(((self.ground.features[some[:, 0], some[:, 1]] - before[inside]) ** 2).sum())
            if error < least:
                best, least = source + move, error
        return best

    def _weight(self, errors: np.ndarray, stands: np.ndarray) -> Float32[np.ndarray, "p"]:  # type: ignore[name-defined]
        """How much each pixel of a tile counts against what stands."""
        import cv2

        window, overlap = self.window, self.window.overlap
        covered = np.append(stands, False)[window.nearest]
        seen = np.where(covered, np.append(errors, 0)[window.nearest], 0).astype(np.float32)
        middle = covered[overlap:-overlap], covered[:, overlap:-overlap]
        strips = Strips(
            top=overlap if middle[1][:overlap].any() else 0,
            left=overlap if middle[0][:, :overlap].any() else 0,
            bottom=overlap if middle[1][-overlap:].any() else 0,
            right=overlap if middle[0][:, -overlap:].any() else 0,
        )
        weight = laid_over(seen, strips)[window.at].astype(np.float32)
        weight[~stands] = 1
        blend = self.params.blend
        if blend:
            plane = np.zeros(self.box, np.float32)
            plane[tuple((window.offsets - self.low).T)] = weight
            soft = cv2.blur(plane, (2 * blend + 1, 2 * blend + 1), borderType=cv2.BORDER_REPLICATE)
            weight = np.where(stands, soft[tuple((window.offsets - self.low).T)], np.float32(1))
        return np.asarray(weight)

    def picture(self) -> tuple[Image, Correspondence]:
        """The result's pixels and where they come from."""
        height, width = self.params.size
        top, left = self.margin
        inside = np.s_[top : top + height, left : left + width]
        pixels = self.result.reshape(*self.canvas, -1)[inside][..., : -self.compared]
        made = Image(with_unit_normals(np.ascontiguousarray(pixels), self.channels), self.channels)
        match = self.match.reshape(*self.canvas, 2)[inside]
        return made, np.ascontiguousarray(self.ground.places[match[..., 0], match[..., 1]])


@stage(version=1, check=check_exemplar)
def near_regular(
    image: Image,
    generators: Vectors,
    vertices: Points,
    params: NearRegularParams,
    rng: np.random.Generator,
    source: Positions | None = None,
) -> NearRegular:
    """Lay tiles of a near-regular exemplar on its lattice.

    Every whole cell of the exemplar, where it is found, makes a tile. Cells of the result are filled row by row;
    each tile is drawn from those that continue their neighbours best, moved a few pixels at most, and joined along
    the cheapest cuts in the directions of its sides. The lattice of the result is exact, so nothing drifts. Tiles
    are compared by all maps and hold no masked pixel; see `usable`. Normals that are blended keep unit length.

    Cells that are out of line do not fit each other. With ``source`` tiles are cut from the straightened exemplar,
    in which they do.

    Parameters
    ----------
    generators : of the lattice, (2, 2) px; no rows where the exemplar has none.
    vertices : where the vertices are, px: in the exemplar, ``vertices`` of `deformed_lattice`; or, with ``source``,
        in the straightened one, ``regular``.
    source : for every pixel of the straightened exemplar its place in the exemplar, px, as from `straighten`.

    Raises
    ------
    InputError
        the exemplar has no lattice, shows no whole cell of it, is smaller than 8x8 px or holds values that are not
        finite; or a tileable result is smaller than a tile.

    References
    ----------
    [LiuTsin2004]_; [Lin2004]_ section 2.2. Tiles are chosen by what they overlap and drawn evenly, where the
    paper draws them at random; their sides run where cells are most alike, and two of them need not follow a
    generator. The paper's exemplars are straight; that others are straightened is ours. The lattice of a tileable
    result is fitted to it, and tiles are sampled to the nearest pixel for it.
    """
    check_exemplar(params, {"image": image})
    if source is not None and source.shape[:2] != (image.height, image.width):
        raise ValueError(f"near_regular: source {source.shape} is not of an exemplar {image.pixels.shape}")
    if len(generators) != 2 or not len(vertices):
        raise InputError("generators: the exemplar shows no lattice, without which there are no tiles to lay")
    tiling = _Tiling(image, source, generators.astype(np.float64), vertices.astype(np.float64), params, rng)
    tiling.run()
    made, match = tiling.picture()
    own = tiling.lattice.generators.astype(np.float32)
    return NearRegular(made, match, params.tileable, own, len(tiling.uses))
