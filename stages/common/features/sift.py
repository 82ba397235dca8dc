"""Scale-invariant features, whose bits are the same on every processor.

OpenCV's are not: with other vector instructions it finds others.
"""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Float32, Float64, UInt8

from texloom.stages.kernels.core.elementary_functions import cos, exp, sin
from texloom.stages.kernels.core.threads import run_spans
from texloom.stages.numerics.filters import gaussian_blur

_LAYERS = 3  # of an octave in which features are found
_LN2 = 0.6931471805599453
_SIGMA = 1.6  # px; blur of an octave's first layer
_OWN = 0.5  # px; blur of a picture itself
_LEAST = 1.0  # difference, of 255, below which there is no feature
_TURNS = 36
_SIZE = 128  # of a descriptor
_MIN_SIDE = 12  # px of an octave
_PIECES = 16


def features(
    picture: UInt8[np.ndarray, "h w"],
) -> tuple[Float32[np.ndarray, "n 2"], Float64[np.ndarray, "n"], Float32[np.ndarray, "n 128"]]:  # type: ignore[name-defined]
    """Places of features, their strengths, and what describes them.

    Parameters
    ----------
    picture : grey levels. Features are also found between its pixels.

    Returns
    -------
    Row and column, px; contrast, 0..1; whole numbers, 0..255, of length 512, about.

    References
    ----------
    [Lowe2004]_ with the constants of OpenCV.
    """
    base = gaussian_blur(_doubled(picture.astype(np.float32)), float(np.sqrt(_SIGMA**2 - (2 * _OWN) ** 2)))
    parts, factor = [], 0.5
    while min(base.shape) >= _MIN_SIDE:
        blurred = _blurred(base)
        parts.append(_of_octave(blurred, factor))
        base, factor = np.ascontiguousarray(blurred[_LAYERS][::2, ::2]), 2 * factor
    if not parts:
        return np.zeros((0, 2), np.float32), np.zeros(0), np.zeros((0, _SIZE), np.float32)
    places, strengths, descriptors = (np.concatenate(part) for part in zip(*parts, strict=True))
    _, first = np.unique(np.column_stack([places, strengths, descriptors]), axis=0, return_index=True)
    first = np.sort(first)
    return places[first], strengths[first], descriptors[first]


def _doubled(plane: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "H W"]:
    """Twice the size, between pixels linearly."""
    for axis in (0, 1):
        lines = np.moveaxis(plane, axis, 0)
        before, after = np.concatenate([lines[:1], lines[:-1]]), np.concatenate([lines[1:], lines[-1:]])
        share = np.float32(0.25)
        both = np.stack([share * before, share * after], axis=1) + 3 * share * lines[:, None]
        plane = np.ascontiguousarray(np.moveaxis(both.reshape(-1, lines.shape[1]), 0, axis))
    return plane


def _blurred(base: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "layers h w"]:
    """The layers of an octave, each blurred by the same factor more than the one before."""
    deviations = _SIGMA * exp(_LN2 / _LAYERS * np.arange(_LAYERS + 3))
    layers = [base]
    for before, after in itertools.pairwise(deviations):
        layers.append(gaussian_blur(layers[-1], float(np.sqrt(after**2 - before**2))))
    return np.stack(layers)


def _of_octave(
    blurred: Float32[np.ndarray, "layers h w"], factor: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`features` of one octave, whose pixels are ``factor`` px of the picture apart."""
    from texloom.stages.kernels.features.sift_descriptors import describe, find_directions, find_extrema

    found = find_extrema(np.diff(blurred, axis=0), _LEAST)
    scales = _SIGMA * exp(_LN2 / _LAYERS * (found[:, 0] + found[:, 3]))
    turns, counts = np.empty((len(found), _TURNS)), np.zeros(len(found), np.int64)

    def turn(first: int, last: int) -> None:
        for number in range(first, last):
            layer, row, column = (int(one) for one in found[number, :3])
            counts[number] = find_directions(blurred[layer], row, column, scales[number], turns[number])

    run_spans(turn, (), len(found), _PIECES)
    own = np.repeat(np.arange(len(found)), counts)
    angle = turns[np.arange(_TURNS) < counts[:, None]]
    places = found[own, 1:3] + found[own, 4:6]
    descriptors = np.empty((len(own), _SIZE), np.float32)
    cosine, sine = cos(angle), sin(angle)

    def fill(first: int, last: int) -> None:
        for number in range(first, last):
            layer, scale = int(found[own[number], 0]), scales[own[number]]
            turned = cosine[number], sine[number], angle[number]
            describe(blurred[layer], *places[number], *turned, scale, descriptors[number])

    run_spans(fill, (), len(own), _PIECES)
    return (places * factor).astype(np.float32), found[own, 6], descriptors
