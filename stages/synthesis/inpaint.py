"""What is not kept of a picture, covered with blocks of the picture itself along the cheapest cuts."""

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

_LEAST = 16  # px of a block
_RING = 1  # px around a block that stay, so that its cut ends where the picture goes on


class InpaintParams(Params):
    """From what blocks it is made."""

    block: int | None = Field(None, ge=_LEAST, le=1024)
    """side of a block, px; null: an eighth of the picture's shorter side, between 32 and 128"""
    tileable: bool = False
    """the picture is to continue across its borders, which need not be kept"""


@dataclasses.dataclass(frozen=True)
class Inpainted:
    """The whole picture."""

    image: Image
    """the picture; kept pixels are to the bit what they were"""
    match: Correspondence
    """the pixel of the picture that each pixel comes from; kept ones come from themselves"""


def _block(height: int, width: int, params: InpaintParams) -> int:
    return params.block or min(max(32, min(height, width) // 8), 128)


def check_picture(params: InpaintParams, known: Mapping[str, Any]) -> None:
    """The picture must hold two blocks in each direction."""
    image = known.get("image")
    if image is None:
        return
    block = _block(image.height, image.width, params)
    if min(image.height, image.width) < 2 * block:
        raise InputError(
            f"image: {image.height}x{image.width} px is too small for blocks of {block} px; "
            "give a larger picture or a smaller block"
        )


class _Cover:
    """A picture being covered.

    Parameters
    ----------
    keep : pixels that stay.
    stands : pixels that show something to go on with, and may be replaced unless kept.
    """

    def __init__(self, image: Image, keep: Mask, stands: Mask, usable: Mask, block: int, wrap: bool):
        self.features = compared(fill_excluded(image))
        self.search = OverlapSearch(self.features)
        self.costs = SeamCosts(self.features, gradients=False)
        self.shape = keep.shape
        self.keep = keep
        self.stands = stands.copy()
        self.forbidden = count_excluded(usable, block, block) > 0
        self.block = block
        self.wrap = wrap
        self.match: Int32[np.ndarray, "h w 2"] = np.moveaxis(np.indices(self.shape, np.int32), 0, 2).copy()

    def run(self) -> None:
        """Cover what does not stand, first where most around it does."""
        total = int((~self.stands).sum())
        while not self.stands.all():
            self._lay(*self._next())
            report(Progress(1 - int((~self.stands).sum()) / total))

    def _next(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the block around the open pixel with most standing ones around it."""
        import cv2

        margin = self.block // 2
        padding = {"mode": "wrap"} if self.wrap else {"mode": "constant"}
        wide = np.pad(self.stands.astype(np.float32), margin, **padding)  # type: ignore[call-overload]
        sums = cv2.boxFilter(wide, -1, (self.block, self.block), normalize=False, borderType=cv2.BORDER_CONSTANT)
        around = np.rint(sums[margin : margin + self.shape[0], margin : margin + self.shape[1]])
        around[self.stands] = -1
        middle = np.unravel_index(int(np.argmax(around)), self.shape)
        lines = []
        for at, side in zip(middle, self.shape, strict=True):
            first = int(at) - margin
            if not self.wrap:
                first = min(max(0, first), side - self.block)
            lines.append((first + np.arange(self.block)) % side)
        return lines[0], lines[1]

    def _lay(self, rows: np.ndarray, columns: np.ndarray) -> None:
        at = np.ix_(rows, columns)
        old, stands = self.match[at], self.stands[at]
        state = np.where(stands, np.where(self.keep[at], KEPT, FREE), FILLED).astype(np.int8)
        ring = np.ones(stands.shape, bool)
        ring[_RING:-_RING, _RING:-_RING] = False
        # A block that reaches a border that is no seam has nothing to go on with there.
        if not self.wrap:
            ring[0, :] &= rows[0] > 0
            ring[-1, :] &= rows[-1] < self.shape[0] - 1
            ring[:, 0] &= columns[0] > 0
            ring[:, -1] &= columns[-1] < self.shape[1] - 1
        state[ring & stands] = KEPT
        new = self._place(old, stands) + np.moveaxis(np.indices(stands.shape, np.int32), 0, 2)
        taken, _ = cheapest_cut(self.costs, old, new, state)
        self.match[at] = np.where(taken[..., None], new, old)
        self.stands[at] = True

    def _place(self, old: Int32[np.ndarray, "m n 2"], stands: Bool[np.ndarray, "m n"]) -> Int32[np.ndarray, "2"]:
        """Top-left pixel of the allowed block that agrees best with what stands."""
        template = self.features[old[..., 0], old[..., 1]]
        if stands.any():
            errors = self.search.errors(template, stands)
        else:
            errors = np.zeros(self.forbidden.shape, np.float32)
        errors[self.forbidden] = np.inf
        return np.array(np.unravel_index(int(np.argmin(errors)), errors.shape), np.int32)


@stage(version=1, check=check_picture)
def inpaint(image: Image, keep: Mask, params: InpaintParams) -> Inpainted:
    """Cover all that is not kept with blocks of the picture.

    Blocks are laid where most of what surrounds an open pixel stands already. Each is the block of the picture that
    agrees best with what stands there, joined to it along the cut that costs least. What is not kept, but may be
    used, stands as well until a cut replaces it; so a band at the borders of a tileable result is cut where it
    shows least.

    Parameters
    ----------
    image : its masked pixels are never copied; open ones among them are replaced.
    keep : true where the picture stays, masked or not.

    Raises
    ------
    InputError
        the picture does not hold two blocks in each direction, or its mask leaves no whole block.

    References
    ----------
    [Efros2001]_ for blocks and [Kwatra2003]_ for cuts; here the result begins with what is kept.
    """
    check_picture(params, {"image": image})
    shape = (image.height, image.width)
    if keep.shape != shape:
        raise ValueError(f"keep of shape {keep.shape} for an image of {image.height}x{image.width} px")
    given = valid_pixels(image)
    usable = np.ones(shape, bool) if given is None else given
    stands = usable | keep
    if params.tileable:
        for line in (0, -1):
            stands[line, :] &= keep[line, :]
            stands[:, line] &= keep[:, line]
    block = _block(*shape, params)
    while block > _LEAST and (count_excluded(usable, block, block) > 0).all():
        block = max(_LEAST, block // 2)
    if (count_excluded(usable, block, block) > 0).all():
        raise InputError(f"image: its mask leaves no whole block of {block} px to fill holes from")
    cover = _Cover(image, keep, stands, usable, block, params.tileable)
    cover.run()
    match = cover.match.astype(np.uint32)
    plain = without_usable(image)
    return Inpainted(Image(plain.pixels[match[..., 0], match[..., 1]], plain.channels), match)
