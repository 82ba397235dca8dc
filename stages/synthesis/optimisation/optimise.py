"""Self-tuning texture optimisation: patch search and voting alternate from coarse to fine."""

import dataclasses
import logging
import math
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
import pydantic
from jaxtyping import Bool, Float32, UInt32
from pydantic import Field

from texloom.stages.common.features.maps import MapWeights
from texloom.stages.common.grids.pyramid import scale_sizes, scaled
from texloom.stages.common.grids.working_size import Halvings
from texloom.stages.synthesis.optimisation import correspondence
from texloom.stages.synthesis.optimisation.allowed import Allowed, allowed_at_scales
from texloom.stages.synthesis.optimisation.border import Border
from texloom.stages.synthesis.optimisation.cells import complete_cells
from texloom.stages.synthesis.optimisation.correspondence import Patches, from_layers, to_layers
from texloom.stages.synthesis.optimisation.features import FeaturesOfScale, PatchFeatures
from texloom.stages.synthesis.optimisation.fixed import FixedPixels
from texloom.stages.synthesis.optimisation.guides import Guides, expected_use, resize_target
from texloom.stages.synthesis.optimisation.inputs import check_patches, check_start
from texloom.stages.synthesis.optimisation.lattice_phase import LatticePhase, min_spacing
from texloom.stages.synthesis.optimisation.match_search import Effort, Search, occurrence_map
from texloom.stages.synthesis.optimisation.plain import coarsest_side, full_size
from texloom.stages.synthesis.optimisation.presets import with_preset
from texloom.stages.synthesis.optimisation.scale import Rounds, Scale, improve_all
from texloom.stages.synthesis.optimisation.starts import best_start
from texloom.stages.synthesis.optimisation.vote import HistogramVote, mean_vote, result_image, vote_pixels, window
from texloom.stages.vocabulary.arrays import Channels, Correspondence, Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.checkpoints import Checkpoints, NoCheckpoints
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.masks import FilledExemplar, tell_holes, valid_pixels, without_usable
from texloom.stages.vocabulary.scratch import bands
from texloom.stages.vocabulary.sizes import Size, format_size
from texloom.stages.vocabulary.tileable import Tileable, wraps_after
from texloom.stages.vocabulary.voted_patches import VotedPatches

_LOG = logging.getLogger(__name__)

_MIN_CELL = 8  # px between lattice lines at the first scale; smaller cells would not be resolved
_PHASE_SHARE = 0.8  # of the scales, coarsest first, at which the lattice is enforced; finer ones preserve it
_FILL_SHARE = 0.4  # of the scales, coarsest first, at which little used places are tried
_LINES = 0.5  # of `regularity` for straight lines at uneven distances; the full one leads to few of their pieces
_TRIED_SCALES = 3  # the coarsest ones, after which one of several starts is chosen

_OURS = {
    "narrowing": "tries",
    "random_share": 0.5,
    "fine_tries": 12,
    "distance_per_try": 0.5,
    "occurrence_coarse": 30.0,
    "regularity": 64.0,
    "final_sigma": 1.0,
    "border": True,
}

PRESETS: dict[str, dict[str, Any]] = {
    "kaspar2015": {},
    "default": {
        **_OURS,
        "patch_size": 12,
        "coarsest": 40,
        "starts": 3,
        "first_iterations": 24,
        "fewer_iterations": 2.3,
        "last_iterations": 3,
        "coarse_sweeps": 4,
        "fine_sweeps": 3,
        "random_tries": 8,
        "tolerance": 0.002,
    },
    "fast": {
        **_OURS,
        "ratio": 1.6,
        "first_iterations": 10,
        "fewer_iterations": 2.0,
        "last_iterations": 2,
        "coarse_sweeps": 4,
        "fine_sweeps": 2,
        "random_tries": 8,
        "tolerance": 0.01,
    },
}
"""values that differ from the fields' defaults, which are those of the paper and of its authors' code"""


