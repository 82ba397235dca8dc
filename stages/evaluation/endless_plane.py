"""A part of a plane without end: a preview, and how its values compare with the texture's."""

import dataclasses
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.synthesis.endless.decorrelation import averageable
from texloom.stages.synthesis.endless.noise import Components, Noise, Tables
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Params, stage

_QUANTILES = 65


class EndlessPlaneParams(Params):
    """What is shown."""

    side: int = Field(2048, ge=64, le=8192)
    """sides of the preview, px of the texture"""


@dataclasses.dataclass(frozen=True)
class EndlessPlane:
    """The preview and its measures."""

    image: Image
    """R G B, linear light, as the shaders compute it"""
    table: dict[str, Any]
    """for each map: `contrast`, its standard deviation over the texture's, and `histogram`, the largest difference
    of their cumulative histograms, 0..1; of all channels the worst"""


@stage(version=1)
def endless_plane(
    texture: Image,
    first: Components,
    inverse: Tables,
    layout: dict[str, Any],
    params: EndlessPlaneParams,
    second: Components | None = None,
    third: Components | None = None,
    fourth: Components | None = None,
) -> EndlessPlane:
    """Compute a part of the plane that shaders cover, and compare contrast and histogram.

    Parameters
    ----------
    texture : what the Gaussian texture was made of.
    first, second, third, fourth, inverse, layout : see `gaussian_texture`.

    References
    ----------
    [HeitzNeyret2018]_, [DeliotHeitz2019]_.
    """
    rows, columns = (one.astype(np.float32) for one in np.mgrid[: params.side, : params.side])
    maps = Noise.of((first, second, third, fourth), inverse, layout).maps(rows, columns)
    table = {}
    for name, _, kind, values in averageable(texture):
        made = maps[name]
        shown = made[..., :2] / made[..., 2:] if kind == "slopes" else made
        table[name] = compared(shown, values)
    color = maps["color"] if maps["color"].shape[2] == 3 else np.repeat(maps["color"], 3, axis=2)
    return EndlessPlane(Image(np.ascontiguousarray(color), ("R", "G", "B")), table)


def compared(made: np.ndarray, given: np.ndarray) -> dict[str, float]:
    """`contrast` and `histogram` of planes as in `EndlessPlane`; of all channels the worst."""
    contrast, histogram = [], []
    for channel in range(given.shape[2]):
        one, other = np.sort(made[..., channel], axis=None), np.sort(given[..., channel], axis=None)
        spread = float(other.std(dtype=np.float64))
        contrast.append(float(one.std(dtype=np.float64)) / spread if spread > 1e-6 else 1.0)
        levels = other[np.linspace(0, other.size - 1, _QUANTILES).astype(np.int64)]
        shares = [np.searchsorted(values, levels, side="right") / values.size for values in (one, other)]
        histogram.append(float(np.abs(shares[0] - shares[1]).max()))
    return {"contrast": min(contrast, key=lambda one: -abs(one - 1)), "histogram": max(histogram)}
