"""The phase of a collage in the lattice of the exemplar that its pieces are cut from."""

import numpy as np
from jaxtyping import Int64

from texloom.stages.common.regularity.lattice_cells import steps_along
from texloom.stages.kernels.core.elementary_functions import complex_product, phase_of, phasor
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.vocabulary.arrays import Correspondence, Mask, Vectors

_NEAR = 15  # px of a window whose mean phase is that of its middle
_MIN_SHARE = 0.5  # of the pixels in it that are neither turned nor scaled


class CollagePhase:
    """What of a collage is in phase with most of it.

    Parameters
    ----------
    generators : px, two rows or one.
    sources : exemplar pixel of every pixel of the collage.
    inside : pixels that are not at joints.
    """

    def __init__(self, generators: Vectors, sources: Correspondence, inside: Mask):
        import cv2

        self.generators = generators.astype(np.float64)
        self.cells = steps_along(self.generators)
        displacement = sources.astype(np.int64) - np.moveaxis(np.indices(inside.shape), 0, 2)
        moved = np.zeros(inside.shape, bool)
        for axis in (0, 1):
            moved |= (displacement != np.roll(displacement, 1, axis)).any(axis=2)
        upright = inside & ~moved
        self.upright = float(upright.sum()) / max(1, int(inside.sum()))
        """share of the pixels that are neither turned nor scaled"""
        drift = phasor(2 * np.pi * matrix_product(displacement, self.cells)).astype(np.complex64)
        drift[~upright] = 0
        self.phase = phase_of(drift.sum(axis=(0, 1), dtype=np.complex128)) / (2 * np.pi)
        sides = (_NEAR, _NEAR)
        planes = [plane for one in np.moveaxis(drift, 2, 0) for plane in (one.real, one.imag)]
        near = np.stack([cv2.blur(np.ascontiguousarray(plane), sides) for plane in planes], axis=2)
        away = np.abs(
            phase_of(complex_product(near[..., ::2] + 1j * near[..., 1::2], phasor(-2 * np.pi * self.phase)))
        )
        is_upright = cv2.blur(upright.astype(np.float32), sides) >= _MIN_SHARE
        self.error = np.where(is_upright, away.max(axis=2) / (2 * np.pi), 0)
        """of each pixel, in cells, 0..0.5; 0 where it is turned or scaled"""

    def corner(self, column: int) -> Int64[np.ndarray, "2"]:
        """A pixel right of ``column`` where the collage would begin in phase with the exemplar's lattice."""
        reach = np.ceil(np.abs(self.generators).sum(axis=0)).astype(int) + 1
        places = np.moveaxis(np.indices(tuple(reach)), 0, 2).reshape(-1, 2) + np.array([0, column])
        steps = matrix_product(places, self.cells) - self.phase
        away = np.hypot(*matrix_product(steps - np.rint(steps), self.generators).T)
        near = places[away <= away.min() + 0.25]
        return np.asarray(near[near.sum(axis=1).argmin()], np.int64)
