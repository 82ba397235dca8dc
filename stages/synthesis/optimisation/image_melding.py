"""Textures by image melding: patches with gain and bias, and votes for gradients."""

import dataclasses
import functools
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np
from jaxtyping import Float32, UInt32
from pydantic import Field

from texloom.stages.common.grids.pyramid import resize
from texloom.stages.synthesis.optimisation.coarse_to_fine import PatchScale, coarse_to_fine, patch_scales
from texloom.stages.synthesis.optimisation.correspondence import Patches, from_layers, to_layers
from texloom.stages.synthesis.optimisation.inputs import check_patches, check_start
from texloom.stages.synthesis.optimisation.melding import Bounds, Melding
from texloom.stages.synthesis.optimisation.plain import PlainOptimisation, PlainParams, PlainTexture
from texloom.stages.synthesis.optimisation.scale import Rounds
from texloom.stages.synthesis.optimisation.vote import result_image, vote_pixels
from texloom.stages.vocabulary.arrays import Channels, Correspondence, Image
from texloom.stages.vocabulary.checkpoints import Checkpoints, NoCheckpoints
from texloom.stages.vocabulary.color import lab_from_linear, linear_from_lab
from texloom.stages.vocabulary.declare import stage

_COLORS = 3

Planes: TypeAlias = Float32[np.ndarray, "H W c"]


class ImageMeldingParams(PlainParams):
    """Parameters of image melding. A preset replaces some defaults; explicit values override it."""

    gradient_weight: float = Field(0.2, ge=0, le=100)
    """weight of squared differences of lightness gradients between patches, and of gradients in the vote; 0 for
    neither"""
    min_gain: float = Field(0.9, gt=0, le=1)
    """least factor on the contrast of an exemplar patch; 1, with a `max_gain` of 1, for no gain"""
    max_gain: float = Field(1.5, ge=1, le=10)
    """largest factor on the contrast of an exemplar patch"""
    bias_lightness: float = Field(10.0, ge=0, le=100)
    """largest change of the mean lightness of an exemplar patch, CIELAB units"""
    bias_color: float = Field(10.0, ge=0, le=200)
    """largest change of the mean a and b of an exemplar patch, CIELAB units"""


@dataclasses.dataclass(frozen=True)
class ImageMeldingScale:
    """The state after a scale, from which a run resumes."""

    match: Annotated[UInt32[np.ndarray, "p q 2"], Channels(("row", "column"))]
    """top-left pixel of the exemplar patch of each target patch, at this scale"""
    target: Planes
    """CIELAB colour and maps of the result so far, to which patches are fitted"""
    image: Image
    """the result so far, with a margin of `patch_size` - 1 px where it is not tileable"""
    scales: list[dict[str, Any]]
    """the scales so far; see `ImageMelding`"""


@dataclasses.dataclass(frozen=True)
class ImageMelding(PlainTexture):
    """The new texture."""


class _State:
    """What changes at a scale: the match in place, and the target."""

    def __init__(self, match: Patches, target: Planes):
        self.match = match
        self.target = target


