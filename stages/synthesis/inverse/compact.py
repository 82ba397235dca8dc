"""Inverse texture synthesis: a small compaction that represents all neighbourhoods of a large texture."""

import dataclasses
import math
from collections.abc import Callable
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Bool, Float32
from pydantic import Field

from texloom.stages.analysis.similarity.k_coherence import Candidates, KCoherenceParams
from texloom.stages.analysis.similarity.tsvq import Leaf, Nodes, TsvqParams
from texloom.stages.common.grids.pyramid import halved_size, resize
from texloom.stages.common.grids.size_checks import check_row_length
from texloom.stages.common.similarity.neighbourhoods import Rectangles, inside_at, inside_of
from texloom.stages.common.source_maps.origins import Origin, origin_of
from texloom.stages.synthesis.control_maps.coarse_level import Guide
from texloom.stages.synthesis.inverse.energy import ExactEnergy
from texloom.stages.synthesis.inverse.level import Matching, Source, TextureLevel, Tree, nearest_in
from texloom.stages.synthesis.inverse.start import QUICK, crop, starts
from texloom.stages.synthesis.inverse.summary import Copied, level_count, outlines, size_check, square_of_share
from texloom.stages.vocabulary.arrays import Correspondence, Image, ScalarMap
from texloom.stages.vocabulary.checkpoints import Checkpoints, NoCheckpoints
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.sizes import SIDES, format_size
from texloom.stages.vocabulary.tileable import TileableBoth

_NEIGHBOURHOODS = 6  # of the texture's that count in the inverse term, about so many at most a compaction's pixel
_SAMPLES = 2048  # neighbourhoods by which compactions are compared
_COARSE_SAMPLES = 1 << 14  # neighbourhoods from which the clusters of a coarse level are grown
_RELAXATIONS = 3  # of the weight of seams, halved each time, where a crop would have a lower energy
_CROP_EFFORTS = ((QUICK, 0.87), ((512, 6, 32), 1.0))
"""for a quick and a careful search of the best crop: its effort, and the share of the crop's energy up to which a
compaction counts as better"""


_Side = Annotated[int, Field(ge=1)]


class CompactParams(Params):
    """Size of the compaction, weights of the energy, and effort."""

    size: Annotated[tuple[_Side, _Side] | Annotated[float, Field(gt=0, lt=1)] | Literal["auto"], SIDES] = "auto"
    """size of the compaction, px, as 128 or 256x128 (width x height); a number below 1: that share of the texture's
    pixels, together with those of its coarse level, in a square; `auto`: a quarter as many pixels as the texture's
    neighbourhoods have clusters, in the texture's aspect ratio, square for an atlas"""
    solver: Literal["improved", "basic"] = "improved"
    """`improved`: pixels are copied, matches found by k-coherence and clusters; `basic`, for comparison: pixels are
    means, matches found by exhaustive search; the image is then copied from the best matches"""
    alpha: float = Field(0.01, ge=1e-6, le=100)
    """weight of the forward term (every neighbourhood of the compaction occurs in the texture) relative to the
    inverse term (every neighbourhood of the texture occurs in the compaction)"""
    terms: Literal["both", "forward", "inverse"] = "both"
    """`forward`: coherence only, the compaction may lack parts of the texture; `inverse`: completeness only, with
    artefacts in between; both alone are for comparison"""
    seams: float = Field(0.6, ge=0, le=100)
    """weight of the seam cost between pixels from different places; 0 is the paper's, which favours pixels near the
    mean of many neighbourhoods and loses fine detail; 2 keeps all detail and represents less of the texture"""
    spacing: int = Field(2, ge=1, le=8)
    """px between the texture's neighbourhoods in the inverse term, at least; more where the texture has over 37
    times as many pixels as the compaction"""
    coarsest: int = Field(24, ge=8, le=1024)
    """shorter side of the compaction at the first level, px, at least"""
    iterations: int = Field(20, ge=1, le=500)
    """maximum iterations at a level"""
    tolerance: float = Field(0.002, ge=0, lt=1)
    """a level ends when an iteration lowers the energy by no more than this share of it"""
    block: int = Field(14, ge=4, le=128)
    """side of the texture blocks that the first level starts from, px"""
    proportion: float = Field(0.0, ge=0, le=100)
    """how strongly the first level preserves the area shares of the texture's materials, where 1 is strong; 0 is
    the paper's: rare materials take as much area as frequent ones"""
    tileable: TileableBoth = False
    """the compaction wraps around; `per_pixel`, which hardly uses what lies at a border, then uses all of it"""
    start: Literal["best", "cover", "random"] = "best"
    """`cover`: blocks that together cover most of the texture's clusters and fit each other; `random`: random
    blocks, as in the paper; `best`: `cover` or the best crop of the texture, whichever gives the lower energy; one
    that wraps around may be slightly worse than the crop, since its ends must meet"""
    start_seams: float | None = Field(None, ge=0, le=100)
    """weight of the seam cost in the choice of blocks for `cover`; null: that of ``seams``"""


