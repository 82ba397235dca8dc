"""Whether a texture may be made endless by blending: whether blends look like it."""

import dataclasses
import logging
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from jaxtyping import Float32

from texloom.stages.analysis.regularity.deformed_lattice import DeformedLatticeParams, deformed_lattice
from texloom.stages.analysis.regularity.lattice_selection import LatticeSelectionParams, lattice_selection
from texloom.stages.analysis.regularity.offset_statistics import OffsetStatisticsParams, offset_statistics
from texloom.stages.analysis.structure.element_size import element_size
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.synthesis.endless.gaussian_texture import (
    GaussianTexture,
    GaussianTextureParams,
    gaussian_texture,
)
from texloom.stages.synthesis.endless.mip_levels import halved
from texloom.stages.synthesis.endless.noise import Noise
from texloom.stages.synthesis.endless.triangle_grid import tiles_at
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, Params, stage

LIMITS = {"difference": (0.09, 0.15), "repetition": (0.3, 0.4), "element size": (0.08, 0.15)}
"""up to which blends are like the texture, and from which they are not; set on 38 photographs, sizes on 45"""

_SIDE = 512  # px, above which it is measured at half the size
_PLANE = 512  # px of the plane that is compared
_BLENDED = 0.55  # largest weight of a tile where tiles are blended
_FOUND = 0.4  # share of the vertices of a lattice
_SEEN = 0.1  # range of a component of colour, of that of the first one, from which it is compared
_SCALES = (1.0, 2.0, 4.0, 8.0)  # px
_LEVELS = 256
_LOG = logging.getLogger(__name__)


class EndlessSuitabilityParams(Params):
    """How a plane is made, and what happens with textures that do not suit."""

    way: Literal["auto", "noise", "cells"] = "auto"
    """`noise` blends, `cells` lays the cells of a lattice, `auto` does so where there is one"""
    labels: tuple[str, ...] = ("noise", "cells")
    """the ways that there are"""
    accept: bool = False
    """go on with a texture whose structure would be blended away"""


@dataclasses.dataclass(frozen=True)
class EndlessSuitability:
    """What was measured, and chosen."""

    table: dict[str, Any]
    """`chosen`: a list of one way, and `because`; `difference`: between cumulative histograms of gradients of the
    texture and of blends of it, at the scale of the largest one, 0..1; `differences` at scales of 1, 2, 4 and 8 px;
    `repetition`: the largest autocorrelation beyond a sixth of its shorter side; `element size`: side of the median
    element between closed contours, as a share of that side, 0 where it does not consist of such; `periods`:
    `courses`, or how a lattice was found, or `none`; `verdict`: `stochastic`, `doubtful` or `structured`"""


@stage(version=1, role="choice")
def endless_suitability(image: Image, params: EndlessSuitabilityParams) -> EndlessSuitability:
    """Measure whether blends of a texture look like the texture itself, as those of stochastic ones do.

    Blends keep the histogram of any texture, but contours of two tiles show through each other, with less contrast.
    So gradients of the components of colour are compared: those where tiles are blended, in the published way,
    with those of the texture. Narrow joints around large elements, as of flagstones, count little in these, and are
    found as closed contours. What repeats loses its order in tiles that are shifted at random; it is found by its
    autocorrelation, and lattices and courses, of which each brick is another one, as by `lattice_selection`. These
    have cells, which can be laid as they are.

    Parameters
    ----------
    image : an exemplar, with or without borders.

    Raises
    ------
    InputError
        it is structured, without a lattice or courses whose cells are found, and ``accept`` is false.

    References
    ----------
    [HeitzNeyret2018]_ say which textures suit; the measures are ours.
    """
    table = suitability_of(image)
    reasons = why_not(table)
    if params.way == "cells":
        return EndlessSuitability({"chosen": ["cells"], "because": "they were asked for", **table})
    if params.way == "auto" and table["periods"] != "none" and _has_cells(image):
        because = f"{_repeats(table)} that blending would destroy"
        return EndlessSuitability({"chosen": ["cells"], "because": because, **table})
    if table["verdict"] == "structured" and not params.accept and params.way == "auto":
        raise InputError(
            f"image: blending would destroy its structure: {reasons}; the flow wang_tiles keeps it, --set "
            "accept=true goes on"
        )
    if table["verdict"] != "stochastic":
        _LOG.warning("blending may destroy its structure: %s; the flow wang_tiles keeps it", reasons)
    because = f"though {reasons}" if reasons else "it is stochastic"
    return EndlessSuitability({"chosen": ["noise"], "because": because, **table})


