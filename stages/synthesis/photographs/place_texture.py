"""Texture in a photograph: places of an exemplar under the footprints of the photograph's pixels."""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Bool, Float32, Int64
from pydantic import Field

from texloom.stages.common.geometry.footprints import footprints, resampled
from texloom.stages.common.grids.screened_poisson import neighbours, screened_poisson_beside
from texloom.stages.kernels.core.elementary_functions import exp, log
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Image, Jacobian, Mask
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.sizes import format_size

_RING = 24  # px around the hole whose contrast is taken over
_MAX_GAIN = 1.25  # of contrast
_DARK = 0.01  # linear light; darker steps are corrected by differences rather than by ratios


class PlaceTextureParams(Params):
    """How texture joins its surroundings."""

    reach: float | None = Field(None, gt=0, le=4096)
    """distance from the hole's border and from seams over which light and colour are corrected, px; null keeps the
    exemplar's"""
    light: float = Field(0.0, ge=0, le=2)
    """share of the brightness of what the hole shows in the photograph, such as shadows, that is taken over"""
    softness: float = Field(12.0, gt=0, le=4096)
    """standard deviation of the Gaussian that separates this light from detail, px"""
    limit: float = Field(1.0, gt=0, le=10)
    """largest step that is corrected, natural logarithm of a ratio of linear light; larger ones are contours"""


@dataclasses.dataclass(frozen=True)
class PlaceTexture:
    """The photograph with the texture in it."""

    image: Image
    """R G B; outside the hole the photograph's own pixels"""


@stage(version=1)
def place_texture(
    positions: Float32[np.ndarray, "H W 2"],
    exemplar: Image,
    jacobian: Float32[np.ndarray, "h w 4"],
    target_jacobian: Float32[np.ndarray, "H W 4"],
    photo: Image,
    hole: Bool[np.ndarray, "H W"],
    params: PlaceTextureParams,
    known: Bool[np.ndarray, "h w"] | None = None,
    corner: Int64[np.ndarray, "2"] | None = None,
    around: Mask | None = None,
) -> PlaceTexture:
    """Fill the hole of a photograph with pixels of an exemplar.

    Every pixel is a mean of the exemplar under its footprint, an ellipse by both Jacobians: reduced texture does
    not alias, and magnified texture is interpolated; its pieces fade into each other over a px of the exemplar.

    With ``reach``, steps at the border of the hole and at seams become smooth ramps of light: of the logarithm of
    linear light, so that the texture has the contrast of its new surroundings. The gradients are those that the
    exemplar has at the sources of both pixels.

    Parameters
    ----------
    positions : for each pixel of the result a row and column of the exemplar, see `per_pixel` and `fold`.
    exemplar, jacobian : the picture that texture is taken from, and its distortion.
    target_jacobian : distortion of the result.
    photo : photograph that the texture is placed in.
    hole : pixels of the result that are replaced in the photograph.
    known : the pixels of the exemplar that may be used.
    corner : row and column of the result's first pixel in the photograph; [0, 0] if not given.
    around : pixels of the photograph that show the same texture; with ``reach`` the hole is joined to these alone,
        and their contrast near it is taken over, which changes the texture's by a quarter at most.

    Raises
    ------
    InputError
        the hole is empty.
    ValueError
        shapes do not match, or the result exceeds the photograph.

    References
    ----------
    [Eisenacher2008]_ section 3.3, antialiased synthesis, and section 4. Unlike there, footprints are elliptical
    [Heckbert1989]_. [Perez2003]_ and [Bhat2008]_, as in `gradient_domain`.
    """
    height, width = positions.shape[:2]
    top, left = (0, 0) if corner is None else (int(part) for part in corner)
    for name, sides in (("target_jacobian", target_jacobian.shape), ("hole", hole.shape)):
        if sides[:2] != (height, width):
            raise ValueError(f"{name} of shape {sides} for a result of {format_size((height, width))}")
    if jacobian.shape[:2] != (exemplar.height, exemplar.width):
        raise ValueError(f"jacobian of shape {jacobian.shape} for an exemplar of {format_size(exemplar)}")
    if top + height > photo.height or left + width > photo.width:
        raise ValueError(f"result of {format_size((height, width))} at {top}, {left} goes beyond the photograph")
    if not hole.any():
        raise InputError("hole: no pixel is marked for replacement; add hole: [polygon, ...] to the patch file")
    usable = np.ones(jacobian.shape[:2], np.bool_) if known is None else known
    places = positions[hole].astype(np.float64)
    feet = footprints(jacobian, places, target_jacobian[hole])
    pixels = np.ascontiguousarray(exemplar.color, np.float32)
    image = np.array(photo.color, np.float32)
    whole = np.zeros(image.shape[:2], np.bool_)
    whole[top : top + height, left : left + width] = hole
    areas = np.abs(feet[:, 0] * feet[:, 3] - feet[:, 1] * feet[:, 2])
    half = int((1 / np.sqrt(max(float(np.median(areas)), 1e-4)) + 0.5) / 2)
    image[whole] = _blended(pixels, usable, positions, hole, jacobian, target_jacobian, half)
    if params.light:
        image[whole] *= _light(photo.color[top : top + height, left : left + width], hole, params)[:, None]
    if params.reach is not None:
        # with a border of known pixels
        box = np.s_[max(0, top - 1) : top + height + 1, max(0, left - 1) : left + width + 1]
        beside = [
            [resampled(pixels, usable, places + side * feet[:, [axis, 2 + axis]], feet) for side in (1, -1)]
            for axis in (0, 1)
        ]
        gain, same = 1.0, np.ones_like(whole)
        if around is not None:
            same = around | whole
            part = np.s_[max(0, top - _RING) : top + height + _RING, max(0, left - _RING) : left + width + _RING]
            gain = _gain(image[part], whole[part], (around & ~whole)[part])
        image[whole] = _joined(image[box], whole[box], same[box], beside, gain, params)
    return PlaceTexture(Image(image, ("R", "G", "B")))


