"""The main method on an exemplar that continues what is fixed of a torus, as tiles do with their borders."""

import dataclasses
import math
from typing import Any, Literal

import numpy as np
from jaxtyping import Float32, Int64
from pydantic import Field

from texloom.stages.common.features.maps import MapWeights
from texloom.stages.common.grids.pyramid import halved_size, resize
from texloom.stages.common.grids.wang import Kind
from texloom.stages.kernels.seams.window_state import FILLED, FREE, KEPT
from texloom.stages.synthesis.edits.gradient_domain import GradientDomainParams, gradient_domain
from texloom.stages.synthesis.edits.revise import ReviseParams, Revision
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimisation.optimise import optimise
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.synthesis.stitching.overlap import compared
from texloom.stages.synthesis.stitching.seams import SeamCosts, cheapest_cut
from texloom.stages.synthesis.tiles.border_waves import Displacement
from texloom.stages.synthesis.tiles.tile_materials import TileMaterials
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Params
from texloom.stages.vocabulary.facts import TORUS
from texloom.stages.vocabulary.masks import fill_excluded, valid_pixels, without_usable
from texloom.stages.vocabulary.progress import part

_STARTS = 4  # of a torus of one material, among which one is chosen
_LARGEST_STEP = 0.5  # of tone at a cut, in standard deviations of a colour; larger ones are contours
_MIN_HALVED = 96  # px, side of tiles and exemplars from which on blocks are laid at half the size


class WangParams(Params):
    """Parameters of the main method that matter for tiles."""

    preset: Literal["kaspar2015", "default", "fast"] = "default"
    """see `optimise`"""
    patch_size: int = Field(10, ge=3, le=32)
    """side of a patch, px"""
    occurrence: float = Field(10.0, ge=0, le=1e4)
    """weight of spatial uniformity, see `optimise`"""
    weights: MapWeights = Field({})


@dataclasses.dataclass(frozen=True)
class Torus:
    """A texture that wraps around, and where each of its pixels comes from."""

    image: Image
    match: Correspondence

    @classmethod
    def of_exemplar(cls, image: Image) -> "Torus":
        """An exemplar as it is, which need not wrap around."""
        places = np.moveaxis(np.indices((image.height, image.width), np.uint32), 0, 2)
        return cls(without_usable(image), np.ascontiguousarray(places))

    def at(self, rows: np.ndarray, columns: np.ndarray) -> "Torus":
        """The torus of these pixels; rows and columns are broadcast and wrapped."""
        rows, columns = rows % self.image.height, columns % self.image.width
        pixels = np.ascontiguousarray(self.image.pixels[rows, columns])
        return Torus(self.image.elsewhere(pixels), np.ascontiguousarray(self.match[rows, columns]))


def small_result(image: Image, pixels: int) -> float:
    """Factor on the weight of spatial uniformity in a result of ``pixels`` px, 0..1.

    The penalty of a patch is relative to the even use of all pixels. In a result much smaller than its exemplar a
    patch that continues its neighbour as the exemplar does costs the weight times the ratio of their sizes. This
    outweighs guides, and a smooth material, whose patches fit each other from anywhere, displaces a rough one. The
    factor is the root of the reciprocal ratio: with all of it, the penalty would be too low to prevent blur.
    """
    valid = valid_pixels(image)
    usable = image.height * image.width if valid is None else int(valid.sum())
    return math.sqrt(min(1.0, pixels / usable))


