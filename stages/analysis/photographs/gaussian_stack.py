"""Gaussian stack of a distorted texture in a region of a photograph."""

import dataclasses
import logging

import numpy as np
from jaxtyping import Bool, Float32, Int64
from pydantic import Field

from texloom.stages.common.similarity.distorted_appearance import block_side, whole_count
from texloom.stages.kernels.core.elementary_functions import power
from texloom.stages.kernels.core.threads import run_all, run_spans, spans
from texloom.stages.vocabulary.arrays import Image, Jacobian, Mask, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.masks import nearest_valid
from texloom.stages.vocabulary.progress import Progress, report

_MAX_BLUR = 0.5  # levels by which a pixel may be less sharp than the level at which it is used
_MIN_WHOLE = 16  # whole neighbourhoods of the coarsest level
_MAX_DIFFERENCE = 0.15  # of mean colours of distant parts, as a share of the deviation of sharp ones
_PIECES = 16
_LOG = logging.getLogger(__name__)
_MAX_GAIN = 8.0  # of the illumination's correction, brighter or darker
_ILLUMINATION_LEVELS = 3  # by which illumination is coarser than the coarsest level
_ILLUMINATION_PASSES = 2
_GRID = 4  # px at least between samples of the illumination
_PIXEL_VARIANCE = 1 / 12  # of a mean over a pixel, px squared
_VARIANCE = 0.36  # of a Gaussian that permits samples 1 px apart, px squared


class GaussianStackParams(Params):
    """Number of levels, and evening of illumination."""

    max_levels: int = Field(6, ge=1, le=10)
    """maximum number of levels; there are fewer where too few neighbourhoods are whole"""
    min_whole: float = Field(0.15, gt=0, le=1)
    """minimum share of the used pixels whose neighbourhoods at the coarsest level are whole; larger values
    reproduce smaller structures from more candidates"""
    distant: bool = False
    """use pixels that lack the finest detail at the coarser levels, where they hold half a step or less, if their
    mean colours are those of the sharp ones; when detail is added they are replaced by ones that look alike a level
    coarser. It helps regular texture"""
    even: float = Field(0.0, ge=0, le=1)
    """share of the slowly varying illumination that is removed, so that distant parts fit together: 0 keeps it, 1
    removes all variation wider than the coarsest level's neighbourhoods"""


@dataclasses.dataclass(frozen=True)
class GaussianStack:
    """Levels from the finest, each with half the resolution of the last."""

    stack: Float32[np.ndarray, "levels h w c"]
    """CIELAB"""
    valid: Bool[np.ndarray, "levels h w"]
    """the pixels of the region that are sharp enough at each level"""
    image: Image
    """the finest level"""
    sharp: Image
    """the photograph in the window, not blurred, its illumination evened as that of the levels"""
    jacobian: Jacobian
    """that of the photograph, in the window"""
    known: Mask
    """all pixels of the region, in the window"""
    corner: Int64[np.ndarray, "2"]
    """row and column in the photograph of the window's first pixel; all outputs cover the region's bounding box"""


@stage(version=1)
def gaussian_stack(
    image: Image, jacobian: Jacobian, level: ScalarMap, region: Mask, params: GaussianStackParams
) -> GaussianStack:
    """Blur a distorted texture as if it were flat, and find the levels at which each pixel is sharp enough.

    Every level is blurred by two Gaussians along the texture's two directions, of constant width in the texture.
    Blur that a pixel already has is deducted.

    Parameters
    ----------
    image : the photograph, or an exemplar.
    jacobian, level, region : see `jacobian_field`.

    Raises
    ------
    InputError
        fewer than 16 neighbourhoods of the region are whole.

    References
    ----------
    [Eisenacher2008]_ section 3.2, sparse distorted Gaussian stack. Unlike there, pixels count as sharp up to half
    a level below; pixels that lack detail are excluded from all levels unless ``distant`` is set; and the camera's
    blur is deducted along each direction separately: a texture that is foreshortened in one direction is still
    blurred along the other, at the finest level too.
    """
    given = jacobian, level, region
    rows, columns = (np.flatnonzero(region.any(axis=axis)) for axis in (1, 0))
    window = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    jacobian, level, region = (np.ascontiguousarray(field[window]) for field in (jacobian, level, region))
    colors, valid = [], []
    planes = np.ascontiguousarray(image.color[window], np.float32)
    grid = _SparseGrid.of(planes, jacobian, region)
    for number in range(params.max_levels):
        # reading between pixels blurs, so distant ones wait for a level
        sharp = region & (level <= (max(0, number - 1) if params.distant else 0) + _MAX_BLUR)
        count = whole_count(sharp, number, jacobian)
        if count < _MIN_WHOLE or (number and count < params.min_whole * np.count_nonzero(sharp)):
            break
        block = block_side(number, jacobian, sharp)
        while 2 * grid.every <= block:
            grid = grid.coarser(2)
        grid.blur_to(number)
        colors.append(grid.of_all_pixels(grid.planes, region))
        valid.append(sharp)
        report(Progress((number + 1) / params.max_levels, scale=number + 1, scales=params.max_levels))
    if not colors:
        raise InputError(
            f"region: contains fewer than {_MIN_WHOLE} whole neighbourhoods of 7x7 elements; mark more of the "
            "photograph"
        )
    lab = np.empty((len(colors), *planes.shape), np.float32)
    gain = (
        _gain(grid, region, len(colors), params.even) if params.even else np.ones((len(planes), 1, 1), np.float32)
    )

    def fill(number: int, first: int, last: int) -> None:
        lab[number, first:last] = lab_from_linear(colors[number][first:last] * gain[first:last])

    run_all(fill, [(number, *span) for number in range(len(colors)) for span in spans(len(planes), _PIECES)])
    if params.distant and not _alike(lab, valid):
        _LOG.warning("distant parts differ in colour from sharp ones and are not used")
        return gaussian_stack(image, *given, params.model_copy(update={"distant": False}))
    corner = np.array([rows[0], columns[0]], np.int64)
    finest, own = (Image(part * gain, ("R", "G", "B")) for part in (colors[0], planes))
    return GaussianStack(lab, np.stack(valid), finest, own, jacobian, region, corner)


