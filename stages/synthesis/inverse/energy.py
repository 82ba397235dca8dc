"""The exact energy of a summary of a texture, by exhaustive search."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float32, Int16

from texloom.stages.common.similarity.neighbourhoods import UNIT, Components, fixed_point, places, whole, windows
from texloom.stages.kernels.core.vector_size import DIMENSIONS
from texloom.stages.synthesis.inverse.level import TextureLevel, nearest


@dataclass(frozen=True)
class Terms:
    """Means over neighbourhoods, squared CIELAB units a pixel."""

    inverse: float
    """from what the texture has to the nearest in the summary: what is missing"""
    forward: float
    """from what the summary has to the nearest in the texture: what is foreign; not weighted"""

    def energy(self, alpha: float) -> float:
        """Their sum, the forward term weighted by ``alpha``; [Wei2008]_ (1)."""
        return self.inverse + alpha * self.forward


class ExactEnergy:
    """The energy of any summary of one texture.

    Parameters
    ----------
    features : what neighbourhoods are compared by, CIELAB units.
    size : side of a neighbourhood, px.
    samples : most neighbourhoods that the inverse term is the mean of, spread evenly; the forward term, which costs
        more and varies less, takes a quarter as many. They are sought among all.
    inside : for an atlas, the pixels that are part of a texture; None for all.

    Notes
    -----
    The nearest neighbourhood is that by the first 32 principal components; its distance is that of all values.
    """

    def __init__(
        self,
        features: Float32[np.ndarray, "h w c"],
        size: int,
        samples: int,
        inside: Bool[np.ndarray, "h w"] | None = None,
    ):
        pixels = fixed_point(features)
        components = Components.of(pixels, features.shape[2], size)
        valid = None if inside is None else whole(inside, size)
        self._hold(pixels, components, valid, samples)

    @classmethod
    def of_level(cls, level: TextureLevel, samples: int) -> "ExactEnergy":
        """That of summaries of a texture whose neighbourhoods are known."""
        energy = cls.__new__(cls)
        energy._hold(level.pixels, level.components, level.tree.leaf >= 0, samples)
        if "vectors" in vars(level):
            energy.vectors = level.vectors
        return energy

    def _hold(
        self,
        pixels: Int16[np.ndarray, "h wc"],
        components: Components,
        valid: Bool[np.ndarray, "p q"] | None,
        samples: int,
    ) -> None:
        self.pixels, self.components, self.samples = pixels, components, samples
        self.size, self.channels = components.size, components.channels
        self.places = places(pixels.shape[0], pixels.shape[1] // self.channels, self.size)
        self.valid = np.full(self.places, True) if valid is None else valid

    @cached_property
    def vectors(self) -> Int16[np.ndarray, "n 32"]:
        """Those of all neighbourhoods, row by row."""
        return self.components.vectors(self.pixels)

    def grid(self, step: int) -> Int16[np.ndarray, "n 32"]:
        """The vectors of neighbourhoods at every ``step`` px down and across, row by row."""
        if "vectors" in vars(self):
            return self.vectors.reshape(*self.places, -1)[::step, ::step].reshape(-1, DIMENSIONS)
        return self.components.vectors(self.pixels, step)

    def largest(self) -> float:
        """Upper bound of the mean distance of two neighbourhoods, squared CIELAB units a pixel.

        The squared diagonal of the box around all vectors.
        """
        vectors = self.vectors[self.valid.ravel()]
        spread = vectors.max(axis=0).astype(np.float64) - vectors.min(axis=0)
        return float((spread**2).sum()) / (self.components.unit * UNIT * self.size) ** 2

    @staticmethod
    def sampled(down: int, across: int, samples: int) -> np.ndarray:
        """Numbers of evenly spread places, row by row, at most ``samples`` or so of ``down`` x ``across``."""
        step = max(1, math.ceil(math.sqrt(down * across / samples)))
        return np.arange(down * across).reshape(down, across)[::step, ::step].ravel()

    def samples_of_texture(self) -> np.ndarray:
        """Numbers of the texture's places that the inverse term is the mean of, row by row."""
        share = self.valid.mean()
        numbers = self.sampled(*self.places, math.ceil(self.samples / max(share, 1e-6)))
        return np.asarray(numbers[self.valid.ravel()[numbers]])

    def of(self, planes: Float32[np.ndarray, "H W c"]) -> Terms:
        """The terms of a summary; ``planes`` are its features, at least a neighbourhood large."""
        return Terms(self.inverse_of(planes), self.forward_of(planes))

    def inverse_of(self, planes: Float32[np.ndarray, "H W c"]) -> float:
        """`Terms.inverse` of a summary."""
        return self.inverse_of_values(fixed_point(planes))

    def inverse_of_values(self, values: Int16[np.ndarray, "H Wc"]) -> float:
        """`inverse_of` a summary in fixed-point steps."""
        numbers = self.samples_of_texture()
        matches = nearest(self.components.vectors_at(self.pixels, numbers), self.components.vectors(values))
        return self._mean_distance(self.pixels, numbers, values, matches)

    def forward_of(self, planes: Float32[np.ndarray, "H W c"]) -> float:
        """`Terms.forward` of a summary."""
        values = fixed_point(planes)
        down, across = places(planes.shape[0], planes.shape[1], self.size)
        numbers = self.sampled(down, across, max(1, self.samples // 4))
        known = np.flatnonzero(self.valid)
        matches = known[nearest(self.components.vectors(values)[numbers], self.vectors[known])]
        return self._mean_distance(values, numbers, self.pixels, matches)

    def _mean_distance(
        self, pixels: Int16[np.ndarray, "h wc"], numbers: np.ndarray, others: np.ndarray, matches: np.ndarray
    ) -> float:
        """From neighbourhoods of ``pixels`` to their matches in ``others``, both in fixed-point steps."""
        one, other = (
            windows(values, self.channels, self.size)[
                np.divmod(ordinals, values.shape[1] // self.channels - self.size + 1)
            ]
            for ordinals, values in ((numbers, pixels), (matches, others))
        )
        difference = one.astype(np.int32) - other
        return int(np.square(difference).sum(dtype=np.int64)) / (numbers.size * self.size**2 * UNIT**2)
