"""Contours: how strongly each pixel looks like the border between two things."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field as Knob

from stages.arrays import ColorField, Field, Image
from stages.color import lab_from_linear, srgb_from_linear
from stages.declare import InputError, InputFile, Params, stage
from stages.masks import filled, usable_pixels

_OPTIONS = (
    "numberOfTrees", "numberOfTreesToEvaluate", "selfsimilarityGridSize", "stride", "shrinkNumber", "patchSize",
    "patchInnerSize", "numberOfGradientOrientations", "regFeatureSmoothingRadius", "ssFeatureSmoothingRadius",
    "gradientNormalizationRadius",
)  # fmt: skip
_TABLES = ("childs", "featureIds", "thresholds", "edgeBoundaries", "edgeBins")


class EdgesParams(Params):
    """Which detector, and what it needs."""

    detector: Literal["gradient", "structured"] = "gradient"
    """`gradient`: steepest change of CIELAB colour over several scales; `structured`: a structured forest, the
    file `model`"""
    model: InputFile | None = None
    """the forest's file (.yml or .yml.gz, as OpenCV's createStructuredEdgeDetection loads), for `structured`"""
    finest: float = Knob(1.5, gt=0, le=50)
    """smallest blur of `gradient`, px of an exemplar of 512 px; a second scale is twice as coarse"""


@dataclasses.dataclass(frozen=True)
class Edges:
    """Contour strength."""

    strength: Field
    """0..1, the strongest contour is 1; all 0 on a constant exemplar"""


def _readable_model(path: Path) -> None:
    """Raise `InputError` unless the file has all that the detector reads; it does not check that itself."""
    import cv2

    if not path.is_file():
        raise InputError(f"model: {path} is not a file")
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        opened = storage.isOpened()
    except (cv2.error, SystemError) as error:
        raise InputError(f"model: {path} is not a structured forest: {str(error).splitlines()[0]}") from None
    if not opened:
        raise InputError(f"model: {path} is not a structured forest: it cannot be parsed")
    options = storage.getNode("options")
    if not options.isMap():
        raise InputError(f"model: {path} is not a structured forest: options is missing")
    for name in _OPTIONS:
        node = options.getNode(name)
        if node.empty() or (not node.isInt() and not node.isReal()) or node.real() < 1:
            raise InputError(f"model: {path} is not a structured forest: options.{name} is missing or below 1")
    for name in _TABLES:
        if storage.getNode(name).empty():
            raise InputError(f"model: {path} is not a structured forest: {name} is missing")


def check_model(params: EdgesParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """A structured forest must be there and whole before anything runs."""
    if params.detector == "structured":
        if params.model is None:
            raise InputError(
                "model: detector 'structured' needs a model file; give one, or use detector 'gradient'"
            )
        _readable_model(params.model)


def _gradient(lab: ColorField, finest: float) -> Field:
    """Largest rate of change of colour in any direction, at the scale where it is largest.

    The rate is the root of the larger eigenvalue of the colour structure tensor [DiZenzo1986]_, times the blur, so
    that an ideal step is equally strong at every scale.
    """
    import cv2

    unit = max(1.0, min(lab.shape[:2]) / 512)
    strongest = np.zeros(lab.shape[:2], np.float32)
    for blur in (finest * unit, 2 * finest * unit):
        smooth = cv2.GaussianBlur(lab, (0, 0), blur, borderType=cv2.BORDER_REFLECT)
        down, across = (cv2.Scharr(smooth, cv2.CV_32F, *axis, scale=1 / 32) for axis in ((0, 1), (1, 0)))
        dd, aa, da = ((x * y).sum(axis=2) for x, y in ((down, down), (across, across), (down, across)))
        steepest = (dd + aa + np.sqrt((dd - aa) ** 2 + 4 * da**2)) / 2
        np.maximum(strongest, np.float32(blur) * np.sqrt(steepest), out=strongest)
    return strongest


def _structured(image: Image, model: Path) -> Field:
    import cv2

    # The detector wants sRGB in 0..1 and crashes on anything else.
    encoded = np.nan_to_num(srgb_from_linear(image.color)).astype(np.float32)
    detector = cv2.ximgproc.createStructuredEdgeDetection(str(model))
    return np.asarray(np.nan_to_num(detector.detectEdges(np.ascontiguousarray(encoded))), np.float32)


@stage(version=1, check=check_model)
def edges(image: Image, params: EdgesParams) -> Edges:
    """Find contours of an exemplar; masked pixels have none.

    Raises
    ------
    InputError
        ``detector`` is 'structured' and ``model`` is missing or not a structured forest.

    References
    ----------
    [Kaspar2015]_ section 3.1 uses the structured forests of [Dollar2013]_; the gradient follows [DiZenzo1986]_.
    """
    usable = usable_pixels(image)
    image = filled(image)
    if params.detector == "structured":
        check_model(params, {})
        assert params.model is not None
        strength = _structured(image, params.model)
    else:
        strength = _gradient(lab_from_linear(image.color), params.finest)
    if usable is not None:
        strength = np.where(usable, strength, strength[usable].min())
    low, high = float(strength.min()), float(strength.max())
    if high - low < 1e-3:  # nothing but rounding
        return Edges(np.zeros_like(strength))
    return Edges(np.clip((strength - low) / (high - low), 0, 1).astype(np.float32))
