"""Structured forests in files: texloom's own, and those of OpenCV's ``createStructuredEdgeDetection``."""

import gzip
import re
import zlib
from pathlib import Path

import numpy as np

from texloom.stages.analysis.structure.structured_forest import FEATURES, TREES, Forest
from texloom.stages.vocabulary.declare import InputError

_MOST = 1 << 29  # bytes of text; the published forest has about 50 MB
OPTIONS = {
    "numberOfTreesToEvaluate": TREES, "selfsimilarityGridSize": 5, "stride": 2, "shrinkNumber": 2, "patchSize": 32,
    "patchInnerSize": 16, "numberOfGradientOrientations": 4, "gradientSmoothingRadius": 0,
    "regFeatureSmoothingRadius": 2, "ssFeatureSmoothingRadius": 8, "gradientNormalizationRadius": 4,
}  # fmt: skip
"""settings of the forests that `Forest` is for, in OpenCV's names"""


def load_forest(path: Path) -> Forest:
    """The forest in an ``.npz`` file that has its tables."""
    with np.load(path) as tables:
        return Forest(**tables)


def read_opencv_forest(path: Path) -> Forest:
    """The forest in a file of OpenCV's, ``.yml`` or ``.yml.gz``.

    Raises
    ------
    InputError : the file is none, is damaged, or has a forest with other settings than [Dollar2013]_.
    """
    if not path.is_file():
        raise InputError(f"model: {path} is not a file")

    def refusal(reason: str) -> InputError:
        return InputError(f"model: {path} is not a structured forest: {reason}")

    try:
        with gzip.open(path) if path.read_bytes()[:2] == b"\x1f\x8b" else path.open("rb") as file:
            text = file.read(_MOST + 1).decode("ascii")
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise refusal(f"it cannot be read: {error}") from None
    if len(text) > _MOST:
        raise refusal(f"it has more than {_MOST} characters")
    entries = dict(re.findall(r"^(\w+):((?:[ \t]*[^\s%].*|[ \t]*)$(?:\n[ \t]+.*$)*)", text, re.MULTILINE))
    options = dict(re.findall(r"^ +(\w+): *(\d+) *$", entries.get("options", ""), re.MULTILINE))
    if not options:
        raise refusal("options is missing")
    for name, wanted in OPTIONS.items():
        if name not in options:
            raise refusal(f"options.{name} is missing")
        if int(options[name]) != wanted:
            raise refusal(f"options.{name} is {options[name]}; texloom evaluates forests of {wanted}")
    trees = int(options.get("numberOfTrees", 0))
    if trees < TREES:
        raise refusal(f"options.numberOfTrees is missing or below {TREES}")

    def table(name: str, dtype: type) -> np.ndarray:
        numbers = re.sub(r"- *\[|[\[\],\s]+", " ", entries.get(name, "")).split()
        if not numbers:
            raise refusal(f"{name} is missing")
        try:
            return np.array(numbers, np.float64).astype(dtype)
        except ValueError as error:
            raise refusal(f"{name}: {error}") from None

    children, features = table("childs", np.int64), table("featureIds", np.int64)
    thresholds, bounds = table("thresholds", np.float32), table("edgeBoundaries", np.int64)
    bins = table("edgeBins", np.int64)
    nodes = children.size // trees
    same_size = children.size == features.size == thresholds.size == nodes * trees
    if not same_size or bounds.size < children.size + 1:
        raise refusal("childs, featureIds, thresholds and edgeBoundaries are not of the same nodes")
    children, bounds = children.reshape(trees, nodes), bounds[: children.size + 1]
    votes = np.diff(bounds)
    is_inner = children > 0
    # Children come after their parents, so that every patch reaches a leaf.
    if (children < 0).any() or (children >= nodes).any() or (is_inner & (children < np.arange(nodes) + 2)).any():
        raise refusal("childs: not the nodes of a tree")
    if (features < 0).any() or (features >= FEATURES).any():
        raise refusal(f"featureIds: not all from 0 to {FEATURES - 1}")
    if bounds[0] != 0 or (votes < 0).any() or bounds[-1] > bins.size or bins.min() < 0 or bins.max() > 255:
        raise refusal("edgeBoundaries and edgeBins do not fit")
    shape = children.shape
    return Forest(
        children.astype(np.int32),
        features.reshape(shape).astype(np.int32),
        thresholds.reshape(shape),
        votes.reshape(shape).astype(np.int32),
        bins[: bounds[-1]].astype(np.uint8),
    )
