"""Draw the exemplars of ``configs/exemplars``: ``python docs/make_exemplars.py``.

A brick wall, seen from the front and evenly lit, as a picture and as the maps of a material; and the same wall
under plaster that has come off in places, with its labels and those of another. All of it is noise and distances to
the borders of bricks, so that the pictures have the licence of the code.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage

FOLDER = Path(__file__).parents[1] / "configs" / "exemplars"
SIDE, ROWS, COLUMNS = 640, 10, 5  # px; bricks down and across
JOINT, CORNER = 11.0, 6.0  # px: width of the joints, radius of a brick's corners
WINDOW = np.s_[41:553, 27:539]  # of the wall, which repeats; the exemplar does not
MAPS_WINDOW = np.s_[41:425, 27:411]
PLASTER_WINDOW = np.s_[0:624, 8:632]  # of which four pixels become one
PLASTER_COLOR, BRICK_COLOR = (235, 205, 120), (170, 60, 40)  # of labels

Plane = np.ndarray
"""(SIDE, SIDE) float64"""


@dataclasses.dataclass(frozen=True)
class Wall:
    """A wall that repeats; planes, colours in linear light."""

    albedo: np.ndarray
    height: Plane
    """0..1"""
    roughness: Plane
    occlusion: Plane
    normal: np.ndarray
    """unit vectors: x right, y up, z towards the viewer"""


def smooth(rng: np.random.Generator, scale: float) -> Plane:
    """Smooth noise that repeats, with mean 0 and deviation 1; ``scale`` in px."""
    noise = ndimage.gaussian_filter(rng.normal(size=(SIDE, SIDE)), scale, mode="wrap")
    return np.asarray((noise - noise.mean()) / noise.std())


def layered(rng: np.random.Generator, scales: tuple[float, ...], fall: float) -> Plane:
    """Noise of several scales, each weaker by ``fall`` than the one before."""
    noise = np.sum([smooth(rng, scale) * fall**level for level, scale in enumerate(scales)], axis=0)
    return np.asarray(noise / noise.std())


def above(noise: Plane, threshold: float) -> Plane:
    """What exceeds a threshold: sparse spots."""
    return np.clip(noise - threshold, 0, None)


def laid(rng: np.random.Generator) -> tuple[Plane, tuple[np.ndarray, np.ndarray]]:
    """Distance of each pixel to the border of its brick, px, positive inside, and the brick's row and column."""
    y, x = np.mgrid[:SIDE, :SIDE].astype(float)
    x += 0.8 * smooth(rng, 8) + 0.35 * smooth(rng, 3)
    y += 0.8 * smooth(rng, 8) + 0.35 * smooth(rng, 3)
    height, width = SIDE / ROWS, SIDE / COLUMNS
    row = np.floor(y / height).astype(int) % ROWS
    x += row % 2 * width / 2
    brick = row, np.floor(x / width).astype(int) % COLUMNS

    def each(low: float, high: float) -> Plane:
        return rng.uniform(low, high, (ROWS, COLUMNS))[brick]

    # laid by hand: each a little off its place, turned, and smaller or larger
    across, down = x % width - width / 2 - each(-2.5, 2.5), y % height - height / 2 - each(-1.5, 1.5)
    turn = each(-0.014, 0.014)
    across, down = across + turn * down, down - turn * across
    right = np.abs(across) - (width - JOINT) / 2 - each(-2.0, 1.5) + CORNER
    below = np.abs(down) - (height - JOINT) / 2 - each(-1.2, 1.0) + CORNER
    outside = np.hypot(np.maximum(right, 0), np.maximum(below, 0)) + np.minimum(np.maximum(right, below), 0)
    rough = 0.7 * layered(rng, (5, 2.5, 1.3), 0.6) - 1.6 * np.minimum(above(smooth(rng, 5), 1.7), 1.2)
    return CORNER - outside + rough, brick