class OptimiseParams(Params):
    """Parameters of the optimisation. A preset replaces some defaults; explicit values override it."""

    preset: Literal["kaspar2015", "default", "fast"] = "default"
    """`kaspar2015`: the paper, and its authors' code for what the paper does not state; `default`: random search at
    every scale, lattices enforced, strong uniformity at coarse scales, sharper last vote, early stop, patches of
    12 px, the best of several starts; `fast`: the same with patches of 10 px, one start, and fewer scales and
    iterations"""
    patch_size: int = Field(10, ge=3, le=32)
    """side of a patch, px"""
    tileable: Tileable | None = None
    """the result continues across its borders: x left to right, y top to bottom, both, off; null: as a picture does
    of which pixels are kept, else off"""
    occurrence: float = Field(10.0, ge=0, le=1e4)
    """weight of spatial uniformity: occurrence penalty of an exemplar patch of average use, squared CIELAB
    units per pixel; 0 lets smooth patches repeat, 100 prevents repetition at the cost of similarity"""
    occurrence_coarse: float = Field(10.0, ge=0, le=1e4)
    """the same weight at the coarsest scale, interpolated logarithmically between; no effect if `occurrence` is
    0"""
    overuse: float = Field(2.0, ge=1, le=1e4)
    """use, in multiples of the average, above which random search rejects an exemplar patch"""
    ratio: float = Field(1.3, gt=1.0, le=4.0)
    """size of a scale relative to the one before it, at least"""
    coarsest: int = Field(35, ge=8)
    """exemplar's shorter side at the first scale, px; never below one and a half patches"""
    first_iterations: int = Field(30, ge=1, le=200)
    """iterations of search and vote at the first scale"""
    fewer_iterations: float = Field(3.0, ge=0, le=100)
    """decrease of the iterations from scale to scale, of ten scales"""
    last_iterations: int = Field(5, ge=1, le=200)
    """minimum number of iterations at a scale"""
    coarse_sweeps: int = Field(10, ge=1, le=50)
    """sweeps of patch search per iteration in the coarser half of the scales"""
    fine_sweeps: int = Field(7, ge=1, le=50)
    """sweeps of patch search per iteration in the finer half"""
    random_tries: int = Field(10, ge=0, le=100)
    """random places tried for a patch in a sweep, as `narrowing` says"""
    fine_tries: int = Field(0, ge=0, le=100)
    """the same at the scales after those of `random_share`"""
    distance_per_try: float = Field(0.0, ge=0, le=1e4)
    """a patch has one of `fine_tries`, the nearest first, for every such multiple of the mean distance to matches:
    few where the match fits, all where it does not; 0 for all at every patch"""
    narrowing: Literal["sweeps", "tries"] = "sweeps"
    """where random places are tried: `sweeps`: in the first sweep of an iteration anywhere, in each that follows
    half as far from the match, and one fewer; `tries`: in the first sweep of an iteration only, the first
    anywhere, each further one nearer to the match"""
    fill_tries: int = Field(6, ge=0, le=100)
    """little used places tried for a patch per sweep, at the coarse scales; where `narrowing` is `tries`, per
    iteration"""
    random_share: float = Field(0.4, ge=0, le=1)
    """share of the scales, coarsest first, at which `random_tries` places are tried, and `fine_tries` at others"""
    histogram_share: float = Field(0.5, ge=0, le=1)
    """share of the scales, coarsest first, at which votes also match the exemplar's histograms"""
    tolerance: float = Field(0.0, ge=0, lt=1)
    """a scale ends early when an iteration changes no more than this share of the patches"""
    regularity: float = Field(0.0, ge=0, le=100)
    """weight of the lattice phase, CIELAB units: a phase error of half a cell counts as twice this difference; of
    half the period of straight lines at uneven distances, as once"""
    period: Size | None = None
    """size of the parts of a tileable result that each contain whole cells of the lattice, as the tiles
    of an atlas do, px; null: all of it"""
    weights: MapWeights = Field({})
    final_sigma: float | None = Field(None, gt=0, le=100)
    """standard deviation of the Gaussian weights of a patch's votes in the last vote, px; null weighs all alike"""
    starts: int = Field(1, ge=1, le=16)
    """results that are begun at the coarsest scales; the one of least repetition, distance of colours to the
    exemplar's, energy and occurrence penalty is continued"""
    border: bool = False
    """the exemplar is continued by half a patch, mirrored, so that its outermost pixels are used like all others"""

    @pydantic.model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, values: Any) -> Any:
        return with_preset(values, PRESETS)


