"""Hex tiling in Python: what its shaders compute, the reference that they are tested with."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float32

from texloom.stages.common.grids.wang import hashed
from texloom.stages.synthesis.endless.mip_levels import in_bands, pyramid_of, texels
from texloom.stages.synthesis.endless.triangle_grid import shifts_of, tiles_at
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import fill_excluded
from texloom.stages.vocabulary.normals import NORMAL

LUMINANCE = (0.299, 0.587, 0.114)
"""of R, G, B, as in [Mikkelsen2022]_"""
FLATTEST = 0.05
"""least z of a normal"""


@dataclasses.dataclass(frozen=True)
class HexTiling:
    """A material and how it is laid, see `texloom.stages.synthesis.endless.hex_shaders`.

    References
    ----------
    [Mikkelsen2022]_.
    """

    pyramid: list[Float32[np.ndarray, "_ _ n"]]
    """levels of detail of all channels"""
    channels: tuple[str, ...]
    layout: Mapping[str, Any]

    @staticmethod
    def of(image: Image, layout: Mapping[str, Any]) -> HexTiling:
        """Of a texture that continues across its borders."""
        return HexTiling(pyramid_of(fill_excluded(image).pixels), image.channels, layout)

    def pixels(
        self, rows: Float32[np.ndarray, "H W"], columns: Float32[np.ndarray, "H W"], level: float = 0.0
    ) -> Float32[np.ndarray, "H W n"]:
        """All channels at places of the plane, px of the texture, at a level of detail."""
        return in_bands(partial(self._band, level), rows, columns)

    def _band(self, level: float, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        from texloom.stages.kernels.core.elementary_functions import cos, power, sin

        spacing = self.layout["spacing"]
        vertices, weights = tiles_at(rows, columns, spacing)
        shifts = shifts_of(vertices, self.pyramid[0].shape[:2]).astype(np.float32)
        found, shares = [], []
        for tile in range(3):
            first, second = vertices[tile].astype(np.float32)
            y0, x0 = (
                second * np.float32(3**0.5 / 2 * spacing),
                (first + second * np.float32(0.5)) * np.float32(spacing),
            )
            angle = self._angles(vertices[tile])
            cosine, sine = (np.asarray(turn(angle), np.float32) for turn in (cos, sin))
            x, y = columns - x0, rows - y0
            own = texels(
                self.pyramid,
                sine * x + cosine * y + y0 + shifts[0, tile],
                cosine * x - sine * y + x0 + shifts[1, tile],
                level,
            )
            shares.append(
                self._luminance(own) * np.asarray(power(weights[tile], self.layout["exponent"]), np.float32)
            )
            found.append(self._with_slopes(own, cosine, sine))
        total = np.sum(shares, axis=0)
        blended = sum(share[..., None] * own for share, own in zip(shares, found, strict=True)) / total[..., None]
        return self._with_normals(np.asarray(blended, np.float32))

    def _angles(self, vertices: np.ndarray) -> np.ndarray:
        """By which the texture is turned in each tile, radians."""
        bits = hashed(vertices[1], vertices[0], 1)
        share = (bits >> 8).astype(np.float32) * np.float32(2.0**-23) - 1
        return np.asarray(share * np.float32(np.deg2rad(self.layout["rotation"])))

    def _luminance(self, own: np.ndarray) -> np.ndarray:
        if self.channels[0] == "Y":
            light = own[..., 0]
        else:
            light = np.asarray(sum(own[..., index] * np.float32(share) for index, share in enumerate(LUMINANCE)))
        contrast = np.float32(self.layout["contrast"])
        return np.asarray(1 - contrast + contrast * np.maximum(light, np.float32(1e-4)))

    def _normal(self) -> list[int]:
        return [self.channels.index(name) for name in NORMAL if name in self.channels]

    def _with_slopes(self, own: np.ndarray, cosine: np.ndarray, sine: np.ndarray) -> np.ndarray:
        """Normals replaced by slopes, turned back as the texture is turned."""
        if len(self._normal()) != 3:
            return own
        first, second, third = self._normal()
        made, z = own.copy(), np.maximum(own[..., third], np.float32(FLATTEST))
        x, y = own[..., first] / z, own[..., second] / z
        made[..., first], made[..., second], made[..., third] = cosine * x - sine * y, sine * x + cosine * y, 1
        return made

    def _with_normals(self, blended: np.ndarray) -> np.ndarray:
        if len(self._normal()) == 3:
            vectors = blended[..., self._normal()]
            blended[..., self._normal()] = vectors / np.sqrt(np.square(vectors).sum(axis=-1, keepdims=True))
        return blended
