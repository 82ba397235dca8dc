"""Orientation field: in which direction a texture runs, at every pixel."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.arrays import ColorField, Image, ScalarMap
from texloom.stages.color import lab_from_linear
from texloom.stages.common.orientation import (
    Doubled,
    angle_of,
    diffused,
    length_of,
    smoothed,
    streaks,
    unit,
)
from texloom.stages.declare import InputError, Params, stage

_WAVES = 0.23  # cycles a pixel that a filter answers to
_ALONG, _ACROSS = 2.4, 1.8  # px; standard deviations of a filter's window
_REACH = 6  # px from a filter's middle to its border
_QUIET = 0.05  # share of the mean answer of the loudest scale below which an answer is no more than noise
_PAINTED = 0.5  # of full cover: from there on a pixel belongs to a stroke


class OrientationFieldParams(Params):
    """How directions are measured and made smooth."""

    angles: int = Field(24, ge=8, le=180)
    """directions of the filters"""
    scales: int = Field(3, ge=1, le=6)
    """sizes of the filters, each twice the one before; the finest sees waves of 4 px"""
    reach: float = Field(4.0, gt=0, le=32)
    """px over which directions are averaged"""
    alike: float = Field(12.0, gt=0, le=200)
    """CIELAB units by which colours may differ where directions are averaged"""
    passes: int = Field(2, ge=0, le=8)
    """times that they are averaged"""
    stiffness: float = Field(1.0, gt=0, le=1e4)
    """how far sure directions reach into places that are not; large is smoother"""
    strokes_reach: float = Field(24.0, gt=0, le=4096)
    """px from a painted stroke in which it overrules what the filters say"""


@dataclasses.dataclass(frozen=True)
class OrientationField:
    """The field, and a picture of it."""

    angle: ScalarMap
    """direction along which the texture runs, radians, 0..pi, from along a row towards growing rows"""
    confidence: ScalarMap
    """0..1: how sure the filters or strokes are there; 0 where the direction comes from the surroundings alone"""
    picture: Image
    """streaks along the field, paler where it is not sure, over the texture"""


def check_strokes(params: OrientationFieldParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """Strokes are painted over the texture, pixel by pixel."""
    image, strokes = known.get("image"), known.get("strokes")
    if image is not None and strokes is not None:
        sizes = [(one.height, one.width) for one in (image, strokes)]
        if sizes[0] != sizes[1]:
            raise InputError(
                f"strokes: {sizes[1][0]}x{sizes[1][1]} px; must be as large as the texture, "
                f"{sizes[0][0]}x{sizes[0][1]} px"
            )


@stage(version=1, check=check_strokes)
def orientation_field(
    image: Image, params: OrientationFieldParams, strokes: Image | None = None
) -> OrientationField:
    """Find the direction in which a texture runs at every pixel.

    Oriented filters answer to waves across each direction, at several scales; the scale that is surest counts.
    Directions are averaged over near pixels of like colour. Where none is sure, they are those of the surroundings,
    by diffusion.

    Parameters
    ----------
    image : the texture; its colour counts.
    strokes : lines painted along the wanted directions, on a transparent layer or on black, as large as the
        texture. Around them they count instead of the filters.

    Raises
    ------
    InputError
        strokes are not of the texture's size, or nothing is painted.

    References
    ----------
    [Wei2008]_ section 4.2 for its use; [Paris2004]_ section 4 for oriented filters, their variance as a measure of
    how sure they are, and bilateral smoothing. Here a filter is a pair of waves, a quarter apart, and variance is
    that of doubled angles. How strokes are painted is ours.
    """
    check_strokes(params, {"image": image, "strokes": strokes})
    lab = lab_from_linear(image.color)
    vectors = _measured(_principal(lab), params)
    if strokes is not None:
        painted, near = _painted(strokes, params.strokes_reach)
        vectors = vectors * (1 - near)[..., None] + painted * near[..., None]
    for _ in range(params.passes):
        vectors = smoothed(vectors, lab, params.reach, params.alike)
    if strokes is not None:
        # what is painted is meant; smoothing must not mix it with its surroundings
        vectors = np.where(near[..., None] == 1, painted, vectors)
    confidence = np.clip(length_of(vectors), 0, 1)
    angle = angle_of(vectors + (1 - confidence)[..., None] ** 2 * unit(diffused(vectors, params.stiffness)))
    return OrientationField(angle, confidence, _picture(image, angle, confidence))


def _principal(lab: ColorField) -> ScalarMap:
    """The combination of the colour's channels that varies most."""
    values = lab.reshape(-1, 3).astype(np.float64)
    values -= values.mean(axis=0)
    _, vectors = np.linalg.eigh(values.T @ values / len(values))
    return np.asarray((values @ vectors[:, 2]).reshape(lab.shape[:2]), np.float32)


