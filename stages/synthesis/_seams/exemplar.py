"""What stitched syntheses copy from: an exemplar, what it is compared by, and which of its pixels may be used."""

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int64
from pydantic import Field

from texloom.stages.arrays import Image
from texloom.stages.color import lab_from_linear
from texloom.stages.common.maps import MIN_SPREAD, map_features
from texloom.stages.declare import InputError
from texloom.stages.masks import count_excluded, fill_excluded, valid_pixels, without_usable

Weights = dict[str, Annotated[float, Field(ge=0, le=100)]]
"""how much a map besides colour counts, by the name of the map or of one of its channels"""

Features: TypeAlias = Float32[np.ndarray, "h w c"]
MoreFeatures: TypeAlias = Float32[np.ndarray, "h w k"]


def lab_of(image: Image) -> Float32[np.ndarray, "h w c"]:
    """CIELAB colours, or lightness alone of a grey picture."""
    found = lab_from_linear(image.color)
    return np.ascontiguousarray(found[..., :1] if image.channels[0] == "Y" else found)


class Exemplar:
    """An exemplar whose masked pixels are never seen: others stand in for them.

    Parameters
    ----------
    color : features of an image's colour, (h, w, c).
    white : distance from black to white by them; CIELAB's is 100.
    weights : see `Weights`; the image must have these maps.

    Raises
    ------
    InputError
        a pixel that may be used holds a value that is not finite, or no pixel may be used.
    """

    image: Image
    """all channels but the mask, without what masked pixels held"""
    features: Features
    """colour, and the principal components of all other maps, scaled to vary together as much as colour alone"""
    usable: Bool[np.ndarray, "h w"] | None
    """which pixels may be used; none if all may"""

    def __init__(
        self, image: Image, color: Callable[[Image], Features], white: float, weights: Mapping[str, float]
    ):
        self.usable = valid_pixels(image)
        self.image = without_usable(fill_excluded(image))
        if not np.isfinite(self.image.pixels).all():
            raise InputError("image: a value is not finite")
        self._open: dict[tuple[int, int], np.ndarray] = {}
        self.features = _with_maps(color(self.image), self.image, self.usable, 100 / white, weights)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        return self.image.height, self.image.width

    def open_places(self, height: int, width: int) -> Bool[np.ndarray, "p q"]:
        """Where a box of pixels that may all be used has its top-left one."""
        if (height, width) not in self._open:
            places = (self.shape[0] - height + 1, self.shape[1] - width + 1)
            whole = self.usable is None
            self._open[height, width] = (
                np.ones(places, bool) if whole else count_excluded(self.usable, height, width) == 0
            )
        return self._open[height, width]

    def anywhere(self, height: int, width: int, rng: np.random.Generator) -> Int64[np.ndarray, "2"]:
        """Row and column of any open place, all as likely."""
        if self.usable is None:
            return rng.integers(0, np.subtract(self.shape, (height, width)).astype(np.int64) + 1)
        found = np.argwhere(self.open_places(height, width))
        return np.asarray(found[rng.integers(len(found))])

    def first_that_fits(self, sides: Sequence[int], name: str, knob: str = "") -> int:
        """Number of the first of ``sides`` whose square masks leave somewhere.

        Raises
        ------
        InputError
            there is none; ``name`` is what a square is called, ``knob`` the parameter that sets its side.
        """
        if self.usable is None:
            return 0
        for number, side in enumerate(sides):
            if self.open_places(side, side).any():
                return number
        instead = f"lower {knob} or mask less" if knob else "mask less"
        raise InputError(f"image: its mask leaves no whole {name} of {sides[-1]} px; {instead}")


def _with_maps(
    color: Features, image: Image, usable: np.ndarray | None, scale: float, weights: Mapping[str, float]
) -> MoreFeatures:
    counted = color.reshape(-1, color.shape[2]) if usable is None else color[usable]
    spread = scale * float(np.sqrt(counted.var(axis=0, dtype=np.float64).sum()))
    maps = map_features(image, spread, weights, usable)
    if not maps.shape[2]:
        return color
    # Tolerances are meant for colour alone, so both together vary as it does.
    base = max(spread, MIN_SPREAD)
    inside = maps.reshape(-1, maps.shape[2]) if usable is None else maps[usable]
    factor = base / np.hypot(base, float(np.sqrt(inside.var(axis=0, dtype=np.float64).sum())))
    both = np.concatenate([color * np.float32(factor), maps * np.float32(factor / scale)], axis=2)
    return np.ascontiguousarray(both, np.float32)
