"""Textures by bidirectional similarity: coherent with the exemplar, and complete."""

import dataclasses
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from jaxtyping import Bool, Int16, UInt32
from pydantic import Field

from texloom.stages.synthesis.optimisation import correspondence
from texloom.stages.synthesis.optimisation.bidirectional_vote import ReversePatches, bidirectional_vote
from texloom.stages.synthesis.optimisation.coarse_to_fine import PatchScale, coarse_to_fine, patch_scales
from texloom.stages.synthesis.optimisation.correspondence import Patches, from_layers, to_layers
from texloom.stages.synthesis.optimisation.inputs import check_patches, check_start
from texloom.stages.synthesis.optimisation.match_search import Search
from texloom.stages.synthesis.optimisation.plain import PlainOptimisation, PlainParams, PlainTexture
from texloom.stages.synthesis.optimisation.scale import Rounds
from texloom.stages.synthesis.optimisation.vote import pad_torus, result_image
from texloom.stages.vocabulary.arrays import Channels, Correspondence, Image
from texloom.stages.vocabulary.checkpoints import Checkpoints, NoCheckpoints
from texloom.stages.vocabulary.declare import stage
from texloom.stages.vocabulary.facts import NOWHERE


class BidirectionalParams(PlainParams):
    """Parameters of bidirectional similarity. A preset replaces some defaults; explicit values override it."""

    completeness: float = Field(0.5, ge=0, lt=1)
    """weight of completeness, that all patches of the exemplar occur in the result; the rest is the weight of
    coherence, that all patches of the result occur in the exemplar. 0 is plain texture optimisation"""


@dataclasses.dataclass(frozen=True)
class BidirectionalScale:
    """The state after a scale, from which a run resumes."""

    match: Annotated[UInt32[np.ndarray, "p q 2"], Channels(("row", "column"))]
    """top-left pixel of the exemplar patch of each target patch, at this scale"""
    reverse: Annotated[UInt32[np.ndarray, "m n 2"], Channels(("row", "column"))]
    """top-left pixel of the target patch of each exemplar patch"""
    image: Image
    """the result so far, with a margin of `patch_size` - 1 px where it is not tileable"""
    scales: list[dict[str, Any]]
    """the scales so far; see `Bidirectional`"""


@dataclasses.dataclass(frozen=True)
class Bidirectional(PlainTexture):
    """The new texture."""

    scales: list[dict[str, Any]]
    """for each scale, coarsest first: height and width of the result, px; number of iterations; energy, the mean
    squared differences of coherence and completeness by their weights, squared CIELAB units per pixel, and the
    part of completeness in it; share of target patches changed in the last iteration"""


class _Matches(NamedTuple):
    """What changes at a scale."""

    match: Patches
    reverse: ReversePatches


