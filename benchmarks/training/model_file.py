"""Structured forests as files that ``cv2.ximgproc.createStructuredEdgeDetection`` loads."""

from __future__ import annotations

import gzip
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.training.features import LABEL, PATCH, SHRINK
from benchmarks.training.trees import STRENGTHS, Tree

OPTIONS = {
    "numberOfTreesToEvaluate": 4, "selfsimilarityGridSize": 5, "stride": 2, "shrinkNumber": SHRINK,
    "patchSize": PATCH, "patchInnerSize": LABEL, "numberOfGradientOrientations": 4, "gradientSmoothingRadius": 0,
    "regFeatureSmoothingRadius": 2, "ssFeatureSmoothingRadius": 8, "gradientNormalizationRadius": 4,
}  # fmt: skip
"""the detector's settings, all but the number of trees"""

VOTES = 4
"""how often a leaf of the file names a pixel that is certain to be a contour: more make the file larger and the
detector slower, and contours no better"""

_ROW = 1000  # numbers a row of a long table


def _table(name: str, rows: Iterable[Iterable[object]]) -> str:
    return f"{name}:\n" + "".join(f"  - [ {', '.join(map(str, row))} ]\n" for row in rows)


def _rows(values: np.ndarray) -> Iterable[Iterable[object]]:
    return (values[start : start + _ROW].tolist() for start in range(0, len(values), _ROW))


def bins_of(strengths: np.ndarray) -> np.ndarray:
    """The pixels of a label, column by column, each as often as it has votes."""
    votes = np.rint(strengths.T.ravel() * (VOTES / STRENGTHS)).astype(np.int64)
    return np.repeat(np.arange(strengths.size), votes)


def model_text(trees: Sequence[Tree]) -> str:
    """The forest in OpenCV's dialect of YAML; all tables have as many nodes as the largest tree."""
    nodes = max(len(tree.children) for tree in trees)

    def filled(values: np.ndarray) -> list[object]:
        return [*values.tolist(), *[0] * (nodes - len(values))]

    bins = [[bins_of(leaf) for leaf in tree.strengths] for tree in trees]
    lengths = [[*map(len, leaves), *[0] * (nodes - len(leaves))] for leaves in bins]
    ends = np.concatenate([[0], np.cumsum(lengths)])
    options = {"numberOfTrees": len(trees), **OPTIONS}
    return (
        "%YAML:1.0\n---\noptions:\n"
        + "".join(f"  {name}: {value}\n" for name, value in options.items())
        + _table("childs", (filled(tree.children) for tree in trees))
        + _table("featureIds", (filled(tree.features) for tree in trees))
        + _table("thresholds", ([f"{float(value):.4g}" for value in filled(tree.thresholds)] for tree in trees))  # type: ignore[arg-type]
        + _table("edgeBoundaries", _rows(ends))
        + _table("edgeBins", _rows(np.concatenate([leaf for leaves in bins for leaf in leaves])))
    )


def write_model(trees: Sequence[Tree], path: Path) -> None:
    """Write a forest, compressed; equal forests give equal bytes.

    Raises
    ------
    ValueError
        the detector does not load trees of these numbers.
    """
    if not trees or len(trees) < OPTIONS["numberOfTreesToEvaluate"]:
        raise ValueError(f"a forest has at least {OPTIONS['numberOfTreesToEvaluate']} trees, not {len(trees)}")
    with path.open("wb") as file, gzip.GzipFile("", "wb", 9, file, mtime=0) as packed:
        packed.write(model_text(trees).encode())
