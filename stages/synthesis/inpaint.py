"""Inpainting: pixels that are not kept are replaced by blocks of the image, joined along minimum cuts."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Int32
from pydantic import Field

from texloom.stages.arrays import Correspondence, Image, Mask
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.masks import count_excluded, fill_excluded, valid_pixels, without_usable
from texloom.stages.progress import Progress, report
from texloom.stages.synthesis._seams.overlap import OverlapSearch, compared
from texloom.stages.synthesis._seams.seams import FILLED, FREE, KEPT, SeamCosts, cheapest_cut

_MIN_BLOCK = 16  # px
_RING = 1  # px around a block that are kept, so that its seam lies inside the block


class InpaintParams(Params):
    """Blocks that are copied."""

    block: int | None = Field(None, ge=_MIN_BLOCK, le=1024)
    """side of a block, px; null: an eighth of the image's shorter side, between 32 and 128"""
    tileable: bool = False
    """the result continues across its borders"""


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
            f"image: {image.height}x{image.width} px is too small for blocks of {block} px; "
            "give a larger image or a smaller block"
        )


class _Inpainting:
    """The image during inpainting.

    Parameters
    ----------
    keep : pixels that are never replaced.
    filled : pixels with content that blocks are matched to, which may be replaced unless kept.
    """

    def __init__(self, image: Image, keep: Mask, filled_pixels: Mask, usable: Mask, block: int, wrap: bool):
        self.features = compared(fill_excluded(image))
        self.search = OverlapSearch(self.features)
        self.costs = SeamCosts(self.features, gradients=False)
        self.shape = keep.shape
        self.keep = keep
        self.filled = filled_pixels.copy()
        self.forbidden = count_excluded(usable, block, block) > 0
        self.block = block
        self.wrap = wrap
        self.match: Int32[np.ndarray, "h w 2"] = np.moveaxis(np.indices(self.shape, np.int32), 0, 2).copy()

    def run(self) -> None:
        """Fill all empty pixels, those with most filled pixels around them first."""
        total = int((~self.filled).sum())
        while not self.filled.all():
            self._lay(*self._next())
            report(Progress(1 - int((~self.filled).sum()) / total))

    def _next(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the block around the empty pixel with most filled pixels around it."""
        import cv2

        margin = self.block // 2
        padding = {"mode": "wrap"} if self.wrap else {"mode": "constant"}
        padded = np.pad(self.filled.astype(np.float32), margin, **padding)  # type: ignore[call-overload]
        sums = cv2.boxFilter(padded, -1, (self.block, self.block), normalize=False, borderType=cv2.BORDER_CONSTANT)
        counts = np.rint(sums[margin : margin + self.shape[0], margin : margin + self.shape[1]])
        counts[self.filled] = -1
        middle = np.unravel_index(int(np.argmax(counts)), self.shape)
        lines = []
        for at, side in zip(middle, self.shape, strict=True):
            first = int(at) - margin
            if not self.wrap:
                first = min(max(0, first), side - self.block)
            lines.append((first + np.arange(self.block)) % side)
        return lines[0], lines[1]

    def _lay(self, rows: np.ndarray, columns: np.ndarray) -> None:
        at = np.ix_(rows, columns)
        old, filled_pixels = self.match[at], self.filled[at]
        state = np.where(filled_pixels, np.where(self.keep[at], KEPT, FREE), FILLED).astype(np.int8)
        ring = np.ones(filled_pixels.shape, bool)
        ring[_RING:-_RING, _RING:-_RING] = False
        # At a border of the image a block has no seam.
        if not self.wrap:
            ring[0, :] &= rows[0] > 0
            ring[-1, :] &= rows[-1] < self.shape[0] - 1
            ring[:, 0] &= columns[0] > 0
            ring[:, -1] &= columns[-1] < self.shape[1] - 1
        state[ring & filled_pixels] = KEPT
        new = self._best_block(old, filled_pixels) + np.moveaxis(np.indices(filled_pixels.shape, np.int32), 0, 2)
        taken, _ = cheapest_cut(self.costs, old, new, state)
        self.match[at] = np.where(taken[..., None], new, old)
        self.filled[at] = True

    def _best_block(
        self, old: Int32[np.ndarray, "m n 2"], filled_pixels: Bool[np.ndarray, "m n"]
    ) -> Int32[np.ndarray, "2"]:
        """Top-left pixel of the unmasked block that matches the filled pixels best."""
        template = self.features[old[..., 0], old[..., 1]]
        if filled_pixels.any():
            errors = self.search.errors(template, filled_pixels)
        else:
            errors = np.zeros(self.forbidden.shape, np.float32)
        errors[self.forbidden] = np.inf
        return np.array(np.unravel_index(int(np.argmin(errors)), errors.shape), np.int32)


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
        raise ValueError(f"keep of shape {keep.shape} for an image of {image.height}x{image.width} px")
    unmasked_pixels = valid_pixels(image)
    usable = np.ones(shape, bool) if unmasked_pixels is None else unmasked_pixels
    filled_pixels = usable | keep
    if params.tileable:
        for line in (0, -1):
            filled_pixels[line, :] &= keep[line, :]
            filled_pixels[:, line] &= keep[:, line]
    block = _block(*shape, params)
    while block > _MIN_BLOCK and (count_excluded(usable, block, block) > 0).all():
        block = max(_MIN_BLOCK, block // 2)
    if (count_excluded(usable, block, block) > 0).all():
        raise InputError(f"image: its mask leaves no whole block of {block} px to fill holes from")
    inpainting = _Inpainting(image, keep, filled_pixels, usable, block, params.tileable)
    inpainting.run()
    match = inpainting.match.astype(np.uint32)
    image = without_usable(image)
    return Inpainted(Image(image.pixels[match[..., 0], match[..., 1]], image.channels), match)