def _alike(lab: Float32[np.ndarray, "levels h w 3"], valid: list[Mask]) -> bool:
    """Whether the pixels that the first coarser level adds have the mean colours of the others."""
    added = [number for number, sharp in enumerate(valid) if (sharp & ~valid[0]).any()]
    if not added:
        return True
    level, sharp = lab[added[0]], valid[added[0]]
    near, far = level[valid[0]], level[sharp & ~valid[0]]
    difference = np.abs(far.mean(axis=0) - near.mean(axis=0))
    return bool((difference <= _MAX_DIFFERENCE * np.maximum(near.std(axis=0), 1)).all())


@dataclasses.dataclass
class _SparseGrid:
    """Every ``every``-th pixel of every ``every``-th row, in the unit of which the Jacobians are."""

    every: int
    planes: Float32[np.ndarray, "h w 3"]
    jacobian: Jacobian
    region: Mask
    variances: list[np.ndarray]
    """of the blur along each direction, squared elements"""

    @classmethod
    def of(cls, planes: Float32[np.ndarray, "h w 3"], jacobian: Jacobian, region: Mask) -> "_SparseGrid":
        """All pixels, each of which is blurred as its area is."""
        squares = [np.square(jacobian[..., [axis, 2 + axis]]).sum(axis=2) for axis in (0, 1)]
        return cls(1, planes, jacobian, region, [_PIXEL_VARIANCE / np.maximum(each, 1e-12) for each in squares])

    def coarser(self, factor: int) -> "_SparseGrid":
        """Every ``factor``-th pixel of this grid."""
        kept = np.s_[::factor, ::factor]
        fields = (np.ascontiguousarray(field[kept]) for field in (self.planes, self.jacobian, self.region))
        planes, jacobian, region = fields
        variances = [variance[kept] for variance in self.variances]
        return _SparseGrid(factor * self.every, planes, jacobian / np.float32(factor), region, variances)

    def blur_to(self, level: int) -> None:
        """Blur to ``level`` what is not yet."""
        from texloom.stages.kernels.distortion.blur import blur_along

        target = np.float32(_PIXEL_VARIANCE + _VARIANCE * (4.0**level - 1))
        for axis in (0, 1):
            sigma = np.sqrt(np.maximum(target - self.variances[axis], 0), dtype=np.float32)
            self.variances[axis] = np.maximum(self.variances[axis], target)
            out = np.empty_like(self.planes)
            shared = (self.planes, self.jacobian, self.region, sigma, axis, out)
            run_spans(blur_along, shared, len(out), _PIECES)
            self.planes = out

    def of_all_pixels(
        self, values: Float32[np.ndarray, "h w 3"], region: Bool[np.ndarray, "height width"]
    ) -> Float32[np.ndarray, "height width 3"]:
        """Values between those of the grid's pixels in the region, for all pixels of ``region``."""
        from texloom.stages.kernels.core.resample import enlarge

        if self.every == 1:
            return values
        row, column = nearest_valid(self.region)
        out = np.empty((*region.shape, values.shape[2]), np.float32)
        run_spans(enlarge, (values[row, column], self.every, out), len(values), _PIECES)
        return out


def _gain(grid: _SparseGrid, region: Mask, number: int, even: float) -> Float32[np.ndarray, "h w 3"]:
    """Factors that remove the share ``even`` of slow changes of light."""
    light = _illumination(grid, region, number)
    mean = light[region].mean(axis=0)
    gain = np.clip(mean / np.maximum(light, 1e-6 + 1e-3 * mean), 1 / _MAX_GAIN, _MAX_GAIN)
    return np.asarray(power(gain, even), np.float32)


def _illumination(grid: _SparseGrid, region: Mask, number: int) -> Float32[np.ndarray, "h w 3"]:
    """The coarsest level, blurred by `_ILLUMINATION_LEVELS` further levels."""
    coarse = grid.coarser(max(1, _GRID // grid.every))
    light = np.ones_like(coarse.planes)
    for _ in range(_ILLUMINATION_PASSES):  # the next pass corrects the one-sided means near borders
        residual = dataclasses.replace(coarse, planes=coarse.planes / light, variances=list(coarse.variances))
        for further in range(_ILLUMINATION_LEVELS):
            residual.blur_to(number + further)
        light = light * np.maximum(residual.planes, 1e-6)
    return coarse.of_all_pixels(light, region)
