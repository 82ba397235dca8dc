"""How well foreign parts of surfaces are found, and how much of clean exemplars is taken for foreign.

    python -m benchmarks.foreign_parts [FOLDER...]

Scenes of walls, plaster and pebbles get a door, a pipe, windows, a sign of another texture, or a strip of sky.
Printed are, for each, precision and recall of the proposed mask, and the intersection over the union with the true
one; then the share masked of the clean scenes, and of the pictures of each FOLDER, of which nothing is foreign.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from texloom.pipelines.media.sources import open_source
from texloom.stages.analysis.photographs.foreign_parts import ForeignPartsParams, foreign_parts
from texloom.stages.analysis.regularity.lattice_selection import LatticeSelectionParams, lattice_selection
from texloom.stages.analysis.regularity.offset_statistics import OffsetStatisticsParams, offset_statistics
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

Picture = np.ndarray
Random = np.random.Generator


def noise(random: Random, shape: tuple[int, int], deviation: float) -> Picture:
    """Gaussian noise, blurred, of mean 0 and deviation 1."""
    plane = gaussian_blur(random.normal(size=shape), deviation, "repeat")
    return np.asarray(plane / plane.std(), np.float32)


def bricks(random: Random, side: int) -> Picture:
    """Courses in running bond, each brick of its own tone: (side, side, 3), linear."""
    high, wide = side // 12, side // 6
    rows, columns = np.indices((side, side))
    course = rows // high
    shifted = columns + (course % 2) * wide // 2
    joint = (rows % high < high // 8 + 1) | (shifted % wide < high // 8 + 1)
    tone = random.normal(1, 0.12, (side // high + 2, side // wide + 3))[course, shifted // wide]
    tone = tone * (1 + 0.06 * noise(random, (side, side), 1.0))
    brick = np.array([0.35, 0.12, 0.08]) * tone[..., None]
    mortar = np.array([0.45, 0.43, 0.4]) * (1 + 0.04 * noise(random, (side, side), 1.0))[..., None]
    return np.clip(np.where(joint[..., None], mortar, brick), 0, 1).astype(np.float32)


def plaster(random: Random, side: int) -> Picture:
    """Of several sizes of roughness, with slow stains."""
    sizes = ((0.05, 0.8), (0.05, 3.0), (0.03, 20.0))
    tone = np.sum([share * noise(random, (side, side), deviation) for share, deviation in sizes], axis=0)
    return np.asarray(np.clip(np.array([0.5, 0.46, 0.36]) * (1 + tone)[..., None], 0, 1), np.float32)


def pebbles(random: Random, side: int) -> Picture:
    """The nearest of scattered centres, each pebble of its own colour, dark between."""
    places = random.uniform(0, side, (400, 2))
    rows, columns = np.indices((side, side))
    first, second = np.full((2, side, side), np.inf)
    owner = np.zeros((side, side), int)
    for index, (row, column) in enumerate(places):
        distance = np.hypot(rows - row, columns - column)
        nearer = np.less(distance, first)
        second = np.asarray(np.where(nearer, first, np.minimum(second, distance)))
        first, owner = np.where(nearer, distance, first), np.where(nearer, index, owner)
    colors = np.array([0.3, 0.28, 0.25]) * random.uniform(0.5, 1.5, (400, 1)) * random.uniform(0.9, 1.1, (400, 3))
    shade: Picture = np.clip((second - first) / (side / 40), 0.1, 1)
    return np.asarray(np.clip(colors[owner] * shade[..., None], 0, 1), np.float32)


def with_door(_: Random, wall: Picture) -> tuple[Picture, np.ndarray]:
    """A painted door with panels."""
    side = len(wall)
    foreign = np.zeros(wall.shape[:2], bool)
    foreign[side // 3 : 5 * side // 6, side // 2 : 3 * side // 4] = True
    rows, columns = np.indices(foreign.shape)
    panel = np.logical_or(rows % (side // 5) < side // 60, columns % (side // 8) < side // 60)
    door = np.where(panel[..., None], [0.01, 0.05, 0.03], [0.02, 0.12, 0.07])
    return np.where(foreign[..., None], door, wall).astype(np.float32), foreign


def with_pipe(_: Random, wall: Picture) -> tuple[Picture, np.ndarray]:
    """A metal pipe from top to bottom."""
    side = len(wall)
    first, wide = side // 4, side // 20
    foreign = np.zeros(wall.shape[:2], bool)
    foreign[:, first : first + wide] = True
    across = np.clip((np.arange(side) - first) / wide, 0, 1)
    shade = 0.1 + 0.5 * across * (1 - across) * 4
    return np.where(foreign[..., None], np.broadcast_to(shade[None, :, None], wall.shape), wall).astype(
        np.float32
    ), foreign


def with_windows(random: Random, wall: Picture) -> tuple[Picture, np.ndarray]:
    """Three windows with white frames."""
    side = len(wall)
    foreign, frame = np.zeros((2, *wall.shape[:2]), bool)
    for row, column in ((0.15, 0.1), (0.15, 0.6), (0.6, 0.65)):
        top, left, high, wide = round(row * side), round(column * side), side // 4, side // 5
        foreign[top : top + high, left : left + wide] = frame[top : top + high, left : left + wide] = True
        for low in range(2):
            for right in range(2):
                down, across = top + side // 50 + low * high // 2, left + side // 50 + right * wide // 2
                frame[down : down + high // 2 - side // 40, across : across + wide // 2 - side // 40] = False
    glass = 0.03 + 0.02 * noise(random, foreign.shape, side / 40)
    window = np.where(frame, 0.7, np.clip(glass, 0, 1))
    return np.where(foreign[..., None], window[..., None], wall).astype(np.float32), foreign


def with_sign(_: Random, wall: Picture) -> tuple[Picture, np.ndarray]:
    """A rectangle of stripes."""
    side = len(wall)
    foreign = np.zeros(wall.shape[:2], bool)
    foreign[side // 8 : 3 * side // 8, side // 6 : side // 2] = True
    stripes = (np.indices(foreign.shape).sum(axis=0) // (side // 40) % 2)[..., None]
    return np.where(foreign[..., None], np.where(stripes, [0.6, 0.5, 0.05], [0.02, 0.02, 0.02]), wall).astype(
        np.float32
    ), foreign


def with_sky(_: Random, wall: Picture) -> tuple[Picture, np.ndarray]:
    """A strip of sky at the top."""
    side = len(wall)
    foreign = np.zeros(wall.shape[:2], bool)
    foreign[: side // 7] = True
    return np.where(foreign[..., None], [0.35, 0.5, 0.8], wall).astype(np.float32), foreign


WALLS: dict[str, Callable[[Random, int], Picture]] = {"bricks": bricks, "plaster": plaster, "pebbles": pebbles}
PARTS: dict[str, Callable[[Random, Picture], tuple[Picture, np.ndarray]]] = {
    "door": with_door,
    "pipe": with_pipe,
    "windows": with_windows,
    "sign": with_sign,
    "sky": with_sky,
}


def proposed(pixels: Picture, lattice: bool = True) -> np.ndarray:
    """What is proposed as foreign in (h, w, 3) linear light."""
    image = Image(pixels, ("R", "G", "B"))
    generators = None
    if lattice:
        density = offset_statistics(image, OffsetStatisticsParams()).density
        generators = lattice_selection(image, density, LatticeSelectionParams()).generators
    made = foreign_parts(image, ForeignPartsParams(), generators=generators)
    return np.asarray(made.mask.pixels[..., 0] < 0.5)


def agreement(found: np.ndarray, foreign: np.ndarray) -> tuple[float, float, float]:
    """Precision, recall, and intersection over union."""
    both, one, other, either = (int(mask.sum()) for mask in (found & foreign, found, foreign, found | foreign))
    return both / max(1, one), both / other, both / either


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--side", type=int, default=384, help="of the scenes, px")
    options = parser.parse_args()
    print(f"{'':18} precision  recall     IoU")
    rows = []
    for number, (wall, make) in enumerate(WALLS.items()):
        for part, put in PARTS.items():
            random = np.random.default_rng(number)
            pixels, foreign = put(random, make(random, options.side))
            rows.append(agreement(proposed(pixels), foreign))
            print(f"{wall + ', ' + part:18}" + "".join(f"{value:9.3f}" for value in rows[-1]), flush=True)
    print(f"{'mean':18}" + "".join(f"{value:9.3f}" for value in np.mean(rows, axis=0)))
    for number, (wall, make) in enumerate(WALLS.items()):
        share = proposed(make(np.random.default_rng(number), options.side)).mean()
        print(f"{wall + ', clean':18}{share:9.3f} masked", flush=True)
    for folder in options.folders:
        shares = [masked_share(path) for path in sorted(folder.iterdir()) if path.is_file()]
        some = np.count_nonzero(shares)
        print(f"{folder.name}: {np.mean(shares):.3f} masked in the mean of {len(shares)}, some in {some}")


def masked_share(path: Path) -> float:
    """Of a picture; 1 where it is refused. Printed if there is any."""
    image = open_source("picture", str(path)).read()
    try:
        share = float(proposed(np.array(np.broadcast_to(image.color, (*image.color.shape[:2], 3)))).mean())
    except InputError:
        share = 1.0
    if share:
        print(f"{path.name:40}{share:9.3f} masked", flush=True)
    return share


if __name__ == "__main__":
    main()
