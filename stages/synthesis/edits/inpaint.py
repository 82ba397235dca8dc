"""Inpainting: pixels that are not kept are replaced by blocks of the image, joined along minimum cuts."""

import dataclasses
import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.synthesis.edits.block_filling import BlockFilling
from texloom.stages.synthesis.stitching.overlap import compared
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.masks import count_excluded, fill_excluded, valid_pixels, without_usable
from texloom.stages.vocabulary.sizes import format_size
from texloom.stages.vocabulary.tileable import Tileable, wraps_after

_LOG = logging.getLogger(__name__)

_MIN_BLOCK = 16  # px


class InpaintParams(Params):
    """Blocks that are copied."""

    block: int | None = Field(None, ge=_MIN_BLOCK, le=1024)
    """side of a block, px; null: an eighth of the image's shorter side, between 32 and 128"""
    tileable: Tileable | None = None
    """borders across which the result continues: x left to right, y top to bottom, both, off; null: as the image,
    which also stays so along the axis that is not named"""


@dataclasses.dataclass(frozen=True)
class Inpainted:
    """The completed image."""

    image: Image
    """the image; kept pixels are unchanged"""
    match: Correspondence
    """source of each pixel in the image; a kept pixel is its own"""


def _block(height: int, width: int, params: InpaintParams) -> int:
    return params.block or min(max(32, min(height, width) // 8), 128)


def check_picture(params: InpaintParams, known: Mapping[str, Any]) -> None:
    """The image must be at least two blocks wide and high."""
    image = known.get("image")
    if image is None:
        return
    block = _block(image.height, image.width, params)
    if min(image.height, image.width) < 2 * block:
        raise InputError(
            f"image: {format_size(image)} is too small for blocks of {block} px; "
            "give a larger image or a smaller block"
        )


@stage(version=1, check=check_picture)
def inpaint(image: Image, keep: Mask, params: InpaintParams) -> Inpainted:
    """Replace all pixels that are not kept by blocks of the image.

    Blocks are laid over empty pixels with most filled pixels around them. Each is the block of the image that
    matches the filled pixels best, joined to them along the minimum cut. Pixels that are not kept but usable
    count as filled until a cut replaces them; the band at the borders of a tileable result is thus cut where
    the seam costs least.

    Parameters
    ----------
    image : its masked pixels are never copied; those that are not kept are replaced.
    keep : true for pixels that stay unchanged, masked or not.

    Raises
    ------
    InputError
        the image is less than two blocks wide or high, or its mask leaves no whole block.
    ValueError
        ``keep`` does not have the image's size.

    References
    ----------
    [Efros2001]_ for blocks and [Kwatra2003]_ for cuts; here the synthesis starts from the kept pixels.
    """
    shape = (image.height, image.width)
    if keep.shape != shape:
        raise ValueError(f"keep of shape {keep.shape} for an image of {format_size(image)}")
    unmasked_pixels = valid_pixels(image)
    usable = np.ones(shape, bool) if unmasked_pixels is None else unmasked_pixels
    filled_pixels = usable | keep
    wrap = wraps_after(params.tileable, image.wraps)
    if params.tileable is None and wrap:
        _LOG.warning("keeps tiling (%s), as the image wraps; --set tileable=off does not", wrap)
    for line in (0, -1):
        if wrap.down:
            filled_pixels[line, :] &= keep[line, :]
        if wrap.across:
            filled_pixels[:, line] &= keep[:, line]
    block = _block(*shape, params)
    while block > _MIN_BLOCK and (count_excluded(usable, block, block) > 0).all():
        block = max(_MIN_BLOCK, block // 2)
    if (count_excluded(usable, block, block) > 0).all():
        raise InputError(f"image: its mask leaves no whole block of {block} px to fill holes from")
    own = np.moveaxis(np.indices(shape, np.int32), 0, 2).copy()
    filling = BlockFilling(compared(fill_excluded(image)), own, keep, filled_pixels, usable, block, wrap)
    filling.run()
    match = filling.match.astype(np.uint32)
    image = without_usable(image)
    made = image.with_pixels(image.pixels[match[..., 0], match[..., 1]])
    return Inpainted(made.wrapping(wrap), match)
