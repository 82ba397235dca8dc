"""Whether the opposite borders of a picture fit, measured where nobody says so."""

import logging

import numpy as np
from jaxtyping import Float32

from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.color import srgb_from_linear

_FITS = 1.5  # times the mean step inside


def border_steps(image: Image, marked: Mask | None = None) -> tuple[float, float]:
    """Mean step across the border of a picture over the mean step inside, of its first row and its first column.

    Steps are differences of neighbours in sRGB; about 1 where the picture continues across its border. Infinite
    where nothing is known, as in a plain picture.

    Parameters
    ----------
    marked : pixels that do not count, such as holes.
    """
    levels = srgb_from_linear(np.clip(image.color, 0, 1))
    unknown = np.zeros(levels.shape[:2], bool) if marked is None else marked
    down = _ratio(levels, unknown)
    return down, _ratio(levels.swapaxes(0, 1), unknown.T)


def _ratio(levels: Float32[np.ndarray, "h w 3"], unknown: Mask) -> float:
    def mean(first: slice, second: slice) -> float:
        known = ~(unknown[first] | unknown[second])
        steps = np.abs(levels[first] - levels[second]).mean(axis=2)[known]
        return float(steps.mean()) if steps.size else np.inf

    inside = mean(slice(0, -1), slice(1, None))
    return mean(slice(-1, None), slice(0, 1)) / inside if 0 < inside < np.inf else np.inf


def tell_borders(log: logging.Logger, image: Image, marked: Mask) -> None:
    """Tell that an edit may break a tile: a marked part touches a border, and the borders fit beside it."""
    touched = marked[[0, -1]].any(), marked[:, [0, -1]].any()
    steps = border_steps(image, marked) if any(touched) else (np.inf, np.inf)
    if max(steps) <= _FITS:
        log.warning(
            "the picture's opposite borders fit (steps across them are %.1f times those inside down, %.1f across), "
            "and the marked part touches one; if it is a tile, --tileable keeps it one",
            *steps,
        )
