"""How far rectangles on planes are extended, on rendered scenes of known extent.

    python -m benchmarks.plane_extents FOLDER

Each picture of the folder is a wall in perspective, with a round object before it, on the next picture as the
ground, before the one after that. Printed are, for a rectangle of about a quarter of the wall, the share of the
wall that it covers before and after, and the share of the latter that is beyond the wall.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from texloom.pipelines.media.sources import open_source
from texloom.stages.analysis.photographs import bezier
from texloom.stages.analysis.photographs.plane_extent import extended
from texloom.stages.common.features.line_segments import line_segments
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.vocabulary.arrays import Image

SHAPE = (480, 640)
_PART = (0.25, 0.75)  # of the wall, along each side: the given rectangle
_NOISE = 0.004  # of the camera


def wall_corners(random: np.random.Generator) -> np.ndarray:
    """Of a wall that is turned away to one side, clockwise, px."""
    near, far = random.uniform(40, 90), random.uniform(120, 170)
    left, right = random.uniform(90, 130), random.uniform(490, 540)
    corners = np.array([[near, left], [far, right], [480 - far, right], [480 - near, left]])
    return corners if random.random() < 0.5 else np.stack([corners[[1, 0, 3, 2], 0], corners[:, 1]], axis=1)


def scene(pictures: list[np.ndarray], random: np.random.Generator) -> tuple[Image, np.ndarray]:
    """A wall, what is below and above it, and an object before it, with the wall's corners."""
    import cv2

    corners = wall_corners(random)
    wall, ground, behind = pictures
    canvas = cv2.resize(behind, SHAPE[::-1], interpolation=cv2.INTER_AREA)
    low = float(corners[2:, 0].min())
    below = np.array([[low, 0], [low, 639], [479, 1200], [479, -560]])
    for picture, place in ((ground, below), (wall, corners)):
        height, width = picture.shape[:2]
        source = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32) - 0.5
        matrix = cv2.getPerspectiveTransform(source, place[:, ::-1].astype(np.float32))
        seen = cv2.warpPerspective(picture, matrix, SHAPE[::-1], flags=cv2.INTER_AREA)
        inside = cv2.warpPerspective(np.ones((height, width), np.float32), matrix, SHAPE[::-1])
        canvas = np.where(inside[..., None] > 0.5, seen, canvas)
    middle = corners.mean(axis=0) + random.uniform(-40, 40, 2)
    rows, columns = np.indices(SHAPE)
    canvas[np.hypot(rows - middle[0], columns - middle[1]) < 35] = 0.05
    return Image(
        np.clip(canvas + random.normal(0, _NOISE, canvas.shape), 0, 1).astype(np.float32), ("R", "G", "B")
    ), corners


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--step", type=int, default=1, help="every so many pictures")
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    paths = sorted(path for path in options.folder.iterdir() if path.suffix in (".png", ".jpg"))
    chosen = paths[options.first :: options.step]
    pictures = [
        np.array(np.broadcast_to(color, (*color.shape[:2], 3)))
        for color in (open_source("picture", str(path)).read().color for path in chosen)
    ]
    rows = []
    for number, path in enumerate(chosen):
        random = np.random.default_rng(number)
        parts = [pictures[(number + step) % len(pictures)] for step in range(3)]
        image, corners = scene(parts, random)
        matrix = bezier.homography(corners)
        low, high = _PART
        square = np.array([[low, low, 1], [low, high, 1], [high, high, 1], [high, low, 1]])
        there = matrix_product(square, matrix.T)
        found = extended(image, there[:, :2] / there[:, 2:], line_segments(image)).corners
        back = matrix_product(np.concatenate([found, np.ones((4, 1))], axis=1), np.linalg.inv(matrix).T)
        flat = back[:, :2] / back[:, 2:]
        (top, left), (bottom, right) = flat[0], flat[2]
        area = (bottom - top) * (right - left)
        both = (min(bottom, 1) - max(top, 0)) * (min(right, 1) - max(left, 0))
        rows.append(((high - low) ** 2, both, 1 - both / area))
        print(f"{path.stem:32}" + "".join(f"{value:8.3f}" for value in rows[-1]), flush=True)
    print(f"{'mean':32}" + "".join(f"{value:8.3f}" for value in np.mean(rows, axis=0)))


if __name__ == "__main__":
    main()
