"""Train the contour model that ships with texloom.

    python -m benchmarks.training.contours                                  write stages/data/contours.npz
    python -m benchmarks.training.contours --pictures 40 --out try.yml.gz   a quick test

The same arguments give the same bytes, with any number of processes. `benchmarks.training.judge` measures the
accuracy of a model.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int64

from benchmarks.training.features import CELL, FEATURES, LABEL, PATCH, SHRINK, Reader
from benchmarks.training.model_file import write_model
from benchmarks.training.pictures import picture_of
from benchmarks.training.trees import Growth, Tree, grow, levels_of, steps_of

MODEL = Path(__file__).parents[2] / "stages" / "data" / "contours.npz"
"""the model that ships with texloom"""


@dataclasses.dataclass(frozen=True)
class Plan:
    """Size of the training set; every tree has its own pictures and features."""

    trees: int = 8
    pictures: int = 450
    """textures per tree"""
    patches: int = 160
    """samples per texture"""
    side: int = 192
    """of the textures, px"""
    centred: float = 0.5
    """share of the samples with a contour near their middle, where there are enough"""
    features: float = 0.25
    """share of the features that a tree may use"""
    seed: int = 7
    growth: Growth = dataclasses.field(default_factory=Growth)


def corners_of(
    contours: Bool[np.ndarray, "h w"], count: int, centred: float, rng: np.random.Generator
) -> Int64[np.ndarray, "n 2"]:
    """Top left pixels of ``count`` patches; a share of them has a contour within the central 4 x 4 pixels."""
    height, width = contours.shape
    rows, columns = np.mgrid[0 : height - PATCH + 1 : SHRINK, 0 : width - PATCH + 1 : SHRINK]
    corners = np.stack([rows.ravel(), columns.ravel()], axis=1)
    near = np.zeros(len(corners), bool)
    for down in range(CELL - 2, CELL + 2):
        for across in range(CELL - 2, CELL + 2):
            near |= contours[corners[:, 0] + down, corners[:, 1] + across]
    wanted = min(int(near.sum()), round(count * centred))
    on = rng.choice(np.flatnonzero(near), wanted, replace=False)
    others = np.flatnonzero(~near) if (~near).sum() >= count - wanted else np.arange(len(corners))
    return corners[np.concatenate([on, rng.choice(others, count - wanted, replace=False)])]


def train_tree(number: int, plan: Plan) -> Tree:
    """Generate pictures, sample patches, and grow tree ``number`` of the forest."""
    import cv2

    cv2.setNumThreads(1)
    rng = np.random.default_rng([plan.seed, number])
    names = np.sort(rng.choice(FEATURES, round(FEATURES * plan.features), replace=False))
    total = plan.pictures * plan.patches
    values = np.empty((total, len(names)), np.float32)
    labels = np.empty((total, LABEL, LABEL), np.uint8)
    window = np.arange(LABEL) + (PATCH - LABEL) // 2
    for index in range(plan.pictures):
        picture = picture_of("train", number * plan.pictures + index, plan.side, plan.seed)
        corners = corners_of(picture.contours, plan.patches, plan.centred, rng)
        here = slice(index * plan.patches, (index + 1) * plan.patches)
        values[here] = Reader(picture.color).read(corners, names)
        rows, columns = (corners[:, axis, None] + window for axis in (0, 1))
        labels[here] = picture.contours[rows[:, :, None], columns[:, None, :]]
    steps = steps_of(values[rng.choice(total, min(total, 20000), replace=False)])
    levels = levels_of(values, steps)
    del values
    return grow(levels, steps, names, labels, plan.growth, rng)


def train(plan: Plan, processes: int) -> list[Tree]:
    """Grow all trees of a forest, in as many processes."""
    if processes == 1:
        return [train_tree(number, plan) for number in range(plan.trees)]
    with ProcessPoolExecutor(processes) as pool:
        return list(pool.map(partial(train_tree, plan=plan), range(plan.trees)))


def main() -> None:
    """Train a model with the options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=MODEL)
    parser.add_argument("--trees", type=int, default=Plan.trees)
    parser.add_argument("--pictures", type=int, default=Plan.pictures, help="textures a tree")
    parser.add_argument("--smallest", type=int, default=Growth.min_samples, help="samples in a leaf, at least")
    parser.add_argument("--seed", type=int, default=Plan.seed)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    growth = Growth(min_samples=options.smallest)
    plan = Plan(trees=options.trees, pictures=options.pictures, seed=options.seed, growth=growth)
    began = time.perf_counter()
    trees = train(plan, options.processes)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    write_model(trees, options.out)
    content = options.out.read_bytes()
    nodes = sum(len(tree.children) for tree in trees)
    print(f"{options.out}: {len(content) / 2**20:.2f} MiB, {nodes} nodes, {time.perf_counter() - began:.0f} s")
    print(f"sha256 {hashlib.sha256(content).hexdigest()}")


if __name__ == "__main__":
    main()
