"""Pixels of a result that are fixed, at every scale."""

import numpy as np
from jaxtyping import Bool, Int16

from texloom.stages.arrays import Correspondence, Image, Mask
from texloom.stages.synthesis._patchmatch import correspondence
from texloom.stages.synthesis._patchmatch.allowed import shrunk


class FixedPixels:
    """Pixels of a result that keep the exemplar pixels of the start.

    Parameters
    ----------
    mask : true where the result is fixed, at full size.
    start : exemplar pixel of every pixel of the result.
    margin : px by which the target exceeds the result on every side; they are not fixed.
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
        """Which pixels of a target are fixed at the scale of ``factor``, and the start's features of all pixels.

        A coarse pixel is fixed if all of it is.

        Parameters
        ----------
        sides : height and width of the target.
        padded : the same with the padding of a torus.
        """
        planes = exemplar.reshape(exemplar.shape[0], -1, channels)
        places = (planes.shape[0], planes.shape[1])
        row, column = correspondence.from_pixels(self.start, self.wide.shape, sides, places, 1, factor)
        beyond = [(0, wide - side) for side, wide in zip(sides, padded, strict=True)]
        fixed = np.pad(shrunk(self.wide, *sides, 1.0), beyond, mode="wrap")
        return fixed[..., None], np.pad(planes[row, column], [*beyond, (0, 0)], mode="wrap")

    def put(self, pixels: np.ndarray, match: Correspondence, image: Image) -> None:
        """Set the fixed pixels of a result, and their sources."""
        own = self.start[self.mask]
        pixels[self.mask] = image.pixels[own[:, 0], own[:, 1]]
        match[self.mask] = own
