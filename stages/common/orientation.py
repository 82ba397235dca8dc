"""Fields of directions without sign: doubled angles, smoothing, diffusion, and pictures of them.

A direction is an angle in radians, 0..pi, from along a row (columns growing) towards growing rows. A half turn more
is the same, so all sums are over (cos 2a, sin 2a), called doubled vectors; their length is how sure a place is.
"""

from typing import TypeAlias

import numpy as np
from jaxtyping import Float32

from texloom.stages.arrays import ColorField, ScalarMap
from texloom.stages.kernels.core.threads import run_spans

Doubled: TypeAlias = Float32[np.ndarray, "h w 2"]
"""(cos 2a, sin 2a) of a direction a, times how sure it is, 0..1"""

_SOLVED = 192  # px; longest side at which a field is diffused
_PIECES = 16


def doubled(angle: ScalarMap, confidence: ScalarMap) -> Doubled:
    """Directions as doubled vectors."""
    return np.stack([confidence * np.cos(2 * angle), confidence * np.sin(2 * angle)], axis=2).astype(np.float32)


def angle_of(vectors: Doubled) -> ScalarMap:
    """Directions of doubled vectors, 0..pi."""
    angle = np.arctan2(vectors[..., 1], vectors[..., 0]) / 2
    return np.asarray(np.where(angle < 0, angle + np.pi, angle), np.float32)


def length_of(vectors: Doubled) -> ScalarMap:
    """How sure they are."""
    return np.asarray(np.hypot(vectors[..., 0], vectors[..., 1]), np.float32)


def unit(vectors: Doubled) -> Doubled:
    """The same directions with length 1; (1, 0) where there is none."""
    length = length_of(vectors)[..., None]
    return np.asarray(np.where(length > 1e-9, vectors / np.maximum(length, 1e-9), [1.0, 0.0]), np.float32)


def smoothed(vectors: Doubled, guide: ColorField, reach: float, alike: float) -> Doubled:
    """Bilateral filter: means over what is near and of a colour like it, the sure ones counting more.

    Parameters
    ----------
    reach : standard deviation of the weight by distance, px.
    alike : standard deviation of the weight by colour, CIELAB units.
    """
    import cv2

    planes = np.ascontiguousarray(np.dstack([vectors, np.ones(vectors.shape[:2], np.float32)]))
    side = 2 * int(np.ceil(2 * reach)) + 1
    found = cv2.ximgproc.jointBilateralFilter(np.ascontiguousarray(guide), planes, side, alike, reach)
    return np.ascontiguousarray(found[..., :2])


def diffused(vectors: Doubled, stiffness: float) -> Doubled:
    """The smoothest field that agrees with what is sure: Laplace's equation where nothing is.

    The sum of squared differences to ``vectors``, weighted by their length, and ``stiffness`` times that between
    neighbours is least. Solved on a grid of up to 192 px a side and interpolated.
    """
    import cv2
    import scipy.sparse
    import scipy.sparse.linalg

    height, width = vectors.shape[:2]
    factor = min(1.0, _SOLVED / max(height, width))
    rows, columns = max(1, round(height * factor)), max(1, round(width * factor))
    given = vectors if factor == 1 else cv2.resize(vectors, (columns, rows), interpolation=cv2.INTER_AREA)
    given = given.reshape(rows, columns, 2).astype(np.float64)
    weight = np.hypot(given[..., 0], given[..., 1]).ravel()
    if not weight.any():
        return np.zeros_like(vectors)
    number = np.arange(rows * columns).reshape(rows, columns)
    one = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    other = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    links = scipy.sparse.coo_array((np.ones(one.size), (one, other)), (number.size, number.size))
    links = (links + links.T).tocsc()
    laplacian = scipy.sparse.diags_array(np.asarray(links.sum(axis=0)).ravel()) - links
    system = (scipy.sparse.diags_array(weight + 1e-9 * stiffness) + stiffness * laplacian).tocsc()
    # the given vectors carry their weight already
    solved = scipy.sparse.linalg.splu(system).solve(given.reshape(-1, 2)).reshape(rows, columns, 2)
    solved = solved.astype(np.float32)
    return (
        solved if factor == 1 else np.asarray(cv2.resize(solved, (width, height), interpolation=cv2.INTER_LINEAR))
    )


def streaks(angle: ScalarMap, length: int) -> ScalarMap:
    """A picture of a field: noise smeared along it, 0..1 [Cabral1993]_."""
    from texloom.stages.kernels.distortion.line_integral import convolve_lines

    noise = np.random.default_rng(0).random(angle.shape, np.float32)
    out = np.empty_like(noise)
    run_spans(convolve_lines, (noise, angle, length, out), angle.shape[0], _PIECES)
    # means of so many have a small spread; it is stretched
    return np.asarray(np.clip(0.5 + (out - 0.5) * 0.9 * np.sqrt(2 * length + 1), 0, 1), np.float32)
