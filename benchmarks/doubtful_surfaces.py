"""How often a photograph is taken for a surface that it does not show, and how often a clean exemplar is doubted.

    python -m benchmarks.doubtful_surfaces FOLDER... [--first 0] [--step 2]

The pictures of the folders are exemplars: frontal, and each of one surface. Of them scenes are rendered whose truth
is known: one wall in perspective; and rooms, rows of houses, columns, domes, balls and folded cloth. Printed is for
each kind how many are taken silently, are taken with a doubt, and are refused, by the steps of `photo_material`. A
plane of which nine tenths, or nine tenths of what is not masked, lie on one flat face of the scene is right, and
not counted as taken.
"""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np

from texloom.pipelines.media.sources import open_source
from texloom.stages.analysis.photographs.foreign_parts import ForeignPartsParams, foreign_parts
from texloom.stages.analysis.photographs.jacobian_field import JacobianFieldParams, jacobian_field
from texloom.stages.analysis.photographs.patch_atlas import PatchAtlasParams, patch_atlas
from texloom.stages.analysis.photographs.plane_proposal import PlaneProposalParams, plane_proposal
from texloom.stages.analysis.regularity.lattice_selection import LatticeSelectionParams, lattice_selection
from texloom.stages.analysis.regularity.offset_statistics import OffsetStatisticsParams, offset_statistics
from texloom.stages.vocabulary.arrays import Image, Quads
from texloom.stages.vocabulary.declare import InputError

SHAPE = (360, 480)
_NOISE = 0.004  # of the camera
_ON_FACE = 0.9  # share of a plane that lies on one face

Picture = np.ndarray
Random = np.random.Generator
Scene = tuple[Picture, np.ndarray]
"""light, and the number of the flat face that each pixel shows; 0 where it shows none"""


def _at(picture: Picture, row: np.ndarray, column: np.ndarray) -> Picture:
    """A picture at places of a plane, px, mirrored beyond its borders."""
    import cv2

    height, width = picture.shape[:2]
    rows = np.abs(np.mod(row + height, 2 * height) - height).astype(np.float32)
    columns = np.abs(np.mod(column + width, 2 * width) - width).astype(np.float32)
    return np.asarray(cv2.remap(picture, columns, rows, cv2.INTER_LINEAR, None, cv2.BORDER_REFLECT))


def _rays() -> tuple[np.ndarray, np.ndarray]:
    """Tangents of the angles down and across at which each pixel looks."""
    rows, columns = np.indices(SHAPE)
    return (rows - SHAPE[0] / 2) / 375, (columns - SHAPE[1] / 2) / 375


def wall(pictures: list[Picture], random: Random) -> Scene:
    """One wall, turned away, that fills the photograph."""
    down, across = _rays()
    turn = random.uniform(0.35, 0.8) * random.choice([-1, 1])
    depth = 1 / (1 - turn * across)
    return _at(pictures[0], 300 * down * depth, 300 * across * depth), np.ones(SHAPE, int)


def room(pictures: list[Picture], random: Random) -> Scene:
    """The inside of a long box: floor, ceiling and both sides of different materials, and an end."""
    down, across = _rays()
    down, across = down + random.uniform(-0.1, 0.1), across + random.uniform(-0.2, 0.2)
    high, wide = 1.0, 1.3
    depth = np.minimum(high / np.maximum(np.abs(down), 1e-6), wide / np.maximum(np.abs(across), 1e-6))
    end = depth > 9
    depth = np.minimum(depth, 9)
    side = np.abs(across) * high > np.abs(down) * wide
    face = np.where(end, 5, np.where(side, np.where(across < 0, 1, 2), np.where(down < 0, 3, 4)))
    light = np.zeros((*SHAPE, 3), np.float32)
    for number in range(1, 6):
        place = (down * depth, depth) if number < 3 else (depth, across * depth)
        row, column = place if number < 5 else (down * depth, across * depth)
        here = (face == number)[..., None]
        light = np.where(here, _at(pictures[number % len(pictures)], 200 * row, 200 * column), light)
    return light / (1 + 0.05 * depth[..., None]), face


