"""One level of a distorted exemplar in short vectors of whole numbers; see `texloom.stages.common.appearance`."""

import numpy as np
from jaxtyping import Bool, Float32, Int16, Int32

from texloom.stages.arrays import Jacobian
from texloom.stages.common import appearance as _appearance
from texloom.stages.common.appearance import COMPONENTS, LONGEST, ONE
from texloom.stages.kernels.core.threads import run_all, run_spans, spans, thread_count

BLOCKS = 4
"""of pixels in a step: one pixel of each is looked at, and stands for all"""

_SAMPLE = 5_000  # windows that components are found from
_SEARCHED = 2**12  # whole neighbourhoods that one is looked for among, for those that are not
_MANY = 2**18  # places that are whole; where there are more, others are looked for at every second pixel at least
_BLOCK = 8  # px by steps of a block for which one is looked for
_PIECES = 32


def whole_count(usable: Bool[np.ndarray, "h w"], level: int, jacobian: Jacobian) -> float:
    """How many pixels have neighbourhoods of which all can be used, about."""
    every = max(1, int(np.sqrt(np.count_nonzero(usable) / _SAMPLE)))
    return float(np.count_nonzero(_whole_windows(usable, level, jacobian, 3, every))) * every**2


def _whole_windows(
    usable: Bool[np.ndarray, "h w"], level: int, jacobian: Jacobian, reach: int, every: int
) -> Bool[np.ndarray, "p q"]:
    from texloom.stages.kernels.distortion.windows import whole_windows

    found = np.zeros((-(-usable.shape[0] // every), -(-usable.shape[1] // every)), np.bool_)
    shared = (usable, jacobian, 2.0**level, reach, every, found)
    run_spans(whole_windows, shared, len(found), _PIECES)
    return found


def analyse(
    planes: Float32[np.ndarray, "h w c"],
    known: Bool[np.ndarray, "h w"],
    sharp: Bool[np.ndarray, "h w"],
    level: int,
    jacobian: Jacobian,
    k: int,
    min_separation: int,
) -> tuple[Int16[np.ndarray, "h w 8"], Int16[np.ndarray, "64 8"], Int32[np.ndarray, "h w k"]] | None:
    """Appearance, basis and similarity sets; none where no neighbourhood is whole.

    Parameters
    ----------
    known : the pixels that are described; others are zeros.
    sharp : those among them that neighbourhoods are taken from.
    min_separation : least distance of the places in a set, px.
    """
    from texloom.stages.kernels.distortion.windows import describe_neighbourhoods, gather_neighbours

    step, every = 2.0**level, max(1, 2**level // BLOCKS)
    rows = spans(-(-len(known) // every), _PIECES)
    appearance, seen = _appearances(planes, known, sharp, level, jacobian)
    places = _some(seen)
    if not places.size:
        return None
    around = np.empty((places.size, 8 * COMPONENTS), np.int16)
    gather_neighbours(appearance, jacobian, places, step, around)
    basis = np.rint(_appearance.components(around, COMPONENTS)[1] * ONE).astype(np.int16)
    vectors, whole = np.zeros_like(appearance), np.zeros_like(known)
    shared = (appearance, seen, jacobian, known, step, basis, every, vectors, whole)
    run_all(describe_neighbourhoods, [(*shared, *span) for span in rows])
    if not whole.any():
        return None
    return appearance, basis, _similar(vectors, known, whole, level, jacobian, k, min_separation)


def _some(usable: Bool[np.ndarray, "h w"]) -> np.ndarray:
    """Places that are usable, evenly spaced."""
    places = np.flatnonzero(usable)
    return places[:: max(1, places.size // _SAMPLE)]


def _appearances(
    planes: Float32[np.ndarray, "h w c"],
    known: Bool[np.ndarray, "h w"],
    sharp: Bool[np.ndarray, "h w"],
    level: int,
    jacobian: Jacobian,
) -> tuple[Int16[np.ndarray, "h w 8"], Bool[np.ndarray, "h w"]]:
    """Appearances of the known pixels, and which of their windows are whole."""
    from texloom.stages.kernels.distortion.windows import describe_windows, gather_windows

    step = 2.0**level
    min_separation = max(1, int(np.sqrt(np.count_nonzero(sharp) / (4 * _SAMPLE))))
    places = np.zeros_like(sharp)
    places[::min_separation, ::min_separation] = _whole_windows(sharp, level, jacobian, 2, min_separation)
    chosen = _some(places if places.any() else sharp)
    sample = np.empty((chosen.size, 25 * planes.shape[2]), np.float32)
    gather_windows(planes, jacobian, chosen, step, sample)
    mean, basis = _appearance.components(sample, COMPONENTS)
    centred = sample - mean
    variances = ((centred @ basis) ** 2).mean(axis=0)
    left = max(float((centred**2).sum(axis=1).mean() - variances.sum()), 0) / sample.shape[1]
    doubt = np.clip((left + 1e-6) / (variances + 1e-6), 1e-4, 1e6)
    found = np.zeros((*known.shape, COMPONENTS), np.float32)
    seen = np.zeros_like(known)
    every = max(1, 2**level // BLOCKS)
    middle, axes = mean.astype(np.float32), basis.astype(np.float32)
    shared = (
        planes, jacobian, known, sharp, step, middle, axes, doubt, every, found, seen,
    )  # fmt: skip
    run_spans(describe_windows, shared, -(-len(known) // every), _PIECES)
    longest = float(np.sqrt((found**2).sum(axis=2).max()))
    return np.trunc(found * np.float32(LONGEST / max(longest, 1e-6))).astype(np.int16), seen


def _similar(
    vectors: Int16[np.ndarray, "h w 8"],
    known: Bool[np.ndarray, "h w"],
    whole: Bool[np.ndarray, "h w"],
    level: int,
    jacobian: Jacobian,
    k: int,
    min_separation: int,
) -> Int32[np.ndarray, "h w k"]:
    """For every place itself, or one like it that is whole, and others that look like that.

    Of the others those of every second pixel of a step are looked for, of every second pixel at least where there
    are many, and the rest follow.
    """
    own = np.arange(whole.size).reshape(whole.shape)
    candidates = np.empty((*whole.shape, k), np.int32)
    candidates[..., 0] = np.where(whole, own, _homes(vectors, known, whole, level, jacobian))
    if k > 1:
        every = max(2 if np.count_nonzero(whole) > _MANY else 1, 2**level // 2)
        grid = np.s_[::every, ::every]
        numbers = own[grid].ravel()
        sets = _appearance.similar_sets(
            np.ascontiguousarray(vectors[grid]), whole[grid], k, max(1, min_separation // every)
        )
        for which in range(1, k):
            found = np.where(whole[grid], numbers[sets[:, which]].reshape(whole[grid].shape), -1)
            others = _followed(found, every, whole, jacobian)
            candidates[..., which] = np.where(others < 0, own, others)
        # those that are not whole have the others of their homes
        candidates[~whole, 1:] = candidates.reshape(-1, k)[candidates[~whole, 0], 1:]
    return candidates


def _homes(
    vectors: Int16[np.ndarray, "h w 8"],
    known: Bool[np.ndarray, "h w"],
    whole: Bool[np.ndarray, "h w"],
    level: int,
    jacobian: Jacobian,
) -> Int32[np.ndarray, "h w"]:
    """For every place a whole one: itself, or one that looks like it where it is known, else any."""
    from scipy.spatial import KDTree

    every = _BLOCK * 2**level
    grid = np.s_[::every, ::every]
    inside = np.flatnonzero(whole)
    own = np.arange(whole.size).reshape(whole.shape)[grid]
    # spread by multiplication
    found = inside[own * 2654435761 % 2**32 * inside.size >> 32]
    asked = known[grid] & ~whole[grid]
    searched = inside[:: max(1, inside.size // _SEARCHED)]
    tree = KDTree(vectors.reshape(-1, COMPONENTS)[searched])
    found[asked] = searched[tree.query(vectors[grid][asked], workers=thread_count())[1]]
    found = np.where(whole[grid], own, found)
    return _followed(found, every, whole, jacobian)


def _followed(
    found: np.ndarray, every: int, whole: Bool[np.ndarray, "h w"], jacobian: Jacobian
) -> Int32[np.ndarray, "h w"]:
    from texloom.stages.kernels.distortion.windows import follow

    out = np.empty(whole.shape, np.int32)
    shared = (np.ascontiguousarray(found, np.int64), every, whole, jacobian, out)
    run_spans(follow, shared, len(out), _PIECES)
    return out
