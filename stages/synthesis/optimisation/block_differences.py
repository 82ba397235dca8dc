"""Differences of a block to every place of an exemplar, by means over squares."""

import numpy as np


def square_means(planes: np.ndarray, corner: np.ndarray, size: np.ndarray, square: int) -> np.ndarray:
    """Means over the squares of ``square`` px that fit into ``size``, counted from ``corner``."""
    import cv2

    height, width = (int(side) // square for side in size)
    region = planes[corner[0] :, corner[1] :][: height * square, : width * square]
    return np.asarray(cv2.resize(region, (width, height), interpolation=cv2.INTER_AREA))


def with_squares(planes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Planes, and the sums of their squares, as `differences` takes them."""
    return planes, (planes**2).sum(axis=2)


def differences(planes: np.ndarray, squares: np.ndarray, template: np.ndarray, filled: np.ndarray) -> np.ndarray:
    """Mean squared difference of a template, where it is ``filled``, at every place of up to four planes."""
    import cv2

    # OpenCV's masked difference correlates the squares of each channel.
    weights = filled.astype(np.float32)
    weighted = template * weights[..., None]
    errors = cv2.matchTemplate(squares, weights, cv2.TM_CCORR)
    errors += (weighted * template).sum() - 2 * cv2.matchTemplate(planes, weighted, cv2.TM_CCORR)
    return np.asarray(errors / weights.sum())


def plane_means(planes: np.ndarray, corner: np.ndarray, size: np.ndarray, square: int) -> np.ndarray:
    """`square_means` of any number of planes, one or more."""
    return np.stack([square_means(plane, corner, size, square) for plane in np.moveaxis(planes, 2, 0)], axis=2)
