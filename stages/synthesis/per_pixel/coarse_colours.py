"""Colours of a coarse level as planes of control, by which per-pixel synthesis compares places too."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.common.grids.pyramid import resize
from texloom.stages.common.per_pixel.tables import CONTROLS
from texloom.stages.synthesis.control_maps.coarse_level import Guide, TargetGuide
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear

_WEIGHT = 1.0  # of the colours, relative to those of the texture


class CoarsePlanes(NamedTuple):
    """How colours become planes of control, fitted to an exemplar."""

    middle: Float64[np.ndarray, "3"]
    scale: float
    """of CIELAB units"""
    weight: float
    """variance of control and colours together, relative to that of the neighbourhoods"""

    @classmethod
    def of(cls, own: Float32[np.ndarray, "h w k"], weight: float, image: Image, colours: Guide) -> "CoarsePlanes":
        """Fitted to an exemplar, so that the weight of control remains.

        Parameters
        ----------
        own : control of the exemplar, 0..1.
        weight : variance of control relative to that of the neighbourhoods.
        image : the exemplar, whose colours vary as much as its neighbourhoods.
        colours : of a coarse level at its pixels.
        """
        varied = _variance(lab_from_linear(image.color))
        scale = np.sqrt(_WEIGHT * max(_variance(own), 1e-6) / (weight * max(varied, 1e-6)))
        middle = colours.mean(axis=(0, 1), dtype=np.float64)
        return cls(middle, scale, weight + _WEIGHT * _variance(colours) / max(varied, 1e-6))

    def planes(self, colours: TargetGuide, most: float = 1.0) -> TargetGuide:
        """The planes, -``most`` to ``most``."""
        return np.clip((colours - self.middle) * self.scale, -most, most).astype(np.float32)


def with_coarse_colours(
    own: Float32[np.ndarray, "h w k"],
    wanted: Float32[np.ndarray, "H W k"],
    weight: float,
    image: Image,
    guides: tuple[Guide, TargetGuide],
) -> tuple[Float32[np.ndarray, "h w all"], Float32[np.ndarray, "H W all"], float]:
    """Control of the exemplar and of the result with three more planes, and the weight of all.

    Where these would be too many planes they are left as they are.

    Parameters
    ----------
    own, wanted : control, 0..1.
    weight : variance of control relative to that of the neighbourhoods, which remains.
    image : the exemplar, whose colours vary as much as its neighbourhoods.
    guides : colours of its pixels, and those wanted, at any size, CIELAB.
    """
    colours, asked = guides
    if own.shape[2] + colours.shape[2] > CONTROLS:
        return own, wanted, weight
    fitted = CoarsePlanes.of(own, weight, image, colours)
    asked = resize(asked, wanted.shape[0], wanted.shape[1], bilinear=True)
    return (
        np.concatenate([own, fitted.planes(colours)], axis=2),
        np.concatenate([wanted, fitted.planes(asked)], axis=2),
        fitted.weight,
    )


def _variance(planes: Float32[np.ndarray, "h w c"]) -> float:
    """That of all planes together."""
    return float(planes.var(axis=(0, 1), dtype=np.float64).sum())