class _MeldingOptimisation(PlainOptimisation[ImageMeldingParams]):
    """The iterations at a scale."""

    saved: ClassVar = ImageMeldingScale

    @functools.cached_property
    def _planes(self) -> Float32[np.ndarray, "h w c"]:
        return np.concatenate([lab_from_linear(self.image.color), self.compared.maps], axis=2)

    def planes(self, scale: PatchScale) -> Float32[np.ndarray, "h w c"]:
        """The exemplar's CIELAB colour and maps at a scale."""
        return resize(self._planes, *scale.exemplar)

    def melding(self, scale: PatchScale) -> Melding:
        """Search and vote at a scale."""
        params = self.params
        bounds = Bounds(params.min_gain, params.max_gain, params.bias_lightness, params.bias_color)
        allowed = None if scale.allowed is None else scale.allowed.places
        return Melding(
            self.planes(scale), params.patch_size, params.gradient_weight, bounds, allowed, params.tileable
        )

    def begun(self, scale: PatchScale, before: _State | None, random: np.random.Generator) -> _State:  # noqa: ARG002
        """The match and the enlarged target of the scale before; of the first scale the start, and a plain vote."""
        match = self.match_at(scale, None if before is None else before.match)
        if before is None:
            return _State(match, vote_pixels(match, self.planes(scale), self.even, self.params.tileable))
        return _State(match, resize(before.target, *scale.target, bilinear=True))

    def rounds(self, state: _State, scale: PatchScale, random: np.random.Generator) -> Rounds:
        """Improve ``state`` at one scale, iteration by iteration."""
        planes, melding = self.planes(scale), self.melding(scale)
        while True:
            energy = melding.step(state.target, state.match, scale.effort, random)
            state.target = melding.vote(state.match, state.target, planes, self.even)
            yield energy

    def picture(self, state: _State, scale: PatchScale) -> Image:
        """The result at a scale: all channels, linear."""
        pixels = vote_pixels(state.match, self.scaled_exemplar(scale), self.final, self.params.tileable)
        colors = self.planes(scale)[..., :_COLORS]
        target = state.target[..., :_COLORS]
        melding = self.melding(scale)
        lab = melding.vote(state.match, target, colors, self.final)
        color = np.maximum(linear_from_lab(lab), 0)
        count = 1 if self.image.channels[0] == "Y" else _COLORS
        pixels[..., :count] = color[..., 1:2] if count == 1 else color
        return result_image(pixels, self.image)

    def save(self, state: _State, scale: PatchScale, scales: list[dict[str, Any]]) -> ImageMeldingScale:
        """A checkpoint."""
        return ImageMeldingScale(to_layers(state.match), state.target, self.picture(state, scale), scales)

    def restored(self, saved: ImageMeldingScale) -> _State:
        """The state of a checkpoint."""
        return _State(from_layers(saved.match), saved.target)


@stage(version=1, check=check_patches)
def image_melding(
    image: Image,
    start: Correspondence,
    params: ImageMeldingParams,
    rng: np.random.Generator,
    checkpoints: Checkpoints = NoCheckpoints(),  # noqa: B008
) -> ImageMelding:
    """Make every patch of the result similar to a patch of the exemplar with other contrast and tone.

    Search and vote alternate at every scale, coarse to fine. Each patch of the result searches the exemplar; a
    patch found there is first brought to the mean and standard deviation of the result's, channel by channel in
    CIELAB, as far as the bounds of gain and bias allow. Patches are compared by colour, maps, and gradients of
    lightness. Each pixel then becomes an average of the fitted patches over it, and so does each gradient; the
    screened Poisson equation joins both, so that steps between patches become smooth.

    The search does not turn, scale or mirror patches. Maps besides colour have neither gain nor bias nor gradients.

    A result is synthesised with a margin of `patch_size` - 1 px along axes that are not tileable, and cropped.
    Masked pixels of the exemplar (see `usable`) are never used.

    Parameters
    ----------
    image : the exemplar. Its maps besides colour are compared by their principal components, weighted by
        ``weights``. All are voted from one correspondence; normals keep unit length.
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
    [Darabi2012]_; [Bhat2008]_ for the screened Poisson equation. [Kaspar2015]_ section 3 compares with it without
    rotation and scale, and in Figure 7 also without gain, bias and gradients, which is plain texture optimisation.
    The bounds are ours: textures with a wide bias of colour drift to the mean colour, above all from random pixels.
    They bound the change of a patch's mean; the gain is about it, so that it cannot brighten bright patches.
    """
    check_start(image, start)
    scales = patch_scales(image, start, params)
    optimisation = _MeldingOptimisation(image, start, params)
    state, done = coarse_to_fine(optimisation, scales, rng.spawn(len(scales)), params.tolerance, checkpoints)
    whole = optimisation.picture(state, scales[-1])
    return ImageMelding.cropped(whole, state.match, image, params, done)
