"""An exemplar that is continued beyond its border, so that all of its pixels can be the middle of a patch."""

import dataclasses

import numpy as np

from texloom.stages.vocabulary.arrays import Correspondence, Image
from texloom.stages.vocabulary.scratch import bands, empty


@dataclasses.dataclass(frozen=True)
class Border:
    """Mirrored pixels around an exemplar, so wide that every pixel of it is the middle of a patch; or none.

    A last vote that weighs the middle of patches most shows nothing else of them. Without a border, the outermost
    half patch of the exemplar would never be visible: 8 % of 256 x 256 px with patches of 10 px.
    """

    patch_size: int
    """1 for no border"""

    @property
    def before(self) -> int:
        """Width above and to the left, px."""
        return self.patch_size // 2

    def lines(self, side: int) -> np.ndarray:
        """Of each row or column with the border, the one of the exemplar, of ``side`` px, that it shows."""
        return np.pad(np.arange(side), (self.before, self.patch_size - 1 - self.before), mode="symmetric")

    def around(self, planes: np.ndarray) -> np.ndarray:
        """One or more planes of the exemplar, with the border."""
        rows, columns = (self.lines(side) for side in planes.shape[:2])
        inner = slice(self.before, self.before + planes.shape[1])
        result = empty((rows.size, columns.size, *planes.shape[2:]), planes.dtype)
        for band in bands(len(planes), result, planes):
            result[self.before :][band, inner] = planes[band]
        outside = np.r_[: self.before, self.before + len(planes) : rows.size]
        result[outside, inner] = planes[rows[outside]]
        for band in bands(rows.size, result):
            for beyond in (slice(inner.start), slice(inner.stop, None)):
                result[band, beyond] = result[band][:, columns[beyond] + self.before]
        return result

    def around_image(self, image: Image) -> Image:
        """The exemplar with the border; what is masked is masked in the border too."""
        return image.elsewhere(self.around(image.pixels))

    def inside(self, plane: np.ndarray, height: int, width: int) -> np.ndarray:
        """A plane of the exemplar of ``height`` x ``width`` px, without the border."""
        rows, columns = (slice(self.before, self.before + side) for side in (height, width))
        return np.ascontiguousarray(plane[rows, columns])

    def moved(self, match: Correspondence) -> Correspondence:
        """Sources in the exemplar, as sources in the exemplar with the border."""
        moved = empty(match.shape, np.uint32)
        for band in bands(len(match), match, moved):
            np.add(match[band], np.uint32(self.before), out=moved[band])
        return moved

    def move_back(self, match: Correspondence) -> None:
        """The reverse of `moved`, in place; no source is in the border."""
        for band in bands(len(match), match):
            match[band] -= np.uint32(self.before)
