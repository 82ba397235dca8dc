"""Textures by bidirectional similarity: coherent with the exemplar, and complete."""

import dataclasses
from functools import partial
from typing import Annotated, Any

import numpy as np
from jaxtyping import Bool, Int16, UInt32
from pydantic import Field

from texloom.stages.synthesis.optimisation import correspondence
from texloom.stages.synthesis.optimisation.bidirectional_vote import ReversePatches, bidirectional_vote
from texloom.stages.synthesis.optimisation.correspondence import Patches, from_layers, to_layers
from texloom.stages.synthesis.optimisation.inputs import check_patches, check_start
from texloom.stages.synthesis.optimisation.match_search import Search
from texloom.stages.synthesis.optimisation.plain import (
    PlainOptimisation,
    PlainParams,
    PlainScale,
    PlainTexture,
    margin_of,
    match_at,
    plain_scales,
    scaled_exemplar,
)
from texloom.stages.synthesis.optimisation.scale import Rounds, improve
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


class _Optimisation(PlainOptimisation[BidirectionalParams]):
    """The iterations at a scale."""

    def rounds(
        self, match: Patches, reverse: ReversePatches, scale: PlainScale, first: bool, random: np.random.Generator
    ) -> Rounds:
        """Improve ``match`` and ``reverse`` in place at one scale, iteration by iteration.

        Parameters
        ----------
        first : ``reverse`` is random, and does not vote before its first search.
        """
        params, size, wrap = self.params, self.params.patch_size, self.params.tileable
        exemplar, _, _ = self.compared.at(scale, False, margin_of(params))
        channels = exemplar.shape[1] // scale.exemplar[1]
        planes = exemplar.reshape(*scale.exemplar, channels).astype(np.float32)

        def vote(completeness: float) -> Int16[np.ndarray, "H Wc"]:
            voted = bidirectional_vote(match, reverse, planes, self.even, completeness, _places(scale), wrap)
            rounded = np.rint(voted).astype(np.int16).reshape(voted.shape[0], -1)
            return pad_torus(rounded, channels, size, wrap) if wrap else rounded

        target = vote(0.0 if first else params.completeness)
        forward = Search(exemplar, channels, size, scale.places, scale.patches, wrap, 0.0, 1.0, scale.allowed)
        while True:
            coherence, _, changed = forward.step(target, match, scale.effort, random)
            completeness = 0.0
            if params.completeness > 0:
                backward = Search(target, channels, size, scale.patches, scale.places, NOWHERE, 0.0, 1.0)
                completeness = params.completeness * backward.step(exemplar, reverse, scale.effort, random)[0]
            yield (1 - params.completeness) * coherence + completeness, completeness, changed
            target = vote(params.completeness)

    def picture(self, match: Patches, reverse: ReversePatches, scale: PlainScale) -> Image:
        """The result at a scale: all channels, linear."""
        pixels = bidirectional_vote(
            match, reverse, scaled_exemplar(self.image, scale), self.final, self.params.completeness,
            _places(scale), self.params.tileable,
        )  # fmt: skip
        return result_image(pixels, self.image)


def _places(scale: PlainScale) -> Bool[np.ndarray, "h_places w_places"] | None:
    """The exemplar patches without masked pixels; none for all."""
    return None if scale.allowed is None else scale.allowed.places


@stage(version=1, check=check_patches)
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
    scales = plain_scales(image, start, params)
    optimisation = _Optimisation(image, params)
    match, reverse, done = _run(optimisation, scales, start, rng.spawn(len(scales)), checkpoints)
    whole = optimisation.picture(match, reverse, scales[-1])
    return Bidirectional.cropped(whole, match, image, params, done)


def _run(
    optimisation: _Optimisation,
    scales: list[PlainScale],
    start: Correspondence,
    randoms: list[np.random.Generator],
    checkpoints: Checkpoints,
) -> tuple[Patches, ReversePatches, list[dict[str, Any]]]:
    """Optimise scale by scale, from the last checkpoint on; both matches at full size, and the scales' records."""
    params = optimisation.params
    match: Patches | None = None
    reverse: ReversePatches | None = None
    done: list[dict[str, Any]] = []
    level = 0
    resumed = checkpoints.latest(BidirectionalScale)
    if resumed is not None:
        level, state = resumed
        match, reverse, done = from_layers(state.match), from_layers(state.reverse), list(state.scales)
    for scale, random in list(zip(scales, randoms, strict=True))[level:]:
        first = reverse is None
        match = match_at(scales, scale, match, start, params)
        if reverse is None:
            places = [random.integers(0, count, scale.places, np.int32) for count in scale.patches]
            reverse = np.stack(places)
        else:
            growth = scale.factor / scales[scale.level - 2].factor
            reverse = correspondence.rescale(reverse, scale.places, scale.patches, growth)
        rounds = optimisation.rounds(match, reverse, scale, first, random)
        preview = partial(optimisation.picture, match, reverse, scale)
        done.append(improve(rounds, scale, scales, params.tolerance, preview))
        if scale.level < len(scales):
            state = BidirectionalScale(to_layers(match), to_layers(reverse), preview(), list(done))
            checkpoints.save(scale.level, state)
    assert match is not None
    assert reverse is not None
    return match, reverse, done
