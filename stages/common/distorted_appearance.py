"""Appearance vectors and similarity sets of a distorted level; see `texloom.stages.common.appearance`."""

from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int32

from texloom.stages.arrays import Jacobian, Mask
from texloom.stages.common.appearance import (
    BASIS_LENGTH,
    COMPONENTS,
    MAX_LENGTH,
    Analysis,
    Appearance,
    Candidates,
    similar_sets,
)
from texloom.stages.common.components import components
from texloom.stages.kernels.core.threads import run_all, run_spans, spans, thread_count
from texloom.stages.masks import nearest_valid

Neighbourhoods: TypeAlias = tuple[Appearance, Mask]
"""a level's neighbourhoods by their principal components, and which of them are whole"""

_BLOCKS = 4  # per step: one pixel of each block is described and represents the others
_LEAST_STRETCH = 0.7  # px per element, of pixels that are sharp at every level

_SAMPLE_SIZE = 5_000  # windows from which the components are computed
_MAX_SEARCHED = 2**14  # whole neighbourhoods that may replace an incomplete one
_MAX_DENSE = 2**18  # whole places; with more, candidates are searched at every second pixel at least
_MAX_QUERIED = 2**14  # places to be replaced; with more, every second pixel
_INEXACT = 0.25  # excess of the distance of a replacement, as a share
_REACH = 4.0  # steps, px, that a place is carried from a whole one
_PIECES = 32


