"""Features from the maps of an exemplar other than colour, such as normals and height."""

import difflib
from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.numerics.matrices import eigenvectors
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.masks import EXCLUSION_CHANNELS

MapWeights = Annotated[
    dict[str, Annotated[float, Field(ge=0, le=100)]],
    Field(
        description="weight of each map besides colour, by the name of the map or of one of its channels, as in "
        "{normal: 2, height: 0}; 1 if not given: all maps together then count as much as colour; 0 ignores a map"
    ),
]

MIN_SPREAD = 5.0
"""minimum spread of colour to which maps are scaled, CIELAB units"""

_MIN_VARIATION = 0.01  # of a map, as a share of its largest value; smaller variation is rounding
_KEPT_VARIANCE = 0.98  # share of the maps' variance that the components keep


def map_channels(channels: Sequence[str]) -> dict[str, list[int]]:
    """Channel indices of each map other than colour; channels such as ``normal.X`` belong to the map ``normal``."""
    maps: dict[str, list[int]] = {}
    first = 1 if channels[0] == "Y" else 3
    for index, name in enumerate(channels):
        if index >= first and name not in EXCLUSION_CHANNELS:
            maps.setdefault(name.partition(".")[0], []).append(index)
    return maps


def check_weights(weights: Mapping[str, float], channels: Sequence[str]) -> None:
    """`InputError` unless every weight names a map or one of its channels."""
    maps = map_channels(channels)
    names = [*maps, *(channels[index] for planes in maps.values() for index in planes)]
    for name in weights:
        if name not in names:
            has = f"has {', '.join(dict.fromkeys(names))}" if names else "has none but colour"
            close = difflib.get_close_matches(name, names, n=1)
            hint = f"; did you mean '{close[0]}'?" if close else ""
            raise InputError(f"weights: no map '{name}'; the image {has}{hint}")


def map_features(
    image: Image, spread: float, weights: Mapping[str, float], valid: Mask | None, max_components: int = 5
) -> Float32[np.ndarray, "h w k"]:
    """The principal components of all maps, scaled to be compared with colour.

    The maps are scaled so that their total variance is that of colour, and then weighted. Maps that vary by less
    than 1 % of their largest value are omitted, as are components beyond 98 % of the variance, so that correlated
    maps cost no more than one.

    Parameters
    ----------
    spread : root of the summed variances of the colour's channels, CIELAB units.
    weights : factor by name of map or channel; 1 if there is none, 0 leaves the map out, as if it did not exist.
    valid : pixels that count for means and variances; None counts all.
    max_components : maximum number of planes.
    """
    maps = {}
    for name, indices in map_channels(image.channels).items():
        own = [image.pixels[..., index] for index in indices]
        means = [plane.mean(dtype=np.float64) for plane in _counted(own, valid)]
        centred = [plane - np.float32(mean) for plane, mean in zip(own, means, strict=True)]
        deviation = np.sqrt(sum(_mean_product(plane, plane) for plane in _counted(centred, valid)))
        factors = [weights.get(image.channels[index], weights.get(name, 1.0)) for index in indices]
        varies = deviation > _MIN_VARIATION * max(float(np.abs(plane).max()) for plane in own)
        if varies and any(factor > 0 for factor in factors):  # else it would change what the others count
            maps[name] = (factors, centred, deviation)
    planes = []
    for factors, centred, deviation in maps.values():
        scale = max(spread, MIN_SPREAD) / np.sqrt(len(maps)) / deviation
        for factor, plane in zip(factors, centred, strict=True):
            if factor > 0:
                planes.append(plane * np.float32(scale * factor))
    if not planes:
        return np.zeros((image.height, image.width, 0), np.float32)
    basis = _components(_counted(planes, valid), max_components)
    # Summed plane by plane, since the order in a matrix product depends on the machine.
    components = [
        sum(plane * np.float32(share) for plane, share in zip(planes, axis, strict=True)) for axis in basis
    ]
    return np.stack(components, axis=2).astype(np.float32)


def _counted(planes: list[np.ndarray], valid: Mask | None) -> list[np.ndarray]:
    return planes if valid is None else [plane[valid] for plane in planes]


def _mean_product(first: np.ndarray, second: np.ndarray) -> float:
    return float((first.astype(np.float64) * second).mean())


def _components(planes: list[np.ndarray], max_components: int) -> np.ndarray:
    """Principal axes of ``planes``, one a row."""
    covariance = np.array([[_mean_product(first, second) for second in planes] for first in planes])
    values, vectors = eigenvectors(covariance)
    shares = np.cumsum(values[::-1]) / values.sum()
    count = min(max_components, int(np.searchsorted(shares, _KEPT_VARIANCE)) + 1)
    axes = vectors[:, ::-1][:, :count].T
    # The sign of an axis is arbitrary; its largest component is made positive.
    signs = np.sign(np.take_along_axis(axes, np.abs(axes).argmax(axis=1)[:, None], axis=1))
    return np.asarray(axes * signs)