class _BidirectionalOptimisation(PlainOptimisation[BidirectionalParams]):
    """The iterations at a scale."""

    saved: ClassVar = BidirectionalScale

    def begun(self, scale: PatchScale, before: _Matches | None, random: np.random.Generator) -> _Matches:
        """Both matches of the scale before; of the first scale that of the start, and random ones."""
        match = self.match_at(scale, None if before is None else before.match)
        if before is None:
            reverse = np.stack([random.integers(0, count, scale.places, np.int32) for count in scale.patches])
            return _Matches(match, reverse)
        return _Matches(match, correspondence.rescale(before.reverse, scale.places, scale.patches, scale.growth))

    def rounds(self, state: _Matches, scale: PatchScale, random: np.random.Generator) -> Rounds:
        """Improve both matches in place at one scale, iteration by iteration.

        At the first scale the reverse ones are random, and do not vote before their first search.
        """
        (match, reverse), params = state, self.params
        size, wrap = params.patch_size, params.tileable
        exemplar, _, _ = self.compared.at(scale, False, params.beyond)
        channels = exemplar.shape[1] // scale.exemplar[1]
        planes = exemplar.reshape(*scale.exemplar, channels).astype(np.float32)

        def vote(completeness: float) -> Int16[np.ndarray, "H Wc"]:
            voted = bidirectional_vote(match, reverse, planes, self.even, completeness, _places(scale), wrap)
            rounded = np.rint(voted).astype(np.int16).reshape(voted.shape[0], -1)
            return pad_torus(rounded, channels, size, wrap) if wrap else rounded

        target = vote(0.0 if scale.level == 1 else params.completeness)
        forward = Search(exemplar, channels, size, scale.places, scale.patches, wrap, 0.0, 1.0, scale.allowed)
        while True:
            coherence, _, changed = forward.step(target, match, scale.effort, random)
            completeness = 0.0
            if params.completeness > 0:
                backward = Search(target, channels, size, scale.patches, scale.places, NOWHERE, 0.0, 1.0)
                completeness = params.completeness * backward.step(exemplar, reverse, scale.effort, random)[0]
            yield (1 - params.completeness) * coherence + completeness, completeness, changed
            target = vote(params.completeness)

    def picture(self, state: _Matches, scale: PatchScale) -> Image:
        """The result at a scale: all channels, linear."""
        pixels = bidirectional_vote(
            *state, self.scaled_exemplar(scale), self.final, self.params.completeness,
            _places(scale), self.params.tileable,
        )  # fmt: skip
        return result_image(pixels, self.image)

    def save(self, state: _Matches, scale: PatchScale, scales: list[dict[str, Any]]) -> BidirectionalScale:
        """A checkpoint."""
        return BidirectionalScale(
            to_layers(state.match), to_layers(state.reverse), self.picture(state, scale), scales
        )

    def restored(self, saved: BidirectionalScale) -> _Matches:
        """The state of a checkpoint."""
        return _Matches(from_layers(saved.match), from_layers(saved.reverse))


def _places(scale: PatchScale) -> Bool[np.ndarray, "h_places w_places"] | None:
    """The exemplar patches without masked pixels; none for all."""
    return None if scale.allowed is None else scale.allowed.places


@stage(version=1, check=check_patches, exemplar_bytes=120)
def bidirectional(
    image: Image,
    start: Correspondence,
    params: BidirectionalParams,
    rng: np.random.Generator,
    checkpoints: Checkpoints = NoCheckpoints(),  # noqa: B008
) -> Bidirectional:
    """Make every patch of the result similar to one of the exemplar, and every patch of the exemplar to one of it.

    Two searches and a vote alternate at every scale, coarse to fine: each patch of the result searches the exemplar
    (coherence), each patch of the exemplar searches the result (completeness), and each pixel becomes the mean of
    the pixels that both kinds of patches propose. The votes of a kind together have the weight of its term, however
    many patches there are. Patches are compared in CIELAB and maps.

    Completeness asks that each patch occurs, not how often: most of a result larger than the exemplar is
    determined by coherence alone, and may repeat.

    A result is synthesised with a margin of `patch_size` - 1 px along axes that are not tileable, and cropped.
    Masked pixels of the exemplar (see `usable`) are never used, and need not occur.

    Parameters
    ----------
    image : the exemplar. Its maps besides colour are compared by their principal components, weighted by
        ``weights``. All are voted from the same correspondences; normals keep unit length.
    start : source of every pixel of the result in the exemplar; its size is the result's.

    Raises
    ------
    InputError
        the exemplar, its unmasked part, or a tileable result, does not contain a patch; ``weights`` names a map
        that the exemplar lacks.
    ValueError
        ``start`` does not fit.

    References
    ----------
    [Simakov2008]_ equation (1), and section 3 for the vote. The paper changes the size of a given image gradually;
    a texture starts from random pixels instead, coarse to fine. [Kaspar2015]_ Figure 4 compares with it as two-way
    similarity. [Barnes2009]_ for the search. The narrow last vote is ours.
    """
    check_start(image, start)
    scales = patch_scales(image, start, params)
    optimisation = _BidirectionalOptimisation(image, start, params)
    state, done = coarse_to_fine(optimisation, scales, rng.spawn(len(scales)), params.tolerance, checkpoints)
    whole = optimisation.picture(state, scales[-1])
    return Bidirectional.cropped(whole, state.match, image, params, done)
