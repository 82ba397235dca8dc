"""A texture whose values are Gaussian, and the tables that lead back from it."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64
from pydantic import Field

from texloom.stages.numerics.normal_distribution import normal_quantiles, normal_shares
from texloom.stages.synthesis.endless.decorrelation import AveragedMap, MapBasis, averageable, basis_of
from texloom.stages.synthesis.endless.mip_levels import halved, pyramid_of
from texloom.stages.synthesis.endless.noise import PAGE, Components, Tables
from texloom.stages.synthesis.endless.triangle_grid import SHARE
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.tileable import check_continues

SIGMA = 1 / 8
"""standard deviation of a Gaussian texture around 1/2: 0..1 holds four of them to each side, and blends beyond
hardly occur; [DeliotHeitz2019]_ has three"""

_MOST_PAGES = 4


class GaussianTextureParams(Params):
    """How the plane is covered, and the size of the tables."""

    tile: float = Field(SHARE, ge=0.05, le=1.0)
    """distance of neighbouring tiles, as a share of the texture's shorter side: more keeps larger features whole,
    less mixes more"""
    sharpness: float = Field(2.0, ge=1, le=16)
    """how narrow the zones are in which tiles are blended; 1 is the published method"""
    entries: int = Field(256, ge=32, le=4096)
    """of a table, over the range of the Gaussian values"""


@dataclasses.dataclass(frozen=True)
class GaussianTexture:
    """By-example noise: what a shader samples."""

    first: Components
    """Gaussian values around 1/2, in 0..1: components of colour, then of each other map; unused ones are 1/2"""
    second: Components | None
    """the next four components; none where there are no more"""
    third: Components | None
    """the next four components"""
    fourth: Components | None
    """the next four components"""
    inverse: Tables
    """from Gaussian values to components, both in 0..1: one row a level, for four components; then the rows of the
    next four"""
    layout: dict[str, Any]
    """`size` (width, height, px), `spacing` of tiles (px), `sharpness`, `levels`, `entries`, `sigma`; `low` and
    `span` of each component; and `maps`, each with the axes and the mean that lead from components to channels"""


@stage(version=1)
def gaussian_texture(image: Image, params: GaussianTextureParams) -> GaussianTexture:
    """Turn a texture into one of Gaussian values, whose blends keep contrast and histogram.

    Maps of a material become components that do not correlate within each map; all of them are looked up at the
    same places, so that they fit to each other in each tile.

    Parameters
    ----------
    image : continues across its borders; maps other than colour may follow.

    Raises
    ------
    InputError
        it does not continue across its borders, or has more than 16 components.

    References
    ----------
    [HeitzNeyret2018]_; [DeliotHeitz2019]_ sections 1.3.2 and 1.3.3 (Gaussian values by ranks, and back), 1.4
    (decorrelation) and 1.5 (a table for each level of detail). Here a table has the quantiles of the averaged
    texture of its level, in place of the table of level 0 blurred by a Gaussian. From afar the plane has the mean
    that it has from near within 4 % on gravel, grass, bark, moss and leather; by the other it is up to 36 % darker.
    """
    check_continues(image)
    maps = averageable(image)
    bases = [basis_of(*one) for one in maps]
    count = sum(basis.count for basis in bases)
    if count > _MOST_PAGES * PAGE:
        raise InputError(f"image: {count} components of maps; at most {_MOST_PAGES * PAGE} fit")
    components = _components(maps, bases)
    gaussian = np.full((image.height, image.width, -(-count // PAGE) * PAGE), 0.5, np.float32)
    for index in range(count):
        gaussian[..., index] = _gaussian(components[..., index])
    low = components.min(axis=(0, 1)).astype(np.float32)
    span = np.maximum(components.max(axis=(0, 1)) - low, 1e-6).astype(np.float32)
    inverse, levels = _tables(maps, bases, gaussian, params.entries)
    inverse[..., :count] = np.clip((inverse[..., :count] - low) / span, 0, 1)
    layout = {
        "size": [image.width, image.height], "spacing": params.tile * min(image.height, image.width),
        "sharpness": params.sharpness, "levels": levels, "entries": params.entries, "sigma": SIGMA,
        "low": low.tolist(), "span": span.tolist(), "maps": [basis.record() for basis in bases],
    }  # fmt: skip
    starts = range(0, gaussian.shape[2], PAGE)
    pages = [np.ascontiguousarray(gaussian[..., first : first + PAGE]) for first in starts]
    others: list[Components | None] = [*pages[1:], *[None] * (_MOST_PAGES - len(pages))]
    rows = np.concatenate([inverse[..., start : start + PAGE] for start in starts])
    return GaussianTexture(pages[0], others[0], others[1], others[2], rows.astype(np.float32), layout)


def _components(maps: Sequence[AveragedMap], bases: Sequence[MapBasis]) -> Float64[np.ndarray, "h w n"]:
    parts = [basis.components(values) for basis, (*_, values) in zip(bases, maps, strict=True)]
    return np.concatenate(parts, axis=2)


def _tables(
    maps: Sequence[AveragedMap], bases: Sequence[MapBasis], gaussian: Float32[np.ndarray, "h w n"], entries: int
) -> tuple[Float64[np.ndarray, "levels entries n"], int]:
    """Components by Gaussian value for each level of detail, and the number of levels."""
    pyramid = pyramid_of(gaussian)
    tables = np.full((len(pyramid), entries, gaussian.shape[2]), 0.5)
    averaged = list(maps)
    for level, smaller in enumerate(pyramid):
        if level:
            averaged = [(*about, halved(values)) for *about, values in averaged]
        components = _components(averaged, bases)
        for index in range(components.shape[2]):
            spread = float(smaller[..., index].std(dtype=np.float64))
            tables[level, :, index] = _inverse(components[..., index], spread, entries)
    return tables, len(pyramid)


def _gaussian(values: Float64[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Gaussian values of the same ranks; equal values have the middle one of their ranks."""
    own, place, count = np.unique(values, return_inverse=True, return_counts=True)
    if len(own) == 1:
        return np.full(values.shape, 0.5, np.float32)
    ranks = np.cumsum(count) - 0.5 * count
    levels = np.clip(0.5 + SIGMA * normal_quantiles(ranks / values.size), 0, 1).astype(np.float32)
    return np.asarray(levels[place].reshape(values.shape))


def _inverse(values: Float64[np.ndarray, "h w"], spread: float, entries: int) -> Float64[np.ndarray, "n"]:  # type: ignore[name-defined]
    """The table by which Gaussian values of this spread get the histogram of ``values``."""
    ordered = np.sort(values, axis=None)
    if spread < 1e-6:
        return np.full(entries, ordered.mean())
    shares = normal_shares((np.arange(entries) / (entries - 1) - 0.5) / spread)
    return np.interp(shares * ordered.size - 0.5, np.arange(ordered.size), ordered)
