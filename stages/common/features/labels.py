"""Label pictures: their few colours, and the label of every pixel despite compression and antialiased borders."""

import itertools

import numpy as np
from jaxtyping import Float32, UInt8

from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.vocabulary.arrays import Mask
from texloom.stages.vocabulary.masks import nearest_valid

MAX_LABELS = 16
"""a picture with more colours is one of values"""

_RADIUS = 20.0 / 255  # of a label's colours about the middle one, in the largest channel
_MAX_SPREAD = 8.0 / 255  # root mean square of the differences of a label's flat pixels from its colour
_MIN_SHARE = 0.002  # of a label among the flat pixels
_MIN_COVER = 0.97  # share of the flat pixels that belong to labels
_MIN_FLAT = 0.3  # share of the pixels that are flat
_SAMPLES = 1 << 16  # flat pixels from which the colours are found
_SLACK = 48.0 / 255  # from a label's colour to the same one in another picture, in the largest channel


def label_colors(
    values: Float32[np.ndarray, "h w c"], valid: Mask | None = None
) -> Float32[np.ndarray, "n c"] | None:
    """The colours of a label picture, most frequent first; None if it is a picture of values.

    A picture has labels if most of it is flat and its flat pixels have few colours. Pixels at borders, between two
    labels, do not count.

    Parameters
    ----------
    values : as painted, 0..1.
    valid : the pixels that count; None counts all.
    """
    flat = _flat(values)
    if valid is not None:
        flat &= valid
    total = values.shape[0] * values.shape[1] if valid is None else int(valid.sum())
    rest = values[flat]
    if len(rest) < _MIN_FLAT * total:
        return None
    rest = rest[:: max(1, len(rest) // _SAMPLES)]
    count = len(rest)
    colors: list[np.ndarray] = []
    while len(rest) and len(colors) < MAX_LABELS:
        near = np.abs(rest - _mode(rest)).max(axis=1) <= _RADIUS
        own = rest[near]
        if len(own) < _MIN_SHARE * count:
            break
        color = np.median(own, axis=0)
        if np.sqrt(((own - color) ** 2).mean(axis=0).max()) > _MAX_SPREAD:
            return None
        colors.append(color)
        rest = rest[~near]
    if len(colors) < 2 or len(rest) > (1 - _MIN_COVER) * count:
        return None
    return np.array(colors, np.float32)


def _flat(values: Float32[np.ndarray, "h w c"]) -> Mask:
    """Pixels whose 3x3 neighbourhood differs little."""
    import cv2

    square = np.ones((3, 3), np.uint8)
    flat = np.ones(values.shape[:2], bool)
    for plane in np.ascontiguousarray(np.moveaxis(values, 2, 0)):
        flat &= cv2.dilate(plane, square) - cv2.erode(plane, square) <= _RADIUS
    return flat


def _mode(values: Float32[np.ndarray, "n c"]) -> Float32[np.ndarray, "c"]:  # type: ignore[name-defined]
    """The most frequent colour, as the median of the fullest cell of a grid."""
    cells = np.floor(values * (255 / 16)).astype(np.int64)
    _, cell, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(np.median(values[cell.ravel() == counts.argmax()], axis=0), np.float32)


def assign_labels(
    values: Float32[np.ndarray, "h w c"], colors: Float32[np.ndarray, "n c"]
) -> UInt8[np.ndarray, "h w"]:
    """The label of every pixel: of the nearest colour, or of the nearest pixel where no colour is near.

    The same goes for thin lines between two labels of which a third one's colour is a mixture.
    """
    import cv2

    differences = np.stack([np.abs(values - color).max(axis=2) for color in colors])
    labels = differences.argmin(axis=0).astype(np.uint8)
    sure = differences.min(axis=0) <= _RADIUS
    own = [(sure & (labels == label)).astype(np.uint8) for label in range(len(colors))]
    near = [cv2.dilate(plane, np.ones((5, 5), np.uint8)) == 1 for plane in own]
    for label, first, second in itertools.permutations(range(len(colors)), 3):
        if first < second and _is_mixture(colors[label], colors[first], colors[second]):
            padded = cv2.copyMakeBorder(own[label], 2, 2, 2, 2, cv2.BORDER_REPLICATE)
            thick = cv2.morphologyEx(padded, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))[2:-2, 2:-2]
            sure &= (own[label] == 0) | (thick == 1) | ~near[first] | ~near[second]
    if not sure.any():
        return labels
    row, column = nearest_valid(sure)
    return np.ascontiguousarray(labels[row, column])


def _is_mixture(color: np.ndarray, first: np.ndarray, second: np.ndarray) -> bool:
    step = second - first
    share = np.clip(matrix_product(color - first, step) / matrix_product(step, step), 0, 1)
    return bool(np.abs(first + share * step - color).max() <= 2 * _RADIUS)


def unknown_color(
    colors: Float32[np.ndarray, "n c"], known: Float32[np.ndarray, "m c"]
) -> Float32[np.ndarray, "c"] | None:  # type: ignore[name-defined]
    """The first of ``colors`` that is none of ``known``; None if there is none."""
    for color in colors:
        if np.abs(known - color).max(axis=1).min() > _SLACK:
            return color
    return None


def simplex(count: int) -> Float32[np.ndarray, "n k"]:
    """Points of ``count`` labels in one dimension less, each at distance 1 from all others."""
    points = np.zeros((count, max(1, count - 1)))
    for axis in range(count - 1):
        points[: axis + 1, axis] = 1
        points[axis + 1, axis] = -(axis + 1)
        points[:, axis] /= np.sqrt(2 * (axis + 1) * (axis + 2))
    return points.astype(np.float32)