def houses(pictures: list[Picture], random: Random) -> Scene:
    """Four fronts side by side at different depths, with windows, below a sky."""
    rows, columns = np.indices(SHAPE)
    light = np.broadcast_to(np.array([0.4, 0.55, 0.8], np.float32), (*SHAPE, 3)).copy()
    face = np.zeros(SHAPE, int)
    borders = [
        0,
        *(round(SHAPE[1] * share) for share in np.array([0.25, 0.5, 0.75]) + random.uniform(-0.06, 0.06, 3)),
        SHAPE[1],
    ]
    for number in range(4):
        scale, top = random.uniform(0.6, 1.6), random.uniform(40, 140)
        left, right = borders[number : number + 2]
        here = (columns >= left) & (columns < right) & (rows >= top)
        color = _at(pictures[number % len(pictures)], rows * scale, columns * scale) * random.uniform(0.6, 1.1, 3)
        high, wide = random.uniform(70, 110), random.uniform(45, 75)
        window = (np.mod(rows - top, high) > 0.45 * high) & (np.mod(columns - left, wide) > 0.5 * wide)
        color = np.where(window[..., None], random.uniform(0.02, 0.1), color)
        light, face = np.where(here[..., None], color, light), np.where(here, number + 1, face)
    return np.where((rows > 320)[..., None], 0.12, light), np.where(rows > 320, 0, face)


def column(pictures: list[Picture], random: Random) -> Scene:
    """A column that fills most of the photograph, before another surface."""
    rows, columns = np.indices(SHAPE)
    radius = random.uniform(140, 250)
    across = (columns - SHAPE[1] / 2) / radius
    angle = np.arcsin(np.clip(across, -1, 1))
    lit = np.clip(np.cos(angle - random.uniform(-0.5, 0.5)), 0.1, 1)[..., None]
    inside = (np.abs(across) < 1)[..., None]
    front = _at(pictures[0], rows.astype(float), angle * radius + 2000) * lit
    return np.where(inside, front, _at(pictures[1], rows * 0.5, columns * 0.5)), np.zeros(SHAPE, int)


def dome(pictures: list[Picture], random: Random) -> Scene:
    """The inside of a dome with coffers, from below."""
    down, across = _rays()
    away = np.hypot(down, across)
    polar = np.arctan2(down, across)
    up = np.arcsin(np.clip(away / 0.85, 0, 0.999))
    count = int(random.integers(16, 28))
    coffer = (np.mod(polar * count / (2 * np.pi), 1) > 0.25) & (np.mod(up * 6, 1) > 0.25)
    stone = _at(pictures[0], up * 300, polar * 200 + 1000)
    return np.where(coffer[..., None], 0.4 * stone, stone), np.zeros(SHAPE, int)


def balls(pictures: list[Picture], random: Random) -> Scene:
    """Balls of some sizes, each of its own material and tint, one before the other."""
    rows, columns = np.indices(SHAPE)
    light = np.full((*SHAPE, 3), 0.02, np.float32)
    for number in range(26):
        radius, row, column_ = random.uniform(45, 85), random.uniform(0, SHAPE[0]), random.uniform(0, SHAPE[1])
        down, across = (rows - row) / radius, (columns - column_) / radius
        inside = down**2 + across**2 < 1
        up = np.sqrt(np.clip(1 - down**2 - across**2, 0, 1))
        color = _at(pictures[number % len(pictures)], 80 * np.arcsin(np.clip(down, -1, 1)) + 500,
                    80 * np.arcsin(np.clip(across, -1, 1)) + 500)  # fmt: skip
        shade = (0.15 + 0.85 * np.clip(up - 0.4 * down, 0, 1))[..., None]
        light = np.where(inside[..., None], color * shade * random.uniform(0.4, 1.2, 3), light)
    return light, np.zeros(SHAPE, int)


def cloth(pictures: list[Picture], random: Random) -> Scene:
    """A cloth in deep folds, lit from the side."""
    rows, columns = np.indices(SHAPE)
    phase = random.uniform(0, 6, 3)
    place = columns + 0.3 * rows + 30 * np.sin(rows / 90 + phase[0])
    slope = np.cos(place / 45 + phase[1]) + 0.5 * np.cos(place / 23 + phase[2])
    length = np.cumsum(np.sqrt(1 + (1.5 * slope) ** 2), axis=1)
    shade = np.clip((1 + 0.9 * slope) / np.sqrt(1 + (1.5 * slope) ** 2), 0.08, None)[..., None]
    return _at(pictures[0], rows.astype(float), 0.7 * length) * shade, np.zeros(SHAPE, int)


FLAT: dict[str, Callable[[list[Picture], Random], Scene]] = {"wall": wall}
OTHERS: dict[str, Callable[[list[Picture], Random], Scene]] = {
    "room": room,
    "houses": houses,
    "column": column,
    "dome": dome,
    "balls": balls,
    "cloth": cloth,
}


