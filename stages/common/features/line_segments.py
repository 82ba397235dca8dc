"""Line segments of a picture, and the coordinates in which they and vanishing points are."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from texloom.stages.common.grids.pyramid import reduced
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.color import srgb_from_linear

_MAX_SIDE = 1024  # px of the longer side at which segments are detected
_MIN_LENGTH = 0.02  # of a segment, half diagonals


@dataclass(frozen=True)
class Segments:
    """Line segments of a picture."""

    ends: Float64[np.ndarray, "n 2 2"]
    """row and column of both ends"""

    @property
    def middles(self) -> Float64[np.ndarray, "n 2"]:
        """Row and column of the middles."""
        return self.ends.mean(axis=1)

    @property
    def lengths(self) -> Float64[np.ndarray, "n"]:  # type: ignore[name-defined]
        """Lengths of the segments."""
        return np.hypot(*(self.ends[:, 1] - self.ends[:, 0]).T)

    def within(self, mask: Mask) -> Bool[np.ndarray, "n"]:  # type: ignore[name-defined]
        """Which segments have their middle where ``mask``, of the picture's pixels, is true."""
        height, width = mask.shape
        rows, columns = np.rint(Frame((height, width)).pixels(self.middles)).astype(int).T
        return np.asarray(mask[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)])

    def __getitem__(self, chosen: np.ndarray) -> "Segments":
        return Segments(self.ends[chosen])


@dataclass(frozen=True)
class Frame:
    """Positions in a photograph: px; and from its middle in half diagonals."""

    size: tuple[int, int]
    """of the photograph, px"""

    @property
    def unit(self) -> float:
        """Half the diagonal, px."""
        return float(np.hypot(*self.size)) / 2

    def pixels(self, places: np.ndarray) -> np.ndarray:
        """Rows and columns, px."""
        return np.asarray(places * self.unit + (np.array(self.size) - 1) / 2)

    def places(self, pixels: np.ndarray) -> np.ndarray:
        """The same in half diagonals from the middle."""
        return np.asarray((pixels - (np.array(self.size) - 1) / 2) / self.unit)


def line_segments(image: Image, side: int = _MAX_SIDE) -> Segments:
    """The line segments of a picture, in half diagonals from its middle, found at ``side`` px [Gioi2010]_."""
    import cv2

    grey = cv2.cvtColor(srgb_from_linear(reduced(image.color, side)).astype(np.float32), cv2.COLOR_RGB2GRAY)
    small = np.rint(grey * 255).astype(np.uint8)
    lines = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(small)[0]
    ends = np.zeros((0, 2, 2)) if lines is None else lines.reshape(-1, 2, 2)[..., ::-1].astype(np.float64)
    frame = Frame((image.height, image.width))
    segments = Segments(frame.places((ends + 0.5) * np.array(frame.size) / small.shape - 0.5))
    return segments[segments.lengths >= _MIN_LENGTH]