def _measured(plane: ScalarMap, params: OrientationFieldParams) -> Doubled:
    """What the filters say, at each pixel by the scale at which they are surest."""
    import cv2

    height, width = plane.shape
    answers = []
    for scale in range(params.scales):
        if scale > 0:
            if min(plane.shape) < 4 * _REACH:
                break
            plane = cv2.pyrDown(plane)
        answers.append(_answers(plane, params.angles))
    quiet = _QUIET * max(float(total.mean()) for _, total in answers) + 1e-9
    found: Doubled = np.zeros((height, width, 2), np.float32)
    for sums, total in answers:
        # beyond the border there is a mirror image, which runs another way
        rows, columns = (np.minimum(np.arange(side), np.arange(side)[::-1]) for side in total.shape)
        inside = np.minimum(rows[:, None], columns)
        vectors = (sums / (total + quiet)[..., None] * np.clip(inside / _REACH, 0, 1)[..., None]).astype(np.float32)
        if vectors.shape != found.shape:
            vectors = cv2.resize(vectors, (width, height), interpolation=cv2.INTER_LINEAR)
        most_confident = length_of(vectors) > length_of(found)
        found = np.where(most_confident[..., None], vectors, found)
    return found


def _answers(plane: ScalarMap, angles: int) -> tuple[np.ndarray, np.ndarray]:
    """The sum of doubled directions, each times the energy of its filters' answer; and the sum of the energies."""
    import cv2

    rows, columns = np.mgrid[-_REACH : _REACH + 1, -_REACH : _REACH + 1].astype(np.float64)
    total = np.zeros(plane.shape, np.float64)
    sums = np.zeros((*plane.shape, 2), np.float64)
    for angle in np.pi * np.arange(angles) / angles:
        along = columns * np.cos(angle) + rows * np.sin(angle)
        across = rows * np.cos(angle) - columns * np.sin(angle)
        window = np.exp(-((along / _ALONG) ** 2 + (across / _ACROSS) ** 2) / 2)
        energy = np.zeros(plane.shape, np.float64)
        for wave in (np.cos, np.sin):
            kernel = window * wave(2 * np.pi * _WAVES * across)
            kernel -= window * kernel.sum() / window.sum()  # nothing is answered to plain colour
            energy += cv2.filter2D(plane, cv2.CV_32F, kernel, borderType=cv2.BORDER_REFLECT).astype(np.float64) ** 2
        total += energy
        sums += energy[..., None] * [np.cos(2 * angle), np.sin(2 * angle)]
    return sums, total


def _painted(strokes: Image, reach: float) -> tuple[Doubled, ScalarMap]:
    """The direction of the nearest painted line, and how far each pixel is under its rule: 1 on the line."""
    import cv2

    cover = (
        strokes.pixels[..., strokes.channels.index("A")] if "A" in strokes.channels else strokes.color.max(axis=2)
    )
    mask = cover >= _PAINTED * max(float(cover.max()), 1e-6)
    if cover.max() <= 0 or mask.all():
        raise InputError("strokes: nothing is painted; paint lines on a transparent layer or on black")
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 1.0)
    down, across = cv2.Scharr(soft, cv2.CV_32F, 0, 1), cv2.Scharr(soft, cv2.CV_32F, 1, 0)
    # borders of a line lie along it: their gradients, doubled, point the other way
    tensor = np.dstack([down**2 - across**2, -2 * down * across, down**2 + across**2])
    tensor = cv2.GaussianBlur(tensor, (0, 0), 4.0)
    straight = tensor[..., :2] / np.maximum(tensor[..., 2:], 1e-9)
    distance, nearest = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE, labelType=cv2.DIST_LABEL_PIXEL
    )
    along = np.zeros((int(nearest.max()) + 1, 2), np.float32)
    along[nearest[mask]] = unit(straight.astype(np.float32))[mask]
    return along[nearest], np.exp(-((distance / reach) ** 2)).astype(np.float32)


def _picture(image: Image, angle: ScalarMap, confidence: ScalarMap) -> Image:
    """Streaks over the dimmed texture."""
    lines = streaks(angle, 14)[..., None]
    sure = (0.35 + 0.65 * np.sqrt(confidence))[..., None]
    light = 0.25 * np.clip(image.color, 0, 1) + 0.6 * (0.5 + (lines - 0.5) * sure) ** 2.2
    return Image(np.ascontiguousarray(light, np.float32), ("R", "G", "B"))