def wall(seed: int) -> Wall:
    """Draw the wall."""
    rng = np.random.default_rng(seed)
    inside, brick = laid(rng)
    share = np.clip(inside / 1.6 + 0.5, 0, 1)  # of brick in a pixel

    def mixed(of_bricks: np.ndarray, of_joints: np.ndarray) -> np.ndarray:
        weight = share[..., None] if of_bricks.ndim == 3 else share
        return weight * of_bricks + (1 - weight) * of_joints

    def each(low: float, high: float) -> Plane:
        return rng.uniform(low, high, (ROWS, COLUMNS))[brick]

    # -- height: rounded bricks with pits, sunken joints
    pits = above(smooth(rng, 1.6), 1.9) + 0.6 * above(smooth(rng, 3.2), 2.0)
    rounded = 0.25 + 0.6 * (1 - np.exp(-np.maximum(inside, 0) / 3)) + each(-0.04, 0.04)
    raised = rounded + 0.035 * layered(rng, (24, 12, 6, 3, 1.5), 0.6) - 0.16 * pits
    height = np.clip(mixed(raised, 0.14 + 0.03 * layered(rng, (10, 4, 1.5, 0.8), 0.9)), 0, 1)

    # -- colour: fired bricks, some burnt, some pale; grain, specks, pits and a little efflorescence
    tone, hue, kind = (
        rng.normal(size=(ROWS, COLUMNS)),
        rng.normal(size=(ROWS, COLUMNS)),
        rng.random((ROWS, COLUMNS)),
    )
    fired = np.array([0.33, 0.128, 0.078]) * np.exp(0.2 * tone[..., None] + hue[..., None] * [-0.03, 0.10, 0.16])
    fired[kind < 0.14] *= [0.50, 0.56, 0.68]
    fired[kind > 0.88] *= [1.18, 1.35, 1.30]
    grain = layered(rng, (14, 6, 2, 0.8), 0.85)
    specks, spots = above(smooth(rng, 1.1), 1.7), np.minimum(above(smooth(rng, 1.4), 1.6), 1.6)
    edge = np.exp(-np.maximum(inside, 0) / 5)
    clay = fired[brick] * np.exp(0.1 * grain - 0.25 * edge)[..., None]
    clay = (clay + specks[..., None] * [0.10, 0.075, 0.055]) * (1 - 0.38 * spots)[..., None]
    salt = 0.13 * np.minimum(above(layered(rng, (30, 14, 5), 0.7), 1.0), 1.5)[..., None]
    clay = clay * (1 - salt) + salt * [0.50, 0.45, 0.40]
    mortar_grain = layered(rng, (12, 4, 1.2, 0.7), 0.95)
    mortar = np.exp(0.1 * mortar_grain)[..., None] * [0.43, 0.40, 0.35]

    roughness = mixed(0.78 + 0.03 * grain + each(-0.06, 0.06) + 0.3 * salt[..., 0], 0.93 + 0.02 * mortar_grain)
    hollow = ndimage.gaussian_filter(height, 4, mode="wrap") - height
    slope = [(np.roll(height, -1, axis) - np.roll(height, 1, axis)) * 2.5 for axis in (0, 1)]
    normal = np.stack([-slope[1], slope[0], np.ones_like(height)], axis=-1)
    return Wall(
        np.clip(mixed(clay, mortar), 0, 1),
        height,
        np.clip(roughness, 0, 1),
        np.clip(1 - 0.9 * np.maximum(hollow, 0), 0.4, 1),
        normal / np.linalg.norm(normal, axis=-1, keepdims=True),
    )