@dataclasses.dataclass(frozen=True)
class OptimiseScale:
    """The state after a scale, from which a run resumes."""

    match: Annotated[UInt32[np.ndarray, "p q 2"], Channels(("row", "column"))]
    """top-left pixel of the exemplar patch of each target patch, at this scale"""
    scales: list[dict[str, Any]]
    """the scales so far; see `Optimised`"""


@dataclasses.dataclass(frozen=True)
class Optimised:
    """The new texture."""

    image: Image
    """all channels of the exemplar"""
    match: Correspondence
    """source of each pixel of the result in the exemplar"""
    occurrence: ScalarMap
    """use of each exemplar pixel by the result's patches; 1 is uniform use of the unmasked pixels"""
    scales: list[dict[str, Any]]
    """for each scale, coarsest first: height and width of the result, px; number of iterations; energy per patch,
    squared CIELAB units per pixel, and the occurrence penalty in it; share of patches changed in the last
    iteration"""
    patches: Annotated[UInt32[np.ndarray, "p q 2"], Channels(("row", "column"))] | None
    """those of the last vote, see `VotedPatches`; None where pixels are kept"""
    voting: dict[str, Any]
    """how that vote was made, see `VotedPatches`; empty where pixels are kept"""


@dataclasses.dataclass(frozen=True)
class _Scale(Scale):
    """Parameters of one scale. The target has a margin of `patch_size` - 1 px where it is not tileable."""

    occurrence: float
    effort: Effort
    histogram: bool
    """votes match the exemplar's histograms"""
    phase: bool
    """a lattice is enforced"""
    allowed: Allowed | None
    """exemplar patches without masked pixels; none for all"""

    @property
    def cost(self) -> float:
        """Relative amount of work."""
        return super().cost * self.effort.sweeps


def _plan(
    exemplar: tuple[int, int],
    full: tuple[int, int],
    generators: Vectors | None,
    usable: Mask | None,
    params: OptimiseParams,
) -> list[_Scale]:
    """The scales, coarsest first. ``full`` is the height and width that the target patches cover at full size."""
    size = params.patch_size
    factors = scale_sizes(*exemplar, _coarsest_side(min(exemplar), full, generators, params), params.ratio)
    alloweds = allowed_at_scales(usable, exemplar, factors, size)
    factors = factors[-len(alloweds) :]
    count = len(factors)
    margin = _margin(params)
    scales = []
    for level, factor in enumerate(factors, 1):
        progress = (level - 1) / (count - 1) if count > 1 else 1.0
        occurrence = params.occurrence
        if occurrence > 0 and params.occurrence_coarse > 0:
            occurrence = params.occurrence_coarse * (occurrence / params.occurrence_coarse) ** progress
        sides, target = ([scaled(side, factor) for side in size] for size in (exemplar, full))
        fine = level > round(params.random_share * count)
        effort = Effort(
            sweeps=params.coarse_sweeps if level <= count / 2 else params.fine_sweeps,
            tries=params.fine_tries if fine else params.random_tries,
            fill_tries=params.fill_tries if level <= round(_FILL_SHARE * count) and occurrence > 0 else 0,
            tolerance=params.tolerance,
            narrow=params.narrowing == "tries",
            distance_per_try=params.distance_per_try if fine else 0.0,
        )
        # The schedule is for ten scales and is stretched to other numbers.
        iterations = round(params.first_iterations - params.fewer_iterations * 9 * progress)
        scales.append(
            _Scale(
                level=level,
                factor=factor,
                exemplar=(sides[0], sides[1]),
                places=(sides[0] - size + 1, sides[1] - size + 1),
                target=(target[0], target[1]),
                patches=(target[0] - margin[0], target[1] - margin[1]),
                iterations=max(params.last_iterations, iterations),
                occurrence=occurrence,
                effort=effort,
                histogram=level <= round(params.histogram_share * count),
                phase=generators is not None and level <= max(1, round(_PHASE_SHARE * count)),
                allowed=alloweds[level - 1],
            )
        )
    return scales


