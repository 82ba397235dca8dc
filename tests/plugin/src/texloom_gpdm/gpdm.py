"""Synthesis by direct matching of patch distributions."""

from __future__ import annotations

import dataclasses

import numpy as np
from pydantic import Field

from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, OddSize, Params, stage
from texloom.stages.vocabulary.sizes import Size
from texloom_gpdm.projections import directions, projected, spread

_USABLE = 0.5  # alpha


class GpdmParams(Params):
    """How the texture is made."""

    size: Size = (256, 256)
    """height and width of the result, px"""
    patch_size: OddSize = 7
    """side of patches, px"""
    projections: int = Field(16, ge=1, le=256)
    """random directions an iteration"""
    iterations: int = Field(40, ge=1, le=1000)
    """iterations a level"""
    levels: int = Field(3, ge=1, le=8)
    """levels of the pyramid, each half as large as the one before"""
    tileable: bool = False
    """whether the result repeats without seams"""


@dataclasses.dataclass(frozen=True)
class Gpdm:
    """What is made."""

    image: Image
    """the texture, with all channels of the exemplar"""


@stage(version=1)
def gpdm(image: Image, params: GpdmParams, rng: np.random.Generator) -> Gpdm:
    """Match the distribution of a texture's patches to the exemplar's by sliced Wasserstein distances.

    All channels are matched together. Patches with a pixel whose alpha is below a half are left out of the target.

    Parameters
    ----------
    image : the exemplar.

    References
    ----------
    Elnekave and Weiss, Generating natural images with direct patch distributions matching, ECCV 2022, section 3;
    projections are matched by sorting, instead of descending a gradient.
    """
    mode = "wrap" if params.tileable else "nearest"
    result: np.ndarray | None = None
    for level in reversed(range(params.levels)):
        scale = 2**level
        target, usable = _reduced(image, scale)
        if level and min(usable.shape) < 2 * params.patch_size:
            continue
        height, width = (max(1, side // scale) for side in params.size)
        if result is None:
            noise = rng.normal(size=(height, width, target.shape[2])).astype(np.float32)
            result = target.mean(axis=(0, 1)) + noise * target.std(axis=(0, 1))
        else:
            result = result.repeat(2, axis=0).repeat(2, axis=1)
            result = np.pad(result, ((0, 1), (0, 1), (0, 0)), mode="edge")[:height, :width]
        allowed = _whole_patches(usable, params.patch_size)
        for _ in range(params.iterations):
            result = result + _step(result, target, allowed, params, rng, mode)
    if result is None:
        raise RuntimeError("there is always a finest level")
    made = Image(np.ascontiguousarray(result, np.float32), image.channels)
    return Gpdm(made.wrapping(params.tileable))


def _reduced(image: Image, scale: int) -> tuple[np.ndarray, np.ndarray]:
    """The exemplar as means of blocks, and where all of a block is usable."""
    height, width = (max(1, side // scale) for side in (image.height, image.width))
    rows, columns = min(scale, image.height), min(scale, image.width)
    blocks = image.pixels[: height * rows, : width * columns].reshape(height, rows, width, columns, -1)
    usable = np.ones(blocks.shape[:4], bool)
    if "A" in image.channels:
        usable = blocks[..., image.channels.index("A")] >= _USABLE
    return blocks.mean(axis=(1, 3)), usable.all(axis=(1, 3))


def _whole_patches(usable: np.ndarray, side: int) -> np.ndarray:
    """Where a patch lies inside of the picture and is usable."""
    from scipy.ndimage import minimum_filter

    allowed = minimum_filter(usable.astype(np.uint8), side, mode="constant", cval=0).astype(bool)
    if not allowed.any():
        raise InputError(f"image: no patch of {side}x{side} px is usable; lower patch_size")
    return allowed


def _step(
    result: np.ndarray,
    target: np.ndarray,
    allowed: np.ndarray,
    params: GpdmParams,
    rng: np.random.Generator,
    mode: str,
) -> np.ndarray:
    """The mean displacement that makes the projections of patches those of the target."""
    channels = result.shape[2]
    total = np.zeros_like(result)
    ranks = np.linspace(0, 1, result.shape[0] * result.shape[1])
    for direction in directions(rng, params.projections, params.patch_size, channels):
        wanted = np.sort(projected(target, direction, "nearest")[allowed])
        found = projected(result, direction, mode)
        order = np.argsort(found, axis=None, kind="stable")
        moved = np.empty(found.size, np.float32)
        moved[order] = np.interp(ranks, np.linspace(0, 1, len(wanted)), wanted)
        total += spread(moved.reshape(found.shape) - found, direction, mode)
    return total * np.float32(channels / params.projections)
