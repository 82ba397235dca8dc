"""Exemplars of tiles with a colour each, between joints: which tile each pixel belongs to, 0 for joints."""

import numpy as np

from tests.synthetic import picture
from texloom.stages.vocabulary.arrays import Image


def _joints(label: np.ndarray, width: int) -> np.ndarray:
    """The labels, 0 within ``width`` px of another one."""
    import cv2

    border = np.zeros(label.shape, np.uint8)
    for axis in (0, 1):
        jump = np.argwhere(np.diff(label, axis=axis) != 0)
        border[tuple(jump.T)] = 1
    near = cv2.dilate(border, np.ones((width, width), np.uint8)) > 0
    return np.where(near, 0, label)


def hexagons(shape: tuple[int, int], side: float) -> tuple[np.ndarray, np.ndarray]:
    """Labels, and the generators of the lattice, px."""
    step = np.array([[1.5 * side, side * 3**0.5 / 2], [0.0, side * 3**0.5]])
    steps = np.moveaxis(np.indices((60, 60)), 0, -1).reshape(-1, 2) - 30
    middles = steps @ step
    near = ((middles > -2 * side) & (middles < np.array(shape) + 2 * side)).all(axis=1)
    places = np.moveaxis(np.indices(shape), 0, -1)
    away = ((places[:, :, None] - middles[near]) ** 2).sum(axis=3)
    return _joints(away.argmin(axis=2) + 1, 3), step


def herringbone(shape: tuple[int, int], width: int) -> tuple[np.ndarray, np.ndarray]:
    """Planks three times as long as wide."""
    length = 3 * width
    label = np.zeros(shape, int)
    number = 0
    rows, columns = np.indices(shape)
    for block in range(-6, 7):
        for step in range(-40, 41):
            top, left = step * width, step * width + 2 * length * block
            for plank in (
                (top, top + width, left, left + length),
                (top + width - length, top + width, left + length, left + length + width),
            ):
                number += 1
                label[(rows >= plank[0]) & (rows < plank[1]) & (columns >= plank[2]) & (columns < plank[3])] = (
                    number
                )
    return _joints(label, 3), np.array([[width, width], [length, -length]], float)


def basket_weave(shape: tuple[int, int], width: int) -> tuple[np.ndarray, np.ndarray]:
    """Squares of three planks, along and across in turn."""
    side = 3 * width
    row, column = np.indices(shape)
    block = row // side, column // side
    lies = (block[0] + block[1]) % 2 == 0
    plank = np.where(lies, row % side, column % side) // width
    return _joints(3 * (block[0] * 100 + block[1]) + plank + 1, 3), np.array([[side, side], [side, -side]], float)


def running_bond(shape: tuple[int, int], height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Bricks whose ends lie over the middles of others."""
    row, column = np.indices(shape)
    course = row // height
    label = course * 100 + (column + course % 2 * (width // 2)) // width + 1
    return _joints(label, 3), np.array([[height, width / 2], [height, -width / 2]])


def blocks(shape: tuple[int, int], height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Courses of equally long blocks of a phase of their own each."""
    row, column = np.indices(shape)
    course = row // height
    label = course * 100 + (column + rng.integers(0, width, 100)[course]) // width + 1
    return _joints(label, 3)


def painted(label: np.ndarray, rng: np.random.Generator) -> Image:
    """Each tile in a colour of its own, on bright joints."""
    colours = rng.uniform(0.05, 0.6, (int(label.max()) + 1, 3))
    colours[0] = 0.9
    return picture(colours[label] + rng.normal(0, 0.01, (*label.shape, 3)))


def mixed_share(label: np.ndarray, match: np.ndarray) -> float:
    """Share of a result's tiles, apart from small parts, that show more than 6 % of several tiles."""
    import cv2

    shown = label[match[..., 0].astype(int), match[..., 1].astype(int)]
    count, number = cv2.connectedComponents((shown > 0).astype(np.uint8), connectivity=4)
    least = 0.3 * np.median(np.bincount(number.ravel(), minlength=count)[1:])
    mixed = total = 0
    for tile in range(1, count):
        counts = np.bincount(shown[number == tile])
        if counts.sum() > least:
            total += 1
            mixed += int(counts.sum() - counts.max() > 0.06 * counts.sum())
    return mixed / total
