"""Histograms of an exemplar, and an exemplar with those between its own and those of another one."""

import dataclasses
from typing import TypeAlias

import numpy as np
from jaxtyping import Float32

from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import row_product
from texloom.stages.vocabulary.arrays import Mask

_SCALES = (1.0, 2.0, 4.0, 8.0, 16.0)  # px, deviations of the blurs between which bands lie
_PASSES = 3
_TURNS = 8  # of the axes of colour, a pass
_LEVELS = 512  # of a histogram
_ENTRIES = 4096  # of the table by which values are moved
_SAMPLE = 2**16  # pixels of which one is made
_FLAT = 0.05  # CIELAB units; what spreads less is moved as a whole

Quantiles: TypeAlias = np.ndarray
"""(q,) float32, in rising order"""
Planes: TypeAlias = Float32[np.ndarray, "h w 3"]


@dataclasses.dataclass(frozen=True)
class Statistics:
    """Histograms of an exemplar: of bands of frequencies, of what is left of them, and of colours."""

    bands: tuple[tuple[Quantiles, ...], ...]
    """of each band the quantiles of L, a and b"""
    mean: np.ndarray
    """(3,) of the lowest frequencies, as their deviation"""
    spread: np.ndarray
    colors: tuple[tuple[Quantiles, ...], ...]
    """along the axes of each turn"""

    @staticmethod
    def of(lab: Planes, valid: Mask) -> "Statistics":
        """Of CIELAB values, those of valid pixels."""
        bands, rest = _bands(lab)
        return Statistics(
            tuple(_histograms(band, valid) for band in bands),
            rest[valid].mean(axis=0, dtype=np.float64),
            rest[valid].std(axis=0, dtype=np.float64),
            tuple(_histograms(_turned(lab, turn), valid) for turn in _turns()),
        )

    def towards(self, other: "Statistics", share: float) -> "Statistics":
        """The statistics a ``share`` of the way to the other ones: barycentres, by optimal transport."""

        def between(one: np.ndarray, two: np.ndarray) -> np.ndarray:
            return np.asarray((1 - share) * one + share * two, one.dtype)

        def all_between(one: tuple[Quantiles, ...], two: tuple[Quantiles, ...]) -> tuple[Quantiles, ...]:
            return tuple(map(between, one, two))

        return Statistics(
            tuple(map(all_between, self.bands, other.bands)),
            between(self.mean, other.mean),
            between(self.spread, other.spread),
            tuple(map(all_between, self.colors, other.colors)),
        )


def with_statistics(lab: Planes, valid: Mask, wanted: Statistics) -> Planes:
    """An exemplar whose bands and colours are distributed as wanted, and whose structure stays.

    Its bands are moved to the wanted histograms, one by one, which keeps the order of their values, then its
    colours along turned axes; a few times, as each changes the others a little.

    References
    ----------
    [HeegerBergen1995]_ for histograms of bands and of pixels in turn, here from an exemplar and not from noise;
    [Rabin2012]_ for barycentres of textures by sliced optimal transport.
    """
    turns = _turns()
    for _ in range(_PASSES):
        bands, rest = _bands(lab)
        found = _histograms(rest, valid)  # of L, a and b, for their spread alone
        gain = [
            float(wide / max(own.std(), _FLAT)) if own.std() > _FLAT else 1.0
            for own, wide in zip(found, wanted.spread, strict=True)
        ]
        mean = rest[valid].mean(axis=0, dtype=np.float64)
        lab = ((rest - mean) * np.array(gain) + wanted.mean).astype(np.float32)
        for band, goal in zip(bands, wanted.bands, strict=True):
            lab = lab + _moved(band, valid, goal)
        for turn, goal in zip(turns, wanted.colors, strict=True):
            lab = _turned(_moved(_turned(lab, turn), valid, goal), turn.T)
    return lab


def _bands(lab: Planes) -> tuple[list[Planes], Planes]:
    bands, rest = [], lab
    for scale in _SCALES:
        smooth = gaussian_blur(rest, scale)
        bands.append(rest - smooth)
        rest = smooth
    return bands, rest


def _histograms(planes: Planes, valid: Mask) -> tuple[Quantiles, ...]:
    """Quantiles of each plane, from evenly spaced pixels."""
    known = planes[valid]
    known = np.sort(known[:: -(-len(known) // _SAMPLE)], axis=0)
    at = np.linspace(0, len(known) - 1, _LEVELS).astype(np.int64)
    return tuple(np.ascontiguousarray(known[at, plane]) for plane in range(planes.shape[2]))


def _moved(planes: Planes, valid: Mask, wanted: tuple[Quantiles, ...]) -> Planes:
    own = _histograms(planes, valid)
    moved = [
        _looked_up(planes[..., plane], here, there)
        if here.std() > _FLAT
        else planes[..., plane] + (there.mean() - here.mean())
        for plane, (here, there) in enumerate(zip(own, wanted, strict=True))
    ]
    return np.stack(moved, axis=2).astype(np.float32)


def _looked_up(values: np.ndarray, here: Quantiles, there: Quantiles) -> np.ndarray:
    """`numpy.interp` by a table at even distances, four times as fast."""
    table = np.interp(np.linspace(here[0], here[-1], _ENTRIES), here, there).astype(np.float32)
    at = np.clip((values - here[0]) * ((_ENTRIES - 1) / (here[-1] - here[0])), 0, _ENTRIES - 1)
    left = np.minimum(at.astype(np.int32), _ENTRIES - 2)
    return np.asarray(table[left] + (at - left) * (table[left + 1] - table[left]))


def _turned(planes: Planes, turn: np.ndarray) -> Planes:
    return row_product(planes.reshape(-1, 3), np.ascontiguousarray(turn)).reshape(planes.shape)


def _turns() -> list[np.ndarray]:
    """Rotations of colour, always the same, of which the last is none."""
    turns = []
    for w, x, y, z in np.random.default_rng(0).standard_normal((_TURNS - 1, 4)):
        square = w * w + x * x + y * y + z * z
        rows = [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
        turns.append((np.array(rows) / square).astype(np.float32))
    return [*turns, np.eye(3, dtype=np.float32)]
