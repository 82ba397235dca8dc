"""By-example noise in Python: what the shaders compute, the reference that they are tested with."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float32

from texloom.stages.synthesis.endless.decorrelation import MapBasis
from texloom.stages.synthesis.endless.mip_levels import bands_of, pyramid_of, texels
from texloom.stages.synthesis.endless.triangle_grid import sharpened, shifts_of, tiles_at
from texloom.stages.vocabulary.arrays import Channels

PAGE = 4
"""components in a picture"""

Components = Annotated[Float32[np.ndarray, "h w 4"], Channels(("R", "G", "B", "A"))]
"""four components of a Gaussian texture"""
Tables = Annotated[Float32[np.ndarray, "rows entries 4"], Channels(("R", "G", "B", "A"))]
"""one row a level of detail, for four components; then the rows of the next four"""


@dataclasses.dataclass(frozen=True)
class Noise:
    """A Gaussian texture with its tables, see `texloom.stages.synthesis.endless.gaussian_texture`."""

    pyramid: list[Float32[np.ndarray, "_ _ n"]]
    """levels of detail of the components, each half as large"""
    inverse: Tables
    layout: Mapping[str, Any]

    @staticmethod
    def of(pages: Sequence[Components | None], inverse: Tables, layout: Mapping[str, Any]) -> Noise:
        """From the outputs of the stage."""
        components = np.concatenate([page for page in pages if page is not None], axis=2)
        return Noise(pyramid_of(components), inverse, layout)

    def maps(
        self, rows: Float32[np.ndarray, "H W"], columns: Float32[np.ndarray, "H W"], level: float = 0.0
    ) -> dict[str, Float32[np.ndarray, "H W c"]]:
        """The maps at places of the plane, by name: linear light, normals, values.

        Parameters
        ----------
        rows, columns : px of the texture; whole numbers are centres of pixels.
        level : of detail, 0 and more; between two whole ones their mean, as trilinear filtering has it.
        """
        parts = [self._band(*band, level) for band in bands_of(rows, columns)]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def _band(self, rows: np.ndarray, columns: np.ndarray, level: float) -> dict[str, np.ndarray]:
        blended = self.gaussian(rows, columns, level)
        low, span = (np.array(self.layout[name], np.float32) for name in ("low", "span"))
        components = self._looked_up(blended, level)[..., : len(low)] * span + low
        made, first = {}, 0
        for record in self.layout["maps"]:
            basis = MapBasis.of(record)
            made[basis.name] = basis.values(components[..., first : first + basis.count])
            first += basis.count
        return made

    def gaussian(
        self, rows: Float32[np.ndarray, "H W"], columns: Float32[np.ndarray, "H W"], level: float = 0.0
    ) -> Float32[np.ndarray, "H W n"]:
        """The Gaussian values of the three tiles of each place, blended so that their variance is kept."""
        vertices, weights = tiles_at(rows, columns, self.layout["spacing"])
        weights = sharpened(weights, self.layout["sharpness"])
        down, across = shifts_of(vertices, self.pyramid[0].shape[:2])
        total = np.zeros((*rows.shape, self.pyramid[0].shape[2]), np.float32)
        for tile in range(3):
            found = texels(
                self.pyramid, rows + down[tile].astype(np.float32), columns + across[tile].astype(np.float32), level
            )
            total += weights[tile][..., None] * (found - np.float32(0.5))
        return np.asarray(total / np.sqrt(np.square(weights).sum(axis=0))[..., None] + np.float32(0.5))

    def _looked_up(self, values: np.ndarray, level: float) -> np.ndarray:
        """The tables at Gaussian ``values``."""
        levels, entries = self.layout["levels"], self.layout["entries"]
        level = min(max(level, 0.0), levels - 1.0)
        lower = int(level)
        upper, between = min(lower + 1, levels - 1), np.float32(level - lower)
        places = np.clip(values, 0, 1) * np.float32(entries - 1)
        left = np.minimum(places.astype(np.int64), entries - 2)
        part = places - left
        made = np.empty_like(values)
        for page in range(values.shape[2] // PAGE):
            for channel in range(PAGE):
                own = page * PAGE + channel
                table = self.inverse[page * levels + lower, :, channel]
                if between:
                    above = self.inverse[page * levels + upper, :, channel]
                    table = table + between * (above - table)
                first = table[left[..., own]]
                made[..., own] = first + part[..., own] * (table[left[..., own] + 1] - first)
        return made
