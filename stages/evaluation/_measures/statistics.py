"""Joint statistics of wavelet coefficients, after Portilla and Simoncelli."""

import itertools
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from texloom.stages.evaluation._measures.pictures import (
    MeasuredPicture,
    UnmeasurableError,
    any_true,
    halves,
    require_side,
    require_variation,
)
from texloom.stages.evaluation._measures.table import Figures, share
from texloom.stages.evaluation._measures.task import Task

SMALLEST = 64
"""side of the smallest window that has statistics, px"""

_LARGEST = 256
_ORIENTATIONS = 4
_REACH = 3  # autocorrelations are kept for 7x7 offsets
_MIN_VARIANCE = 1e-6  # of a band; less is rounding error; the exemplar's is 1

Statistics = dict[str, np.ndarray]
"""vectors of one length for windows of one size, by group"""
_KnownWindows = dict[tuple[int, int], tuple[np.ndarray, Statistics]]
"""windows and their statistics, by address and side; kept, as the memory of one that is not may hold another one"""


class _Filters(NamedTuple):
    highest: np.ndarray
    """response of the high-pass residual, by frequency as in a transform"""
    bands: np.ndarray
    """(scale, orientation, row, column) one-sided responses, so that filtered pictures are analytic"""
    lows: np.ndarray
    """(scale, row, column) what is left below each scale"""


