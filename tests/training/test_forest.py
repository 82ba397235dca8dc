"""The trainer reads the features of the detector, and writes files that OpenCV and texloom load."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.training import kernels
from benchmarks.training.features import CELL, CHANNELS, DIRECT, FEATURES, GRID, Reader, triangle
from benchmarks.training.model_file import VOTES, bins_of, write_model
from benchmarks.training.trees import LEVELS, STRENGTHS, Growth, Tree, described, grow, levels_of, steps_of
from texloom.stages.analysis.structure.forest_files import load_forest, read_opencv_forest


def random_tree(splits: int, rng: np.random.Generator) -> Tree:
    """Splits leaves at random; leaves name some pixels."""
    children, open_leaves = [0], [0]
    for _ in range(splits):
        leaf = open_leaves.pop(int(rng.integers(len(open_leaves))))
        children[leaf] = len(children) + 1
        open_leaves += [len(children), len(children) + 1]
        children += [0, 0]
    inner = np.array(children) > 0
    features = np.where(inner, rng.integers(FEATURES, size=len(inner)), 0)
    # Four digits, as files have them, and off the round numbers that features of plain patches are.
    middle = np.where(features < DIRECT, 0.3, 0.0)
    thresholds = np.where(inner, np.round(middle + rng.normal(0, 0.02, len(inner)), 3) + 0.0003, 0)
    strengths = rng.integers(0, STRENGTHS + 1, (len(inner), 16, 16)) * (rng.random((len(inner), 16, 16)) < 0.1)
    strengths[inner] = 0
    return Tree(
        np.array(children, np.int32),
        features.astype(np.int32),
        thresholds.astype(np.float32),
        strengths.astype(np.uint8),
    )


def votes(strengths: np.ndarray) -> np.ndarray:
    """Strengths as the file has them: a quarter of certain is one vote."""
    return np.array([round(float(value) / 3) for value in strengths.ravel()], np.float32).reshape(strengths.shape)


def detect(trees: list[Tree], color: np.ndarray) -> np.ndarray:
    """The detector with a forest, patch by patch."""
    height, width = color.shape[:2]
    reader = Reader(cv2.copyMakeBorder(color, 8, 8, 8, 8, cv2.BORDER_REFLECT))
    answer = np.zeros((height, width, 1), np.float32)
    for i in range((height - 16) // 2):
        for j in range((width - 16) // 2):
            values = reader.read(np.array([[2 * i, 2 * j]]), np.arange(FEATURES))[0]
            for k in range(4):
                tree, node = trees[((i + j) % 8 + k) % len(trees)], 0
                while tree.children[node]:
                    right = not values[tree.features[node]] < tree.thresholds[node]
                    node = tree.children[node] - 1 + right
                label = votes(tree.strengths[node]) * np.float32(8 / 1024)
                answer[2 * i : 2 * i + 16, 2 * j : 2 * j + 16, 0] += label
    return triangle(answer, 1)[..., 0]


@pytest.mark.parametrize("splits", [[0, 0, 0, 0], [3, 6, 1, 9, 4]])
def test_a_written_forest_is_evaluated_as_defined(
    splits: list[int], tmp_path: Path, rng: np.random.Generator
) -> None:
    trees = [random_tree(count, rng) for count in splits]
    for suffix in (".yml.gz", ".npz"):
        write_model(trees, tmp_path / f"forest{suffix}")
    color = cv2.resize(rng.integers(0, 256, (8, 9, 3), np.uint8), (40, 36), interpolation=cv2.INTER_CUBIC)
    for forest in (load_forest(tmp_path / "forest.npz"), read_opencv_forest(tmp_path / "forest.yml.gz")):
        strength = forest.detect(color.astype(np.float32) / 255)
        np.testing.assert_allclose(strength, detect(trees, color), atol=1e-6)
        assert strength.max() > 0


def test_equal_forests_are_equal_files(tmp_path: Path) -> None:
    for name in ("a", "b"):
        for suffix in (".npz", ".yml.gz"):
            rng = np.random.default_rng(1)
            write_model([random_tree(5, rng) for _ in range(4)], tmp_path / f"{name}{suffix}")
    for suffix in (".npz", ".yml.gz"):
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_forests_that_opencv_would_misread_are_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    with pytest.raises(ValueError, match="at least 4"):
        write_model([random_tree(1, rng)] * 3, tmp_path / "forest.yml.gz")


def test_bins_go_down_columns_and_repeat() -> None:
    leaf = np.zeros((16, 16), np.uint8)
    leaf[3, 5], leaf[2, 0], leaf[9, 9] = STRENGTHS // 2, STRENGTHS // VOTES, 1
    assert bins_of(leaf).tolist() == [2, 5 * 16 + 3, 5 * 16 + 3]


def test_features_are_values_then_differences(rng: np.random.Generator) -> None:
    color = rng.integers(0, 256, (64, 48, 3), np.uint8)
    reader = Reader(color)
    row, column, plane, corner = 7, 11, 4, (10, 6)
    direct = plane * CELL**2 + column * CELL + row
    first, second = 2, 8  # the second pair below counts from there
    pairs = [(a, b) for a in range(25) for b in range(a + 1, 25)]
    difference = DIRECT + plane * len(pairs) + pairs.index((first, second))
    values = reader.read(np.array([corner]), np.array([direct, difference]))[0]
    assert values[0] == reader.regular[corner[0] // 2 + row, corner[1] // 2 + column, plane]
    ends = [
        reader.similarity[corner[0] // 2 + GRID[spot % 5], corner[1] // 2 + GRID[spot // 5], plane]
        for spot in (first, second)
    ]
    assert values[1] == ends[0] - ends[1]
    assert DIRECT + CHANNELS * len(pairs) == FEATURES


def test_levels_count_the_thresholds_that_are_reached(rng: np.random.Generator) -> None:
    values = np.stack([rng.normal(size=500), np.repeat([0.0, 1.0], 250)], axis=1).astype(np.float32)
    steps = steps_of(values)
    levels = levels_of(values, steps)
    assert len(steps[0]) == LEVELS - 1
    assert steps[1][0] == 0
    assert steps[1][-1] == 1
    for feature in (0, 1):
        for level, threshold in enumerate(steps[feature], 1):
            np.testing.assert_array_equal(levels[feature] >= level, values[:, feature] >= threshold)


def naive_split(
    levels: np.ndarray, rows: np.ndarray, classes: np.ndarray, candidates: np.ndarray, smallest: int
) -> tuple[int, int]:
    """Exhaustive search."""

    def purity(part: np.ndarray) -> float:
        return float((part.sum() ** 2 + (len(part) - part.sum()) ** 2) / len(part))

    best, split = purity(classes.astype(np.int64)) + 1e-6, (-1, 0)
    for candidate in candidates:
        for level in range(1, LEVELS):
            left = levels[candidate, rows] < level
            is_level = (levels[candidate, rows] == level - 1).any()
            if is_level and min(left.sum(), (~left).sum()) >= smallest:
                value = purity(classes[left].astype(np.int64)) + purity(classes[~left].astype(np.int64))
                if value > best:
                    best, split = value, (int(candidate), level)
    return split


def test_split_is_the_best(rng: np.random.Generator) -> None:
    levels = rng.integers(0, LEVELS, (5, 60)).astype(np.uint8)
    levels[2] //= 16
    for _ in range(10):
        rows = rng.choice(60, 40, replace=False)
        classes = ((levels[3, rows] > 60) ^ (rng.random(40) < 0.3)).astype(np.uint8)
        candidates = rng.choice(5, 4, replace=False)
        split = kernels.best_split(levels, rows, classes, candidates, LEVELS, 5)
        assert tuple(split) == naive_split(levels, rows, classes, candidates, 5)


def test_classes_are_the_sides_along_the_principal_direction(rng: np.random.Generator) -> None:
    spread = np.array([1, 6, 2, 0.5])
    labels = (rng.normal(size=(300, 4)) * spread).astype(np.float32)
    rows = np.arange(300)
    classes = np.empty(300, np.uint8)
    ones = kernels.principal_sign(labels, rows, rows, 40, classes)
    _, _, directions = np.linalg.svd(labels - labels.mean(axis=0), full_matrices=False)
    side = (labels - labels.mean(axis=0)) @ directions[0] > 0
    assert ones == classes.sum()
    assert max((classes == side).mean(), (classes != side).mean()) > 0.99


def test_equal_labels_form_one_class() -> None:
    classes = np.ones(9, np.uint8)
    assert kernels.principal_sign(np.ones((9, 4), np.float32), np.arange(9), np.arange(9), 5, classes) == 0
    assert not classes.any()


def test_tree_learns_where_contours_are(rng: np.random.Generator) -> None:
    """A feature tells on which of two columns the contour runs; another is noise."""
    count = 400
    side = rng.integers(0, 2, count)
    labels = np.zeros((count, 16, 16), np.uint8)
    labels[side == 0, :, 4] = 1
    labels[side == 1, :, 11] = 1
    values = np.stack([rng.normal(size=count), side + rng.normal(0, 0.1, count)], axis=1).astype(np.float32)
    steps = steps_of(values)
    names = np.array([17, 4000])
    tree = grow(levels_of(values, steps), steps, names, labels, Growth(), rng)
    assert tree.children.tolist() == [2, 0, 0]
    assert tree.features[0] == 4000
    assert 0.3 < tree.thresholds[0] < 0.7
    certain = round((1 - 1 / 16) * STRENGTHS)
    for leaf, column in ((1, 4), (2, 11)):
        assert (tree.strengths[leaf][:, column] == certain).all()
        assert tree.strengths[leaf].sum() == 16 * certain


def test_labels_that_differ_more_lie_farther_apart() -> None:
    labels = np.zeros((3, 16, 16), np.uint8)
    for label, column in zip(labels, (4, 5, 12), strict=True):
        label[:, column] = 1
    vectors = described(labels)
    assert vectors.shape == (3, 64)
    assert np.linalg.norm(vectors[0] - vectors[1]) < np.linalg.norm(vectors[0] - vectors[2])
