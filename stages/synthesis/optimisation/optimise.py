"""Self-tuning texture optimisation: patch search and voting alternate from coarse to fine."""

import dataclasses
import logging
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float32, UInt32

from texloom.stages.analysis.structure.contour_cells import ContourCells
from texloom.stages.analysis.structure.ground_objects import MIN_GROUND, GroundObjects
from texloom.stages.common.grids.border import Border
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.common.grids.working_size import Halvings
from texloom.stages.common.similarity.neighbourhoods import Rectangles
from texloom.stages.synthesis.optimisation import correspondence
from texloom.stages.synthesis.optimisation.cells import complete_cells
from texloom.stages.synthesis.optimisation.coarse_to_fine import (
    CoarserPatches,
    PatchScale,
    coarse_to_fine,
    match_at,
    patch_scales,
)
from texloom.stages.synthesis.optimisation.correspondence import Patches, from_layers, to_layers
from texloom.stages.synthesis.optimisation.even_joints import EvenJoints
from texloom.stages.synthesis.optimisation.features import FeaturesOfScale, PatchFeatures
from texloom.stages.synthesis.optimisation.fixed import FixedPixels
from texloom.stages.synthesis.optimisation.guides import Guides, expected_use, guides_of
from texloom.stages.synthesis.optimisation.inputs import check_inputs, check_patches
from texloom.stages.synthesis.optimisation.lattice_alignment import align_pieces
from texloom.stages.synthesis.optimisation.lattice_phase import LatticePhase, min_spacing
from texloom.stages.synthesis.optimisation.match_search import Search, occurrence_map
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.synthesis.optimisation.overuse import Overuse
from texloom.stages.synthesis.optimisation.scale import Rounds
from texloom.stages.synthesis.optimisation.seam_relaxation import relax_seams
from texloom.stages.synthesis.optimisation.several_cells import SeveralCells, completion_of
from texloom.stages.synthesis.optimisation.several_exemplars import Balance, SeveralExemplars, largest_block
from texloom.stages.synthesis.optimisation.starts import best_start
from texloom.stages.synthesis.optimisation.vote import HistogramVote, mean_vote, result_image, vote_pixels, window
from texloom.stages.vocabulary.arrays import Channels, Correspondence, Image, ScalarMap, Vectors
from texloom.stages.vocabulary.checkpoints import Checkpoints, NoCheckpoints
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.masks import FilledExemplar, tell_holes, valid_pixels, without_usable
from texloom.stages.vocabulary.scratch import bands
from texloom.stages.vocabulary.tileable import wraps_after
from texloom.stages.vocabulary.voted_patches import VotedPatches

_LOG = logging.getLogger(__name__)

_MIN_CELL = 8  # px between lattice lines at the first scale; smaller cells would not be resolved
_PATCHES_A_BLOCK = 1.5  # at the first scale, of blocks of several exemplars; smaller ones would vanish
_PHASE_SHARE = 0.8  # of the scales, coarsest first, at which the lattice is enforced; finer ones preserve it
_LINES = 0.5  # of `regularity` for straight lines at uneven distances; the full one leads to few of their pieces
_OVERUSE = 2.0  # use, in multiples of the average, above which random search rejects a patch
_TRIED_SCALES = 3  # the coarsest ones, after which one of several starts is chosen


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


