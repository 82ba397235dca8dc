"""Layouts of a texture's parts: an integer a pixel, constant within a part.

Every layout draws on a square canvas of ``side`` pixels; its parts are about ``unit`` pixels large.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import cv2
import numpy as np

from benchmarks.training.fields import Array, log_uniform, octaves

Layout = Callable[[int, float, np.random.Generator], Array]


def _cells_of(points: Array, side: int) -> Array:
    """The nearest of ``points`` (row, column) for every pixel."""
    seeds = np.ones((side, side), np.uint8)
    inside = np.clip(points, 0, side - 1).astype(int)
    seeds[inside[:, 0], inside[:, 1]] = 0
    _, labels = cv2.distanceTransformWithLabels(seeds, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
    return np.asarray(labels, np.int32)


def _grid(side: int, down: float, across: float) -> tuple[Array, Array]:
    row, column = np.indices((side, side), np.float32)
    return row / np.float32(down), column / np.float32(across)


def _numbered(row: Array, column: Array) -> Array:
    number = (np.floor(row).astype(np.int32) + 512) * 4096 + np.floor(column).astype(np.int32) + 2048
    return np.asarray(number)


def bricks(side: int, unit: float, rng: np.random.Generator) -> Array:
    """Rows of bricks, each row shifted."""
    row, column = _grid(side, unit * rng.uniform(0.4, 1.0), unit * rng.uniform(1.0, 2.5))
    count = int(row.max()) + 1
    shift = 0.5 * (np.arange(count) % 2) if rng.random() < 0.6 else rng.random(count)
    return _numbered(row, column + shift.astype(np.float32)[np.floor(row).astype(int)])


def tiles(side: int, unit: float, rng: np.random.Generator) -> Array:
    """Square, hexagonal or basket-woven tiles."""
    kind = rng.integers(3)
    row, column = _grid(side, unit, unit * rng.uniform(0.8, 1.25))
    if kind == 0:
        return _numbered(row, column)
    if kind == 1:
        rows, columns = np.mgrid[0 : side / unit * 1.16 : 1, 0 : side / unit : 1]
        points = np.stack([rows * unit * 0.866, (columns + 0.5 * (rows % 2)) * unit], axis=-1).reshape(-1, 2)
        return _cells_of(points, side)
    upright = (np.floor(row) + np.floor(column)) % 2 == 0
    pieces = int(rng.integers(2, 4))
    return np.where(upright, _numbered(row * pieces, column), _numbered(row, column * pieces) + 2**24)


def cells(side: int, unit: float, rng: np.random.Generator) -> Array:
    """Voronoi cells, nearly regular or irregular, of similar or different sizes."""
    if rng.random() < 0.5:
        steps = np.arange(0, side + unit, unit)
        points = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
        points = points + rng.uniform(-0.5, 0.5, points.shape) * unit * rng.uniform(0.3, 1.2)
    else:
        points = rng.uniform(0, side, (max(4, int((side / unit) ** 2)), 2))
    return _cells_of(points, side)


def pebbles(side: int, unit: float, rng: np.random.Generator) -> Array:
    """Overlapping round stones on a background."""
    return _scattered(side, unit, rng.uniform(1.0, 1.6), rng.uniform(0.6, 3.0), rng)


def leaves(side: int, unit: float, rng: np.random.Generator) -> Array:
    """Overlapping long or pointed shapes."""
    return _scattered(side, unit, rng.uniform(1.8, 6.0), rng.uniform(1.0, 3.5), rng, pointed=True)


def _scattered(
    side: int, unit: float, stretch: float, cover: float, rng: np.random.Generator, pointed: bool = False
) -> Array:
    ids = np.zeros((side, side), np.int32)
    area = unit**2 / (1.3 if pointed else 1.0)
    count = int(np.clip(cover * side**2 / area, 4, 6000))
    spread = rng.uniform(0.1, 0.6)
    main, turn = rng.uniform(0, np.pi), rng.choice([0.2, 3.2])
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    long, short = unit / 2 * stretch**0.5, unit / 2 / stretch**0.5
    outline = np.stack([np.sin(angles), np.cos(angles)], axis=1)
    if pointed:
        outline[:, 0] *= np.abs(outline[:, 0]) ** rng.uniform(0, 1)
    centres = rng.uniform(0, side, (count, 2))
    sizes = np.exp(rng.normal(0, spread, count))
    turns = main + rng.uniform(-turn / 2, turn / 2, count)
    dents = 1 + rng.normal(0, 0.0 if pointed else 0.05, (count, len(angles)))
    for number in range(count):
        shape = outline * (sizes[number] * dents[number])[:, None] * (short, long)
        cosine, sine = np.cos(turns[number]), np.sin(turns[number])
        across = centres[number, 1] + cosine * shape[:, 1] - sine * shape[:, 0]
        down = centres[number, 0] + sine * shape[:, 1] + cosine * shape[:, 0]
        points = np.rint(np.stack([across, down], axis=1)).astype(np.int32)
        cv2.fillPoly(ids, [points], number + 1)
    return ids


def planks(side: int, unit: float, rng: np.random.Generator) -> Array:
    """Long boards of uneven widths, cut at uneven lengths."""
    edges = np.cumsum(rng.uniform(0.6, 1.4, int(side / unit) + 3) * unit)
    board = np.searchsorted(edges, np.arange(side)).astype(np.float32)
    length = unit * log_uniform(rng, 3, 30)
    start = rng.random(len(edges) + 1).astype(np.float32)
    column = np.arange(side, dtype=np.float32)[None, :] / np.float32(length) + start[board.astype(int)][:, None]
    return _numbered(np.broadcast_to(board[:, None], (side, side)), column)


def weave(side: int, unit: float, rng: np.random.Generator) -> Array:
    """Bands that go over and under each other."""
    row, column = _grid(side, unit, unit * rng.uniform(0.7, 1.4))
    float_length = int(rng.integers(1, 3))  # how many bands one goes over
    across = (np.floor(row) + np.floor(column)) // float_length % 2 == 0
    hole = rng.uniform(0, 0.15)
    middle_row, middle_column = np.abs(row % 1 - 0.5), np.abs(column % 1 - 0.5)
    # A band on top is narrower than its cell; beside it the band below shows, beside both the ground.
    on_row, on_column = middle_row < 0.5 - hole, middle_column < 0.5 - hole
    bands = np.where(
        (across & on_row) | (on_row & ~on_column), np.floor(row).astype(np.int32) * 2 + 2,
        np.where(on_column, np.floor(column).astype(np.int32) * 2 + 3, 0),
    )  # fmt: skip
    return np.asarray(bands, np.int32)


def scales(side: int, unit: float, rng: np.random.Generator) -> Array:
    """Rows of round or pointed scales, each row over the one before."""
    ids = np.zeros((side, side), np.int32)
    step = unit * rng.uniform(0.35, 0.6)
    height = unit * rng.uniform(0.5, 0.9)
    pointed = rng.random() < 0.3
    number = 0
    for row in range(int(side / step) + 3, -2, -1):
        for column in range(-1, int(side / unit) + 2):
            number += 1
            centre = (round((column + 0.5 * (row % 2)) * unit), round(row * step))
            if pointed:
                corners = np.array([(-unit / 2, 0), (0, height), (unit / 2, 0), (0, -height)])
                cv2.fillPoly(ids, [np.rint(corners + centre).astype(np.int32)], number)
            else:
                cv2.ellipse(ids, centre, (round(unit / 2), round(height)), 0, 0, 360, number, -1)
    return ids


def stains(side: int, unit: float, rng: np.random.Generator) -> Array:
    """Regions where smooth noise exceeds some levels."""
    noise = octaves((side, side), unit, rng.uniform(0.2, 0.6), rng)
    levels = np.sort(rng.uniform(-1, 1.2, int(rng.integers(1, 4))))
    return np.searchsorted(levels, noise.ravel()).reshape(noise.shape).astype(np.int32)


LAYOUTS: Mapping[str, Layout] = {
    "bricks": bricks, "tiles": tiles, "cells": cells, "pebbles": pebbles, "cracks": cells, "planks": planks,
    "weave": weave, "scales": scales, "stains": stains, "leaves": leaves,
}  # fmt: skip
"""the kinds of texture; cracks are cells whose borders are visible only in places"""
