"""What has reduced the detail of a picture before it came: enlargement, and strong compression by JPEG."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.kernels.core.elementary_functions import cos, log
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import srgb_from_linear
from texloom.stages.vocabulary.masks import valid_pixels

_WINDOW = 512  # px; the middle of the picture is measured
_MIN_SIDE = 256  # px; smaller pictures are not to be reduced
_LIGHT = np.array([0.2126, 0.7152, 0.0722], np.float32)

_BLOCK = 8  # px, of JPEG
_MIN_STEP = 0.3  # mean excess of the jumps between blocks over the mean jump of neighbours
_MIN_CLEAR = 3.5  # the same over the deviation of the excess at other lines
_MIN_JUMP = 1.0  # codes of 8 bits; a plain picture has no steps to speak of

_SEGMENT = 128  # px, of the spectra
_MIDDLE, _HIGH = (0.125, 0.22), (0.375, 0.47)  # cycles per px
_EMPTY = 0.028  # power of high over that of middle frequencies; natural pictures have 0.1
_NOISE = 3.5  # squared codes; more power at high frequencies is no noise of rounding and compression
_SOFT = 0.063  # the first, where pixels are interpolated
_MIN_PEAK = 8.0  # of the spectrum of the sharpness of lines over its median
_DETREND = 25  # lines
_SAME = 0.01  # cycles per px


def flaws_of(image: Image) -> list[str]:
    """What is wrong with the resolution of a picture, each with what to do; in words, none where nothing is.

    An enlarged picture has next to no power at high spatial frequencies, or lines that are alternately sharp and
    soft, as pixels between those of the original are means. A picture that was compressed strongly has steps
    between blocks of 8 x 8 px, in both directions. Excluded pixels in the middle of the picture prevent both.

    References
    ----------
    Traces of interpolation: [Gallagher2005]_, here of the mean magnitude of second differences. The rest is ours.
    """
    codes = _codes(image)
    if codes is None:
        return []
    flaws = []
    if _is_enlarged(codes):
        flaws.append(
            "the exemplar has no detail of the size of its pixels: it was enlarged, or is out of focus; "
            "--reduce 0.5 makes patches that hold more, in less time"
        )
    if all(_has_blocks(lines) for lines in (codes, codes.T)):
        flaws.append(
            "the exemplar shows the blocks of 8 x 8 px of strong JPEG compression, which the result will copy; "
            "--reduce 0.5 hides them"
        )
    return flaws


def _codes(image: Image) -> Float32[np.ndarray, "h w"] | None:
    """The middle of a picture as grey sRGB values, 0..255; none of a small one, or where pixels are excluded."""
    if min(image.height, image.width) < _MIN_SIDE:
        return None
    rows, columns = (
        slice((side - min(side, _WINDOW)) // 2, (side + min(side, _WINDOW)) // 2)
        for side in (image.height, image.width)
    )
    part = image.cropped(rows, columns)
    valid = valid_pixels(image)
    if valid is not None and not valid[rows, columns].all():
        return None
    grey = (srgb_from_linear(part.color) * _LIGHT).sum(axis=2)
    return np.asarray(255 * grey, np.float32)


def _has_blocks(codes: Float32[np.ndarray, "h w"]) -> bool:
    """Whether jumps between columns are larger at every eighth."""
    jumps = np.abs(np.diff(codes, axis=1))
    excess = (jumps[:, 1:-1] - (jumps[:, :-2] + jumps[:, 2:]) / 2).mean(axis=0)
    phases = np.array([excess[phase::_BLOCK].mean() for phase in range(_BLOCK)])
    others = np.delete(phases, phases.argmax())
    jump = float(jumps.mean())
    step = float(phases.max() - np.median(others))
    clear = float(phases.max() - others.mean()) >= _MIN_CLEAR * float(others.std())
    return jump >= _MIN_JUMP and step >= _MIN_STEP * jump and clear


def _is_enlarged(codes: Float32[np.ndarray, "h w"]) -> bool:
    powers = [_powers(lines) for lines in (codes, codes.T)]
    ratio = max(max(high, 1e-3) / max(middle, 1e-3) for middle, high in powers)
    if ratio <= _EMPTY and max(high for _, high in powers) <= _NOISE:
        return True
    if ratio > _SOFT:
        return False
    across, down = (_interpolation(lines) for lines in (codes, codes.T))
    return min(across[0], down[0]) >= _MIN_PEAK and abs(across[1] - down[1]) <= _SAME


def _powers(codes: Float32[np.ndarray, "h w"]) -> tuple[float, float]:
    """Power along the rows at middle and at high frequencies, squared codes."""
    window = _hann(_SEGMENT)
    frequency = np.fft.rfftfreq(_SEGMENT)
    starts = range(0, codes.shape[1] - _SEGMENT + 1, _SEGMENT // 2)
    power = np.zeros(len(frequency))
    for start in starts:
        part = codes[:, start : start + _SEGMENT]
        spectrum = np.fft.rfft((part - part.mean(axis=1, keepdims=True)) * window, axis=1)
        power += (np.abs(spectrum) ** 2).mean(axis=0) / (window**2).sum() / len(starts)
    middle, high = (float(power[(frequency >= low) & (frequency <= high)].mean()) for low, high in (_MIDDLE, _HIGH))
    return middle, high


def _interpolation(codes: Float32[np.ndarray, "h w"]) -> tuple[float, float]:
    """How strongly the sharpness of columns alternates, and with which frequency, cycles per px."""
    sharpness = log(np.abs(np.diff(codes, 2, axis=1)).mean(axis=0) + 0.05)
    half = _DETREND // 2
    sharpness -= np.convolve(np.pad(sharpness, half, "reflect"), np.ones(_DETREND) / _DETREND, "valid")
    spectrum = np.abs(np.fft.rfft(sharpness * _hann(len(sharpness))))
    frequency = np.fft.rfftfreq(len(sharpness))
    counted = frequency >= 0.2
    for multiple in (2, 3, 4):  # of JPEG's blocks
        counted &= np.abs(frequency - multiple / _BLOCK) > 2.5 / len(sharpness)
    place = int(np.where(counted, spectrum, 0).argmax())
    return float(spectrum[place] / max(float(np.median(spectrum[counted])), 1e-9)), float(frequency[place])


def _hann(length: int) -> Float64[np.ndarray, "*n"]:
    return np.asarray((1 - cos(2 * np.pi * np.arange(length) / (length - 1))) / 2)
