"""Growing one tree of a structured forest [Dollar2013]_."""

from __future__ import annotations

import dataclasses
from collections import deque

import numpy as np
from jaxtyping import Float32, Int32, UInt8

LEVELS = 128
"""number of quantisation levels of a feature's values"""
STRENGTHS = 12
"""strength in a leaf of a pixel that is a contour in all samples"""


@dataclasses.dataclass(frozen=True)
class Growth:
    """Stopping criteria, and effort of a split."""

    min_samples: int = 16
    """minimum number of samples in a leaf"""
    max_depth: int = 32
    candidates: int = 256
    """features that a split may use, drawn for each"""
    class_samples: int = 256
    """samples from which labels are divided into two classes"""


@dataclasses.dataclass(frozen=True)
class Tree:
    """Nodes in an order in which the two children of a node are neighbours and come after it."""

    children: Int32[np.ndarray, "nodes"]
    """number of the right child, 0 for a leaf; the left child comes directly before"""
    features: Int32[np.ndarray, "nodes"]
    """which feature is compared; 0 in a leaf"""
    thresholds: Float32[np.ndarray, "nodes"]
    """values below go left"""
    strengths: UInt8[np.ndarray, "nodes 16 16"]
    """how much likelier than in the label as a whole a contour is at each pixel, in steps of 1 / `STRENGTHS`; 0
    where it is less likely, and in nodes that are no leaves"""


def steps_of(values: Float32[np.ndarray, "n f"]) -> list[np.ndarray]:
    """Thresholds of every feature: at most ``LEVELS - 1`` quantiles of its values, to four digits."""
    shares = np.linspace(0, 1, LEVELS + 1)[1:-1]
    quantiles = np.quantile(values, shares, axis=0).astype(np.float64)
    return [np.unique(np.array([f"{value:.4g}" for value in column], np.float32)) for column in quantiles.T]


def levels_of(values: Float32[np.ndarray, "n f"], steps: list[np.ndarray]) -> UInt8[np.ndarray, "f n"]:
    """How many thresholds of its feature each value has reached."""
    levels = np.empty(values.shape[::-1], np.uint8)
    for feature, thresholds in enumerate(steps):
        levels[feature] = np.searchsorted(thresholds, values[:, feature], side="right")
    return levels


def described(contours: UInt8[np.ndarray, "n 16 16"]) -> Float32[np.ndarray, "n 64"]:
    """Labels as vectors to measure their difference by: contours blurred to 8 x 8."""
    wide = np.pad(contours, ((0, 0), (1, 1), (1, 1))).astype(np.float32)
    rows = wide[:, 0:-2:2] + 2 * wide[:, 1:-1:2] + wide[:, 2::2]
    soft = rows[:, :, 0:-2:2] + 2 * rows[:, :, 1:-1:2] + rows[:, :, 2::2]
    return np.sqrt(soft.reshape(len(contours), -1) / 16)


def grow(
    levels: UInt8[np.ndarray, "f n"],
    steps: list[np.ndarray],
    names: np.ndarray,
    contours: UInt8[np.ndarray, "n 16 16"],
    growth: Growth,
    rng: np.random.Generator,
) -> Tree:
    """Grow a tree over samples.

    Every node divides its samples into two classes by their labels, and selects the feature that separates the
    classes best. The paper's leaves store their medoid label. Ours store by how much each pixel was a contour more
    often than the label's mean: a leaf that cannot localise contours then has no effect, and dense structure stays
    distinct.

    Parameters
    ----------
    levels, steps : the samples' features, see `levels_of` and `steps_of`.
    names : number of each feature in the detector.
    contours : 1 where a pixel of a sample's label is a contour.
    """
    from benchmarks.training.kernels import best_split, principal_sign

    vectors = described(contours)
    queue = deque([(np.arange(levels.shape[1]), 0)])  # samples and depth of nodes
    nodes: list[tuple[int, int, float, np.ndarray]] = []
    while queue:
        rows, depth = queue.popleft()
        split = -1
        if depth < growth.max_depth and len(rows) >= 2 * growth.min_samples:
            few = len(rows) <= growth.class_samples
            sample = rows if few else rng.choice(rows, growth.class_samples, replace=False)
            classes = np.empty(len(rows), np.uint8)
            ones = principal_sign(vectors, rows, sample, 12, classes)
            if 0 < ones < len(rows):
                candidates = rng.choice(len(names), min(growth.candidates, len(names)), replace=False)
                split, level = best_split(levels, rows, classes, candidates, LEVELS, growth.min_samples)
        if split < 0:
            likely = contours[rows].mean(axis=0)
            strengths = np.rint(np.maximum(likely - likely.mean(), 0) * STRENGTHS).astype(np.uint8)
            nodes.append((0, 0, 0.0, strengths))
        else:
            right_child = len(nodes) + len(queue) + 2
            none = np.zeros(contours.shape[1:], np.uint8)
            nodes.append((right_child, int(names[split]), float(steps[split][level - 1]), none))
            left = levels[split, rows] < level
            queue += [(rows[left], depth + 1), (rows[~left], depth + 1)]
    children, features, thresholds, leaves = zip(*nodes, strict=True)
    return Tree(
        np.array(children, np.int32),
        np.array(features, np.int32),
        np.array(thresholds, np.float32),
        np.stack(leaves),
    )