def _margin(params: OptimiseParams) -> tuple[int, int]:
    """What is synthesised above and below the result, left and right of it, px."""
    down, across = (0 if around else params.patch_size - 1 for around in params.tileable or NOWHERE)
    return down, across


def _coarsest_side(exemplar: int, full: tuple[int, int], generators: Vectors | None, params: OptimiseParams) -> int:
    """Shorter side of the exemplar at the first scale, px, given it and the target's sides at full size."""
    size = params.patch_size
    side = max(params.coarsest, math.ceil(1.5 * size))
    if generators is not None:
        spacing = min_spacing(generators)
        side = max(side, min(exemplar, math.ceil(_MIN_CELL * exemplar / spacing)))
    return max(side, coarsest_side(exemplar, full, size, params.tileable or NOWHERE))


class _Optimisation:
    """The data of one run, and the iterations at a scale."""

    def __init__(
        self,
        image: Image,
        guidance: ScalarMap | None,
        weight: float,
        guides: Guides | None,
        phase: LatticePhase | None,
        regularity: float,
        fixed: FixedPixels | None,
        params: OptimiseParams,
    ):
        exemplar = FilledExemplar.of(image)
        self.image = exemplar.image
        self.sizes = Halvings(self.image.pixels)
        self.compared = PatchFeatures(
            exemplar, guidance, weight, params.weights, guides, phase, regularity,
            params.patch_size, None if fixed is None else fixed.shown,
        )  # fmt: skip
        self.fixed = fixed
        self.params = params
        self.final = window(params.patch_size, params.final_sigma)
        self.wrap = params.tileable or NOWHERE
        self.margin = _margin(params)

    @property
    def lab(self) -> Float32[np.ndarray, "h w 3"]:
        """CIELAB of the exemplar."""
        if self.compared.colors == 3:
            return np.ascontiguousarray(self.compared.planes[..., :3])
        return lab_from_linear(self.image.color)

    def rounds(
        self, match: Patches, scale: _Scale, features: FeaturesOfScale, random: np.random.Generator
    ) -> Rounds:
        """Improve ``match`` in place at one scale, iteration by iteration."""
        params, size, wrap = self.params, self.params.patch_size, self.wrap
        exemplar, given, where = features
        channels = exemplar.shape[1] // scale.exemplar[1]
        expected, expected_places = self._expected(scale)
        search = Search(
            exemplar, channels, size, scale.places, scale.patches, wrap, scale.occurrence, params.overuse,
            scale.allowed, expected_places,
        )  # fmt: skip
        histogram = None
        if scale.histogram:
            usable = None if scale.allowed is None else scale.allowed.pixels
            histogram = HistogramVote(exemplar, size, wrap, *self.compared.ranges(channels), usable, expected)
        padded = (scale.patches[0] + size - 1, scale.patches[1] + size - 1)
        fixed = None
        if self.fixed is not None:
            fixed = self.fixed.target(exemplar, channels, scale.target, scale.factor, padded, self.compared)

        def vote(current: np.ndarray | None) -> np.ndarray:
            target: np.ndarray
            if current is None or histogram is None:
                target = mean_vote(match, exemplar, channels, size, wrap, current)
            else:
                target = histogram(match, current, random)
            if given is not None:
                planes = target.reshape(given.shape[0], -1, channels)[..., -given.shape[2] :]
                for band in bands(len(planes), target, given):
                    np.copyto(planes[band], given[band], where=True if where is None else where[band])
            if fixed is not None:
                np.copyto(target.reshape(*padded, channels), fixed[1], where=fixed[0])
            return target

        target = vote(None)
        while True:
            yield search.step(target, match, scale.effort, random)
            target = vote(target)

    def _expected(
        self, scale: _Scale
    ) -> tuple[Float32[np.ndarray, "h w"] | None, Float32[np.ndarray, "p q"] | None]:
        """Use of exemplar pixels and of patches that the guides ask for, relative to even use; none without."""
        guides, size = self.compared.guides, self.params.patch_size
        if guides is None:
            return None, None
        own, target = guides.at(scale, scale.target, self.margin)
        usable = None if scale.allowed is None else scale.allowed.pixels
        expected = expected_use(own, target, size, usable)
        middle = tuple(slice(size // 2, size // 2 + count) for count in scale.places)
        return expected, expected[middle]

    def picture(self, match: Patches, scale: _Scale, margin: tuple[int, int] = (0, 0)) -> Image:
        """The result at a scale: all channels, linear, without ``margin`` px above and below, left and right."""
        small = self.sizes.resized(*scale.exemplar)
        pixels = vote_pixels(match, small, self.final, self.wrap, margin)
        return result_image(pixels, self.image)


@stage(version=1, check=check_patches, in_bands=True)
def optimise(
    image: Image,
    start: Correspondence,
    params: OptimiseParams,
    rng: np.random.Generator,
    guidance: ScalarMap | None = None,
    weight: float = 1.0,
    generators: Vectors | None = None,
    keep: Bool[np.ndarray, "_ _"] | None = None,
    given: Image | None = None,
    exemplar_guide: Float32[np.ndarray, "h w k"] | None = None,
    target_guide: Float32[np.ndarray, "H W k"] | None = None,
    guiding: Bool[np.ndarray, "_ _"] | None = None,
    checkpoints: Checkpoints = NoCheckpoints(),  # noqa: B008
) -> Optimised:
    """Make every patch of the result similar to a patch of the exemplar, and use the exemplar uniformly.

    Two steps alternate at every scale: each target patch searches the exemplar patch of least difference in CIELAB,
    guidance and maps plus an occurrence penalty, which rises with that patch's use; then each pixel becomes an
    average of the votes of all patches over it. The last vote averages the exemplar's own pixels in all
    channels, linear.

    Along axes that are not tileable the result is synthesised with a margin of `patch_size` - 1 px, so that its
    border has the quality of its middle, and cropped at the end.

    With `border` the exemplar is continued by its mirror image, of which no pixel is a source.

    Masked pixels of the exemplar (see `usable`) are never used: no patch that contains one is copied or voted for.
    Coarse scales with too few unmasked patches are omitted.

    Parameters
    ----------
    image : the exemplar. Its maps besides colour are compared by their principal components, weighted by
        ``weights``. All are voted from one correspondence; normals (``normal.X normal.Y normal.Z``) keep unit
        length.
    start : source of every pixel of the result in the exemplar; its size is the result's.
    guidance : distance to features, 0..100; see `signed_distance`.
    weight : factor on ``guidance``, whose energy is scaled by its square; see `guidance_weight`.
    generators : the exemplar's lattice, two rows of px, or one, at right angles to its courses; none or no rows
        where it has none. Patches are then also compared by their phase in the lattice; a tileable result contains
        whole cells; and where nothing is kept or guided, joints that cross a cell are moved to its outline where
        that halves their cost. Not in the paper.
    keep : true where the result is given: there it is bit-identical to the exemplar's pixels, masked or not, that
        ``start`` names, and the rest is synthesised to match. None keeps nothing.
    given : an image of the result's size with the exemplar's channels, whose pixels are kept instead of those that
        ``start`` names, as when a texture is revised.
    exemplar_guide, target_guide : what lies where in the exemplar and what is to lie where in the result, CIELAB
        units; see `guide`. Patches are also compared by it, and the exemplar's patches of every value of the guide
        are used uniformly. The target's is resized to the result, and NaN where it asks for nothing. None without a
        guide.
    guiding : true where pixels of ``keep`` are only matched to: the result has the votes of its patches there,
        which resemble them. None for none.

    Raises
    ------
    InputError
        the exemplar, its unmasked part, or a tileable result, does not contain a patch; ``weights`` names a map
        that the exemplar lacks.
    ValueError
        ``guidance``, ``start``, ``keep`` or a guide does not fit.

    Notes
    -----
    As in the authors' code, distances are means over a patch's pixels, and ``occurrence`` is relative to them.
    Where the paper updates the occurrence map after every change, we update it between strips of the result,
    which makes no visible difference and gives the same bits for any number of threads.

    References
    ----------
    [Kaspar2015]_ sections 3 and 3.2; [Kopf2007]_ for histogram voting; [Barnes2009]_ for the search;
    [Hertzmann2001]_ for guides.

    Examples
    --------
    >>> import skimage.data, texloom
    >>> brick = skimage.data.brick()[:48, :48]
    >>> start = texloom.stages.initialise(brick, size=(48, 64)).match
    >>> texloom.stages.optimise(brick, start, preset="fast").image.shape
    (48, 64, 1)
    """
    _check_inputs(image, start, guidance, keep, given, guiding)
    kept = image if given is None else given
    wrap = wraps_after(params.tileable, NOWHERE if keep is None else kept.wraps)
    params = params.model_copy(update={"tileable": wrap})
    border = Border(params.patch_size if params.border else 1)
    guides = _guides(image, start, exemplar_guide, target_guide, border)
    sides = image.height, image.width
    image, start = border.around_image(image), border.moved(start)
    guidance = None if guidance is None else border.around(guidance)
    phase, regularity = None, params.regularity
    if generators is not None and len(generators) and regularity > 0:
        if len(generators) == 1 and (2 * np.abs(generators[0]) >= sides).any():
            regularity *= _LINES
        phase = LatticePhase(generators, start, wrap, None if given is None else keep, params.period)
    margin = _margin(params)
    full = full_size(start, margin)
    usable = valid_pixels(image)
    fixed = None if keep is None else FixedPixels(keep, start, margin, given, guiding)
    scales = _plan((image.height, image.width), full, generators if phase else None, usable, params)
    optimisation = _Optimisation(image, guidance, weight, guides, phase, regularity, fixed, params)
    match, done = _run(optimisation, scales, start, full, rng, checkpoints)

    if phase is not None and len(phase.origin) == 2 and keep is None and guides is None:
        complete_cells(
            match, optimisation.lab, params.patch_size, margin, wrap, generators, phase, scales[-1].allowed
        )

    made = optimisation.picture(match, scales[-1], margin)
    source = correspondence.to_pixels(match, params.patch_size, wrap, margin)
    if fixed is not None:
        fixed.put(made.pixels, source, without_usable(image))
        if given is None:  # else it is a window of what the caller makes
            tell_holes(_LOG, made)
    border.move_back(source)
    used_area = None if usable is None else int(usable.sum())
    occurrence = occurrence_map(match, (image.height, image.width), params.patch_size, used_area)
    occurrence = border.inside(occurrence, *sides)
    if params.border:
        own = sides[0] * sides[1] if usable is None else int(border.inside(usable, *sides).sum())
        occurrence *= np.float32(own / occurrence.sum(dtype=np.float64))
    voted = None
    if keep is None:
        voted = VotedPatches(to_layers(match), sides, params.patch_size, params.final_sigma, params.border, wrap)
    return Optimised(
        image=made.wrapping(wrap),
        match=source,
        occurrence=occurrence,
        scales=done,
        patches=None if voted is None else voted.patches,
        voting={} if voted is None else voted.record(),
    )


def _check_inputs(
    image: Image,
    start: Correspondence,
    guidance: ScalarMap | None,
    keep: Bool[np.ndarray, "_ _"] | None,
    given: Image | None,
    guiding: Bool[np.ndarray, "_ _"] | None,
) -> None:
    height, width = start.shape[:2]
    if guidance is not None and guidance.shape != (image.height, image.width):
        raise ValueError(f"guidance of shape {guidance.shape} for an exemplar of {format_size(image)}")
    check_start(image, start)
    if keep is not None and keep.shape != (height, width):
        raise ValueError(f"keep of shape {keep.shape} for a start of {format_size((height, width))}")
    if guiding is not None and guiding.shape != (height, width):
        raise ValueError(f"guiding of shape {guiding.shape} for a start of {format_size((height, width))}")
    if given is not None:
        if (given.height, given.width) != (height, width):
            raise ValueError(f"given of {format_size(given)} for a start of {format_size((height, width))}")
        channels = without_usable(image).channels
        if given.channels != channels:
            raise ValueError(f"given has the channels {given.channels}, the exemplar {channels}")


def _guides(
    image: Image,
    start: Correspondence,
    exemplar_guide: Float32[np.ndarray, "h w k"] | None,
    target_guide: Float32[np.ndarray, "H W k"] | None,
    border: Border,
) -> Guides | None:
    if exemplar_guide is None or target_guide is None:
        if exemplar_guide is not target_guide:
            raise ValueError("exemplar_guide and target_guide go together")
        return None
    if exemplar_guide.shape[:2] != (image.height, image.width) or exemplar_guide.shape[2] != target_guide.shape[2]:
        raise ValueError(
            f"guides of shapes {exemplar_guide.shape} and {target_guide.shape} for an exemplar of "
            f"{format_size(image)}"
        )
    return Guides(border.around(exemplar_guide), resize_target(target_guide, start.shape[0], start.shape[1]))


def _run(
    optimisation: _Optimisation,
    scales: list[_Scale],
    start: Correspondence,
    full: tuple[int, int],
    rng: np.random.Generator,
    checkpoints: Checkpoints,
) -> tuple[Patches, list[dict[str, Any]]]:
    """Optimise scale by scale, from the last checkpoint on; the match at full size, and a record of each scale."""
    params = optimisation.params
    randoms = rng.spawn(len(scales))
    runs: list[_Run] = [_Run(None, [], randoms)]
    tried = min(_TRIED_SCALES, len(scales) - 1)
    first = 0
    resumed = checkpoints.latest(OptimiseScale)
    if resumed is not None:
        first, state = resumed
        runs = [_Run(from_layers(state.match), list(state.scales), randoms)]
    elif optimisation.fixed is None and tried:
        runs += [_Run(None, [], rng.spawn(tried)) for _ in range(params.starts - 1)]
    for scale in scales[first:]:
        matches = [_begun(run.match, scale, scales, start, full, params.patch_size) for run in runs]
        features = optimisation.compared.at(scale, scale.phase, optimisation.margin)
        records = improve_all(
            [
                optimisation.rounds(match, scale, features, run.randoms[scale.level - 1])
                for match, run in zip(matches, runs, strict=True)
            ],
            scale, scales, params.tolerance, [partial(optimisation.picture, match, scale) for match in matches],
        )  # fmt: skip
        runs = [
            _Run(match, [*run.done, record], run.randoms)
            for match, run, record in zip(matches, runs, records, strict=True)
        ]
        if len(runs) > 1:
            if scale.level < tried:
                continue
            exemplar = optimisation.image.elsewhere(optimisation.sizes.resized(*scale.exemplar))
            results = [optimisation.picture(run.match, scale) for run in runs if run.match is not None]
            best = runs[best_start(exemplar, results, [run.done[-1] for run in runs])]
            runs = [_Run(best.match, best.done, randoms)]
        match, done = runs[0].match, runs[0].done
        assert match is not None
        if scale.level < len(scales):
            checkpoints.save(scale.level, OptimiseScale(to_layers(match), done))
    match = runs[0].match
    assert match is not None
    return match, runs[0].done


@dataclasses.dataclass(frozen=True)
class _Run:
    """A result so far."""

    match: Patches | None
    """none before the first scale"""
    done: list[dict[str, Any]]
    """a record of each scale"""
    randoms: list[np.random.Generator]
    """of each scale"""


def _begun(
    match: np.ndarray | None,
    scale: _Scale,
    scales: list[_Scale],
    start: Correspondence,
    full: tuple[int, int],
    patch_size: int,
) -> Patches:
    """The match with which a scale begins, from that of the scale before, or else from the start."""
    if match is None:
        match = correspondence.from_pixels(start, full, scale.patches, scale.places, patch_size, scale.factor)
    else:
        growth = scale.factor / scales[scale.level - 2].factor
        match = correspondence.rescale(match, scale.patches, scale.places, growth)
    return match if scale.allowed is None else scale.allowed.moved(match)