class TileSynthesis:
    """The main method on one exemplar, which continues what is fixed.

    Parameters
    ----------
    tile, border : side of a tile, and what fits on each side of its borders, px.
    materials : where there are several exemplars.
    guide : of the exemplar.
    kind : of the tiles; between materials, those by edges let spatial uniformity count less, see `small_result`.
    pixels : of the result.
    """

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
        *,
        kind: Kind,
        pixels: int,
    ):
        self.image, self.tile, self.materials = image, tile, materials
        self.colors = lab_from_linear(fill_excluded(image).color)
        self.inputs = (guidance, weight, generators)
        self.chosen = {name: getattr(params, name) for name in WangParams.model_fields} | {"period": (tile, tile)}
        if materials is not None and kind == "edges":
            self.chosen["occurrence"] *= small_result(image, pixels)
        # What is fixed would not be continued if it were narrower than a patch at the first scale, nor if a
        # stronger penalty outweighed it there.
        coarsest = min(image.height, image.width) * min(1.0, params.patch_size / (2 * border))
        options = ReviseParams(
            **self.chosen, occurrence_coarse=self.chosen["occurrence"], coarsest=max(8, math.ceil(coarsest))
        )
        own = guide if materials is None else materials.exemplar
        has_lattice = generators is not None and len(generators) > 0
        self.revision = Revision(image, guidance, weight, generators, options, own)
        self.halved: Revision | None = None
        """for the blocks, of which the first scale shows no more; a lattice asks for whole pixels"""
        if not has_lattice and border >= params.patch_size and min(tile, image.height, image.width) >= _MIN_HALVED:
            half_guide = None if own is None else _half(own)
            self.halved = Revision(_half_image(image), None, 1.0, None, options, half_guide)

    def start(self, count: int, side: int, structure: Mask | None, rng: np.random.Generator) -> Torus:
        """A torus of ``count`` squares side by side, of the materials one after another."""
        guidance, weight, generators = self.inputs
        starting, optimising = rng.spawn(2)
        guides: dict[str, Any] = {}
        if self.materials is not None:
            wanted = self.materials.between(np.arange(count)[None], side, side * count)
            guides = {"exemplar_guide": self.materials.exemplar, "target_guide": wanted}
        size = InitialiseParams(size=(side, side * count))
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
        displacement: Displacement | None = None,
    ) -> Torus:
        """A torus that fits to the pixels of ``keep``, and has those of ``shared`` among them unchanged.

        From there on it continues what is known, where ``filled`` is true at most, up to the line along which this
        differs least from what the main method has made: the border of ``keep`` itself would show as a straight
        line, since patches across it are averaged on one side only. In smooth parts, where this line is straight
        again, as it is shortest, steps of tone across it pass over into what was made.

        Of several starts it is the one with least difference between the mean colours of its ``parts``, numbers
        from 1, and that of the exemplar; not where there are several, whose materials ``points`` has, and which
        ``displacement`` moves. ``wanted`` is what the guide of the exemplar is to be where.
        """
        if self.materials is not None:
            size = (known.image.height, known.image.width)
            wanted, parts = self.materials.between(points, *size, displacement), None
        block = min(self.tile, self.image.height, self.image.width) // 2
        *placing, optimising = rng.spawn(2 if parts is None else _STARTS + 1)
        with part(0.0, 0.2):
            starts = [self._start(known, keep, filled, block, parts is None, wanted, random) for random in placing]
        if parts is not None:
            starts.sort(key=lambda start: self._deviation(start, parts))
        with part(0.2, 1.0):
            made = self.revision.optimised(known.image, starts[0], keep, TORUS, optimising, keep & ~shared, wanted)
        own = self._cut(known.image, made.image, shared, filled)[..., None]
        joined = known.image.elsewhere(np.where(own, made.image.pixels, known.image.pixels))
        match = np.where(own, made.match, known.match)
        tones = GradientDomainParams(maps=("albedo",), limit=_LARGEST_STEP, border_only=True)
        even = gradient_domain(self.image, joined.wrapping(True), match, tones, ~own[..., 0])
        return self._level(even.image, match, shared)

    def _start(
        self,
        known: Torus,
        keep: Mask,
        filled: Mask,
        block: int,
        spread: bool,
        wanted: Float32[np.ndarray, "H W k"] | None,
        random: np.random.Generator,
    ) -> Correspondence:
        """As `Revision.start`, with blocks that are laid at half the size where possible."""
        if self.halved is None:
            return self.revision.start(
                known.image, ~keep, known.match, TORUS, random, random, filled, block, spread, wanted
            )
        every = np.s_[::2, ::2]
        start = self.halved.start(
            _half_image(known.image), ~keep[every], known.match[every] // 2, TORUS, random, random, filled[every],
            block // 2, spread, None if wanted is None else _half(wanted),
        )  # fmt: skip
        rows, columns = np.indices(keep.shape)
        doubled = 2 * start[rows // 2, columns // 2] + np.stack([rows % 2, columns % 2], axis=2)
        sides = np.array([self.image.height, self.image.width]) - 1
        return np.where(keep[..., None], known.match, np.minimum(doubled, sides)).astype(np.uint32)

    def _cut(self, known: Image, made: Image, shared: Mask, filled: Mask) -> Mask:
        """Where ``made`` is shown and not ``known``, joined along minimum cuts.

        Each tile is cut by itself: those whose lines between them are shared as they are, others from middle to
        middle.
        """
        middle = tuple(min(self.tile, side) // 2 for side in shared.shape)
        shift = (0, 0) if shared[0].all() else middle
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
        return np.roll(taken, (-shift[0], -shift[1]), (0, 1))

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


def _half(planes: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "p q c"]:
    """At half the size, rounded up."""
    return resize(planes, *halved_size((planes.shape[0], planes.shape[1]), 1), bilinear=True)


def _half_image(image: Image) -> Image:
    return image.elsewhere(_half(image.pixels))
