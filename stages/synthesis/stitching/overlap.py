"""Template matching: squared differences of a template at every place of an exemplar, by Fourier transforms."""

from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int64

from texloom.stages.kernels.core.elementary_functions import power
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.kernels.core.threads import run_spans
from texloom.stages.vocabulary.arrays import Image

WEIGHTS = (0.299, 0.587, 0.114)
"""share of red, green and blue in a difference"""

_PIECES = 4  # of work that threads share
_NOISE = 2e-6  # error of a transform in single precision, as a share of the sum

Errors: TypeAlias = Float32[np.ndarray, "p q"]
"""weighted squared difference a pixel for every place of a template's top-left corner"""


def compared(image: Image) -> Float32[np.ndarray, "h w 3"]:
    """Colour in sRGB steps, each channel times the root of its weight, so that squared differences sum as weighted.

    Black is 0 and white has length 1; brighter values continue along the same curve.
    """
    linear = np.maximum(image.color, 0)
    encoded = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * power(linear, 1 / 2.4) - 0.055)
    return np.asarray(encoded * np.sqrt(WEIGHTS), np.float32)


class OverlapSearch:
    """Compares templates with all places of one exemplar.

    Parameters
    ----------
    features : (h, w, c), as from `compared`.

    References
    ----------
    [Nealen2003]_ section 3.1.
    """

    def __init__(self, features: Float32[np.ndarray, "h w c"]):
        fft = loaded("scipy.fft")
        self.shape = (features.shape[0], features.shape[1])
        # Templates do not cross the border, so that transforms need no padding for them.
        self.padded = tuple(fft.next_fast_len(side, real=True) for side in self.shape)
        # Differences are invariant to an offset, and centred values lose less precision in the transforms.
        self.middle = features.mean(axis=(0, 1), dtype=np.float64).astype(np.float32)
        centred = (features - self.middle).astype(np.float32)
        planes = [*np.moveaxis(centred, 2, 0), (centred**2).sum(axis=2)]
        self._spectra = np.stack([fft.rfft2(plane, self.padded, workers=1) for plane in planes])

    def errors(self, template: Float32[np.ndarray, "m n c"], mask: Bool[np.ndarray, "m n"]) -> Errors:
        """Mean squared difference where ``mask`` is true, at every place where the whole template fits.

        Parameters
        ----------
        template : features; any finite values where ``mask`` is false.
        mask : true somewhere; no larger than the exemplar.
        """
        from texloom.stages.kernels.seams.template_spectrum import template_spectrum

        fft = loaded("scipy.fft")
        centred = np.where(mask[..., None], template - self.middle, np.float32(0))
        planes = np.stack([*np.moveaxis(centred, 2, 0), mask.astype(np.float32)])
        # The rows first, so that those beyond the template, which are all zero, are not transformed.
        spectra = fft.fft(fft.rfft(planes, self.padded[1], axis=2, workers=1), self.padded[0], axis=1, workers=1)
        both = spectra.view(np.float32), self._spectra.view(np.float32)
        run_spans(template_spectrum, both, self.padded[0], _PIECES)
        spectrum = spectra[-1]
        places = tuple(side - size + 1 for side, size in zip(self.shape, mask.shape, strict=True))
        errors = fft.irfft2(spectrum, self.padded, workers=1)[: places[0], : places[1]]
        errors += float((centred.astype(np.float64) ** 2).sum())
        return np.asarray(np.maximum(errors / float(mask.sum()), 0), np.float32)

    def noise(self, template: Float32[np.ndarray, "m n c"], mask: Bool[np.ndarray, "m n"]) -> float:
        """Bound of the numerical error of `errors`; places that differ by less are equal."""
        centred = (template - self.middle)[mask]
        return _NOISE * (1.0 + float((centred.astype(np.float64) ** 2).sum(axis=1).mean()))


def good_enough(errors: Errors, tolerance: float, noise: float) -> Bool[np.ndarray, "p q"]:
    """Places whose error is at most 1 + ``tolerance`` times the minimum."""
    return np.asarray(errors <= float(errors.min()) * (1 + tolerance) + noise)


def pick(errors: Errors, tolerance: float, noise: float, rng: np.random.Generator) -> Int64[np.ndarray, "2"]:
    """Row and column of a random `good_enough` place, uniformly distributed."""
    places = np.flatnonzero(good_enough(errors, tolerance, noise))
    return np.array(divmod(int(places[rng.integers(places.size)]), errors.shape[1]))


class ReducedSearch:
    """Fast template matching in a large exemplar: on a grid of means over squares, then refined per pixel.

    Parameters
    ----------
    features : as for `OverlapSearch`.
    squares : about how many squares there are along a side of the exemplar.
    """

    def __init__(self, features: Float32[np.ndarray, "h w c"], squares: int):
        self.features = features
        self.side = max(1, int(np.sqrt(features.shape[0] * features.shape[1])) // squares)
        self.search = OverlapSearch(_means(features, self.side))

    def best(
        self,
        template: Float32[np.ndarray, "m n c"],
        mask: Bool[np.ndarray, "m n"],
        free: Bool[np.ndarray, "p q"],
        count: int,
        min_separation: int,
    ) -> Int64[np.ndarray, "k 2"]:
        """Up to ``count`` best places, at least ``min_separation`` px apart.

        Parameters
        ----------
        template, mask : as for `OverlapSearch.errors`; both sides at least as long as a square of the means.
        free : permitted places of the template's top-left pixel.
        """
        share = _means(mask[..., None].astype(np.float32), self.side)
        known = _means(np.where(mask[..., None], template, np.float32(0)), self.side) / np.maximum(share, 1e-6)
        errors = self.search.errors(known, share[..., 0] >= min(0.5, float(share.max())))
        open_squares = np.zeros(errors.shape, bool)
        some = free[:: self.side, :: self.side][: errors.shape[0], : errors.shape[1]]
        open_squares[: some.shape[0], : some.shape[1]] = some
        errors[~open_squares] = np.inf
        corners = []
        near = -(-min_separation // self.side)
        for _ in range(count):
            row, column = divmod(int(errors.argmin()), errors.shape[1])
            if not np.isfinite(errors[row, column]):
                break
            errors[max(0, row - near + 1) : row + near, max(0, column - near + 1) : column + near] = np.inf
            corners.append((row, column))
        places = np.array(corners, np.int64).reshape(-1, 2) * self.side
        if self.side > 1:
            from texloom.stages.kernels.seams.overlap_difference import refine_positions

            refine_positions(self.features, template, mask, free, places, self.side)
        return places


def _means(planes: Float32[np.ndarray, "h w c"], side: int) -> Float32[np.ndarray, "p q c"]:
    """Means over whole squares; remaining rows and columns are ignored."""
    height, width = planes.shape[0] // side, planes.shape[1] // side
    squares = planes[: height * side, : width * side].reshape(height, side, width, side, -1)
    return np.asarray(squares.mean(axis=(1, 3)), np.float32)