def block_side(level: int, jacobian: Jacobian, used: Mask) -> int:
    """Side, px, of blocks of which one pixel is described; less where ``used`` pixels hold several elements."""
    if 2**level < 2 * _BLOCKS:
        return 1
    a, b, c, d = (entry.astype(np.float64) for entry in jacobian[used].T)
    half = (a * a + b * b + c * c + d * d) / 2
    least = np.sqrt(np.min(half - np.sqrt(np.maximum(half**2 - (a * d - b * c) ** 2, 0)), initial=1))
    return max(1, int(2**level * min(1.0, least / _LEAST_STRETCH)) // _BLOCKS)


def whole_count(valid: Mask, level: int, jacobian: Jacobian) -> float:
    """Approximate number of pixels whose neighbourhoods are valid."""
    every = max(1, int(np.sqrt(np.count_nonzero(valid) / _SAMPLE_SIZE)))
    return float(np.count_nonzero(_whole_windows(valid, level, jacobian, 3, every))) * every**2


def _whole_windows(valid: Mask, level: int, jacobian: Jacobian, reach: int, every: int) -> Bool[np.ndarray, "p q"]:
    from texloom.stages.kernels.distortion.windows import whole_windows

    whole = np.zeros((-(-valid.shape[0] // every), -(-valid.shape[1] // every)), np.bool_)
    shared = (valid, jacobian, 2.0**level, reach, every, whole)
    run_spans(whole_windows, shared, len(whole), _PIECES)
    return whole


def analyse(
    planes: Float32[np.ndarray, "h w c"],
    known: Mask,
    sharp: Mask,
    level: int,
    jacobian: Jacobian,
    k: int,
    min_separation: int,
    coarser: Neighbourhoods | None = None,
) -> tuple[Analysis, Neighbourhoods] | None:
    """Appearance, basis and similarity sets, and the neighbourhoods; None where no neighbourhood is whole.

    Parameters
    ----------
    known : the pixels that may be read; those are described from which sharp ones can be reached, others are zeros.
    sharp : those of them that may be used at this level.
    min_separation : minimum distance between the members of a set, px.
    coarser : those of the next coarser level, by which incomplete ones are replaced: places that are not sharp here
        are sharp there.
    """
    from texloom.stages.kernels.distortion.windows import describe_neighbourhoods, gather_neighbours

    step, every = 2.0**level, block_side(level, jacobian, sharp)
    rows = spans(-(-len(known) // every), _PIECES)
    described = known & _near(sharp, level, jacobian)
    appearance, seen = _appearances(planes, known, sharp, described, level, jacobian, every)
    places = _sample(seen)
    if not places.size:
        return None
    around = np.empty((places.size, 8 * COMPONENTS), np.int16)
    gather_neighbours(appearance, jacobian, places, step, around)
    basis = np.rint(components(around, COMPONENTS)[1] * BASIS_LENGTH).astype(np.int16)
    vectors, whole = np.zeros_like(appearance), np.zeros_like(known)
    shared = (appearance, seen, jacobian, described, step, basis, every, vectors, whole)
    run_all(describe_neighbourhoods, [(*shared, *span) for span in rows])
    if not whole.any():
        return None
    own = vectors, whole
    replacements = _replacements(own, coarser, known, sharp, level, jacobian, every)
    candidates = _similar(own, replacements, level, jacobian, k, min_separation)
    return (appearance, basis, candidates), own


def _sample(complete: Mask) -> np.ndarray:
    """Evenly spaced places of ``complete``."""
    places = np.flatnonzero(complete)
    return places[:: max(1, places.size // _SAMPLE_SIZE)]


def _near(sharp: Mask, level: int, jacobian: Jacobian) -> Mask:
    """The pixels that a place carried from a sharp one may meet, and their neighbours a step away."""
    import cv2

    widest = float(np.sqrt(np.square(jacobian[sharp]).sum(axis=1).max(initial=0)))
    distance = cv2.distanceTransform((~sharp).astype(np.uint8), cv2.DIST_L2, 3)
    return np.asarray(distance <= (_REACH + widest) * 2**level)


def _appearances(
    planes: Float32[np.ndarray, "h w c"],
    known: Mask,
    sharp: Mask,
    described: Mask,
    level: int,
    jacobian: Jacobian,
    every: int,
) -> tuple[Appearance, Mask]:
    """Appearances of the described pixels, and the pixels whose windows are whole."""
    from texloom.stages.kernels.distortion.windows import describe_windows, gather_windows

    step = 2.0**level
    min_separation = max(1, int(np.sqrt(np.count_nonzero(sharp) / (4 * _SAMPLE_SIZE))))
    places = np.zeros_like(sharp)
    places[::min_separation, ::min_separation] = _whole_windows(sharp, level, jacobian, 2, min_separation)
    chosen = _sample(places if places.any() else sharp)
    sample = np.empty((chosen.size, 25 * planes.shape[2]), np.float32)
    gather_windows(planes, jacobian, chosen, step, sample)
    mean, basis = components(sample, COMPONENTS)
    centred = sample - mean
    variances = ((centred @ basis) ** 2).mean(axis=0)
    residual = max(float((centred**2).sum(axis=1).mean() - variances.sum()), 0) / sample.shape[1]
    noise = np.clip((residual + 1e-6) / (variances + 1e-6), 1e-4, 1e6)
    projection = np.zeros((*known.shape, COMPONENTS), np.float32)
    seen = np.zeros_like(known)
    middle, axes = mean.astype(np.float32), basis.astype(np.float32)
    shared = (
        planes, jacobian, known, sharp, described, step, middle, axes, noise, every, projection, seen,
    )  # fmt: skip
    run_spans(describe_windows, shared, -(-len(known) // every), _PIECES)
    longest = float(np.sqrt((projection**2).sum(axis=2).max()))
    return np.trunc(projection * np.float32(MAX_LENGTH / max(longest, 1e-6))).astype(np.int16), seen


def _similar(
    compared: Neighbourhoods,
    replacements: Int32[np.ndarray, "h w"],
    level: int,
    jacobian: Jacobian,
    k: int,
    min_separation: int,
) -> Candidates:
    """Similarity sets: each place itself, or its replacement if it is not whole, and the most similar others.

    The others are searched for on a grid of half a step, of two pixels at least where there are many, and followed
    between.
    """
    vectors, whole = compared
    own = np.arange(whole.size).reshape(whole.shape)
    candidates = np.empty((*whole.shape, k), np.int32)
    candidates[..., 0] = np.where(whole, own, replacements)
    if k > 1:
        every = max(2 if np.count_nonzero(whole) > _MAX_DENSE else 1, 2**level // 2)
        grid = np.s_[::every, ::every]
        numbers = own[grid].ravel()
        sets = similar_sets(np.ascontiguousarray(vectors[grid]), whole[grid], k, max(1, min_separation // every))
        for which in range(1, k):
            targets = np.where(whole[grid], numbers[sets[:, which]].reshape(whole[grid].shape), -1)
            others = _followed(targets, every, whole, jacobian)
            candidates[..., which] = np.where(others < 0, own, others)
        # Incomplete places share the candidates of their replacements.
        candidates[~whole, 1:] = candidates.reshape(-1, k)[candidates[~whole, 0], 1:]
    return candidates


def _replacements(
    own: Neighbourhoods,
    coarser: Neighbourhoods | None,
    known: Mask,
    sharp: Mask,
    level: int,
    jacobian: Jacobian,
    every: int,
) -> Int32[np.ndarray, "h w"]:
    """The whole place most similar to every known place that is not whole and may be reached from one that is.

    Others have that of the nearest. Places that are not sharp enough at this level are compared at the coarser one.
    """
    from scipy.ndimage import distance_transform_edt
    from scipy.spatial import KDTree

    whole = own[1]
    begun = whole if coarser is None else whole | coarser[1]
    reached = known & (distance_transform_edt(~begun) < _REACH * 2**level)
    every = max(every, 2 if np.count_nonzero(reached & ~whole) > _MAX_QUERIED else 1)
    grid = np.s_[::every, ::every]
    targets = np.arange(whole.size).reshape(whole.shape)[grid]
    missing = (reached & ~whole)[grid]
    if coarser is not None and (whole & coarser[1]).any():
        parts = [(own, missing & sharp[grid]), (coarser, missing & ~sharp[grid])]
    else:
        parts = [(own, missing)]
    for (vectors, also), queried in parts:
        searched = np.flatnonzero(whole & also)
        searched = searched[:: max(1, searched.size // _MAX_SEARCHED)]
        if queried.any():
            tree = KDTree(vectors.reshape(-1, COMPONENTS)[searched])
            targets[queried] = searched[tree.query(vectors[grid][queried], eps=_INEXACT, workers=thread_count())[1]]
    row, column = nearest_valid((whole | reached)[grid])
    return _followed(targets[row, column], every, whole, jacobian)


def _followed(targets: np.ndarray, every: int, whole: Mask, jacobian: Jacobian) -> Int32[np.ndarray, "h w"]:
    """Targets of all pixels, continued from those of a grid along the texture."""
    from texloom.stages.kernels.distortion.windows import follow

    out = np.empty(whole.shape, np.int32)
    shared = (np.ascontiguousarray(targets, np.int64), every, whole, jacobian, out)
    run_spans(follow, shared, len(out), _PIECES)
    return out