@dataclasses.dataclass(frozen=True)
class CompactLevel:
    """The state after a level, from which a run resumes."""

    source: Correspondence
    """the texture pixel of each compaction pixel, at this level"""
    image: Image
    """the compaction so far"""
    energy: list[dict[str, Any]]
    """the iterations so far; see `Compacted`"""


@dataclasses.dataclass(frozen=True)
class Compacted(Copied):
    """The compaction."""

    origin: Origin | None
    """for an atlas, the texture and its pixel that each pixel is copied from; else none"""
    guide: Guide | None
    """colours of the coarse level at each pixel, CIELAB; none without"""
    use: ScalarMap
    """how many of the texture's neighbourhoods are matched with those around each pixel, relative to the mean"""
    sides: list[int]
    """height and width, px"""
    energy: list[dict[str, Any]]
    """for each iteration of each level, coarsest first: level; height and width of the compaction, px; iteration
    (``round``); the energy and its weighted terms, inverse, forward and seams, squared CIELAB units per pixel;
    share of pixels changed since the previous iteration"""


@stage(version=2, check=size_check("compact"), outlines=outlines)
def compact(
    texture: Image,
    features: Float32[np.ndarray, "h w c"],
    nodes: Nodes,
    leaf: Leaf,
    candidates: Candidates,
    params: CompactParams,
    rng: np.random.Generator,
    control: Image | None = None,
    rectangles: Rectangles | None = None,
    coarse: Image | None = None,
    guide: Guide | None = None,
    checkpoints: Checkpoints = NoCheckpoints(),  # noqa: B008
) -> Compacted:
    """Summarise a texture in a small compaction that contains all of its neighbourhoods and no others.

    Three steps alternate at every level: the inverse match of each neighbourhood of the texture (cluster centres
    search the whole compaction, the others take their centre's match or continue a neighbour's); the forward match
    of each neighbourhood of the compaction (by k-coherence); and the choice of each pixel among the candidates of
    its neighbours' sources, so that the energy falls most.

    Parameters
    ----------
    texture : any number of channels, which are copied together.
    features : planes in which neighbourhoods are compared, CIELAB units; see `control_features`.
    nodes, leaf : clusters of the neighbourhoods; see `tsvq`. They determine the neighbourhood's side.
    candidates : see `k_coherence`.
    control : control map copied with the texture; of any size of the same aspect ratio.
    rectangles : of the textures, where ``texture`` is an atlas; pixels between them are ignored. See `atlas`.
    coarse, guide : a coarse level of the texture that is kept beside the compaction, and its colours at the
        texture's size, which are copied with it; see `coarse_level`.

    Raises
    ------
    InputError
        the compaction is larger than the texture, or smaller than a neighbourhood; there are too many channels.
    ValueError
        ``features``, ``leaf`` or ``candidates`` does not belong to the texture.

    Notes
    -----
    Unlike in the paper, a match is kept until a better one is found, so that the energy never rises within a level.
    For given matches the optimal pixel is the candidate nearest to the weighted mean of all pixels matched with it,
    which favours smooth places. A seam cost as in [Kwatra2003]_ counters that, and pixels are chosen one after the
    other. For orientation fields see `compact_oriented`.

    References
    ----------
    [Wei2008]_ equation (1), sections 3 to 5; [Kwatra2005]_ for the basic solver.
    """
    shape = (texture.height, texture.width)
    neighbourhood = shape[0] - leaf.shape[0] + 1
    expected = (shape[0] - neighbourhood + 1, shape[1] - neighbourhood + 1)
    if features.shape[:2] != shape or leaf.shape != expected or candidates.shape[:2] != expected:
        raise ValueError(
            f"features {features.shape}, leaf {leaf.shape} and candidates {candidates.shape} "
            f"do not belong to a texture of {format_size(shape)}"
        )
    check_row_length("compact", features.shape[2], neighbourhood)
    compactor = _Compactor(texture, features, Tree(nodes, leaf, candidates), rectangles, coarse, params)
    source, use, energy = compactor.run(rng, checkpoints)
    copied = Copied.of(texture, control, np.moveaxis(source, 0, 2), params.tileable)
    return Compacted(
        **vars(copied),
        origin=None if rectangles is None else origin_of(source, rectangles),
        guide=None if guide is None else guide[source[0], source[1]],
        use=use,
        sides=list(source.shape[1:]),
        energy=energy,
    )


