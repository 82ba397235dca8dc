"""What an exemplar shows in the cells of its lattice: those that fit to each other, with joints of one tone."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.synthesis.near_regular.lattice_tiles import Window
from texloom.stages.synthesis.near_regular.tile_set import TileSource
from texloom.stages.vocabulary.normals import NORMAL

_MARGIN = 4  # px around a window, for levels of detail

_NEAR = 0.06  # of the shorter generator: distance from the outline within which tone is measured
_SPREAD = 1 / 8  # of the same, over which it is averaged
_FADE = 0.3  # of the same: depth to which tone is changed
_FAR = 2.5  # times the median difference from the other cells around joints: cells beyond are left out
_ALIKE = 0.5  # of the variance between cells inside them, up to which cells are alike
_END = 0.15  # of the same: around ends of runs, which are compared
_LEAST = 0.05  # band, as a share of the shorter generator
_NARROWEST = 1.5  # px


def box_of(around: Window) -> tuple[Int64[np.ndarray, "2"], Int64[np.ndarray, "2"]]:
    """Offset of the first pixel of a box around a window from its point of the lattice, and the box's shape."""
    first = around.offsets.min(axis=0) - _MARGIN - 1
    return first, around.offsets.max(axis=0) + _MARGIN + 2 - first


@dataclasses.dataclass(frozen=True)
class CellContents:
    """Boxes around the cells of an exemplar."""

    pixels: Float32[np.ndarray, "k m n c"]
    """all channels of the image"""
    features: Float32[np.ndarray, "k m n f"]
    depth: Float32[np.ndarray, "m n"]
    """distance from the outline, px, negative outside"""
    first: Int64[np.ndarray, "2"]
    """offset of the first pixel of a box from its point of the lattice"""
    short: float
    """length of the shorter generator, px"""

    @staticmethod
    def of(source: TileSource, around: Window, corners: Int64[np.ndarray, "k 2"], short: float) -> "CellContents":
        """Of the cells with points at ``corners``; beyond the picture boxes show its border."""
        first, shape = box_of(around)
        depth = np.full(shape, -around.band, np.float32)
        depth[tuple((around.offsets - first).T)] = around.depth
        places = corners[:, None, None] + np.moveaxis(np.indices(shape), 0, -1) + first
        at = np.clip(places, 0, np.array(source.valid.shape) - 1)
        values = source.pixels[at[..., 0], at[..., 1]]
        count = values.shape[3] - source.features.shape[2]
        return CellContents(values[..., :count], values[..., count:], depth, first, short)

    def cropped(self, first: Int64[np.ndarray, "2"], shape: tuple[int, ...]) -> "CellContents":
        """Boxes of a smaller window, that begins ``first`` px from the point of the lattice, with a margin."""
        top, left = (first - _MARGIN - self.first).tolist()
        part = np.s_[top : top + shape[0] + 2 * _MARGIN, left : left + shape[1] + 2 * _MARGIN]
        return CellContents(
            self.pixels[:, *part], self.features[:, *part], self.depth[part], first - _MARGIN, self.short
        )

    def fitting(self, most: int) -> "CellContents":
        """Without the cells that differ most from the others around their joints, sorted by lightness."""
        ring = np.abs(self.depth) < max(2.0, _NEAR * self.short)
        values = self.features[:, ring].astype(np.float64)
        away = np.square(values - np.median(values, axis=0)).mean(axis=(1, 2))
        kept = np.flatnonzero(away <= _FAR * np.median(away))
        kept = kept[np.argsort(away[kept], kind="stable")[:most]]
        tone = self.features[kept][:, self.depth > 0, 0].mean(axis=1)
        kept = kept[np.argsort(tone, kind="stable")]
        return dataclasses.replace(self, pixels=self.pixels[kept], features=self.features[kept])

    @property
    def alike(self) -> float:
        """Share of their variance that all cells have in common, 0 to 1; about 0 where the lattice is none."""
        return self._alike(self.depth > 0)

    def alike_at_ends(self, base: Float64[np.ndarray, "2"]) -> float:
        """The same of their ends along ``base``, where joints of runs are, px."""
        length = float(np.hypot(*base))
        places = np.moveaxis(np.indices(self.depth.shape), 0, -1) + self.first
        along = matrix_product(places.astype(np.float64), base / length)
        end = np.minimum(np.abs(along), np.abs(along - length)) < _END * self.short
        return self._alike(end & (self.depth > -_END * self.short))

    def _alike(self, where: Bool[np.ndarray, "m n"]) -> float:
        inside = self.features[:, where].astype(np.float64)
        own = float(inside.var(axis=0, ddof=1).sum(axis=1).mean())
        mean = float(inside.mean(axis=0).var(axis=0).sum())
        common = mean - own / len(inside)  # the mean of unlike cells varies too
        return max(0.0, common / max(common + own, 1e-9))

    def with_even_joints(self, channels: tuple[str, ...]) -> "CellContents":
        """With the same slow tone around all joints, which fades to that of each cell inside.

        Else neighbours would differ by it. Normals stay as they are.
        """
        ring = np.square(np.clip(1 - np.abs(self.depth) / (2 * _NEAR * self.short), 0, 1)).astype(np.float32)
        fade = np.clip(1 - self.depth / (_FADE * self.short), 0, 1)
        weight = fade * fade * (3 - 2 * fade) / (gaussian_blur(ring, _SPREAD * self.short) + np.float32(1e-6))

        def even(planes: Float32[np.ndarray, "k m n"]) -> Float32[np.ndarray, "k m n"]:
            away = (planes - planes.mean(axis=0)) * ring
            return np.asarray(
                planes - weight * np.stack([gaussian_blur(one, _SPREAD * self.short) for one in away])
            )

        pixels, features = self.pixels.copy(), self.features.copy()
        for index, name in enumerate(channels):
            if index < (1 if channels[0] == "Y" else 3):
                encoded = even(np.sqrt(np.maximum(pixels[..., index], 0)))
                pixels[..., index] = np.square(np.maximum(encoded, 0))
            elif name not in NORMAL:
                pixels[..., index] = even(pixels[..., index])
        for index in range(features.shape[3]):
            features[..., index] = even(features[..., index])
        return dataclasses.replace(self, pixels=pixels, features=features)

    def band(self, widest: float) -> float:
        """Half the width of the zone around joints in which cells are alike, and may be blended, px."""
        variance = self.features.var(axis=0, dtype=np.float64).sum(axis=2)
        inside = self.depth > widest
        limit = _ALIKE * float(np.median(variance[inside] if inside.any() else variance))
        away = np.abs(self.depth)
        count = 0
        while count < widest and _mean(variance, (away >= count) & (away < count + 1)) <= limit:
            count += 1
        return float(np.clip(count, max(_NARROWEST, _LEAST * self.short), widest))


def _mean(values: Float64[np.ndarray, "m n"], where: Bool[np.ndarray, "m n"]) -> float:
    return float(values[where].mean()) if where.any() else np.inf
