"""What the maps of an exemplar besides its colour add to what patches are compared by."""

import difflib
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float32

from texloom.stages.arrays import Image, Mask
from texloom.stages.declare import InputError
from texloom.stages.masks import USABLE

LEAST_SPREAD = 5.0
"""CIELAB units; colour that varies less does not make maps count less"""

_FLAT = 0.01  # spread of a map as a share of its largest value, below which it holds nothing but rounding
_ENOUGH = 0.98  # share of the maps' variance after which no further component is kept


def map_channels(channels: Sequence[str]) -> dict[str, list[int]]:
    """The planes of each map besides colour; those of one name before the dot, as in ``normal.X``, are one map."""
    found: dict[str, list[int]] = {}
    first = 1 if channels[0] == "Y" else 3
    for index, name in enumerate(channels):
        if index >= first and name not in ("A", USABLE):
            found.setdefault(name.partition(".")[0], []).append(index)
    return found


def check_weights(weights: Mapping[str, float], channels: Sequence[str]) -> None:
    """Every weight must belong to a map, or a channel of one; `InputError` otherwise."""
    maps = map_channels(channels)
    names = [*maps, *(channels[index] for planes in maps.values() for index in planes)]
    for name in weights:
        if name not in names:
            has = f"has {', '.join(dict.fromkeys(names))}" if names else "has none but colour"
            close = difflib.get_close_matches(name, names, n=1)
            hint = f"; did you mean '{close[0]}'?" if close else ""
            raise InputError(f"weights: no map '{name}'; the image {has}{hint}")


def map_features(
    image: Image, spread: float, weights: Mapping[str, float], usable: Mask | None, most: int = 5
) -> Float32[np.ndarray, "h w k"]:
    """The principal components of all maps, at most ``most`` planes; squared differences of these weigh them.

    Each map is scaled so that all of them together vary as much as colour does; then come the weights. Maps that
    vary by less than a hundredth of their largest value are left out, and so are components beyond 98 % of the
    variance: maps that go together cost no more than one.

    Parameters
    ----------
    spread : root of the summed variances of the colour's channels, CIELAB units.
    weights : factor by name of map or channel; 1 if there is none, 0 leaves the map out.
    usable : pixels that count for means and variances; none counts all.
    """
    maps = {}
    for name, indices in map_channels(image.channels).items():
        own = [image.pixels[..., index] for index in indices]
        means = [plane.mean(dtype=np.float64) for plane in _counted(own, usable)]
        centred = [plane - np.float32(mean) for plane, mean in zip(own, means, strict=True)]
        deviation = np.sqrt(sum(_mean_product(plane, plane) for plane in _counted(centred, usable)))
        if deviation > _FLAT * max(float(np.abs(plane).max()) for plane in own):
            maps[name] = (indices, centred, deviation)
    planes = []
    for name, (indices, centred, deviation) in maps.items():
        scale = max(spread, LEAST_SPREAD) / np.sqrt(len(maps)) / deviation
        for index, plane in zip(indices, centred, strict=True):
            factor = weights.get(image.channels[index], weights.get(name, 1.0))
            if factor > 0:
                planes.append(plane * np.float32(scale * factor))
    if not planes:
        return np.zeros((image.height, image.width, 0), np.float32)
    basis = _components(_counted(planes, usable), most)
    # Sums plane by plane, since those of a matrix product depend on the machine.
    found = [sum(plane * np.float32(share) for plane, share in zip(planes, axis, strict=True)) for axis in basis]
    return np.stack(found, axis=2).astype(np.float32)


def _counted(planes: list[np.ndarray], usable: Mask | None) -> list[np.ndarray]:
    return planes if usable is None else [plane[usable] for plane in planes]


def _mean_product(one: np.ndarray, other: np.ndarray) -> float:
    return float((one.astype(np.float64) * other).mean())


def _components(planes: list[np.ndarray], most: int) -> np.ndarray:
    """Orthonormal axes along which ``planes`` vary most, the first most of all, one a row."""
    covariance = np.array([[_mean_product(one, other) for other in planes] for one in planes])
    values, vectors = np.linalg.eigh(covariance)
    shares = np.cumsum(values[::-1]) / values.sum()
    count = min(most, int(np.searchsorted(shares, _ENOUGH)) + 1)
    axes = vectors[:, ::-1][:, :count].T
    # An axis and its opposite are the same; the one with the larger end ahead is taken.
    ahead = np.sign(np.take_along_axis(axes, np.abs(axes).argmax(axis=1)[:, None], axis=1))
    return np.asarray(axes * ahead)
