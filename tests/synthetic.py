"""Exemplars whose lattice is known, and the difference of two lattices."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from texloom.stages.vocabulary.arrays import Image

LATTICES: dict[str, np.ndarray] = {
    "rectangular": np.array([[40.0, 0.0], [0.0, 56.0]]),
    "half_drop": np.array([[44.0, 30.0], [0.0, 60.0]]),
    "hexagonal": np.array([[0.0, 48.0], [24 * np.sqrt(3), 24.0]]),
    "sheared": np.array([[38.0, 11.0], [-6.0, 52.0]]),
}
"""generators, px, in rows"""


def picture(pixels: np.ndarray) -> Image:
    """A grey (h, w) or colour (h, w, 3) array as linear light."""
    pixels = np.ascontiguousarray(np.atleast_3d(pixels), np.float32)
    return Image(pixels, ("Y",) if pixels.shape[2] == 1 else ("R", "G", "B"))


def smooth_noise(shape: tuple[int, ...], sigma: float, rng: np.random.Generator) -> np.ndarray:
    """Noise in 0..1 whose blobs are about ``sigma`` px wide."""
    import cv2

    noise = cv2.GaussianBlur(rng.normal(size=shape), (0, 0), sigma)
    return (noise - noise.min()) / np.ptp(noise)


def blobs(shape: tuple[int, ...], rng: np.random.Generator, sigma: float = 2.5) -> np.ndarray:
    """Smooth noise with sharp borders, 0.02 to 1."""
    return np.clip(4 * smooth_noise(shape, sigma, rng) - 1.5, 0.02, 1)


def spots(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Spots of a few px with soft borders, 0..1, ever more to the right."""
    density = np.linspace(0, 1, shape[1])
    return np.asarray(np.clip(4 * (smooth_noise(shape, 1.5, rng) + density - 1) + 0.5, 0, 1))


def masked(image: Image, usable: np.ndarray, value: float) -> Image:
    """``image`` with ``value`` in the pixels that are not ``usable``, which a further channel marks."""
    pixels = np.where(usable[..., None], image.pixels, np.float32(value))
    return Image(np.concatenate([pixels, usable[..., None]], axis=2, dtype=np.float32), (*image.channels, "usable"))


def identity(shape: tuple[int, int]) -> np.ndarray:
    """A correspondence in which every pixel is its own source."""
    return np.ascontiguousarray(np.moveaxis(np.indices(shape, np.uint32), 0, 2))


def points(generators: np.ndarray, shape: tuple[int, int], origin: np.ndarray) -> np.ndarray:
    """All lattice points, (n, 2), less than a cell beyond a picture of ``shape``."""
    reach = range(-64, 65)
    steps = np.array([(i, j) for i in reach for j in reach])
    places = steps @ generators + origin
    beyond = np.hypot(*generators.T).max()
    return places[((places > -beyond) & (places < np.array(shape) + beyond)).all(axis=1)]


