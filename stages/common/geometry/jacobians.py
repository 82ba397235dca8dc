"""Inverse Jacobians, and those of rotations."""

import numpy as np
from jaxtyping import Float

from texloom.stages.kernels.core.elementary_functions import cos, sin
from texloom.stages.vocabulary.arrays import Jacobian, ScalarMap


def inverted(jacobian: Float[np.ndarray, "h w 4"]) -> Float[np.ndarray, "h w 4"]:
    """From px of an image to its texture, in the precision of ``jacobian``; not finite where it is singular.

    `numpy.linalg.inv` takes several times as long for many 2x2 matrices.
    """
    a, b, c, d = np.moveaxis(jacobian, 2, 0)
    return np.asarray(np.stack([d, -b, -c, a], axis=2) / (a * d - b * c)[..., None])


def rotations(angle: ScalarMap) -> Jacobian:
    """Those of texture whose rows run along ``angle``, radians, from along a row towards growing rows."""
    sine, cosine = sin(angle), cos(angle)
    return np.stack([cosine, sine, -sine, cosine], axis=2)