def _blended(
    pixels: Float32[np.ndarray, "h w 3"],
    usable: Mask,
    positions: np.ndarray,
    hole: Bool[np.ndarray, "H W"],
    jacobian: Jacobian,
    target_jacobian: Float32[np.ndarray, "H W 4"],
    half: int,
) -> Float32[np.ndarray, "n 3"]:
    """The exemplar's pixels at those of the hole; pieces of magnified texture fade into each other.

    Parameters
    ----------
    half : px of the result in half a px of the exemplar; 0: nothing is blended.
    """
    own = np.argwhere(hole)
    total = np.zeros((len(own), 3), np.float32)
    sides = ((-half, 1), (0, 2), (half, 1)) if half else ((0, 1),)
    for (down, one), (across, other) in itertools.product(sides, repeat=2):
        beside = np.clip(own + np.array((down, across)), 0, np.array(hole.shape) - 1)
        row, column = beside.T
        places = positions[row, column].astype(np.float64)
        feet = footprints(jacobian, places, target_jacobian[row, column])
        places += np.einsum("nij,nj->ni", feet.reshape(-1, 2, 2), own - beside)
        total += np.float32(one * other) * resampled(pixels, usable, places, feet)
    return total / np.float32(sum(weight for _, weight in sides) ** 2)


def _light(color: Float32[np.ndarray, "h w 3"], hole: Mask, params: PlaceTextureParams) -> Float32[np.ndarray, "n"]:  # type: ignore[name-defined]
    """Slow brightness of the hole's pixels relative to its geometric mean over the hole."""

    logs = _logarithm(color.mean(axis=2)) * hole
    soft, share = (gaussian_blur(plane, params.softness) for plane in (logs, hole.astype(np.float32)))
    light = soft[hole] / share[hole]
    return np.asarray(exp(np.float32(params.light) * (light - light.mean())), np.float32)


def _joined(
    image: Float32[np.ndarray, "h w 3"],
    hole: Mask,
    same: Mask,
    beside: list[list[Float32[np.ndarray, "n 3"]]],
    gain: float,
    params: PlaceTextureParams,
) -> Float32[np.ndarray, "n 3"]:
    """The hole's pixels without steps at seams and at its border.

    Parameters
    ----------
    same : the pixels that show the same texture; borders with others keep their contrast.
    beside : what the exemplar has after and before the sources of the hole's pixels, down and across.
    gain : factor on the texture's contrast.
    """
    logs = _logarithm(image)
    excess = np.zeros_like(logs)
    for axis in (0, 1):
        steps = np.zeros((2, *logs.shape), np.float32)
        steps[0][hole] = _logarithm(beside[axis][0]) - logs[hole]
        steps[1][hole] = logs[hole] - _logarithm(beside[axis][1])
        for first, second in neighbours(len(logs), axis, NOWHERE):
            # the larger of both, since a mean would blur seams
            larger = np.square(steps[0][first]).sum(axis=2) >= np.square(steps[1][second]).sum(axis=2)
            wanted = np.where(larger[..., None], steps[0][first], steps[1][second])
            missing = np.float32(gain) * wanted - (logs[second] - logs[first])
            other = ~(hole[first] | hole[second]) | ~(same[first] & same[second])
            missing[other | (np.abs(missing) > params.limit).any(axis=2)] = 0
            excess[first] += missing
            excess[second] -= missing
    change = np.stack(
        [screened_poisson_beside(excess[..., k], float(params.reach or 0), NOWHERE, hole)[hole] for k in range(3)],
        axis=1,
    )
    return np.asarray(np.maximum(exp(logs[hole] + change) - np.float32(_DARK), 0), np.float32)


def _gain(image: Float32[np.ndarray, "h w 3"], hole: Mask, around: Mask) -> float:
    """The contrast around the hole relative to that in it, within limits."""
    logs = _logarithm(image)
    contrast = []
    for area in (around, hole):
        steps = [
            np.abs(logs[second] - logs[first])[area[first] & area[second]]
            for axis in (0, 1)
            for first, second in neighbours(len(logs), axis, NOWHERE)
        ]
        contrast.append(float(np.concatenate(steps).sum(dtype=np.float64)) / max(1, sum(map(len, steps))))
    return float(np.clip(contrast[0] / max(contrast[1], 1e-6), 1 / _MAX_GAIN, _MAX_GAIN)) if contrast[0] else 1.0


def _logarithm(color: np.ndarray) -> Float32[np.ndarray, "..."]:
    return np.asarray(log(np.maximum(color, 0) + np.float32(_DARK)), np.float32)