def stamped(
    generators: np.ndarray,
    rng: np.random.Generator,
    shape: tuple[int, int] = (288, 320),
    jitter: float = 0.0,
) -> Image:
    """A round textured motif at every lattice point on a noisy ground.

    Parameters
    ----------
    jitter : how far a motif may stand from its point in each axis, as a share of the shorter generator.
    """
    import cv2

    radius = 0.48 * np.hypot(*generators.T).min()
    side = 2 * int(np.ceil(radius)) + 1
    motif = np.stack([smooth_noise((side, side), 2.0, rng) for _ in range(3)], axis=2)
    distance = np.hypot(*(np.indices((side, side)) - side // 2))
    cover = np.clip(radius - distance, 0, 1)

    spread = jitter * np.hypot(*generators.T).min()
    pixels = np.full((*shape, 3), 0.4)
    for centre in points(generators, shape, rng.uniform(0, 40, 2)):
        corner = centre + rng.uniform(-spread, spread, 2) - side // 2
        first = np.maximum(np.floor(corner).astype(int) - 1, 0)
        (top, left), (bottom, right) = first, np.minimum(np.floor(corner).astype(int) + side + 2, shape)
        if bottom > top and right > left:
            under = pixels[top:bottom, left:right]
            # between pixels, as lattices have it
            to = np.array([[1, 0, corner[1] - left], [0, 1, corner[0] - top]])
            alpha = cv2.warpAffine(cover, to, under.shape[1::-1])[..., None]
            under += alpha * (cv2.warpAffine(motif, to, under.shape[1::-1]) - under)
    return picture(np.clip(pixels + rng.normal(0, 0.03, pixels.shape), 0, 1))


def tiled(cell: np.ndarray, drop: int, shape: tuple[int, int]) -> tuple[Image, np.ndarray]:
    """``cell`` (p, q, c) over and over, each row of cells ``drop`` px right of the last; its generators."""
    height, width = cell.shape[:2]
    row, column = np.indices(shape)
    pixels = cell[row % height, (column - row // height * drop) % width]
    return picture(pixels), np.array([[height, drop], [0, width]], np.float32)


def difference(measured: np.ndarray, true: np.ndarray) -> float:
    """How far ``measured`` is from generators of the lattice ``true``, px; infinite if it is coarser or finer."""
    if measured.shape != (2, 2):
        return np.inf
    steps = np.rint(measured @ np.linalg.inv(true))
    if abs(abs(np.linalg.det(steps)) - 1) > 1e-6:
        return np.inf
    return float(np.hypot(*(measured - steps @ true).T).max())


def bent(
    generators: np.ndarray, rng: np.random.Generator, height: float = 3.0
) -> tuple[Image, Callable[[np.ndarray], np.ndarray]]:
    """A picture as `stamped` whose lattice is bent, and how far places (n, 2) of the straight one have moved."""
    import cv2

    straight = stamped(generators, rng)
    sides = np.array([straight.height, straight.width])

    def field(places: np.ndarray) -> np.ndarray:
        row, column = (2 * np.pi * places / sides).T
        return height * np.stack([np.sin(column + 0.5 * row), np.cos(row - 0.3 * column)], axis=1)

    grid = np.moveaxis(np.indices(sides), 0, -1).reshape(-1, 2).astype(float)
    before = grid
    for _ in range(20):
        before = grid - field(before)
    maps = before.astype(np.float32).reshape(*sides, 2)
    pixels = cv2.remap(straight.pixels, maps[..., 1], maps[..., 0], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return picture(np.clip(pixels, 0, 1)), field


def continued(cell: np.ndarray, drop: int, match: np.ndarray) -> np.ndarray:
    """Pixels of a result that goes on as `tiled` does from where its first pixel comes from.

    Parameters
    ----------
    match : (H, W, 2), where the result's pixels come from.
    """
    row, column = np.indices(match.shape[:2]) + match[0, 0].astype(int)[:, None, None]
    whole, _ = tiled(cell, drop, (int(row.max()) + 1, int(column.max()) + 1))
    return np.asarray(whole.pixels[row, column])


def jump(pixels: np.ndarray) -> float:
    """Differences across a result's borders by those between neighbours inside."""
    wraps = [np.abs(pixels.take([0], axis) - pixels.take([-1], axis)).mean() for axis in (0, 1)]
    inside = [np.abs(np.diff(pixels, axis=axis)).mean() for axis in (0, 1)]
    return float(sum(wraps) / sum(inside))


def wall(shape: tuple[int, int], period: float, degrees: float, rng: np.random.Generator) -> Image:
    """Bricks of random lengths and tones in courses of ``period`` px, with dark joints.

    Parameters
    ----------
    degrees : by which the step from course to course is turned from downwards.
    """
    angle = np.radians(degrees)
    row, column = np.indices(shape)
    across = row * np.cos(angle) + column * np.sin(angle) + 4096 * period
    along = column * np.cos(angle) - row * np.sin(angle)
    course = (across // period).astype(int)
    inside = across - course * period
    course -= course.min()
    tone = np.zeros(shape)
    for number in range(course.max() + 1):
        ends = np.cumsum(rng.uniform(1.2, 3, 400)) * period - 2 * max(shape)
        own = course == number
        brick = np.searchsorted(ends, along[own])
        joint = along[own] - ends[brick - 1] < 0.12 * period
        tone[own] = np.where(joint, 0.1, rng.uniform(0.4, 0.7, 401)[brick])
    tone[inside < 0.12 * period] = 0.1
    return picture(np.clip(tone + 0.1 * smooth_noise(shape, 1.5, rng), 0, 1))


def tiles(rng: np.random.Generator) -> np.ndarray:
    """Six by six square tiles of 20 px with dark joints, as a picture of a file has them."""
    y, x = np.indices((120, 120))
    joint = ((y % 20) < 3) | ((x % 20) < 3)
    tones = 0.6 + 0.1 * rng.random((6, 6))[y // 20, x // 20] + 0.05 * blobs((120, 120), rng)
    shown = np.clip(np.where(joint, 0.15, tones), 0, 1)
    return np.asarray(np.rint(shown[..., None] * (255, 230, 200)), np.uint8)


def soiled_wall(rng: np.random.Generator) -> tuple[Image, Image, np.ndarray]:
    """Bricks under smooth dirt, put together of two crops that are out of step; the dirt; where pixels come from.

    Bricks are 24 x 16 px with joints of 3 px, every other course by half a brick to the side; see `WALL`.
    """
    down, across = np.indices((96, 200))
    course = down // 16
    joint = (down % 16 < 3) | ((across + 12 * (course % 2)) % 24 < 3)
    dirt = smooth_noise(joint.shape, 10, rng)
    bricks = np.where(joint[..., None], 0.6, [0.3, 0.1, 0.06]) * (0.9 + 0.2 * rng.random((96, 200, 1)))
    wall = bricks * (1 - 0.8 * dirt[..., None]) + 0.8 * dirt[..., None] * [0.05, 0.06, 0.02]
    columns = np.concatenate([np.arange(48), np.arange(101, 149)])
    source = np.stack(np.meshgrid(np.arange(96), columns, indexing="ij"), axis=2).astype(np.uint32)
    control = Image(np.ascontiguousarray(dirt[:, columns, None], np.float32), ("dirt",))
    return picture(wall[:, columns]), control, source


WALL = np.array([[16, 12], [16, -12]], np.float32)
"""generators of `soiled_wall`"""


def in_step(source: np.ndarray, generators: np.ndarray) -> float:
    """How alike the phases of a result's pixels are in the texture that they come from, less their own; 0..1."""
    away = (source - np.indices(source.shape[:2]).transpose(1, 2, 0)) @ np.linalg.inv(generators)
    return float(np.abs(np.exp(2j * np.pi * away).mean(axis=(0, 1))).min())
