"""Appearance vectors and similarity sets of a distorted level; see `appearance` beside it."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64

from texloom.stages.common.similarity.appearance import (
    BASIS_LENGTH,
    COMPONENTS,
    MAX_LENGTH,
    Appearance,
    Basis,
    Candidates,
    similar_sets,
)
from texloom.stages.common.similarity.components import components
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.kernels.core.threads import run_spans, thread_count
from texloom.stages.numerics.matrices import row_product
from texloom.stages.vocabulary.arrays import Jacobian, Mask
from texloom.stages.vocabulary.masks import nearest_valid

_BLOCKS = 4  # per step: one pixel of each block is described and represents the others
_LEAST_STRETCH = 0.7  # px per element, of pixels that are sharp at every level

_SAMPLE_SIZE = 5_000  # windows from which the components are computed
_MAX_SEARCHED = 2**14  # whole neighbourhoods that may replace an incomplete one
_MAX_DENSE = 2**16  # described places; with more, neighbourhoods are compared at every second of them
_MAX_QUERIED = 2**14  # places to be replaced; with more, every second, but one a step at least
_INEXACT = 0.25  # excess of the distance of a replacement, as a share
_REACH = 4.0  # steps, px, that a place is carried from a whole one
_PIECES = 32


@dataclasses.dataclass(frozen=True)
class Neighbourhoods:
    """Those of every ``every``-th pixel of every ``every``-th row of a level."""

    every: int
    vectors: Appearance
    """principal components"""
    whole: Mask

    def of_grid(self, every: int, shape: tuple[int, ...]) -> "Neighbourhoods":
        """The nearest ones to every ``every``-th pixel of a grid of ``shape``."""
        if every == self.every:
            return self
        at = self._nearest(every, shape)
        return Neighbourhoods(every, self.vectors[at], self.whole[at])

    def whole_pixels(self, shape: tuple[int, ...]) -> Mask:
        """Whether the nearest one to each pixel is whole."""
        return np.asarray(self.whole[self._nearest(1, shape)])

    def _nearest(self, every: int, shape: tuple[int, ...]) -> tuple[np.ndarray, ...]:
        return np.ix_(
            *(
                np.minimum((np.arange(side) * every + self.every // 2) // self.every, most - 1)
                for side, most in zip(shape, self.whole.shape, strict=False)
            )
        )

    def every_second(self) -> "Neighbourhoods":
        """Every second in both directions."""
        return Neighbourhoods(2 * self.every, self.vectors[::2, ::2], self.whole[::2, ::2])


def block_side(level: int, jacobian: Jacobian, used: Mask) -> int:
    """Side, px, of blocks of which one pixel is described; less where ``used`` pixels hold several elements."""
    if 2**level < 2 * _BLOCKS:
        return 1
    from texloom.stages.kernels.distortion.distorted_windows import least_stretch

    least = min(run_spans(least_stretch, (jacobian, used), len(used), _PIECES))
    return max(1, int(2**level * min(1.0, least / _LEAST_STRETCH)) // _BLOCKS)


def whole_count(valid: Mask, level: int, jacobian: Jacobian) -> float:
    """Approximate number of pixels whose neighbourhoods are valid."""
    every = max(1, int(np.sqrt(np.count_nonzero(valid) / _SAMPLE_SIZE)))
    return float(np.count_nonzero(_whole_windows(valid, 2.0**level, jacobian, 3, every))) * every**2


def _whole_windows(valid: Mask, step: float, jacobian: Jacobian, reach: int, every: int) -> Bool[np.ndarray, "p q"]:
    from texloom.stages.kernels.distortion.distorted_windows import whole_windows

    whole = np.zeros((-(-valid.shape[0] // every), -(-valid.shape[1] // every)), np.bool_)
    run_spans(whole_windows, (valid, jacobian, step, reach, every, whole), len(whole), _PIECES)
    return whole


def analyse(
    planes: Float32[np.ndarray, "h w c"],
    known: Mask,
    sharp: Mask,
    level: int,
    jacobian: Jacobian,
    min_separation: int,
    coarser: Neighbourhoods | None,
    appearance: Appearance,
    candidates: Candidates,
) -> tuple[Basis, Neighbourhoods] | None:
    """Fill the appearances and similarity sets of a level.

    Returns
    -------
    the basis and the neighbourhoods; None where no neighbourhood is whole.

    Coarse levels are described on a grid of a quarter of a step, and similar places are searched for on one of half
    a step where there are many.

    Parameters
    ----------
    known : the pixels that may be read; those are described from which sharp ones can be reached, others are zeros.
    sharp : those of them that may be used at this level.
    min_separation : minimum distance between the members of a set, px.
    coarser : those of the next coarser level, by which incomplete ones are replaced: places that are not sharp here
        are sharp there.
    appearance, candidates : output; appearances are zeros before.
    """
    from texloom.stages.kernels.distortion.distorted_windows import (
        describe_neighbourhoods,
        gather_neighbours,
        interpolate,
    )

    step, every = 2.0**level, block_side(level, jacobian, sharp)
    grid = np.s_[::every, ::every]
    bent = np.ascontiguousarray(jacobian[grid]) / np.float32(every)
    inside, usable = np.ascontiguousarray(known[grid]), np.ascontiguousarray(sharp[grid])
    described = inside & _near(usable, step, bent, every)
    coarse = appearance if every == 1 else np.zeros((*inside.shape, COMPONENTS), np.int16)
    seen = _appearances(planes[grid], inside, usable, described, step, bent, coarse)
    places = _sample(seen)
    if not places.size:
        return None
    around = np.empty((places.size, 8 * COMPONENTS), np.int16)
    gather_neighbours(coarse, bent, places, step, around)
    basis = np.rint(components(around, COMPONENTS)[1] * BASIS_LENGTH).astype(np.int16)
    further = 2 if np.count_nonzero(described) > _MAX_DENSE else 1
    shape = tuple(-(-side // further) for side in described.shape)
    own = Neighbourhoods(every * further, np.zeros((*shape, COMPONENTS), np.int16), np.zeros(shape, np.bool_))
    shared = (coarse, seen, bent, described, step, basis, further, own.vectors, own.whole)
    run_spans(describe_neighbourhoods, shared, shape[0], _PIECES)
    if not own.whole.any():
        return None
    whole = own.whole_pixels(known.shape) & known
    _fill_candidates(own, coarser, whole, known, sharp, step, jacobian, min_separation, candidates)
    if every > 1:
        run_spans(interpolate, (coarse, every, appearance), len(appearance), _PIECES)
    return basis, own


def _sample(complete: Mask) -> np.ndarray:
    """Evenly spaced places of ``complete``."""
    places = np.flatnonzero(complete)
    return places[:: max(1, places.size // _SAMPLE_SIZE)]


def _near(sharp: Mask, step: float, jacobian: Jacobian, every: int) -> Mask:
    """The pixels that a place carried from a sharp one may meet, and their neighbours a step away."""
    import cv2

    widest = float(np.sqrt(np.square(jacobian[sharp]).sum(axis=1).max(initial=0)))
    distance = cv2.distanceTransform((~sharp).astype(np.uint8), cv2.DIST_L2, 3)
    return np.asarray(distance <= (_REACH / every + widest) * step)


def _appearances(
    planes: Float32[np.ndarray, "h w c"],
    known: Mask,
    sharp: Mask,
    described: Mask,
    step: float,
    jacobian: Jacobian,
    appearance: Appearance,
) -> Mask:
    """Fill the appearances of the described pixels; the pixels whose windows are whole."""
    from texloom.stages.kernels.distortion.distorted_windows import MARGIN, TILE, describe_windows, gather_windows

    planes = np.ascontiguousarray(planes)
    min_separation = max(1, int(np.sqrt(np.count_nonzero(sharp) / (4 * _SAMPLE_SIZE))))
    places = np.zeros_like(sharp)
    places[::min_separation, ::min_separation] = _whole_windows(sharp, step, jacobian, 2, min_separation)
    chosen = _sample(places if places.any() else sharp)
    sample = np.empty((chosen.size, 25 * planes.shape[2]), np.float32)
    gather_windows(planes, jacobian, chosen, step, sample)
    mean, basis = components(sample, COMPONENTS)
    centred = sample - mean
    squares = row_product(centred, basis) ** 2
    variances = squares.mean(axis=0)
    residual = max(float((centred**2).sum(axis=1).mean() - variances.sum()), 0) / sample.shape[1]
    noise = np.clip((residual + 1e-6) / (variances + 1e-6), 1e-4, 1e6)
    longest = float(np.sqrt(squares.sum(axis=1).max()))
    seen = np.zeros_like(known)
    around = ((MARGIN, MARGIN), (MARGIN, MARGIN))
    shared = (
        np.pad(np.moveaxis(planes, 2, 0), ((0, 0), *around), "edge"), jacobian, np.pad(known, around),
        np.pad(sharp, around), described, step, mean.astype(np.float32), basis.astype(np.float32), noise,
        MAX_LENGTH / max(longest, 1e-6), float(MAX_LENGTH), appearance, seen,
    )  # fmt: skip
    run_spans(describe_windows, shared, -(-len(known) // TILE), _PIECES)
    return seen


def _fill_candidates(
    own: Neighbourhoods,
    coarser: Neighbourhoods | None,
    whole: Mask,
    known: Mask,
    sharp: Mask,
    step: float,
    jacobian: Jacobian,
    min_separation: int,
    candidates: Candidates,
) -> None:
    """Similarity sets: each place itself, or its replacement if it is not whole, and the most similar others.

    They are searched for on the grid of the neighbourhoods, and followed between.
    """
    k = candidates.shape[2]
    places = np.arange(whole.size, dtype=np.int32).reshape(whole.shape)
    targets, every = _replacements(own, coarser, known, sharp, step)
    candidates[..., 0] = _followed(targets, every, whole, jacobian)
    np.copyto(candidates[..., 0], places, where=whole)
    if k > 1:
        numbers = places[:: own.every, :: own.every].ravel()
        sets = similar_sets(own.vectors, own.whole, k, max(1, min_separation // own.every))
        for which in range(1, k):
            targets = np.where(own.whole, numbers[sets[:, which]].reshape(own.whole.shape), -1)
            others = _followed(targets, own.every, whole, jacobian)
            candidates[..., which] = np.where(others < 0, places, others)
        # Incomplete places share the candidates of their replacements.
        candidates[~whole, 1:] = candidates.reshape(-1, k)[candidates[~whole, 0], 1:]


def _replacements(
    own: Neighbourhoods, coarser: Neighbourhoods | None, known: Mask, sharp: Mask, step: float
) -> tuple[Int64[np.ndarray, "p q"], int]:
    """The whole place most similar to each known place that is not whole and may be reached from one that is.

    Others have that of the nearest. Places that are not sharp enough at this level are compared at the coarser one.
    They are those of every so many pixels, and how many.
    """
    ndimage = loaded("scipy.ndimage")
    spatial = loaded("scipy.spatial")
    whole, begun, grid = own.whole, own.whole, np.s_[:: own.every, :: own.every]
    further = None if coarser is None else coarser.of_grid(own.every, whole.shape)
    if further is not None:
        begun = whole | further.whole
    reached = known[grid] & (own.every * ndimage.distance_transform_edt(~begun) < _REACH * step)
    missing = reached & ~whole
    fewer = own.every_second()
    if own.every < step and np.count_nonzero(missing) > _MAX_QUERIED and fewer.whole.any():
        return _replacements(fewer, coarser, known, sharp, step)
    if further is not None and (whole & further.whole).any():
        parts = [(own, missing & sharp[grid]), (further, missing & ~sharp[grid])]
    else:
        parts = [(own, missing)]
    targets = np.arange(known.size).reshape(known.shape)[grid].copy()
    numbers = targets.ravel().copy()
    for compared, queried in parts:
        searched = np.flatnonzero(whole & compared.whole)
        searched = searched[:: max(1, searched.size // _MAX_SEARCHED)]
        if queried.any():
            tree = spatial.KDTree(compared.vectors.reshape(-1, COMPONENTS)[searched])
            nearest = tree.query(compared.vectors[queried], eps=_INEXACT, workers=thread_count())[1]
            targets[queried] = numbers[searched[nearest]]
    row, column = nearest_valid(whole | reached)
    return targets[row, column], own.every


def _followed(targets: np.ndarray, every: int, whole: Mask, jacobian: Jacobian) -> Int32[np.ndarray, "h w"]:
    """Targets of all pixels, continued from those of a grid along the texture."""
    from texloom.stages.kernels.distortion.distorted_windows import follow

    out = np.empty(whole.shape, np.int32)
    shared = (np.ascontiguousarray(targets, np.int64), every, whole, jacobian, out)
    run_spans(follow, shared, len(out), _PIECES)
    return out