def plastered(drawn: Wall, seed: int) -> tuple[Wall, np.ndarray]:
    """The wall under plaster that has come off in places, and where it is left."""
    rng = np.random.default_rng(seed)
    edge = smooth(rng, 40) + 0.22 * smooth(rng, 9) + 0.1 * smooth(rng, 3) + 0.15
    inside = edge / np.hypot(*np.gradient(smooth(np.random.default_rng(seed), 40))).mean() / 1.5  # px, about
    cover = np.clip(inside + 0.5, 0, 1)
    rounded = 1 - np.exp(-np.maximum(inside, 0) / 2.5)
    grain, waves = layered(rng, (2.2, 1.1, 0.7), 0.8), layered(rng, (60, 25, 10), 0.7)
    height = (1 - cover) * drawn.height + cover * (1.1 + 0.7 * rounded + 0.02 * grain + 0.04 * waves)
    pale = np.array([0.62, 0.53, 0.37]) * np.exp(0.05 * waves + 0.035 * grain)[..., None]
    stain = np.clip(layered(rng, (35, 12, 4), 0.8) - 0.6, 0, 1.5)[..., None]
    pale = pale * (1 - 0.25 * stain) * (1 - 0.3 * np.exp(-np.maximum(inside, 0) / 6))[..., None]
    shadow = 1 - 0.5 * np.exp(inside / 5) * (inside < 0)
    albedo = (1 - cover[..., None]) * drawn.albedo * shadow[..., None] + cover[..., None] * pale
    hollow = ndimage.gaussian_filter(height, 4, mode="wrap") - height
    slope = [(np.roll(height, -1, axis) - np.roll(height, 1, axis)) * 2.0 for axis in (0, 1)]
    normal = np.stack([-slope[1], slope[0], np.ones_like(height)], axis=-1)
    wall = dataclasses.replace(
        drawn,
        albedo=np.clip(albedo, 0, 1),
        height=height,
        occlusion=np.clip(1 - 0.6 * np.maximum(hollow, 0), 0.4, 1),
        normal=normal / np.linalg.norm(normal, axis=-1, keepdims=True),
    )
    return wall, inside > 0


def painted(is_plaster: np.ndarray) -> np.ndarray:
    """A label picture, 0..1."""
    return np.where(is_plaster[..., None], PLASTER_COLOR, BRICK_COLOR) / 255


def target(side: int) -> np.ndarray:
    """Where plaster is to be left: all but an arch, and a strip along the ground."""
    row, column = np.mgrid[:side, :side] / side
    arch = (np.abs(column - 0.5) < 0.2) & (row > 0.4) | (np.hypot(row - 0.4, column - 0.5) < 0.2)
    ground = row > 0.82 + 0.03 * np.sin(14 * column)
    return ~(arch | ground)


def halved(values: np.ndarray) -> np.ndarray:
    """Means of 2x2 pixels."""
    return np.asarray(values.reshape(values.shape[0] // 2, 2, values.shape[1] // 2, 2, -1).mean(axis=(1, 3)))


def lit(drawn: Wall) -> np.ndarray:
    """A photograph of the wall: light from the upper left, and from all around."""
    light = np.array([-0.28, 0.42, 0.86])
    direct = np.clip(drawn.normal @ (light / np.linalg.norm(light)), 0, None)
    return drawn.albedo * (0.47 * drawn.occlusion + 0.69 * direct)[..., None]


def save(name: str, values: np.ndarray, is_color: bool = False) -> None:
    """Write values 0..1, colours as sRGB."""
    if is_color:
        values = np.where(values <= 0.0031308, 12.92 * values, 1.055 * np.clip(values, 0, 1) ** (1 / 2.4) - 0.055)
    path = FOLDER / name
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)).save(path, optimize=True)


def main() -> None:
    """Write the pictures."""
    drawn = wall(1)
    save("bricks.png", lit(drawn)[WINDOW], is_color=True)
    save("brick_maps/bricks_albedo.png", drawn.albedo[MAPS_WINDOW], is_color=True)
    save("brick_maps/bricks_normal.png", drawn.normal[MAPS_WINDOW] / 2 + 0.5)
    save("brick_maps/bricks_height.png", drawn.height[MAPS_WINDOW])
    save("brick_maps/bricks_roughness.png", drawn.roughness[MAPS_WINDOW])
    old, is_plaster = plastered(drawn, 5)
    save("plaster.png", halved(lit(old)[PLASTER_WINDOW]), is_color=True)
    save("plaster_labels.png", halved(painted(is_plaster[PLASTER_WINDOW])))
    save("plaster_target.png", painted(target(384)))


if __name__ == "__main__":
    main()
