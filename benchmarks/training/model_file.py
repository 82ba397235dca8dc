"""Structured forests as files: for texloom, or for ``cv2.ximgproc.createStructuredEdgeDetection``."""

from __future__ import annotations

import gzip
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.training.trees import STRENGTHS, Tree
from texloom.stages.analysis.structure.forest_files import OPTIONS

VOTES = 4
"""how often a leaf of the file names a pixel that is certain to be a contour: more make the file larger and the
detector slower, and contours no better"""

_ROW = 1000  # numbers a row of a long table


def bins_of(strengths: np.ndarray) -> np.ndarray:
    """The pixels of a label, column by column, each as often as it has votes."""
    votes = np.rint(strengths.T.ravel() * (VOTES / STRENGTHS)).astype(np.int64)
    return np.repeat(np.arange(strengths.size), votes)


def tables_of(trees: Sequence[Tree]) -> dict[str, np.ndarray]:
    """The tables of `stages.analysis.structure.structured_forest.Forest`; all trees as large as the largest one."""
    shape = len(trees), max(len(tree.children) for tree in trees)
    tables: dict[str, np.ndarray] = {
        "children": np.zeros(shape, np.uint16),
        "features": np.zeros(shape, np.uint16),
        "thresholds": np.zeros(shape, np.float32),
        "votes": np.zeros(shape, np.uint16),
    }
    bins = [[bins_of(leaf) for leaf in tree.strengths] for tree in trees]
    for number, (tree, leaves) in enumerate(zip(trees, bins, strict=True)):
        of_tree = (tree.children, tree.features, tree.thresholds, np.array([len(leaf) for leaf in leaves]))
        for table, values in zip(tables.values(), of_tree, strict=True):
            table[number, : len(values)] = values
    return {**tables, "bins": np.concatenate([leaf for leaves in bins for leaf in leaves]).astype(np.uint8)}


def opencv_text(tables: Mapping[str, np.ndarray]) -> str:
    """A forest in OpenCV's dialect of YAML."""
    bounds = np.concatenate([[0], np.cumsum(tables["votes"], dtype=np.int64)])
    thresholds = ([f"{float(value):.4g}" for value in row] for row in tables["thresholds"])
    options = {"numberOfTrees": len(tables["children"]), **OPTIONS}
    return (
        "%YAML:1.0\n---\noptions:\n"
        + "".join(f"  {name}: {value}\n" for name, value in options.items())
        + _table("childs", tables["children"])
        + _table("featureIds", tables["features"])
        + _table("thresholds", thresholds)
        + _table("edgeBoundaries", _rows(bounds))
        + _table("edgeBins", _rows(tables["bins"]))
    )


def _table(name: str, rows: Iterable[Iterable[object]]) -> str:
    return f"{name}:\n" + "".join(f"  - [ {', '.join(map(str, row))} ]\n" for row in rows)


def _rows(values: np.ndarray) -> Iterable[Iterable[object]]:
    return (values[start : start + _ROW].tolist() for start in range(0, len(values), _ROW))


def write_model(trees: Sequence[Tree], path: Path) -> None:
    """Write a forest, compressed: for texloom (.npz) or OpenCV (.yml.gz); equal forests give equal bytes.

    Raises
    ------
    ValueError
        the detector does not load trees of these numbers.
    """
    if not trees or len(trees) < OPTIONS["numberOfTreesToEvaluate"]:
        raise ValueError(f"a forest has at least {OPTIONS['numberOfTreesToEvaluate']} trees, not {len(trees)}")
    with path.open("wb") as file:
        if path.suffix == ".npz":
            np.savez_compressed(file, **tables_of(trees))  # type: ignore[arg-type]
        else:
            with gzip.GzipFile("", "wb", 9, file, mtime=0) as packed:
                packed.write(opencv_text(tables_of(trees)).encode())
