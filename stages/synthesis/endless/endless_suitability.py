"""Whether a texture may be made endless by blending: whether blends look like it."""

import dataclasses
import logging
from typing import Any

import numpy as np
from jaxtyping import Float32

from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.synthesis.endless.gaussian_texture import GaussianTextureParams, gaussian_texture
from texloom.stages.synthesis.endless.noise import Noise
from texloom.stages.synthesis.endless.triangle_grid import tiles_at
from texloom.stages.vocabulary.arrays import Image, Vectors
from texloom.stages.vocabulary.declare import InputError, Params, stage

STOCHASTIC = 0.09
"""difference up to which blends are like the texture"""
STRUCTURED = 0.15
"""difference from which they are not"""

_SIDE = 512  # px, above which it is measured at half the size
_PLANE = 768  # px of the plane that is compared
_BLENDED = 0.55  # largest weight of a tile where tiles are blended
_SCALES = (1.0, 2.0, 4.0, 8.0)  # px
_LEVELS = 256
_LOG = logging.getLogger(__name__)


class EndlessSuitabilityParams(Params):
    """What happens with textures that do not suit."""

    accept: bool = False
    """go on with a texture whose structure would be blended away"""


@dataclasses.dataclass(frozen=True)
class EndlessSuitability:
    """What was measured."""

    table: dict[str, Any]
    """`difference`: between cumulative histograms of gradients of the texture and of blends of it, at the scale of the
    largest one, 0..1; `differences` at scales of 1, 2, 4 and 8 px; `repeats`: whether it has a lattice; `verdict`:
    `stochastic`, `doubtful` or `structured`"""


@stage(version=1)
def endless_suitability(
    image: Image, params: EndlessSuitabilityParams, generators: Vectors | None = None
) -> EndlessSuitability:
    """Measure whether blends of a texture look like the texture itself, as those of stochastic ones do.

    Blends keep the histogram of any texture, but contours of two tiles show through each other, with less contrast.
    So gradients of the first component of colour are compared: those where tiles are blended, in the published way,
    with those of the texture.

    Parameters
    ----------
    image : an exemplar, with or without borders.
    generators : of its lattice, two rows where it repeats in two directions.

    Raises
    ------
    InputError
        it is structured, and ``accept`` is false.

    References
    ----------
    [HeitzNeyret2018]_ say which textures suit; the measure is ours.
    """
    differences = _differences(image)
    worst = max(differences)
    repeats = generators is not None and len(generators) == 2
    verdict = "stochastic" if worst <= STOCHASTIC else "doubtful" if worst <= STRUCTURED else "structured"
    verdict = "structured" if repeats else verdict
    table = {"difference": worst, "differences": differences, "repeats": repeats, "verdict": verdict}
    why = "it repeats in two directions" if repeats else (
        f"gradients of blends differ by {worst:.3f}, of stochastic textures by less than {STOCHASTIC}"
    )  # fmt: skip
    if verdict == "structured" and not params.accept:
        raise InputError(
            f"image: its structure would be blended away: {why}; wang_tiles keeps it, --set accept=true goes on"
        )
    if verdict != "stochastic":
        _LOG.warning("structure may be blended away: %s; wang_tiles keeps it", why)
    return EndlessSuitability(table)


def _differences(image: Image) -> list[float]:
    while min(image.height, image.width) > _SIDE:
        image = image.with_pixels(Noise.halved(image.pixels))
    color = image.with_pixels(np.ascontiguousarray(image.color), ("R", "G", "B")).wrapping(True)
    texture = gaussian_texture(color, GaussianTextureParams(sharpness=1))
    rows, columns = (one.astype(np.float32) for one in np.mgrid[:_PLANE, :_PLANE])
    blended = Noise.of((texture.first,), texture.inverse, texture.layout).gaussian(rows, columns)[..., 0]
    zone = tiles_at(rows, columns, texture.layout["spacing"])[1].max(axis=0) < _BLENDED
    return [
        _largest_gap(_gradients(texture.first[..., 0], scale)[1:-1, 1:-1], _gradients(blended, scale)[zone])
        for scale in _SCALES
    ]


def _gradients(plane: Float32[np.ndarray, "h w"], scale: float) -> Float32[np.ndarray, "h w"]:
    smooth = gaussian_blur(plane, scale)
    down, across = (np.roll(smooth, -1, axis) - np.roll(smooth, 1, axis) for axis in (0, 1))
    return np.sqrt(down * down + across * across)


def _largest_gap(first: np.ndarray, second: np.ndarray) -> float:
    """Largest difference of two cumulative histograms, as in the test of Kolmogorov and Smirnov."""
    one, other = np.sort(first, axis=None), np.sort(second, axis=None)
    levels = np.concatenate(
        [values[np.linspace(0, len(values) - 1, _LEVELS).astype(np.int64)] for values in (one, other)]
    )
    shares = [np.searchsorted(values, levels, side="right") / len(values) for values in (one, other)]
    return float(np.abs(shares[0] - shares[1]).max())