@cache
def _filters(side: int, scales: int) -> _Filters:
    frequency = np.fft.fftshift(np.fft.fftfreq(side)) * 2  # 1 is the Nyquist frequency
    radius = np.hypot(frequency[:, None], frequency[None, :])
    octave = np.log2(np.maximum(radius, 1 / side))
    angle = np.arctan2(frequency[:, None], frequency[None, :])

    def low(scale: int) -> np.ndarray:
        return np.asarray(np.cos(np.pi / 2 * np.clip(octave + scale + 1, 0, 1)))

    turns = np.arange(_ORIENTATIONS)[:, None, None] * np.pi / _ORIENTATIONS
    wedges = np.maximum(np.cos(angle - turns), 0) ** (_ORIENTATIONS - 1)
    wedges[:, side // 2, side // 2] = 0
    bands = np.stack([low(k) * np.sqrt(1 - low(k + 1) ** 2) * wedges for k in range(scales)])
    lows = np.stack([low(k + 1) for k in range(scales)])
    highest = np.sqrt(1 - low(0) ** 2)
    return _Filters(*(np.fft.ifftshift(one, axes=(-2, -1)).astype(np.float32) for one in (highest, bands, lows)))


def _picture(spectrum: np.ndarray, response: np.ndarray, side: int) -> np.ndarray:
    """A spectrum, filtered and transformed back, at a resolution of ``side`` px."""
    import cv2

    lowest = (np.s_[: side // 2], np.s_[-side // 2 :])  # frequencies of 0 or more, and below
    filtered = np.empty((*response.shape[:-2], side, side), spectrum.dtype)
    for rows, columns in itertools.product(lowest, lowest):
        place = (..., rows, columns)
        np.multiply(spectrum[place], response[place], out=filtered[place])
    filtered *= np.float32(1 / spectrum.shape[-1] ** 2)
    for plane in filtered.reshape(-1, side, side):
        parts = plane.view(np.float32).reshape(side, side, 2)
        cv2.dft(parts, parts, cv2.DFT_INVERSE)
    return filtered


def _powers(values: np.ndarray) -> np.ndarray:
    """Squared magnitudes."""
    return np.asarray(values.real**2 + values.imag**2 if np.iscomplexobj(values) else values * values)


def _correlations(planes: np.ndarray) -> np.ndarray:
    """Normalised autocorrelation of each plane at half of the offsets of a 7x7 square; the others are equal."""
    import cv2

    offsets = np.arange(-_REACH, _REACH + 1)
    squares = []
    for plane in planes:
        spectrum = cv2.dft(plane - plane.mean())
        power = cv2.mulSpectrums(spectrum, spectrum, 0, conjB=True)
        sums = cv2.dft(power, flags=cv2.DFT_INVERSE | cv2.DFT_SCALE)
        squares.append(sums[np.ix_(offsets, offsets)].ravel())
    square = np.stack(squares)
    count = square.shape[1] // 2
    return np.asarray(square[:, :count] / (square[:, count : count + 1] + _MIN_VARIANCE * planes.shape[-1] ** 2))


def _correlation(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Correlation coefficients of every plane of ``one`` with every plane of ``other``; complex if they are."""
    first, second = (planes.reshape(len(planes), -1) for planes in (one, other))
    first, second = (values - values.mean(axis=1, keepdims=True) for values in (first, second))
    scale = [np.sqrt(_powers(values).mean(axis=1) + _MIN_VARIANCE) for values in (first, second)]
    return np.asarray(first @ second.conj().T / first.shape[1] / scale[0][:, None] / scale[1][None, :])


def _shape(values: np.ndarray) -> list[float]:
    """Logarithm of the deviation, skewness, logarithm of the kurtosis."""
    values = values - values.mean()
    squares = values * values
    variance = float(squares.mean()) + _MIN_VARIANCE
    skewness = float((squares * values).mean()) / variance**1.5
    kurtosis = float((squares * squares).mean()) / variance**2
    return [0.5 * np.log(variance), skewness, float(np.log(kurtosis + 0.1))]


def _window_statistics(tone: np.ndarray, colors: np.ndarray) -> Statistics:
    import cv2

    side = len(tone)
    scales = int(np.log2(side // 16))
    filters = _filters(side, scales)
    parts = cv2.dft(tone - tone.mean(), flags=cv2.DFT_COMPLEX_OUTPUT)
    spectrum = parts.view(np.complex64)[..., 0]
    sides = [side >> scale for scale in range(scales)]
    bands = [_picture(spectrum, filters.bands[k], sides[k]) for k in range(scales)]
    magnitudes = [np.abs(band) for band in bands]
    lows = [_picture(spectrum, filters.lows[k], sides[k] // 2).real for k in range(scales)]
    highest = _picture(spectrum, filters.highest, side).real

    upper = np.triu_indices(_ORIENTATIONS, 1)
    across, phases = [], []
    for k in range(scales - 1):
        lines = magnitudes[k][:, ::2] + magnitudes[k][:, 1::2]
        fine = (lines[..., ::2] + lines[..., 1::2]) / 4
        across.append(_correlation(fine, magnitudes[k + 1]).ravel())
        coarse = _picture(spectrum, filters.bands[k + 1], sides[k])
        doubled = coarse * coarse * (1 / np.maximum(np.abs(coarse), np.float32(1e-12)))
        relation = _correlation(bands[k], doubled).ravel()
        phases.append(np.concatenate([relation.real, relation.imag]))
    energies = [np.log((magnitude**2).mean(axis=(1, 2)) + _MIN_VARIANCE) for magnitude in magnitudes]
    return {
        "pixels": np.array([tone.mean(), *_shape(tone), *np.quantile(tone, [0.01, 0.99])]),
        "low bands": np.array([_shape(low) for low in lows]).ravel(),
        "energy": np.array([*np.concatenate(energies), np.log((highest**2).mean() + _MIN_VARIANCE)]),
        "magnitude autocorrelation": np.concatenate([_correlations(plane).ravel() for plane in magnitudes]),
        "low band autocorrelation": np.concatenate([_correlations(low[None]).ravel() for low in lows]),
        "orientations": np.concatenate([_correlation(plane, plane)[upper] for plane in magnitudes]),
        "scales": np.concatenate(across),
        "phases": np.concatenate(phases),
        "colors": np.cov(np.ascontiguousarray(colors.reshape(-1, 3).T))[np.triu_indices(3)],
    }


def window_side(*measured: MeasuredPicture) -> int:
    """Side of the largest windows that fit in all pictures outside their masks, px.

    `UnmeasurableError` where masks leave no window of `SMALLEST` px.
    """
    side = min(_LARGEST, min(picture.shorter for picture in measured) // 16 * 16)
    while not all(any_true(picture.windows(side, side)) for picture in measured):
        side -= 16
        if side < SMALLEST:
            raise UnmeasurableError(f"masks leave no window of {SMALLEST} px")
    return side


def _places(picture: MeasuredPicture, side: int) -> list[tuple[int, int]]:
    """Top-left pixels of up to four windows, each as near to its corner of the picture as masks allow."""
    starts = [
        [(extent - side) * step // max(count - 1, 1) for step in range(count)]
        for extent, count in ((extent, min(2, extent // side)) for extent in picture.tone.shape)
    ]
    corners = [(row, column) for row in starts[0] for column in starts[1]]
    whole = picture.windows(side, side)
    if whole is None:
        return corners
    free = np.argwhere(whole)
    nearest = (free[((free - corner) ** 2).sum(axis=1).argmin()] for corner in corners)
    return list(dict.fromkeys((int(row), int(column)) for row, column in nearest))


def statistics(
    picture: MeasuredPicture,
    side: int,
    scale: Float64[np.ndarray, "3"],
    known: _KnownWindows | None = None,
) -> Statistics:
    """Mean over up to four windows of ``side`` px of the statistics of tone and colour.

    Marginal moments, band energies, autocorrelations of magnitudes and low-pass pictures, correlations between
    orientations and scales, relative phase, colour covariance. ``scale``: deviations of L, a and b. ``known``: of
    windows so far; parts of a picture are views of it, and may have windows in common.

    References
    ----------
    [Portilla2000]_ section 2. Here magnitudes of two scales are compared at the coarser one's resolution and
    deviation and kurtosis enter by their logarithms.
    """
    known = {} if known is None else known
    windows: list[Statistics] = []
    for row, column in _places(picture, side):
        tone = picture.tone[row : row + side, column : column + side]
        key = (tone.ctypes.data, side)
        if key not in known:
            colors = picture.lab[row : row + side, column : column + side] / scale
            known[key] = tone, _window_statistics(tone, colors)
        windows.append(known[key][1])
    return {group: np.mean([one[group] for one in windows], axis=0) for group in windows[0]}


def statistics_distance(one: Statistics, other: Statistics) -> dict[str, float]:
    """Root mean square difference within each group."""
    return {group: float(np.sqrt(((one[group] - other[group]) ** 2).mean())) for group in one}


def joint_statistics(task: Task) -> Figures:
    """Difference of the joint statistics of wavelet coefficients."""
    require_variation(task.exemplar)
    require_side(2 * SMALLEST, task.exemplar)
    require_side(SMALLEST, task.result)
    task.require_all_made()
    scale = np.sqrt(task.exemplar.variances)
    scale = np.maximum(scale, 0.1 * scale.max())  # a and b of a grey exemplar have no scale

    windows: _KnownWindows = {}

    def groups(one: MeasuredPicture, other: MeasuredPicture) -> dict[str, float]:
        side = window_side(one, other)
        return statistics_distance(*(statistics(picture, side, scale, windows) for picture in (one, other)))

    values = groups(task.exemplar, task.result)
    between = [groups(*pair) for pair in halves(task.exemplar)]
    floors = {group: float(np.mean([half[group] for half in between])) for group in values}
    ceilings = groups(task.exemplar, task.shuffled)
    # band energies differ far more than correlations, so each group has its own floor and ceiling
    scores = [share(values[group], floors[group], ceilings[group]) for group in values]
    known = [score for score in scores if score is not None]
    value, floor, ceiling = (float(np.mean(list(parts.values()))) for parts in (values, floors, ceilings))
    return Figures(value, floor, ceiling, {"groups": values}, float(np.mean(known)) if known else None)