def _has_cells(image: Image) -> bool:
    """Whether most cells of its lattice, or strips of its courses, are found where the lattice has them."""
    density = offset_statistics(image, OffsetStatisticsParams()).density
    generators = lattice_selection(image, density, LatticeSelectionParams()).generators
    try:
        return deformed_lattice(image, DeformedLatticeParams(), generators).detected >= _FOUND
    except InputError:  # its cells are not detected, or it has none at full size
        return False


def suitability_of(image: Image) -> dict[str, Any]:
    """The table of `EndlessSuitability`."""
    while min(image.height, image.width) > _SIDE:
        image = image.with_pixels(halved(image.pixels))
    color = image.with_pixels(np.ascontiguousarray(image.color), ("R", "G", "B")).wrapping(True)
    texture = gaussian_texture(color, GaussianTextureParams(sharpness=1))
    differences = _differences(texture)
    found = {
        "difference": max(differences),
        "repetition": _repetition(texture.first[..., 0]),
        "element size": element_size(color) / min(color.height, color.width),
    }
    worst = max(sum(value > limit for limit in LIMITS[name]) for name, value in found.items())
    density = offset_statistics(image, OffsetStatisticsParams()).density
    lattice = lattice_selection(image, density, LatticeSelectionParams())
    verdict = "structured" if len(lattice.generators) else ("stochastic", "doubtful", "structured")[worst]
    return {**found, "differences": differences, "periods": lattice.chosen, "verdict": verdict}


def why_not(table: Mapping[str, Any]) -> str:
    """What makes a texture not stochastic, by its table."""
    reasons = [
        f"its {name} is {table[name]:.3f}, that of stochastic textures below {limits[0]}"
        for name, limits in LIMITS.items()
        if table[name] > limits[0]
    ]
    if table["periods"] != "none":
        reasons.append(_repeats(table))
    return " and ".join(reasons)


def _repeats(table: Mapping[str, Any]) -> str:
    return "it has courses" if table["periods"] == "courses" else "it has a lattice"


def _differences(texture: GaussianTexture) -> list[float]:
    """At each scale, of the component of colour that differs most, but for those that hardly vary."""
    rows, columns = (one.astype(np.float32) for one in np.mgrid[:_PLANE, :_PLANE])
    blended = Noise.of((texture.first,), texture.inverse, texture.layout).gaussian(rows, columns)
    zone = tiles_at(rows, columns, texture.layout["spacing"])[1].max(axis=0) < _BLENDED
    spans = texture.layout["span"]
    seen = [index for index in range(len(spans)) if spans[index] >= _SEEN * spans[0]]
    return [
        max(
            _largest_gap(
                _gradients(texture.first[..., index], scale)[1:-1, 1:-1],
                _gradients(blended[..., index], scale)[zone],
            )
            for index in seen
        )
        for scale in _SCALES
    ]


def _repetition(plane: Float32[np.ndarray, "h w"]) -> float:
    """The largest autocorrelation beyond a sixth of the shorter side, without slow changes."""
    side = min(plane.shape)
    detail = (plane - gaussian_blur(plane, side / 8)).astype(np.float64)
    spread = float(np.square(detail).mean())
    if spread < 1e-12:
        return 0.0
    height, width = plane.shape
    shape = (2 * height, 2 * width)
    sums = np.fft.irfft2(np.abs(np.fft.rfft2(detail, shape)) ** 2, shape)
    down, across = (np.minimum(np.arange(2 * size), 2 * size - np.arange(2 * size)) for size in (height, width))
    pairs = (height - down)[:, None] * (width - across)
    far = (
        (down[:, None] ** 2 + across**2 > (side / 6) ** 2) & (down[:, None] < 0.6 * height) & (across < 0.6 * width)
    )
    return float((sums[far] / pairs[far]).max()) / spread


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
