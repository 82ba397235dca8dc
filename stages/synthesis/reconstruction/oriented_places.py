"""Oriented results: places in the exemplar, and Jacobians between both."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float32, UInt32

from texloom.stages.common.geometry.jacobians import inverted
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.vocabulary.arrays import Image, Jacobian
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.normals import turned, with_unit_normals

Places: TypeAlias = Float32[np.ndarray, "2 H W"]
"""rows and columns of an exemplar, between its pixels, that the pixels of a result come from"""


@dataclass(frozen=True)
class Frames:
    """Orientation and scale of the texture at every pixel of a result."""

    jacobian: Jacobian
    """from px of the exemplar to px of the result"""
    inverse: Jacobian
    """and back"""

    @classmethod
    def of(cls, jacobian: Jacobian, height: int, width: int) -> "Frames":
        """The Jacobians of a result of ``height`` x ``width`` px; those of the nearest pixels, as means of
        rotations would shrink.

        Raises
        ------
        InputError
            a pixel has no area.
        """
        rows, columns = _nearest((height, width), jacobian.shape[:2])
        own = np.ascontiguousarray(jacobian[rows, columns])
        a, b, c, d = np.moveaxis(own, 2, 0)
        if not (np.abs(a * d - b * c) > 0).all():
            raise InputError("target_jacobian: a pixel has no area")
        return cls(own, np.ascontiguousarray(inverted(own)))

    def to_exemplar(
        self, offset: np.ndarray, window: tuple[slice, slice] = (slice(None), slice(None))
    ) -> np.ndarray:
        """Offsets in the exemplar of offsets in the result, both (2, ...), at the pixels of a window."""
        matrix = self.inverse[window].reshape(*self.inverse[window].shape[:2], 2, 2)
        return np.asarray(np.einsum("yxij,jyx->iyx", matrix, offset))

    def finer(
        self, places: Places, factor: float, shape: tuple[int, int]
    ) -> Float32[np.ndarray, "2 finer_H finer_W"]:
        """The same sources at this scale, which is ``factor`` times finer; each continues the nearest pixel's.

        Parameters
        ----------
        shape : height and width of the exemplar at this scale, px.
        """
        size = self.jacobian.shape[:2]
        rows, columns = _nearest(size, places.shape[1:])
        parents = np.stack(np.broadcast_arrays(rows, columns))
        offset = np.indices(size) - grown(parents, factor)
        return clipped(grown(places[:, rows, columns], factor) + self.to_exemplar(offset), shape)


def _nearest(size: tuple[int, ...], coarse: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Rows, (H, 1), and columns of the nearest pixels in a picture of another size."""
    rows, columns = ((np.arange(own) * 2 + 1) * other // (2 * own) for own, other in zip(size, coarse, strict=True))
    return rows[:, None], columns


def grown(places: np.ndarray, factor: float) -> np.ndarray:
    """Places in a picture that is ``factor`` times finer."""
    return (places + 0.5) * factor - 0.5


def clipped(places: np.ndarray, shape: tuple[int, int]) -> Places:
    """Places clipped to a picture of ``shape``."""
    limit = np.array(shape, np.float32)[:, None, None] - 1
    return np.ascontiguousarray(np.clip(places, 0, limit), np.float32)


def at_scale(
    source: UInt32[np.ndarray, "full_H full_W 2"], factor: float, size: tuple[int, int], shape: tuple[int, int]
) -> Places:
    """Places at the scale of ``factor`` from a correspondence of full size.

    Parameters
    ----------
    size, shape : height and width of result and exemplar at the scale, px.
    """
    rows, columns = _nearest(size, source.shape[:2])
    return clipped(grown(np.moveaxis(source[rows, columns], 2, 0).astype(np.float32), factor), shape)


def interpolated(image: Image, places: Places) -> Image:
    """The pixels at places, within each channel's range, by cubic splines: linear mixtures would blur."""
    ndimage = loaded("scipy.ndimage")
    planes = [
        np.clip(ndimage.map_coordinates(plane, places, order=3, mode="nearest"), plane.min(), plane.max())
        for plane in np.moveaxis(image.pixels, 2, 0)
    ]
    return image.elsewhere(np.stack(planes, axis=2))


def interpolated_along(image: Image, places: Places, jacobian: Jacobian) -> Image:
    """The `interpolated` pixels, with normals turned by ``jacobian``, from px of the image to px of the result."""
    pixels = turned(interpolated(image, places).pixels, image.channels, jacobian)
    return image.elsewhere(with_unit_normals(pixels, image.channels))
