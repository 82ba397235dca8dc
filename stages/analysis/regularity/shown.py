"""How often an exemplar shows its structure."""

import numpy as np

from texloom.stages.common.grids.pyramid import resize
from texloom.stages.kernels.core.elementary_functions import complex_product
from texloom.stages.numerics.matrices import matrix_product, pseudo_inverse
from texloom.stages.vocabulary.arrays import ScalarMap

_BLOCKS = 4  # a side, whose means are compared
_MIRROR_SIDE = 128  # px to which a picture is reduced for its symmetry
_MIN_OVERLAP = 0.5  # share of a picture that its mirror image has to cover
_ELEMENT = 60.0  # integral ranges of the gradient magnitude in an element, about


def periods(generators: np.ndarray, shape: tuple[int, int]) -> float:
    """Number of periods that an image of ``shape`` shows, in the direction of fewest.

    Parameters
    ----------
    generators : of a lattice, (2, 2) px, or the step between courses, (1, 2) px.
    """
    lines = pseudo_inverse(generators.astype(np.float64))  # a pixel's (row, column) times this are cells
    return float(matrix_product(np.array(shape), np.abs(lines)).min())


def elements(gradients: ScalarMap) -> float:
    """Number of elements that an image of a random texture shows, roughly, from its gradient magnitude.

    The variance of a mean over an area, compared with that of single pixels, gives the area over which pixels are
    alike, the integral range. Elements of real textures have some sixty of these.

    References
    ----------
    [Lantuejoul1991]_. The number in an element is ours, from 44 photographs; it varies by a factor of two.
    """
    height, width = (side // _BLOCKS for side in gradients.shape)
    if not height or not width:
        return 0.0
    blocks = gradients[: height * _BLOCKS, : width * _BLOCKS].reshape(_BLOCKS, height, _BLOCKS, width)
    means = blocks.mean(axis=(1, 3), dtype=np.float64)
    variance = float(means.var(ddof=1))
    if variance <= 0:
        return 0.0
    return _BLOCKS**2 * float(gradients.var(dtype=np.float64)) / variance / _ELEMENT


def mirror_symmetry(lightness: ScalarMap) -> float:
    """Highest correlation of an image with its mirror image about any upright or level axis near its middle, -1..1.

    Near 1 for a single ornament. Means of rows and columns are subtracted, since stripes are symmetric as well.
    """
    factor = min(1.0, _MIRROR_SIDE / max(lightness.shape))
    height, width = (max(1, round(side * factor)) for side in lightness.shape)
    plane = resize((lightness - lightness.mean())[..., None], height, width)[..., 0].astype(np.float64)
    least = 1e-6 * float(np.square(plane).sum()) + 1e-12
    plane -= plane.mean(axis=0)
    plane -= plane.mean(axis=1, keepdims=True)
    size = (2 * height, 2 * width)

    def correlated(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        return np.asarray(
            np.fft.irfft2(complex_product(np.fft.rfft2(first, size), np.conj(np.fft.rfft2(second, size))), size)
        )

    inside = np.ones_like(plane)
    covered = correlated(inside, inside) >= _MIN_OVERLAP * plane.size
    highest = -1.0
    for axis in (0, 1):
        mirrored = np.flip(plane, axis)
        product = correlated(plane, mirrored)[covered]
        power = correlated(plane**2, inside)[covered] * correlated(inside, mirrored**2)[covered]
        highest = max(highest, float((product / np.sqrt(np.maximum(power, least**2))).max()))
    return highest
