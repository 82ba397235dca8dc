"""Empty pixels of a picture are covered by blocks of an exemplar, joined along minimum cuts."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int32

from texloom.stages.kernels.seams.window_state import FILLED, FREE, KEPT
from texloom.stages.numerics.filters import padded
from texloom.stages.synthesis.stitching.overlap import Errors, OverlapSearch
from texloom.stages.synthesis.stitching.seams import SeamCosts, cheapest_cut
from texloom.stages.vocabulary.arrays import Mask
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.masks import count_excluded
from texloom.stages.vocabulary.progress import Progress, report

_RING = 1  # px around a block that are kept, so that its seam lies inside the block


Choice: TypeAlias = Callable[[Errors, Int32[np.ndarray, "2"]], Int32[np.ndarray, "2"]]
"""the exemplar's place of a block, from the error of every place and the block's first row and column; the error is
infinite where the block would contain masked pixels"""


def best(errors: Errors, corner: Int32[np.ndarray, "2"]) -> Int32[np.ndarray, "2"]:  # noqa: ARG001
    """The place that matches best."""
    return np.array(np.unravel_index(int(np.argmin(errors)), errors.shape), np.int32)


class BlockFilling:
    """A picture while blocks are laid over its empty pixels.

    Parameters
    ----------
    features : of the exemplar.
    match : source of each pixel of the picture in the exemplar; any where it is empty.
    keep : pixels that are never replaced.
    filled : pixels with content that blocks are matched to, which may be replaced unless kept.
    usable : pixels of the exemplar that blocks may contain.
    block : side of a block, px.
    wrap : where the picture continues across its borders.
    choose : the place of a block in the exemplar.
    given : features of the pixels that are kept, where these are not the exemplar's.
    """

    def __init__(
        self,
        features: Float32[np.ndarray, "h w c"],
        match: Int32[np.ndarray, "H W 2"],
        keep: Bool[np.ndarray, "H W"],
        filled: Bool[np.ndarray, "H W"],
        usable: Mask,
        block: int,
        wrap: Wraps,
        choose: Choice = best,
        given: Float32[np.ndarray, "H W c"] | None = None,
    ):
        self.features = features
        self.search = OverlapSearch(self.features)
        self.costs = SeamCosts(self.features, gradients=False)
        self.shape = keep.shape
        self.keep = keep
        self.filled = filled.copy()
        self.forbidden = count_excluded(usable, block, block) > 0
        self.block = block
        self.wrap = wrap
        self.choose = choose
        self.given = given
        self.match = match
        wide = padded(self.filled, block // 2, wrap.modes("constant"))
        self.around = _box_sums(wide, block)[: self.shape[0], : self.shape[1]]
        """how many pixels are filled of the block that has each pixel in its middle"""

    def run(self) -> None:
        """Fill all empty pixels, those with most filled pixels around them first."""
        total = int((~self.filled).sum())
        while not self.filled.all():
            self._lay(*self._next())
            report(Progress(1 - int((~self.filled).sum()) / total))

    def _next(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the block around the empty pixel with most filled pixels around it."""
        margin = self.block // 2
        middle = np.unravel_index(int(np.argmax(np.where(self.filled, -1, self.around))), self.shape)
        lines = []
        for at, side, around in zip(middle, self.shape, self.wrap, strict=True):
            first = int(at) - margin
            if not around:
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
        if not self.wrap.down:
            ring[0, :] &= rows[0] > 0
            ring[-1, :] &= rows[-1] < self.shape[0] - 1
        if not self.wrap.across:
            ring[:, 0] &= columns[0] > 0
            ring[:, -1] &= columns[-1] < self.shape[1] - 1
        state[ring & filled_pixels] = KEPT
        corner = np.array([rows[0], columns[0]], np.int32)
        template = self.features[old[..., 0], old[..., 1]]
        if self.given is not None:
            template = np.where(self.keep[at][..., None], self.given[at], template)
        block = np.moveaxis(np.indices(filled_pixels.shape, np.int32), 0, 2)
        new = self._new_corner(template, filled_pixels, corner) + block
        taken, _ = cheapest_cut(self.costs, old, new, state)
        self.match[at] = np.where(taken[..., None], new, old)
        self.filled[at] = True
        self._count(corner, ~filled_pixels)

    def _count(self, corner: Int32[np.ndarray, "2"], more: Bool[np.ndarray, "m n"]) -> None:
        """Count pixels that a block has filled at those around it."""
        reach = self.block - 1
        sums = _box_sums(np.pad(more, reach), self.block)
        lines = []
        for axis, (first, side, around) in enumerate(zip(corner, self.shape, self.wrap, strict=True)):
            line = int(first) - reach + self.block // 2 + np.arange(sums.shape[axis])
            if not around:
                inside = (line >= 0) & (line < side)
                line, sums = line[inside], sums.compress(inside, axis)
            lines.append(line % side)
        np.add.at(self.around, np.ix_(*lines), sums)  # a line may be there twice

    def _new_corner(
        self,
        template: Float32[np.ndarray, "m n c"],
        filled_pixels: Bool[np.ndarray, "m n"],
        corner: Int32[np.ndarray, "2"],
    ) -> Int32[np.ndarray, "2"]:
        """Top-left pixel of the unmasked block that is chosen by its match with the filled pixels."""
        if filled_pixels.any():
            errors = self.search.errors(template, filled_pixels)
        else:
            errors = np.zeros(self.forbidden.shape, np.float32)
        errors[self.forbidden] = np.inf
        return self.choose(errors, corner)


def _box_sums(marked: Bool[np.ndarray, "m n"], side: int) -> Int32[np.ndarray, "p q"]:
    """How many pixels are marked of the square at every place where a whole one fits."""
    sums = np.pad(marked.cumsum(0, np.int32).cumsum(1, np.int32), ((1, 0), (1, 0)))
    return np.asarray(sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side])
