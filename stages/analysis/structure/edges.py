"""Contours: how strongly each pixel resembles a boundary between two objects."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from texloom.stages.analysis.structure.forest_files import load_forest, read_opencv_forest
from texloom.stages.analysis.structure.structured_forest import Forest
from texloom.stages.common.grids.working_size import in_full, working_image
from texloom.stages.kernels.core.elementary_functions import power
from texloom.stages.kernels.core.threads import run_all
from texloom.stages.numerics.filters import gaussian_blur, gradients
from texloom.stages.vocabulary.arrays import ColorField, Image, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear, srgb_from_linear
from texloom.stages.vocabulary.declare import InputFile, Params, stage
from texloom.stages.vocabulary.masks import fill_excluded, valid_pixels
from texloom.stages.vocabulary.progress import Progress, report

MODEL = Path(__file__).parents[2] / "data" / "contours.npz"
"""the forest that ships with texloom; docs/contours.md tells how it was trained"""
MODEL_DIGEST = "b5f5a4ebd714db0af1a9018fb7b841248a80e0c197dcceadfc51dbc9ffbd8ae4"
"""SHA-256 of `MODEL`; being part of the code, it changes the keys of results when the model changes"""

_BORDER = 32  # px of padding; the detector does not respond at the border of its input
_MIN_SIDE = 128  # px; exemplars are not reduced below
_MAX_SIDE = 768  # px; nor enlarged beyond


class EdgesParams(Params):
    """Which detector is used, and its settings."""

    detector: Literal["structured", "gradient"] = "structured"
    """`structured`: a structured forest trained on contours of textures; `gradient`: maximum CIELAB gradient over
    two scales"""
    model: InputFile | None = None
    """another forest for `structured` (.yml or .yml.gz, as OpenCV's createStructuredEdgeDetection loads)"""
    scales: tuple[Annotated[float, Field(ge=0.125, le=4)], ...] = Field((0.5, 1.0, 2.0), min_length=1, max_length=8)
    """magnifications at which `structured` runs, relative to an exemplar of at most 512 px; none is enlarged beyond
    768 px"""
    background_threshold: float = Field(0.1, ge=0, le=1)
    """subtracted from the votes of `structured`: the level that the default model gives to areas without contours;
    use 0 with another model"""
    finest: float = Field(1.5, gt=0, le=50)
    """blur of the finer scale of `gradient`, px of an exemplar of 512 px; the other scale is twice as coarse"""


@dataclasses.dataclass(frozen=True)
class Edges:
    """Contour strength."""

    strength: ScalarMap
    """0..1, scaled to a maximum of 1; all 0 on a constant exemplar"""


def check_model(params: EdgesParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """A structured forest given by the user must be valid."""
    if params.detector == "structured" and params.model is not None:
        read_opencv_forest(params.model)


def _gradient(lab: ColorField, sigma: float) -> ScalarMap:
    """Maximum rate of change of colour in any direction and at any of two scales.

    The rate is the root of the larger eigenvalue of the colour structure tensor [DiZenzo1986]_, times the blur, so
    that an ideal step has the same strength at every scale.
    """

    unit = max(1.0, min(lab.shape[:2]) / 512)
    strongest = np.zeros(lab.shape[:2], np.float32)
    for blur in (sigma * unit, 2 * sigma * unit):
        smooth = gaussian_blur(lab, blur, "repeat")
        down, across = (difference / np.float32(32) for difference in gradients(smooth))
        dd, aa, da = ((x * y).sum(axis=2) for x, y in ((down, down), (across, across), (down, across)))
        steepest = (dd + aa + np.sqrt((dd - aa) ** 2 + 4 * da**2)) / 2
        np.maximum(strongest, np.float32(blur) * np.sqrt(steepest), out=strongest)
    return strongest


def magnifications(shorter: int, scales: Sequence[float]) -> list[float]:
    """Magnifications for an exemplar with this shorter side, px, relative to its own size."""
    unit = 1 / max(1.0, shorter / 512)
    useful = [scale for scale in scales if scale >= 1 or scale * shorter >= _MIN_SIDE] or [1.0]
    return [unit * scale if scale <= 1 else min(unit * scale, max(unit, _MAX_SIDE / shorter)) for scale in useful]


def _structured(image: Image, params: EdgesParams) -> ScalarMap:
    """Geometric mean of the forest's responses at several magnifications, which suppresses grain."""
    # The detector expects sRGB in 0..1.
    encoded = np.nan_to_num(srgb_from_linear(image.color)).astype(np.float32)
    strength = np.ones(encoded.shape[:2], np.float32)
    if np.ptp(encoded, axis=(0, 1)).max() < 1e-3:
        return strength
    detect = _shipped().detect if params.model is None else read_opencv_forest(params.model).detect
    used = magnifications(min(image.height, image.width), params.scales)
    # The last is usually the largest, with which a thread should begin.
    calls = [(magnification, encoded, detect) for magnification in reversed(used)]
    for response in reversed(run_all(_magnified, calls)):
        strength *= np.maximum(response, 0)
    mean = power(strength, 1 / len(used))
    return np.maximum(mean - np.float32(params.background_threshold), np.float32(0))


@functools.cache
def _shipped() -> Forest:
    return load_forest(MODEL)


def _magnified(magnification: float, encoded: np.ndarray, detect: Callable[[np.ndarray], np.ndarray]) -> ScalarMap:
    """A detector's response to the magnified image, resized to the image's own size."""
    import cv2

    height, width = encoded.shape[:2]
    size = max(1, round(width * magnification)), max(1, round(height * magnification))
    resized = cv2.resize(encoded, size, interpolation=cv2.INTER_AREA if magnification < 1 else cv2.INTER_CUBIC)
    padded = np.pad(np.clip(resized, 0, 1), ((_BORDER, _BORDER), (_BORDER, _BORDER), (0, 0)), "symmetric")
    inside = detect(np.ascontiguousarray(padded))[_BORDER:-_BORDER, _BORDER:-_BORDER]
    interpolation = cv2.INTER_AREA if magnification > 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(np.nan_to_num(inside), (width, height), interpolation=interpolation), np.float32)


@stage(version=2, check=check_model)
def edges(image: Image, params: EdgesParams) -> Edges:
    """Detect contours of an exemplar; excluded pixels have none.

    Of an exemplar of more than 1.5 million pixels, those of its `working_image` are detected.

    Parameters
    ----------
    image : the exemplar.

    Raises
    ------
    InputError
        ``model`` is missing or not a structured forest, or all pixels are excluded.

    References
    ----------
    [Kaspar2015]_ section 3.1 uses the structured forests of [Dollar2013]_, trained on photographs of scenes; ours
    is trained on procedural textures. The gradient follows [DiZenzo1986]_.

    Examples
    --------
    >>> import skimage.data, texloom
    >>> strength = texloom.stages.edges(skimage.data.brick()[:64, :64], detector="gradient").strength
    >>> strength.min(), strength.max()
    (np.float32(0.0), np.float32(1.0))
    """
    height, width = image.height, image.width
    image, step = working_image(image)
    report(Progress(0.2))
    return Edges(in_full(_strength(image, params), step, height, width))


def _strength(image: Image, params: EdgesParams) -> ScalarMap:
    """See `Edges`."""
    valid = valid_pixels(image)
    image = fill_excluded(image)
    if params.detector == "structured":
        strength = _structured(image, params)
    else:
        strength = _gradient(lab_from_linear(image.color), params.finest)
    if valid is not None:
        strength = np.where(valid, strength, strength[valid].min())
    low, high = float(strength.min()), float(strength.max())
    if high - low < 1e-3:  # rounding
        return np.zeros_like(strength)
    return np.clip((strength - low) / (high - low), 0, 1).astype(np.float32)
