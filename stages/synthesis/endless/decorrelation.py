"""Maps of a material as components that do not correlate, and back."""

from __future__ import annotations

import dataclasses
import logging
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.common.features.maps import map_channels
from texloom.stages.numerics.matrices import eigenvectors, matrix_product
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import EXCLUSION_CHANNELS, fill_excluded
from texloom.stages.vocabulary.normals import NORMAL

Kind: TypeAlias = Literal["color", "slopes", "values"]
Planes: TypeAlias = Float32[np.ndarray, "h w c"]
AveragedMap: TypeAlias = tuple[str, tuple[str, ...], Kind, Float32[np.ndarray, "_ _ _"]]
"""name, channels, kind, and values whose averages make sense"""

_STEEPEST = 0.05  # least z of a normal, from which slopes are clipped
_LOG = logging.getLogger(__name__)


@dataclasses.dataclass(frozen=True)
class MapBasis:
    """One map of a material: an affine map to components whose covariance is 0."""

    name: str
    channels: tuple[str, ...]
    """of the image"""
    kind: Kind
    """``color`` is encoded by its square root, ``slopes`` are x / z and y / z of normals"""
    mean: tuple[float, ...]
    axes: tuple[tuple[float, ...], ...]
    """an axis of unit length a row, of the largest variance first"""

    @property
    def count(self) -> int:
        """Components."""
        return len(self.axes)

    def components(self, values: Planes) -> Float64[np.ndarray, "h w k"]:
        """Of averaged ``values``: linear light, slopes, values."""
        encoded = np.sqrt(np.maximum(values, 0)) if self.kind == "color" else values
        centred = encoded.astype(np.float64) - np.array(self.mean)
        return np.asarray(matrix_product(centred, np.array(self.axes).T))

    def values(self, components: Float32[np.ndarray, "*n k"]) -> Float32[np.ndarray, "*n c"]:
        """Channels of the image from components: linear light, normals of unit length, values."""
        axes, mean = np.array(self.axes, np.float32), np.array(self.mean, np.float32)
        encoded = mean + sum(components[..., k, None] * axes[k] for k in range(len(axes)))
        if self.kind == "color":
            return np.asarray(np.square(np.maximum(encoded, np.float32(0))))
        if self.kind == "slopes":
            vectors = np.concatenate([encoded, np.ones_like(encoded[..., :1])], axis=-1)
            lengths = np.sqrt(np.square(vectors).sum(axis=-1, keepdims=True, dtype=np.float32))
            return np.asarray(vectors / lengths)
        return np.asarray(encoded)

    def record(self) -> dict[str, Any]:
        """For a table."""
        return {**dataclasses.asdict(self), "channels": list(self.channels), "mean": list(self.mean),
                "axes": [list(axis) for axis in self.axes]}  # fmt: skip

    @staticmethod
    def of(record: dict[str, Any]) -> MapBasis:
        """From its `record`."""
        axes = tuple(tuple(axis) for axis in record["axes"])
        return MapBasis(record["name"], tuple(record["channels"]), record["kind"], tuple(record["mean"]), axes)


def averageable(image: Image) -> list[AveragedMap]:
    """The maps of an image as values whose averages make sense: name, channels, kind and values, colour first.

    Alpha and exclusion are left out; excluded pixels have the values of the nearest others.
    """
    whole = fill_excluded(image)
    count = 1 if image.channels[0] == "Y" else 3
    maps: list[AveragedMap] = [("color", image.channels[:count], "color", whole.pixels[..., :count])]
    for name, own in map_channels(image.channels).items():
        channels, values = tuple(image.channels[index] for index in own), whole.pixels[..., own]
        if channels == NORMAL:
            z = values[..., 2:]
            if steep := float((z < _STEEPEST).mean()):
                _LOG.warning(
                    "%s: %.2g %% of the normals are steeper than 87 degrees, and clipped", name, 100 * steep
                )
            maps.append((name, channels, "slopes", values[..., :2] / np.maximum(z, np.float32(_STEEPEST))))
        else:
            maps.append((name, channels, "values", values))
    if left_out := [name for name in image.channels if name in EXCLUSION_CHANNELS]:
        _LOG.warning("%s: left out", ", ".join(left_out))
    return maps


def basis_of(name: str, channels: tuple[str, ...], kind: Kind, values: Planes) -> MapBasis:
    """The principal axes of a map.

    References
    ----------
    [DeliotHeitz2019]_ section 1.4, which decorrelates colour so; other maps of several channels alike. Colour is
    encoded, since hues of dark pixels spread little in linear light, and blending would mix them with light ones.
    """
    encoded = (np.sqrt(np.maximum(values, 0)) if kind == "color" else values).astype(np.float64)
    mean = encoded.mean(axis=(0, 1))
    centred = (encoded - mean).reshape(-1, encoded.shape[2])
    covariance = np.einsum("ni,nj->ij", centred, centred) / len(centred)
    axes = eigenvectors(covariance)[1][:, ::-1].T
    # the sign of an axis is arbitrary; its largest part is made positive
    axes = axes * np.sign(np.take_along_axis(axes, np.abs(axes).argmax(axis=1)[:, None], axis=1))
    rounded = [tuple(float(np.float32(one)) for one in axis) for axis in axes]
    return MapBasis(name, channels, kind, tuple(float(np.float32(one)) for one in mean), tuple(rounded))
