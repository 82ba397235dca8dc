"""How unlike most others the parts of a picture look, at several scales."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, Float64

from texloom.stages.common.grids.pyramid import resize
from texloom.stages.kernels.core.threads import run_spans
from texloom.stages.numerics.filters import gaussian_blur, gradients
from texloom.stages.numerics.matrices import eigenvectors, row_product, square_sums
from texloom.stages.vocabulary.arrays import Mask, ScalarMap

_PLACES = 2400
_FEW = 16  # places; fewer tell nothing
_MIN_SHOWN = 0.7  # share of a window that the picture shows; others look like the nearest that does
_CORE = 0.5  # share of places whose spread is that of the surface
_PASSES = 6
_EXPLAINED_BY = 0.25  # share of places that look alike where a look belongs to the surface
_APART = 3.0  # deviations of the blur; nearer places show the same
_NOTICED = 1.5  # CIELAB, a deviation below which differences do not count
_LEAST_USUAL = 0.25  # of a unit: what is less does not show, however even a surface is
_PIECES = 16  # of work that threads share
_STEEP = 0.5  # weight of gradients against colours


def unlikeness(
    lab: Float32[np.ndarray, "h w 3"],
    valid: Mask,
    deviation: float,
    foreign: Mask | None = None,
    places: int = _PLACES,
) -> ScalarMap:
    """How far the look around each pixel is from those that explain it; 1 is usual, at several it is foreign.

    The look of a place is the mean and the deviation of CIELAB, and the mean steepness down and across, in a
    Gaussian window. The half of the places that are nearest to each other, with the least covariance, is the core;
    distances are in units of the core's spread, so that a wall of many greys has room in grey, and none in red. A
    place is explained by the quarter of all that look most like it, away from it; how far the farthest of these is,
    over what that is in the core, is the result.

    Parameters
    ----------
    valid : where the picture is known; elsewhere the result is 0.
    deviation : of the window, px.
    foreign : what is known not to explain others.
    places : at most, that are compared with each other.

    References
    ----------
    [RousseeuwDriessen1999]_ the determinant of least covariance, here from one start; [Ramaswamy2000]_ distance to
    the k-th neighbour. The looks, and units of the core, are ours.
    """
    rows, known, every = _compared(lab, valid, deviation, places)
    if len(rows) < _FEW:
        return np.zeros(lab.shape[:2], np.float32)
    units, core = _in_units_of_core(rows, _CORE)
    compared = np.argwhere(known).astype(np.int32) * every
    down, across = (np.abs(one[:, None] - one) > _APART * deviation for one in compared.T)
    explains = (down | across) & (True if foreign is None else ~_on_grid(foreign, every)[known])
    distance = np.where(explains, np.sqrt(_squared_distances(units)), np.inf)
    explaining = max(0, round(_EXPLAINED_BY * len(rows)) - 1)
    distance.partition(explaining, axis=1)
    last = distance[:, explaining]
    usual = float(np.median(last[core]))
    if not np.isfinite(usual):  # most places are foreign, and too few are left to explain the others
        return np.zeros(lab.shape[:2], np.float32)
    last = np.where(np.isfinite(last), last, 2 * last[np.isfinite(last)].max(initial=usual))
    values = np.zeros(known.shape, np.float32)
    values[known] = last / max(usual, _LEAST_USUAL)
    return np.where(valid, _between(values, known, every, lab.shape[:2]), np.float32(0))


def unlike_core(
    lab: Float32[np.ndarray, "h w 3"], valid: Mask, deviation: float, share: float, places: int = _PLACES
) -> ScalarMap:
    """How far the look around each pixel is from those of the core, in the spread of which 1 is usual.

    As `unlikeness`, but the core is only a ``share`` of the places, and no others explain any: where a picture
    shows several surfaces, only the one that most places look alike on is near.
    """
    rows, known, every = _compared(lab, valid, deviation, places)
    if len(rows) < _FEW:
        return np.zeros(lab.shape[:2], np.float32)
    units, core = _in_units_of_core(rows, share)
    distance = np.sqrt(_squared_distances(units)[:, core])
    distance.partition(len(core) // 4, axis=1)
    last = distance[:, len(core) // 4]
    values = np.zeros(known.shape, np.float32)
    values[known] = last / max(float(np.median(last[core])), _LEAST_USUAL)
    return np.where(valid, _between(values, known, every, lab.shape[:2]), np.float32(0))


def _compared(
    lab: Float32[np.ndarray, "h w 3"], valid: Mask, deviation: float, places: int
) -> tuple[Float64[np.ndarray, "n k"], Bool[np.ndarray, "p q"], int]:
    """The looks at places on a grid, which of its places are known, and the px from one to the next."""
    looks, shown = _looks(lab, valid, deviation)
    every = max(1, round(deviation))
    while (lab.shape[0] // every) * (lab.shape[1] // every) > places:
        every += 1
    known = _on_grid(valid, every) & (_on_grid(shown, every) >= _MIN_SHOWN)
    return _on_grid(looks, every)[known].astype(np.float64), known, every


def _on_grid(plane: np.ndarray, every: int) -> np.ndarray:
    return plane[every // 2 :: every, every // 2 :: every]


def _looks(
    lab: Float32[np.ndarray, "h w 3"], valid: Mask, deviation: float
) -> tuple[Float32[np.ndarray, "h w 8"], ScalarMap]:
    """What it looks like around each pixel, and which share of that is known."""
    counted = valid.astype(np.float32)
    shown = np.maximum(gaussian_blur(counted, deviation, "zero"), np.float32(1e-6))
    steep = [np.abs(plane) * np.float32(_STEEP) for plane in gradients(lab[..., 0], (1, 2, 1))]
    planes = np.concatenate([lab, np.square(lab), np.stack(steep, axis=2)], axis=2)
    means = gaussian_blur(planes * counted[..., None], deviation, "zero") / shown[..., None]
    means[..., 3:6] = np.sqrt(np.maximum(means[..., 3:6] - np.square(means[..., :3]), 0))
    return means, shown


def _in_units_of_core(
    rows: Float64[np.ndarray, "n k"], share: float
) -> tuple[Float64[np.ndarray, "n k"], np.ndarray]:
    """The places along the principal axes of the core, in its deviations, and which are the core."""
    size = max(2, round(share * len(rows)))
    squared = _squared_distances(rows)
    start = int(np.partition(squared, size - 1, axis=1)[:, size - 1].argmin())
    core = np.argsort(squared[start], kind="stable")[:size]
    units = rows
    for _ in range(_PASSES):
        mean = rows[core].mean(axis=0)
        values, vectors = eigenvectors(square_sums(rows[core] - mean) / len(core))
        units = row_product(rows - mean, vectors) / np.sqrt(np.maximum(values, 0) + _NOTICED**2)
        core = np.argsort(np.square(units).sum(axis=1), kind="stable")[:size]
    return units, core


def _squared_distances(rows: Float64[np.ndarray, "n k"]) -> Float64[np.ndarray, "n n"]:
    from texloom.stages.kernels.core.squared_distances import squared_distances

    out = np.empty((len(rows), len(rows)))
    run_spans(squared_distances, (np.ascontiguousarray(rows.T), out), len(rows), _PIECES)
    return out


def _between(
    values: Float32[np.ndarray, "p q"], known: Bool[np.ndarray, "p q"], every: int, shape: tuple[int, int]
) -> ScalarMap:
    """Of places on a grid, of every pixel: linearly, with that of the nearest for those not known."""
    places, others = np.argwhere(known), np.argwhere(~known)
    apart = np.square(others[:, None] - places[None]).sum(axis=2)  # at most `_PLACES` of each
    values[~known] = values[known][apart.argmin(axis=1)]
    wide = resize(values[..., None], values.shape[0] * every, values.shape[1] * every, bilinear=True)
    rest = [(0, max(0, length - have)) for length, have in zip(shape, wide.shape[:2], strict=True)]
    return np.asarray(np.pad(wide[..., 0], rest, "edge")[: shape[0], : shape[1]], np.float32)