class _Compactor:
    """Runs the solver from the coarsest to the finest level."""

    def __init__(
        self,
        texture: Image,
        features: Float32[np.ndarray, "h w c"],
        tree: Tree,
        rectangles: Rectangles | None,
        coarse: Image | None,
        params: CompactParams,
    ):
        self.texture, self.features, self.tree, self.params = texture, features, tree, params
        self.shape = (texture.height, texture.width)
        self.inside = inside_of(rectangles, *self.shape)
        self.neighbourhood = self.shape[0] - tree.leaf.shape[0] + 1
        self.size = self._size(None if rectangles is None else min(self.shape), coarse)
        smallest = self.shape
        if rectangles is not None:
            smallest = (int(rectangles[:, 2].min()), int(rectangles[:, 3].min()))
        least = max(params.coarsest, self.neighbourhood)
        crowding = math.prod(self.shape) / (_NEIGHBOURHOODS * math.prod(self.size))
        self.spacing = max(params.spacing, round(math.sqrt(crowding)))
        self.levels = level_count(smallest, 2 * self.neighbourhood, self.size, least)
        costs = np.cumsum([0.0] + [16.0**level for level in range(self.levels)])
        self.progress = costs / costs[-1]
        """share of the work done before each level and after the last"""
        self.seams = 0.0 if params.solver == "basic" else params.seams
        self.alpha = {"both": params.alpha, "forward": 1.0, "inverse": 0.0}[params.terms]

    def _size(self, atlas_side: int | None, coarse: Image | None) -> tuple[int, int]:
        """Height and width of the compaction, px; that of an atlas fits in a square of ``atlas_side``.

        A share of the texture includes the pixels of its ``coarse`` level.
        """
        largest = self.shape if atlas_side is None else (atlas_side, atlas_side)
        size = self.params.size
        if size == "auto":
            # A quarter as many pixels as clusters, [Wei2008]_ section 5.
            clusters = int((self.tree.nodes[:, 1] < 0).sum())
            factor = max(math.sqrt(0.25 * clusters / math.prod(largest)), 2 * self.neighbourhood / min(largest))
            height, width = (max(1, round(side * min(1.0, factor))) for side in largest)
            size = (height, width)
        elif isinstance(size, float):
            size = square_of_share(size, int(self.inside.sum()), largest, coarse)
        if min(size) < self.neighbourhood:
            raise InputError(
                f"compact: size: {format_size(size)} does not hold a neighbourhood of {self.neighbourhood} px"
            )
        return size

    def run(
        self, rng: np.random.Generator, checkpoints: Checkpoints
    ) -> tuple[Source, ScalarMap, list[dict[str, Any]]]:
        """Source and use of every pixel of the compaction, and the iterations; see `Compacted`."""
        params, source = self.params, None
        is_whole = params.terms == "both" and params.solver == "improved"
        energy: list[dict[str, Any]] = []
        first = 0
        resumed = checkpoints.latest(CompactLevel)
        if resumed is not None:
            first, state = resumed
            source, energy = np.moveaxis(state.source.astype(np.int32), 2, 0), list(state.energy)
        for level in range(first + 1, self.levels + 1):
            data = self._level(level)
            size = halved_size(self.size, self.levels - level)
            sources = self._starts(data, size, rng) if source is None else [_doubled(source, size, data.inside)]
            matching, iterations = self._solve_best(data, sources, level)
            if level == self.levels and params.start == "best" and is_whole:
                matching, iterations = self._unless_crop(data, matching, iterations)
            energy += iterations
            source = matching.source if params.solver == "improved" else matching.source_of_forward()
            matching.source = source
            if level < self.levels:
                preview = self._preview(matching)
                checkpoints.save(level, CompactLevel(_as_correspondence(source), preview(), list(energy)))
        assert source is not None
        return source, matching.use(), energy

    def _level(self, level: int) -> TextureLevel:
        shape = halved_size(self.shape, self.levels - level)
        return TextureLevel(
            resize(self.features, *shape), self.neighbourhood, self.spacing,
            self.tree if level == self.levels else None,
            TsvqParams(neighbourhood=self.neighbourhood, max_samples=_COARSE_SAMPLES),
            KCoherenceParams(k=self.tree.candidates.shape[2]), inside_at(self.inside, *shape),
        )  # fmt: skip

    def _starts(self, data: TextureLevel, size: tuple[int, int], rng: np.random.Generator) -> list[Source]:
        params = self.params
        seams = self.seams if params.start_seams is None else params.start_seams
        return starts(data, size, params.block, params.start, seams, params.proportion, params.tileable, rng)

    def _solve_best(
        self, data: TextureLevel, sources: list[Source], level: int
    ) -> tuple[Matching, list[dict[str, Any]]]:
        """The solution of least exact energy from one of ``sources``, and its iterations."""
        before, after = self.progress[level - 1 : level + 1]
        share = float(after - before) / len(sources)
        solved = []
        for number, source in enumerate(sources):
            matching = self._matching(data, source)
            iterations = self._solve(matching, level, float(before) + number * share, share)
            exact = ExactEnergy.of_level(data, _SAMPLES).inverse_of_values(matching.values) if sources[1:] else 0.0
            last = iterations[-1]
            solved.append((exact + last["forward"] + last["seams"], matching, iterations))
        return min(solved, key=lambda one: one[0])[1:]

    def _unless_crop(
        self, data: TextureLevel, matching: Matching, iterations: list[dict[str, Any]]
    ) -> tuple[Matching, list[dict[str, Any]]]:
        """The solution, or the one that begins with the best crop if a crop has a lower inverse energy.

        Where its ends cannot meet without raising the energy above the crop's, visible seams are weighted less.
        """
        exact = ExactEnergy.of_level(data, _SAMPLES)
        energy = exact.inverse_of_values(matching.values)
        for effort, margin in _CROP_EFFORTS:
            cropped = crop(data, self.size, self.params.tileable, effort)
            if cropped is None:
                return matching, iterations
            start = self._matching(data, cropped)
            if energy <= margin * exact.inverse_of_values(start.values):
                return matching, iterations
        iterations = self._solve(start, self.levels, 1.0, 0.0)
        plain = crop(data, self.size, False, effort)
        limit = np.inf if plain is None else exact.inverse_of_values(self._matching(data, plain, wrap=False).values)
        for relaxation in range(1, _RELAXATIONS + 1):
            if exact.inverse_of_values(start.values) <= limit:
                break
            start = self._matching(data, start.source, self.seams / 2**relaxation)
            iterations += self._solve(start, self.levels, 1.0, 0.0)
        return start, iterations

    def _matching(
        self, data: TextureLevel, source: Source, seams: float | None = None, wrap: bool | None = None
    ) -> Matching:
        """See `Matching`; seam weight and topology are those of the params where None."""
        params = self.params
        return Matching(
            data, np.ascontiguousarray(source), self.alpha, self.seams if seams is None else seams,
            float(params.terms != "forward"), params.tileable if wrap is None else wrap,
        )  # fmt: skip

    def _preview(self, matching: Matching) -> Callable[[], Image]:
        pixels = resize(self.texture.pixels, matching.level.height, matching.level.width)
        return lambda: self.texture.elsewhere(pixels[matching.source[0], matching.source[1]])

    def _solve(self, matching: Matching, level: int, before: float, share: float) -> list[dict[str, Any]]:
        """Alternate matches and choice of pixels until the energy hardly falls.

        ``before`` and ``share`` of the whole work are done when this begins, and by this.
        """
        params = self.params
        iterations: list[dict[str, Any]] = []
        preview = self._preview(matching)
        height, width = matching.source.shape[1:]
        changed = 1.0
        while True:
            self._match(matching, len(iterations) + 1)
            inverse, forward, seams = matching.energy()
            energy = inverse + forward + seams
            iterations.append(
                {
                    "level": level, "height": height, "width": width, "round": len(iterations) + 1,
                    "energy": energy, "inverse": inverse, "forward": forward, "seams": seams, "changed": changed,
                }
            )  # fmt: skip
            ended = (
                len(iterations) == params.iterations
                or energy == 0
                or (len(iterations) > 1 and iterations[-2]["energy"] - energy <= params.tolerance * energy)
            )
            done = 1.0 if ended else len(iterations) / params.iterations
            report(
                Progress(
                    done=min(1.0, before + share * done), scale=level, scales=self.levels,
                    iteration=len(iterations), iterations=params.iterations, energy=energy, preview=preview,
                )
            )  # fmt: skip
            if ended:
                return iterations
            if params.solver == "basic":
                matching.average()
            else:
                changed = matching.choose() / (height * width)

    def _match(self, matching: Matching, iteration: int) -> None:
        if self.params.solver == "basic":
            matching.match_inverse(matching.propose_by_search())
            matching.match_forward_by_search()
        else:
            proposed = matching.inverse
            # Fewer matches change from iteration to iteration, so that ever fewer iterations need a search.
            if proposed is None or iteration.bit_count() == 1:
                proposed = matching.propose_by_centres(matching.source[0].size)
            matching.match_inverse(proposed)
            matching.match_forward_by_coherence()


def _doubled(source: Source, size: tuple[int, int], inside: Bool[np.ndarray, "h w"]) -> np.ndarray:
    """The same compaction at twice the resolution."""
    rows, columns = np.arange(size[0]), np.arange(size[1])
    coarse = source[:, rows[:, None] // 2, columns // 2]
    finer = 2 * coarse + np.stack(np.broadcast_arrays(rows[:, None] % 2, columns % 2))
    return np.asarray(nearest_in(inside, finer))


def _as_correspondence(source: Source) -> Correspondence:
    return np.ascontiguousarray(np.moveaxis(source, 0, 2).astype(np.uint32))
