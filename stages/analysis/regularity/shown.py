"""How often an exemplar shows its structure."""

import numpy as np

from texloom.stages.common.grids.pyramid import resize
from texloom.stages.kernels.core.elementary_functions import complex_product
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import determinant, matrix_product, pseudo_inverse
from texloom.stages.vocabulary.arrays import ScalarMap

_BLOCKS = 4  # a side, whose means are compared
_MIRROR_SIDE = 128  # px to which a picture is reduced for its symmetry
_MIN_OVERLAP = 0.5  # share of a picture that its mirror image has to cover
_MIN_TURN = 0.22  # root mean square change of direction across a picture; of 50 with a lattice at most .13
_CELL = 0.75  # of a cell's side: standard deviation of the window in which directions are averaged
_FLAT = 0.05  # of the mean squared gradient, below which a window has no direction
_PADDED = 4  # times a picture's sides: spectra are sampled finely enough to tell one period from two
_ELEMENT = 60.0  # integral ranges of the gradient magnitude in an element, about


def periods(generators: np.ndarray, shape: tuple[int, int]) -> float:
    """Number of periods that an image of ``shape`` shows, in the direction of fewest.

    Parameters
    ----------
    generators : of a lattice, (2, 2) px, or the step between courses, (1, 2) px.
    """
    lines = pseudo_inverse(generators.astype(np.float64))  # a pixel's (row, column) times this are cells
    return float(matrix_product(np.array(shape), np.abs(lines)).min())


def periods_of_directions(lightness: ScalarMap, generators: np.ndarray) -> float:
    """How often an image shows the structure in which directions change from cell to cell; inf where they do not.

    Cells of a lattice all have the same mean direction. Where it changes, as between the two rows of a herringbone,
    whose planks' width repeats in both, the structure is larger than the cells. It is shown as often as the
    strongest wave of the directions, and at least once.

    Parameters
    ----------
    generators : of the lattice, (2, 2) px.

    References
    ----------
    Ours.
    """
    lengths = np.hypot(*generators.astype(np.float64).T)
    area = abs(float(determinant(generators.astype(np.float64))))
    sigma = max(_CELL * area**0.5, float(lengths.max()) / 2)
    margin = round(sigma)
    if min(lightness.shape) <= 3 * margin:
        return np.inf
    rows, columns = (np.asarray(plane, np.float32) for plane in np.gradient(gaussian_blur(lightness, 1.0)))
    energy = gaussian_blur(rows**2 + columns**2, sigma)
    energy += _FLAT * energy.mean()
    inside = np.s_[margin:-margin, margin:-margin]
    doubled = (columns**2 - rows**2, 2 * rows * columns)
    turns = [(gaussian_blur(plane, sigma) / energy)[inside].astype(np.float64) for plane in doubled]
    turns = [plane - plane.mean() for plane in turns]
    if sum(float((plane**2).mean()) for plane in turns) < _MIN_TURN**2:
        return np.inf
    height, width = turns[0].shape
    # Welch's window
    down, across = (1 - np.square(np.linspace(-1, 1, side + 2)[1:-1]) for side in (height, width))
    window = down[:, None] * across
    size = (_PADDED * height, _PADDED * width)
    power = np.sum([np.abs(np.fft.rfft2(plane * window, size)) ** 2 for plane in turns], axis=0)
    row, column = np.unravel_index(int(np.argmax(power)), power.shape)
    waves = np.array([min(row, size[0] - row) / size[0], column / size[1]]) * lightness.shape
    return max(1.0, float(waves.max()))


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
