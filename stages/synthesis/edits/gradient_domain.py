"""Maps without steps at seams, integrated from the exemplar's gradients (gradient-domain compositing)."""

import dataclasses
import logging
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32
from pydantic import Field

from texloom.stages.common.features.maps import map_channels
from texloom.stages.common.grids.parts import LARGEST_WHOLE, parts_with_margins
from texloom.stages.common.grids.screened_poisson import neighbours, screened_poisson, screened_poisson_beside
from texloom.stages.common.source_maps.source_gradients import source_gradients
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask, ScalarMap
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.facts import NOWHERE, Wraps
from texloom.stages.vocabulary.masks import valid_pixels
from texloom.stages.vocabulary.normals import NORMAL, with_unit_normals
from texloom.stages.vocabulary.scratch import bands, empty, release
from texloom.stages.vocabulary.sizes import format_size

_LOG = logging.getLogger(__name__)
_REACHES = 16  # margin of a part in reaches, over which a correction falls below 1e-6 of itself
_ROOM = 0.1  # of the exemplar's range, by which heights may lie beyond it; 95 % of corrections need at most .08
_TOLD = 0.01  # share of pixels that are cut by more than a level of 8 bits
_ROUNDING = 1e-6  # of the exemplar's range; gradients that differ by less are equal


class GradientDomainParams(Params):
    """Maps that are integrated, and the reach of corrections."""

    maps: tuple[str, ...] = ("height", "normal", "ao")
    """names of the maps, or of their channels, `albedo` for colour; those that the image lacks are ignored"""
    reach: float = Field(16.0, gt=0, le=4096)
    """distance from a seam over which values are corrected, px: small ones preserve values, large ones gradients"""
    limit: float | None = Field(None, gt=0, le=100)
    """largest step that is corrected, in standard deviations of the map: larger ones are contours that do not meet,
    whose correction would spread; null corrects all"""
    border_only: bool = False
    """correct only steps at the border of what is kept, not those inside the result"""


@dataclasses.dataclass(frozen=True)
class GradientDomain:
    """The result with corrected maps."""

    image: Image
    """the maps integrated from gradients, within the exemplar's range, heights by a tenth beyond it; all others
    unchanged"""


def check_maps(params: GradientDomainParams, known: Mapping[str, Any]) -> None:
    """Alpha cannot be integrated, nor a single component of normals."""
    for name in params.maps:
        if name == "A" or name in NORMAL:
            raise InputError(f"maps: '{name}' cannot be integrated alone; give maps, as height, normal or albedo")
    exemplar, image = known.get("exemplar"), known.get("image")
    if exemplar is not None and image is not None:
        missing = [name for name in image.channels if name not in exemplar.channels]
        if missing:
            raise InputError(f"image: has a channel {missing[0]}, which the exemplar lacks")


@stage(version=1, check=check_maps, in_bands=True)
def gradient_domain(
    exemplar: Image,
    image: Image,
    match: Correspondence,
    params: GradientDomainParams,
    keep: Mask | None = None,
) -> GradientDomain:
    """Remove the steps that copying leaves at seams, as in heights whose sources have different levels.

    For two neighbours of the result the exemplar provides gradients: that from the first one's source to the pixel
    beside it, and that to the second one's source from the pixel before it. They are equal where the sources are
    neighbours; at a seam their mean is taken. The map minimises the sum of squared differences of gradients
    and, with weight 1 / ``reach`` squared, of values. Steps become smooth ramps, while ridges and edges stay
    sharp. A map without seams is unchanged.

    The components of a normal are integrated separately, then brought to unit length.

    A result of more than 4096 x 4096 px is integrated in parts of 2048 x 2048 px with margins of 16 reaches, beyond
    which a correction has no effect in float32.

    Parameters
    ----------
    exemplar, image : the material and the result, with the same channels; the result may wrap.
    match : source of each pixel of the result in the exemplar.
    keep : true where the result stays unchanged, and is the boundary condition for its surroundings.

    Raises
    ------
    InputError
        ``maps`` names alpha or a component of normals; the image has a channel that the exemplar lacks.
    ValueError
        ``match`` or ``keep`` does not fit.

    References
    ----------
    [Perez2003]_ for copying gradients; [Bhat2008]_ for the screened Poisson equation and its solution by Fourier
    transforms, here cosine transforms along axes that do not wrap. With ``keep``, conjugate gradients solve it.
    """
    if match.shape[:2] != (image.height, image.width):
        raise ValueError(f"match of shape {match.shape} for an image of {format_size(image)}")
    size = (exemplar.height, exemplar.width)
    if any((match[band] >= size).any() for band in bands(image.height, match)):
        raise ValueError(f"match points beyond the exemplar of {format_size(size)}")
    if keep is not None and keep.shape != (image.height, image.width):
        raise ValueError(f"keep of shape {keep.shape} for an image of {format_size(image)}")
    wrap = image.wraps
    if image.height * image.width <= LARGEST_WHOLE:
        return GradientDomain(image.with_pixels(_integrated(exemplar, image, match, params, wrap, keep)))
    pixels = empty(image.pixels.shape, np.float32)
    margin = math.ceil(_REACHES * params.reach)
    for rows, columns, inner in parts_with_margins(image.height, image.width, margin, wrap):
        place = np.ix_(rows, columns)
        part = image.elsewhere(image.pixels[place])
        kept = None if keep is None else keep[place]
        made = _integrated(exemplar, part, match[place], params, NOWHERE, kept)
        pixels[rows[inner[0]][:, None], columns[inner[1]]] = made[inner]
        release(pixels, image.pixels, match)
    return GradientDomain(image.with_pixels(pixels))


