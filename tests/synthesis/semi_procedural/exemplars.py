"""Walls to lay without end."""

from __future__ import annotations

import functools
import itertools

import numpy as np

from tests.synthetic import smooth_noise
from texloom.stages.synthesis.semi_procedural.cell_texture import CellTexture, CellTextureParams, cell_texture
from texloom.stages.synthesis.semi_procedural.cell_tiling import CellTiling
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.normals import NORMAL

HEIGHT, WIDTH = 24, 40  # px of a brick with its joints
GENERATORS = np.array([[HEIGHT, WIDTH / 2], [0, WIDTH]], np.float32)


def wall(phases: np.ndarray | None = None, side: int = 216) -> Image:
    """Bricks with tones of their own in light mortar, with normals and roughness.

    ``phases``: of each course, px; the bond is regular without.
    """
    rng = np.random.default_rng(6)
    rows, columns = np.indices((side, side))
    course, y = np.divmod(rows, HEIGHT)
    along = columns + (course % 2 * WIDTH // 2 if phases is None else phases[course])
    number, x = np.divmod(along, WIDTH)
    tones = rng.uniform(0.15, 0.4, (side, side))[course, number]
    mortar = (y < 3) | (x < 3)
    grain = 0.03 * smooth_noise((side, side), 1.0, rng).astype(np.float64)
    light = np.where(mortar, 0.7, tones) + grain
    color = np.stack([light, 0.7 * light, 0.5 * light], axis=2)
    slopes = np.stack(np.gradient(np.where(mortar, 0.0, 1.0))[::-1], axis=2)
    vectors = np.concatenate([-slopes, np.ones((side, side, 1))], axis=2) * (1, -1, 1)
    vectors /= np.sqrt(np.square(vectors).sum(axis=2, keepdims=True))
    planes = np.concatenate([color, vectors, np.where(mortar, 0.9, 0.4)[..., None]], axis=2)
    return Image(np.maximum(planes, -1).astype(np.float32), ("R", "G", "B", *NORMAL, "roughness"))


def uneven_wall(side: int = 264) -> tuple[Image, list[np.ndarray]]:
    """Blocks of 25 to 54 px with tones of their own in light mortar, and where those of each course begin."""
    rng = np.random.default_rng(9)
    light, begins = np.full((side, side), 0.7), []
    for top in range(0, side, HEIGHT):
        ends = np.cumsum(rng.integers(25, 55, side // 25 + 3)) - 60
        for left, right in itertools.pairwise(ends):
            light[top + 3 : top + HEIGHT, max(0, left + 3) : max(0, right)] = rng.uniform(0.15, 0.4)
        begins.append(ends)
    light += 0.02 * smooth_noise((side, side), 1.0, rng)
    return Image(np.repeat(light[..., None], 3, axis=2).astype(np.float32), ("R", "G", "B")), begins


def lattice(generators: np.ndarray = GENERATORS, side: int = 216) -> tuple[np.ndarray, np.ndarray]:
    """Steps and positions of all vertices in and around the exemplar, which lie in the middle of bricks."""
    steps = (np.moveaxis(np.indices((14, 24)), 0, -1) - (2, 12)).reshape(-1, 2)
    places = steps @ generators + (HEIGHT / 2, WIDTH / 2)
    near = ((places > -HEIGHT) & (places < side + HEIGHT)).all(axis=1)
    return steps[near].astype(np.int32), places[near].astype(np.float32)


@functools.cache
def wall_made() -> tuple[CellTexture, CellTiling]:
    """Of the wall with a regular bond."""
    return made(wall())


def made(image: Image, **params: float) -> tuple[CellTexture, CellTiling]:
    steps, vertices = lattice()
    texture = cell_texture(image, GENERATORS, steps, vertices, CellTextureParams(**params))
    return texture, CellTiling.of(texture.image, texture.window, texture.layout)


@functools.cache
def made_of_courses() -> tuple[CellTexture, CellTiling]:
    """Of a wall whose courses have phases of their own."""
    phases = np.array([0, 23, 9, 31, 15, 36, 4, 27, 12])
    frame = np.array([[HEIGHT, 0], [0, 2 * HEIGHT]], np.float32)
    steps, vertices = lattice(frame)
    texture = cell_texture(wall(phases), frame, steps, vertices, CellTextureParams(), courses=True)
    return texture, CellTiling.of(texture.image, texture.window, texture.layout)
