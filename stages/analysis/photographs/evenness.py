"""How alike the parts of a surface are: many periods of one texture, or several surfaces."""

import numpy as np
from jaxtyping import Float32

from texloom.stages.analysis.photographs.reduced_surface import reduced_surface
from texloom.stages.kernels.core.elementary_functions import exp, log
from texloom.stages.numerics.filters import gradients
from texloom.stages.numerics.matrices import least_squares, matrix_product
from texloom.stages.vocabulary.arrays import Image, Mask

_SIDE = 192  # px of the longer side, at which a picture is judged
_BLOCKS = 4  # along each side, which are compared with each other
_NOISE = 0.3  # CIELAB for a px, added to mean gradients
_DRIFT = (
    10.0  # CIELAB, the range of a drift that light has on one flat surface; more is a fold, a turn or another one
)
_PASSES = 8  # of its robust fit
_TERMS = 6  # of a quadratic
_SLIGHT = 3.0  # deviation of colours, CIELAB, below which parts do not differ: plain plaster


def evenness(lab: Float32[np.ndarray, "h w 3"], shown: Mask, least: float, slight: float = 1e-3) -> float:
    """How alike blocks are in their mean colours and mean gradients: 1 where all are equal, 0 where nothing tells.

    Parameters
    ----------
    least : share of a block that has to be shown for it to count.
    slight : deviation of all colours, CIELAB, that counts at least.
    """
    import cv2

    lightness = np.where(shown, lab[..., 0], lab[shown][:, 0].mean())
    slopes = [np.abs(slope) / 32 for slope in gradients(lightness)]
    # A slope at the border of what is shown is none of the surface's.
    inner = cv2.erode(shown.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1) > 0
    means = []
    for rows in np.array_split(np.arange(len(shown)), _BLOCKS):
        for columns in np.array_split(np.arange(shown.shape[1]), _BLOCKS):
            block = np.ix_(rows, columns)
            inside = inner[block]
            if inside.any() and shown[block].mean() >= least:
                colors = lab[block][inside].mean(axis=0).tolist()
                means.append([*colors, *(float(slope[block][inside].mean()) + _NOISE for slope in slopes)])
    table = np.array(means)
    if len(table) < _BLOCKS:
        return 0.0
    total = max(float(lab[shown].var(axis=0).sum()), slight**2)
    between = float(table[:, :3].var(axis=0).sum()) / total
    return max(0.0, 1 - between) * float(exp(-log(table[:, 3:]).std(axis=0).mean()))


def without_drift(lab: Float32[np.ndarray, "h w 3"], shown: Mask) -> Float32[np.ndarray, "h w 3"]:
    """A surface without its slow drift of light, where that is slight; else as it is.

    The drift is a quadratic in both coordinates, fitted robustly to each channel: light from the sky and from the
    ground differ in colour. One of a wide range is none of light on a flat surface, and stays.

    Parameters
    ----------
    shown : where it counts.
    """
    height, width = shown.shape
    if shown.sum() < 4 * _TERMS:
        return lab
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    terms = np.stack([np.ones_like(x), y, x, y * y, x * x, x * y], axis=2)
    some, colors = terms[shown], lab[shown].astype(np.float64)
    weights = np.ones((len(some), 1))
    fitted = np.zeros((_TERMS, 3))
    for _ in range(_PASSES):
        fitted = np.stack([least_squares(some * weights, plane) for plane in (colors * weights).T], axis=1)
        rest = np.sqrt(np.square(colors - matrix_product(some, fitted)).sum(axis=1, keepdims=True))
        weights = 1 / np.sqrt(1 + np.square(rest / (2 * np.median(rest) + _NOISE)))
    drift = matrix_product(some, fitted)
    if float(np.ptp(drift, axis=0).max()) > _DRIFT:
        return lab
    even = lab.copy()
    even[shown] -= (drift - np.median(drift, axis=0)).astype(np.float32)
    return even


def picture_evenness(image: Image, usable: Mask, least: float = 0.3) -> float:
    """The `evenness` of what is usable of a picture, without slight drift of light; see there."""
    lab, shown = reduced_surface(image, usable, _SIDE)
    return evenness(without_drift(lab, shown), shown, least, _SLIGHT) if shown.any() else 0.0
