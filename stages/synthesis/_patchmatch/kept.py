"""Pixels of a result that stay what they are, at every scale."""

import numpy as np
from jaxtyping import Bool, Int16

from texloom.stages.arrays import Correspondence, Image, Mask
from texloom.stages.synthesis._patchmatch import correspondence
from texloom.stages.synthesis._patchmatch.allowed import shrunk


class Kept:
    """Pixels of a result that are given: each is the exemplar pixel that the start names.

    Parameters
    ----------
    mask : true where the result is given, at full size.
    start : exemplar pixel of every pixel of the result.
    margin : px that the target reaches beyond the result on every side, of which nothing is given.
    """

    def __init__(self, mask: Mask, start: Correspondence, margin: int):
        self.mask = mask
        self.start = start
        self.wide = np.pad(mask, margin)

    def target(
        self,
        exemplar: Int16[np.ndarray, "h wc"],
        channels: int,
        sides: tuple[int, int],
        factor: float,
        padded: tuple[int, int],
    ) -> tuple[Bool[np.ndarray, "H W 1"], Int16[np.ndarray, "H W c"]]:
        """Which pixels of a target are given at the scale of ``factor``, and the features of all where they are.

        A coarse pixel is given where all of it is.

        Parameters
        ----------
        sides : height and width of the target.
        padded : the same with what is repeated behind the far edges of a torus.
        """
        planes = exemplar.reshape(exemplar.shape[0], -1, channels)
        places = (planes.shape[0], planes.shape[1])
        row, column = correspondence.from_pixels(self.start, self.wide.shape, sides, places, 1, factor)
        beyond = [(0, wide - side) for side, wide in zip(sides, padded, strict=True)]
        given = np.pad(shrunk(self.wide, *sides, 1.0), beyond, mode="wrap")
        return given[..., None], np.pad(planes[row, column], [*beyond, (0, 0)], mode="wrap")

    def put(self, pixels: np.ndarray, match: Correspondence, image: Image) -> None:
        """Set the given pixels of a result, and where they come from."""
        own = self.start[self.mask]
        pixels[self.mask] = image.pixels[own[:, 0], own[:, 1]]
        match[self.mask] = own