def _integrated(
    exemplar: Image,
    image: Image,
    match: Correspondence,
    params: GradientDomainParams,
    wrap: Wraps,
    keep: Mask | None,
) -> np.ndarray:
    """The corrected pixels of an image that is in memory."""
    usable = valid_pixels(exemplar)
    open_pixels = np.ones(match.shape[:2], bool) if keep is None else ~keep
    maps = map_channels(image.channels)
    maps["albedo"] = [place for place, channel in enumerate(image.channels) if channel in ("R", "G", "B", "Y")]
    pixels = image.pixels.copy()
    for name, places in maps.items():
        for place in places:
            channel = image.channels[place]
            if name not in params.maps and channel not in params.maps:
                continue
            own = np.ascontiguousarray(exemplar.pixels[..., exemplar.channels.index(channel)])
            known = own if usable is None else own[usable]
            limit = np.inf if params.limit is None else params.limit * float(known.std(dtype=np.float64))
            border = open_pixels if params.border_only else None
            rounding = _ROUNDING * max(float(np.ptp(known)), 1e-12)
            excess = _excess(own, pixels[..., place], match, usable, wrap, rounding, limit, border)
            if not excess[open_pixels].any():
                continue
            if keep is None:
                change = screened_poisson(excess, params.reach, wrap)
            else:
                change = screened_poisson_beside(excess, params.reach, wrap, open_pixels)
            lowest, highest = _bounds(channel, known, exemplar)
            corrected = pixels[..., place] + change
            if channel == "height":
                _tell_cut(corrected[open_pixels], lowest, highest, float(np.ptp(known)))
            pixels[..., place] = np.where(open_pixels, np.clip(corrected, lowest, highest), pixels[..., place])
    if "normal" in params.maps:
        whole = with_unit_normals(pixels, image.channels)
        pixels = np.where(open_pixels[..., None], whole, pixels)
    return np.asarray(pixels)


def _tell_cut(values: np.ndarray, lowest: float, highest: float, span: float) -> None:
    share = float(((values < lowest - span / 255) | (values > highest + span / 255)).mean())
    if share >= _TOLD:
        told = "height: %.2g %% of the corrected pixels would lie outside %.3g .. %.3g, and are cut to it"
        _LOG.warning(told, 100 * share, lowest, highest)


def _bounds(channel: str, known: np.ndarray, exemplar: Image) -> tuple[float, float]:
    """What the corrected values of a channel may be, of which ``known`` are the exemplar's.

    Heights may lie a little beyond those of the exemplar, where a rise continues on another one; those of integers
    within 0..1.
    """
    lowest, highest = float(known.min()), float(known.max())
    if channel != "height":
        return lowest, highest
    room = _ROOM * (highest - lowest)
    is_float = exemplar.facts.of_map("height").range is not None
    least, most = (-np.inf, np.inf) if is_float else (min(0.0, lowest), max(1.0, highest))
    return max(least, lowest - room), min(most, highest + room)


def _excess(
    own: ScalarMap,
    values: np.ndarray,
    match: Correspondence,
    usable: Mask | None,
    wrap: Wraps,
    rounding: float,
    limit: float,
    border: Bool[np.ndarray, "H W"] | None,
) -> Float32[np.ndarray, "H W"]:
    """Divergence, outflow minus inflow, of the difference between the exemplar's and the result's gradients."""
    excess = np.zeros(values.shape, np.float32)
    for axis in (0, 1):
        for first, second in neighbours(values.shape[0], axis, wrap):
            ends = match[first], match[second]
            wanted, known = source_gradients(lambda *at: own[at][..., None], own.shape, *ends, usable, axis)
            missing = np.where(known, wanted[..., 0] - (values[second] - values[first]), np.float32(0))
            if border is not None:
                missing[border[first] == border[second]] = 0
            missing[(np.abs(missing) <= rounding) | (np.abs(missing) > limit)] = 0
            excess[first] += missing
            excess[second] -= missing
    return excess