def outcome(image: Image, face: np.ndarray | None = None) -> tuple[str, str]:
    """``right``, ``silent``, ``doubted`` or ``refused``, and the reason, as `photo_material` has them."""
    try:
        made = plane_proposal(image, PlaneProposalParams())
        if len(made.corners) and face is not None and _on_one(made.corners[0], face):
            return "right", made.table["why"]
        doubt = made.table["doubt"]
        front = image if face is None and not len(made.corners) else _front(image, made.corners)
        density = offset_statistics(front, OffsetStatisticsParams()).density
        generators = lattice_selection(front, density, LatticeSelectionParams()).generators
        parts = foreign_parts(front, ForeignPartsParams(), generators=generators, plane=made.table)
        table = parts.table
        usable = parts.mask.pixels[..., 0] > 0.5
        if face is not None and len(made.corners) and _left_on_one(usable, made.corners, face):
            return "right", f"{made.table['why']}; {table['why']}"
    except InputError as error:
        return "refused", str(error)
    doubt = doubt or table["doubt"]
    return ("doubted", doubt) if doubt else ("silent", f"{made.table['why'][:40]}, evenness {table['evenness']}")


def _front(image: Image, corners: Quads) -> Image:
    field = jacobian_field(image, JacobianFieldParams(), planes=corners)
    places = (field.region, field.controls, field.spaces, field.sizes, field.scale)
    return patch_atlas(image, *places, PatchAtlasParams(max_side=2048), level=field.level).largest


def _left_on_one(usable: np.ndarray, corners: Quads, face: np.ndarray) -> bool:
    """Whether what is left on a plane from the front lies on one face."""
    for number in range(1, int(face.max()) + 1):
        shown = np.repeat((face == number)[..., None], 3, axis=2).astype(np.float32)
        on = _front(Image(shown, ("R", "G", "B")), corners).pixels[..., 0] > 0.5
        if on.shape == usable.shape and np.count_nonzero(on & usable) > _ON_FACE * np.count_nonzero(usable):
            return True
    return False


def _on_one(corners: np.ndarray, face: np.ndarray) -> bool:
    import cv2

    inside = np.zeros(face.shape, np.uint8)
    cv2.fillPoly(inside, [np.rint(np.clip(corners[:, ::-1], -5000, 5000)).astype(np.int32)], 1)
    shown = np.bincount(face[inside > 0], minlength=2)
    return bool(shown[1:].max(initial=0) > _ON_FACE * max(1, shown.sum()))


def main() -> None:
    """Print all rates."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--step", type=int, default=1, help="every so many pictures")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--scenes", type=int, default=4, help="of each kind")
    parser.add_argument("--why", action="store_true", help="print the reason of each")
    options = parser.parse_args()
    logging.getLogger("texloom").setLevel(logging.ERROR)
    paths = [path for folder in options.folders for path in sorted(folder.iterdir()) if path.is_file()]
    chosen = paths[options.first :: options.step]
    pictures = []
    for path in chosen:
        color = open_source("picture", str(path)).read().color
        pictures.append(np.array(np.broadcast_to(color, (*color.shape[:2], 3)), np.float32))
    rows: dict[str, list[str]] = {"clean exemplar": []}

    def judged(kind: str, name: str, image: Image, face: np.ndarray | None = None) -> None:
        how, why = outcome(image, face)
        rows.setdefault(kind, []).append(how)
        if options.why:
            print(f"{kind:16}{name:34}{how:9}{why[:150]}", flush=True)

    for path, picture in zip(chosen, pictures, strict=True):
        judged("clean exemplar", path.stem, Image(picture, ("R", "G", "B")))
    for kind, make in {**FLAT, **OTHERS}.items():
        for number in range(options.scenes):
            random = np.random.default_rng(1000 * options.first + number)
            parts = [pictures[(3 * number + 5 * step) % len(pictures)] for step in range(4)]
            light, face = make(parts, random)
            noisy = np.clip(light + random.normal(0, _NOISE, light.shape), 0, 1).astype(np.float32)
            judged(kind, str(number), Image(noisy, ("R", "G", "B")), face)
    columns = ("right", "silent", "doubted", "refused")
    print(f"{'':16}" + "".join(f"{name:>9}" for name in columns))
    for kind, found in rows.items():
        print(f"{kind:16}" + "".join(f"{found.count(name):9}" for name in columns))


if __name__ == "__main__":
    main()