class _Optimisation:
    """The data of one run, and the iterations at a scale."""

    saved: ClassVar = OptimiseScale

    def __init__(
        self,
        image: Image,
        start: Correspondence,
        guidance: ScalarMap | None,
        weight: float,
        guides: Guides | None,
        phase: LatticePhase | None,
        regularity: float,
        fixed: FixedPixels | None,
        share: ScalarMap | None,
        several: SeveralExemplars | None,
        relaxes: bool,
        params: OptimiseParams,
    ):
        exemplar = FilledExemplar.of(image)
        self.image = exemplar.image
        self.sizes = Halvings(self.image.pixels)
        self.compared = PatchFeatures(
            exemplar, guidance, weight, params.weights, guides, phase, regularity,
            params.patch_size, None if fixed is None else fixed.shown,
        )  # fmt: skip
        self.start = start
        self.fixed = fixed
        self.share = share
        self.several = several
        self.relaxes = relaxes
        self.params = params
        self.final = window(params.patch_size, params.schedule.final_sigma)
        self.wrap = params.tileable or NOWHERE
        self.halved: Float32[np.ndarray, "h w c"] | None = None
        """features of the exemplar at half its size, from the last scale on, where seams are relaxed"""

    @property
    def lab(self) -> Float32[np.ndarray, "h w 3"]:
        """CIELAB of the exemplar."""
        if self.compared.colors == 3 and len(self.compared.planes):
            return np.ascontiguousarray(self.compared.planes[..., :3])
        lab = np.empty((self.image.height, self.image.width, 3), np.float32)
        for band in bands(self.image.height, self.image.pixels):
            lab[band] = lab_from_linear(self.image.elsewhere(self.image.pixels[band]).color)
        return lab

    def begun(
        self,
        scale: PatchScale,
        before: CoarserPatches | None,
        random: np.random.Generator,  # noqa: ARG002
    ) -> Patches:
        """The match with which a scale begins."""
        return match_at(scale, before, self.start, self.params)

    def rounds(self, match: Patches, scale: PatchScale, random: np.random.Generator) -> Rounds:
        """Improve ``match`` in place at one scale, iteration by iteration."""
        phased = self.compared.phase is not None and (scale.level == 1 or scale.within(_PHASE_SHARE))
        features = self.compared.at(scale, phased, self.params.beyond)
        if scale.level == scale.count and self.relaxes:
            self.halved = self.compared.halved()
        if scale.level == scale.count and self.fixed is None:  # else fixed pixels look at the planes once more
            self.compared.release()
        return self._rounds(match, scale, features, random)

    def _rounds(
        self, match: Patches, scale: PatchScale, features: FeaturesOfScale, random: np.random.Generator
    ) -> Rounds:
        params, size, wrap = self.params, self.params.patch_size, self.wrap
        exemplar, given, where = features
        channels = exemplar.shape[1] // scale.exemplar[1]
        expected, expected_places = self._expected(scale)
        balance: Balance | Overuse | None = None
        if self.several is not None:
            balance = self.several.at(scale.exemplar, size, scale.places)
        elif params.most_use is not None and params.occurrence > 0:
            phase = self.compared.phase
            parts = None if phase is None else phase.parts(scale.places, scale.factor)
            balance = Overuse(scale.places, params.most_use, scale.allowed, expected_places, parts)
        search = Search(
            exemplar, channels, size, scale.places, scale.patches, wrap, params.occurrence_at(scale), _OVERUSE,
            scale.allowed, expected_places, balance,
        )  # fmt: skip
        histogram = None
        if scale.within(params.histogram_share):
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
        self, scale: PatchScale
    ) -> tuple[Float32[np.ndarray, "h w"] | None, Float32[np.ndarray, "p q"] | None]:
        """Use of exemplar pixels and of patches that guides and shares ask for, relative to even use; or none."""
        guides, size, expected = self.compared.guides, self.params.patch_size, None
        if guides is not None:
            own, target = guides.at(scale, scale.target, self.params.beyond)
            usable = None if scale.allowed is None else scale.allowed.pixels
            expected = expected_use(own, target, size, usable)
        if self.share is not None:
            share = resize(self.share[..., None], *scale.exemplar, bilinear=True)[..., 0]
            expected = share if expected is None else expected * share
        if expected is None:
            return None, None
        middle = tuple(slice(size // 2, size // 2 + count) for count in scale.places)
        return expected, expected[middle]

    def picture(self, match: Patches, scale: PatchScale, margin: tuple[int, int] = (0, 0)) -> Image:
        """The result at a scale: all channels, linear, without ``margin`` px above and below, left and right."""
        small = self.sizes.resized(*scale.exemplar)
        pixels = vote_pixels(match, small, self.final, self.wrap, margin)
        return result_image(pixels, self.image)

    def save(self, match: Patches, scale: PatchScale, scales: list[dict[str, Any]]) -> OptimiseScale:  # noqa: ARG002
        """A checkpoint."""
        return OptimiseScale(to_layers(match), scales)

    def restored(self, saved: OptimiseScale) -> Patches:
        """The match of a checkpoint."""
        return from_layers(saved.match)

    def best(self, matches: Sequence[Patches], scale: PatchScale, records: Sequence[Mapping[str, Any]]) -> int:
        """The number of the best of several results of a scale."""
        exemplar = self.image.elsewhere(self.sizes.resized(*scale.exemplar))
        return best_start(exemplar, [self.picture(match, scale) for match in matches], records)


@stage(version=5, check=check_patches, in_bands=True, exemplar_bytes=90, seconds=(0.5, 9))
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
    target_guide: Float32[np.ndarray, "_ _ k"] | None = None,
    guiding: Bool[np.ndarray, "_ _"] | None = None,
    contours: ScalarMap | None = None,
    share: ScalarMap | None = None,
    rectangles: Rectangles | None = None,
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
        whole cells. At the end, pieces move onto the result's lattice where that makes their joints cheaper; and
        where nothing is kept or guided and contours show no cells, joints that cross a cell are moved to its
        outline where that halves their cost. Not in the paper.
    keep : true where the result is given: there it is bit-identical to the exemplar's pixels, masked or not, that
        ``start`` names, and the rest is synthesised to match. None keeps nothing.
    given : an image of the result's size with the exemplar's channels, whose pixels are kept instead of those that
        ``start`` names, as when a texture is revised.
    exemplar_guide, target_guide : what lies where in the exemplar and what is to lie where in the result, CIELAB
        units; see `guide`. Patches are also compared by it, and the exemplar's patches of every value of the guide
        are used uniformly. The target's is resized to the result, and NaN where it asks for nothing. None without a
        guide.
    contours : strength of the exemplar's contours, see `edges`. Where they surround cells, such as bricks, and
        nothing is kept or guided, those of the result that show parts of several are replaced by whole ones at the
        end; with ``rectangles`` also under a guide, and where borders between exemplars cut them; see
        `CellCompletion`. Objects apart on a plain ground become whole, or are removed; see `ObjectCompletion`. Not
        in the paper.
    share : use of each exemplar pixel that is wanted, relative to even use, above 0; none for even use.
    rectangles : of several exemplars in one picture, see `exemplar_sheet`; without a guide each gives its share of
        the result, by a penalty on all patches of those that give more.
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
    check_inputs(image, start, keep, given, guiding, {"guidance": guidance, "contours": contours, "share": share})
    kept = image if given is None else given
    wrap = wraps_after(params.tileable, NOWHERE if keep is None else kept.wraps)
    params = params.model_copy(update={"tileable": wrap})
    border = Border(params.patch_size if params.border else 1)
    guides = guides_of(image, start, exemplar_guide, target_guide, border)
    several = None
    if rectangles is not None and guides is None:
        shape = (image.height, image.width)
        several = SeveralExemplars.of(rectangles, valid_pixels(image), share, shape).around(border)
    exemplar, sides = image, (image.height, image.width)
    image, start = border.around_image(image), border.moved(start)
    phase, regularity = None, params.regularity
    if generators is not None and len(generators) and regularity > 0:
        if len(generators) == 1 and (2 * np.abs(generators[0]) >= sides).any():
            regularity *= _LINES
        phase = LatticePhase(generators, start, wrap, None if given is None else keep, params.period)
    margin, usable = params.beyond, valid_pixels(image)
    fixed = None if keep is None else FixedPixels(keep, start, margin, given, guiding)
    resolved = 0.0  # px at the first scale for each px of the exemplar
    if generators is not None and phase is not None:
        resolved = _MIN_CELL / min_spacing(generators)
    elif rectangles is not None and several is not None:
        resolved = _PATCHES_A_BLOCK * params.patch_size / largest_block(rectangles, start.shape[:2])
    cells = math.ceil(resolved * min(image.height, image.width))
    scales = patch_scales(image, start, params, params.occurrence > 0, cells)
    distance = None if guidance is None else border.around(guidance)
    share = None if share is None else border.around(share)
    seams_may_move = keep is None and (guides is None or params.guided_seams)
    relaxes = params.relaxed_seams and seams_may_move and phase is None and several is None
    optimisation = _Optimisation(
        image, start, distance, weight, guides, phase, regularity, fixed, share, several, relaxes, params
    )
    del distance
    randoms, tried = rng.spawn(len(scales)), min(_TRIED_SCALES, len(scales) - 1)
    others = [] if keep is not None or not tried else [rng.spawn(tried) for _ in range(params.starts - 1)]
    match, done = coarse_to_fine(
        optimisation, scales, randoms, params.tolerance, checkpoints, others, optimisation.best
    )

    allowed = scales[-1].allowed
    of_several = None
    if contours is not None and rectangles is not None and keep is None:
        of_several = SeveralCells(contours, rectangles, border)
    between_cells = of_several is not None and of_several.consists.any()  # borders of exemplars come to lie there
    if optimisation.halved is not None and not between_cells:
        relax_seams(match, optimisation.halved, params.patch_size, wrap, allowed, scales[-1].places)
    aligned = phase if params.relaxed_seams and seams_may_move and rectangles is None else None
    found, lattice, objects = None, None, None
    if params.whole_cells and keep is None and (guides is None or rectangles is not None):
        found = None if contours is None else of_several or ContourCells(contours, border)
        objects = found if of_several is None and found is not None and found.ground >= MIN_GROUND else None
        found = found if found is not None and found.clear else None
        lattice = phase if found is None and phase is not None and len(phase.origin) == 2 else None
        objects = objects if lattice is None else None
    lab = None if (aligned, found, lattice, objects) == (None, None, None, None) else optimisation.lab
    if lab is not None and objects is not None:
        objects = GroundObjects(objects, lab)
        found = objects if objects.clear else found
    del optimisation.compared
    if lab is not None:
        if aligned is not None:
            align_pieces(match, lab, params.patch_size, margin, wrap, generators, aligned, allowed)
        if found is not None:
            completion_of(found, lab, params.patch_size, allowed).complete(match, wrap)
        elif lattice is not None:
            complete_cells(match, lab, params.patch_size, margin, wrap, generators, lattice, allowed)
    del lab, found, objects, of_several  # large, as the exemplar may be

    made = optimisation.picture(match, scales[-1], margin)
    source = correspondence.to_pixels(match, params.patch_size, wrap, margin)
    if fixed is not None:
        fixed.put(made.pixels, source, without_usable(image))
        if given is None:  # else it is a window of what the caller makes
            tell_holes(_LOG, made)
    border.move_back(source)
    evens = params.even_joints and seams_may_move and rectangles is None
    if evens:
        EvenJoints(exemplar).apply(made, source, wrap)
    used_area = None if usable is None else int(usable.sum())
    occurrence = occurrence_map(match, (image.height, image.width), params.patch_size, used_area)
    occurrence = border.inside(occurrence, *sides)
    if params.border:
        own = sides[0] * sides[1] if usable is None else int(border.inside(usable, *sides).sum())
        occurrence *= np.float32(own / occurrence.sum(dtype=np.float64))
    voted = None
    if keep is None:
        sigma = params.schedule.final_sigma
        voted = VotedPatches(to_layers(match), sides, params.patch_size, sigma, params.border, evens, wrap)
    return Optimised(
        image=made.wrapping(wrap),
        match=source,
        occurrence=occurrence,
        scales=done,
        patches=None if voted is None else voted.patches,
        voting={} if voted is None else voted.record(),
    )
