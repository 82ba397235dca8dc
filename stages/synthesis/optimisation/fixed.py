"""Pixels of a result that are fixed, at every scale."""

import numpy as np
from jaxtyping import Bool, Int16

from texloom.stages.common.grids.pyramid import resize
from texloom.stages.common.similarity.neighbourhoods import fixed_point
from texloom.stages.synthesis.optimisation import correspondence
from texloom.stages.synthesis.optimisation.allowed import shrunk
from texloom.stages.synthesis.optimisation.features import PatchFeatures
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask
from texloom.stages.vocabulary.masks import fill_excluded, valid_pixels


class FixedPixels:
    """Pixels of a result that keep the exemplar pixels of the start, or those of an image that is given.

    Parameters
    ----------
    mask : true where the result is fixed, at full size.
    start : exemplar pixel of every pixel of the result.
    margin : px by which the target exceeds the result above and below, left and right; they are not fixed.
    given : of the result's size, with the exemplar's channels; none for the exemplar's pixels. Its pixels with an
        alpha below a half stay, but nothing is matched to them.
    guiding : fixed pixels that are not set in the result; none for none.
    """

    def __init__(
        self,
        mask: Mask,
        start: Correspondence,
        margin: tuple[int, int],
        given: Image | None = None,
        guiding: Mask | None = None,
    ):
        self.mask = mask
        self.lasting = mask if guiding is None else mask & ~guiding
        self.start = start
        self.margin = [(beyond, beyond) for beyond in margin]
        self.given = given
        self.shown = None if given is None else fill_excluded(given)
        valid = None if given is None else valid_pixels(given)
        self.wide = np.pad(mask if valid is None else mask & valid, self.margin)

    def target(
        self,
        exemplar: Int16[np.ndarray, "h wc"],
        channels: int,
        sides: tuple[int, int],
        factor: float,
        padded: tuple[int, int],
        features: PatchFeatures,
    ) -> tuple[Bool[np.ndarray, "H W _c"], Int16[np.ndarray, "H W c"]]:
        """Which features of a target are fixed at the scale of ``factor``, and the features of all pixels.

        A coarse pixel is fixed if all of it is.

        Parameters
        ----------
        sides : height and width of the target.
        padded : the same with the padding along axes that wrap.
        features : of exemplar and given image at full size.
        """
        planes = exemplar.reshape(exemplar.shape[0], -1, channels)
        places = (planes.shape[0], planes.shape[1])
        row, column = correspondence.from_pixels(self.start, self.wide.shape, sides, places, 1, factor)
        own, known = planes[row, column], np.ones(1, bool)
        if self.shown is not None:
            whole, known = features.of_given(self.shown, channels)
            # What is not kept would spread into its surroundings at coarser scales.
            replaced = features.planes[self.start[~self.mask][:, 0], self.start[~self.mask][:, 1]]
            whole[~self.mask, : replaced.shape[1]] = replaced
            wide = resize(np.pad(whole, [*self.margin, (0, 0)], mode="edge"), *sides)
            own = np.where(known, fixed_point(wide).reshape(*sides, channels), own)
        beyond = [(0, wide - side) for side, wide in zip(sides, padded, strict=True)]
        fixed = np.pad(shrunk(self.wide, *sides, 1.0), beyond, mode="wrap")
        return fixed[..., None] & known, np.pad(own, [*beyond, (0, 0)], mode="wrap")

    def put(self, pixels: np.ndarray, match: Correspondence, image: Image) -> None:
        """Set the fixed pixels of a result, and their sources, but for those that only guide."""
        own = self.start[self.lasting]
        if self.given is None:
            pixels[self.lasting] = image.pixels[own[:, 0], own[:, 1]]
        else:
            pixels[self.lasting] = self.given.pixels[self.lasting]
        match[self.lasting] = own
