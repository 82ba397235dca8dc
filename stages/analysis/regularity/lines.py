"""Straight lines at uneven distances that cross the whole exemplar, such as joints of planks or grain."""

import numpy as np
from jaxtyping import Float64

from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import length_of
from texloom.stages.vocabulary.arrays import ScalarMap, Vectors

_STRIPS = 4  # along the lines, compared one by one
_MIN_SIDE = 64  # px of an exemplar
_MIN_LIKENESS = 0.65  # mean correlation of a strip's profile with those of the others
_MIN_WORST = 0.5  # the same of each strip
_MIN_EXPLAINED = 0.35  # share of the variance
_ENDS = 32  # parts of a side, of which the outermost do not count; lines there may be cut
_LEAST, _MOST = 0.5, 0.85  # of a side: the period
_MIN_REPEATED = 0.25  # covariance of the profile with itself at the period, relative to its variance


def line_period(planes: tuple[ScalarMap, ScalarMap]) -> tuple[Vectors, float] | None:
    """The period in which a pattern of straight lines continues best, and the likeness of its parts; or None.

    The lines run along columns or rows. Averaged along them, all strips of the exemplar have nearly the same
    profile, which explains much of the variance. The period is the distance, of half a side to 85 % of it, at
    which the profile is most like itself, so that lines meet lines there.

    Parameters
    ----------
    planes : lightness and its gradient magnitude, without shading.
    """
    best = None
    for axis in (0, 1):  # along which the lines run
        for plane in planes:
            if min(plane.shape) < _MIN_SIDE:
                continue
            likeness = _likeness(plane, axis)
            if likeness < _MIN_LIKENESS or (best is not None and likeness <= best[1]):
                continue
            length, repeated = _period(plane.mean(axis=axis, dtype=np.float64))
            if repeated >= _MIN_REPEATED:
                best = np.array([[0, length] if axis == 0 else [length, 0]], np.float32), likeness
    return best


def refined_period(plane: ScalarMap, period: Vectors, reach: int) -> Vectors:
    """The period, at most ``reach`` px from one found in a reduced picture, at which ``plane`` is most like itself.

    Parameters
    ----------
    plane : lightness at full size.
    period : see `line_period`, px of ``plane``.
    """
    axis = 0 if period[0, 0] == 0 else 1
    profile = plane.mean(axis=axis, dtype=np.float64)
    profile -= gaussian_blur(profile[None], len(profile) / _ENDS, "edge")[0]
    middle = round(float(period[0, 1 - axis]))
    lengths = range(middle - reach, min(middle + reach, len(profile) - 1) + 1)
    repeated = [float((profile[length:] * profile[:-length]).mean()) for length in lengths]
    length = lengths[int(np.argmax(repeated))]
    return np.array([[0, length] if axis == 0 else [length, 0]], np.float32)


def _likeness(plane: ScalarMap, axis: int) -> float:
    """Mean correlation of the strips' profiles with those of the others; 0 where one is not alike, or all vary."""
    explained = plane.mean(axis=axis, dtype=np.float64).var() / max(float(plane.var(dtype=np.float64)), 1e-12)
    if explained < _MIN_EXPLAINED:
        return 0.0
    profiles = np.stack([part.mean(axis=axis, dtype=np.float64) for part in np.array_split(plane, _STRIPS, axis)])
    others = profiles.sum(axis=0) - profiles
    likeness = [_correlation(own, other) for own, other in zip(profiles, others, strict=True)]
    return float(np.mean(likeness)) if min(likeness) >= _MIN_WORST else 0.0


def _period(profile: Float64[np.ndarray, "n"]) -> tuple[int, float]:  # type: ignore[name-defined]
    """Distance at which the profile is most like itself, px, and the covariance there, relative to its variance.

    The correlation of the parts that overlap would be high by chance where they contain no line.
    """
    side = len(profile)
    profile = profile[side // _ENDS : side - side // _ENDS]
    profile = profile - profile.mean()
    lengths = range(round(_LEAST * side), round(_MOST * side) + 1)
    repeated = [float((profile[length:] * profile[:-length]).mean()) for length in lengths]
    best = int(np.argmax(repeated))
    return lengths[best], repeated[best] / float(profile.var())


def _correlation(first: np.ndarray, second: np.ndarray) -> float:
    first, second = first - first.mean(), second - second.mean()
    return float((first * second).sum() / max(float(length_of(first) * length_of(second)), 1e-12))
