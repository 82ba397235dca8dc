"""Jacobian field: the distortion of a texture on the surfaces of a photograph, at every pixel."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64
from numpy.typing import ArrayLike
from pydantic import Field

from texloom.stages.analysis._distortion import bezier
from texloom.stages.analysis._distortion.geometry import (
    Geometry,
    Patch,
    frontal,
    pixels_inside,
    plane_controls,
    read_geometry,
)
from texloom.stages.analysis._distortion.pull_push import pull_push
from texloom.stages.arrays import Image, Jacobian, Mask, ScalarMap
from texloom.stages.common.orientation import streaks
from texloom.stages.common.sizes import check_same_size
from texloom.stages.declare import Document, InputError, Params, stage

_CELLS = 16  # a side: parts of a patch in which its pixels are searched
_PIECES = 8
_CELLS_ALONG = 8  # cells of the drawn grid along a patch's longer side
_MIN_CELLS_ACROSS = 2  # along the shorter side of a long patch, where that takes no more than _MAX_CELLS_ALONG
_MAX_CELLS_ALONG = 64
_MIN_REGION = 256  # px
_MIN_WINDOW = 7  # px; side of a square that must fit into the region


class JacobianFieldParams(Params):
    """Geometry of the surfaces, and resolution of the texture."""

    geometry: Document | None = None
    """a YAML or JSON file of patches, `patches: [{corners: [[row, column], ...], size: [down, across]}]`; see
    docs/photographs.md. null: the whole photograph is a frontal plane"""
    detail: float = Field(0.3, gt=0, le=1)
    """share of the region that is sharp enough for the finest level: smaller values give a larger, finer texture
    from fewer pixels"""
    magnify: float = Field(1.0, gt=0, le=16)
    """factor on the texture's size when it is placed in the photograph"""


@dataclasses.dataclass(frozen=True)
class JacobianField:
    """Distortion and regions of the texture in the photograph."""

    jacobian: Jacobian
    """from texture elements to px; an element is about a px where the texture is sharpest"""
    level: ScalarMap
    """log2 of the elements per pixel in the most foreshortened direction: 0 where the texture is sharp"""
    region: Mask
    """the pixels to take texture from"""
    hole: Mask
    """the pixels to be filled"""
    features: Bool[np.ndarray, "classes h w"]
    """each class of features; one empty class where the file names none"""
    scale: float
    """elements per unit of texture"""
    grid: Image
    """the photograph with a grid over every patch, darkened outside the region"""
    streamlines: Image
    """line integral convolution along both directions of the texture over the photograph: red down, green across"""


def check_geometry(params: JacobianFieldParams, known: Mapping[str, Any]) -> None:
    """The file must be valid for the photograph; a region image must have the photograph's size."""
    image, region = known.get("image"), known.get("region")
    if image is not None:
        geometry = _geometry(params, (image.height, image.width))
        if region is None and params.geometry is not None:
            _check_region(geometry, (image.height, image.width), params.geometry.file)
    check_same_size(region, "region", image, "photograph")


@stage(version=1, check=check_geometry)
def jacobian_field(
    image: Image, params: JacobianFieldParams, region: Image | None = None, scale: float | None = None
) -> JacobianField:
    """Compute the distortion of the texture on a photograph's surfaces from patches placed by hand.

    A plane is given by four corners, which determine its homography and, if not given, its aspect ratio; a curved
    surface by the control points of a rational bicubic Bézier patch. Texture coordinates are proportional to length
    in space along both sides of a patch. The Jacobians of overlapping patches are averaged, and extrapolated
    outside all patches.

    Parameters
    ----------
    image : the photograph.
    region : an image of the photograph's size, bright where texture may be taken from; replaces the file's region.
    scale : elements per unit of texture of another photograph, whose texture is to be placed here.

    Raises
    ------
    InputError
        the file is invalid; a patch is crossed, folds over, crosses the horizon or is outside the photograph; or
        the region is empty or has another size.

    References
    ----------
    [Eisenacher2008]_ section 3.1: homographies, weights of control points, derivatives in homogeneous coordinates,
    averaging, extrapolation; section 3.2, equation 2, levels; [Gortler1996]_ pull-push; [Cabral1993]_ streamlines.
    Unlike there, the speed along a patch is its mean over the middle curve; the finest level is that of a share of
    the region and not of one pixel; and sharpness is that of the more foreshortened direction and not the area of
    an element, which would leave streaks.
    """
    shape = (image.height, image.width)
    geometry = _geometry(params, shape)
    field, covered = _field(geometry, shape)
    inside = pixels_inside(geometry.region, shape) if geometry.region else covered
    if region is not None:
        inside = region.color.max(axis=2) >= 0.5
    hole = pixels_inside(geometry.hole, shape)
    inside = inside & ~pixels_inside(geometry.without, shape) & ~hole
    features = [pixels_inside(area, shape) for area in geometry.features.values()] or [np.zeros(shape, np.bool_)]
    if np.count_nonzero(inside) < _MIN_REGION:
        raise InputError(f"region: {np.count_nonzero(inside)} px remain, fewer than {_MIN_REGION}")
    stretch = _min_stretch(field)
    if scale is None:
        scale = float(np.quantile(stretch[inside], 1 - params.detail, method="nearest"))
    field = np.asarray(field * (params.magnify / scale), np.float32)
    level = np.asarray(-np.log2(np.maximum(stretch * (params.magnify / scale), 1e-6)), np.float32)
    return JacobianField(
        field,
        level,
        inside,
        hole,
        np.stack(features),
        float(scale),
        _grid(image, geometry, inside),
        _streamlines(image, field),
    )


def control_points(
    corners: ArrayLike, beyond: float = 0.0
) -> tuple[Float64[np.ndarray, "4 4 2"], Float64[np.ndarray, "4 4"]]:
    """The control points and weights of a plane, as a start for a curved patch of a geometry file.

    Parameters
    ----------
    corners : four [row, column] in px of the photograph, clockwise from the texture's origin.
    beyond : extension of the plane on every side, in multiples of its size.

    Returns
    -------
    rows and columns of the 4x4 control points, px, from the texture's first row to its last; and their weights, 1
    at the first corner.

    Raises
    ------
    InputError
        the corners are crossed, collinear or anticlockwise, or the plane crosses the horizon.

    References
    ----------
    [Eisenacher2008]_ section 3.1.

    Examples
    --------
    >>> points, weights = control_points([[0, 0], [0, 30], [60, 30], [60, 0]])
    >>> points[1, 2].round(6).tolist(), weights[1, 2].round(6).item()
    ([20.0, 20.0], 1.0)
    """
    quad = np.array(corners, np.float64)
    if quad.shape != (4, 2) or not np.isfinite(quad).all():
        raise InputError("corners: want four [row, column]")
    controls = plane_controls(quad, beyond, "corners")
    return controls[..., :2] / controls[..., 2:], controls[..., 2]


def _geometry(params: JacobianFieldParams, shape: tuple[int, int]) -> Geometry:
    return frontal(shape) if params.geometry is None else read_geometry(params.geometry, shape)


def _check_region(geometry: Geometry, shape: tuple[int, int], file: Path) -> None:
    """`InputError` where the region is too small."""
    import cv2

    inside = pixels_inside(geometry.region, shape) if geometry.region else _outlines(geometry, shape)
    inside = inside & ~pixels_inside(geometry.without, shape) & ~pixels_inside(geometry.hole, shape)
    names = ", ".join(patch.name for patch in geometry.patches[:3])
    where = f"geometry: {file}: region ({names})"
    if np.count_nonzero(inside) < _MIN_REGION:
        raise InputError(f"{where}: {np.count_nonzero(inside)} px remain, fewer than {_MIN_REGION}")
    if not cv2.erode(
        np.pad(inside, 1).astype(np.uint8), np.ones((_MIN_WINDOW, _MIN_WINDOW), np.uint8), borderValue=0
    ).any():
        raise InputError(f"{where}: does not contain a square of {_MIN_WINDOW}x{_MIN_WINDOW} px")


def _outlines(geometry: Geometry, shape: tuple[int, int]) -> Mask:
    """The pixels inside the outlines of all patches."""
    along = np.linspace(0, 1, 33)
    zero, one = np.zeros(33), np.ones(33)
    u, v = (np.concatenate(parts) for parts in ([zero, along, one, along[::-1]], [along, one, along[::-1], zero]))
    lines = [bezier.points(patch.controls, u, v) for patch in geometry.patches]
    covered = np.zeros(shape, np.bool_)
    for patch, line in zip(geometry.patches, lines, strict=True):
        part = pixels_inside([np.clip(line, -1e5, 1e5)], shape)
        if not part.any():
            raise InputError(f"{patch.name}: is outside the photograph of {shape[0]}x{shape[1]} px")
        covered |= part
    return covered


def _field(geometry: Geometry, shape: tuple[int, int]) -> tuple[Jacobian, Mask]:
    """Jacobians of units of texture, extrapolated everywhere; and the pixels that patches cover."""
    from texloom.stages.kernels.core.threads import run_spans
    from texloom.stages.kernels.distortion.patch_coverage import cover

    total = np.zeros((*shape, 4))
    count, place = np.zeros(shape, np.int32), np.zeros((*shape, 2))
    for patch in geometry.patches:
        before = count.sum()
        shared = (patch.controls, patch.space, patch.unit, _CELLS, total, count, place)
        run_spans(cover, shared, shape[0], _PIECES)
        if count.sum() == before:
            raise InputError(f"{patch.name}: is outside the photograph of {shape[0]}x{shape[1]} px")
    covered = count > 0
    field = np.asarray(total / np.maximum(count, 1)[..., None], np.float32)
    area = field[..., 0] * field[..., 3] - field[..., 1] * field[..., 2]
    if not (area[covered] > 0).all():
        raise InputError("patches: two overlapping patches have opposite directions of texture")
    # Areas are extrapolated separately, since means of different directions are too short.
    planes = np.concatenate([field, np.log(np.where(covered, area, 1))[..., None]], axis=2).astype(np.float32)
    planes = pull_push(planes, covered.astype(np.float32))
    field, target = planes[..., :4], np.exp(planes[..., 4])
    current = field[..., 0] * field[..., 3] - field[..., 1] * field[..., 2]
    factor = np.sqrt(target / np.maximum(current, 1e-3 * target))
    return np.asarray(np.where(covered[..., None], field, field * factor[..., None]), np.float32), covered


def _min_stretch(field: Jacobian) -> ScalarMap:
    """The smaller singular value: px per unit of texture in the most foreshortened direction."""
    a, b, c, d = np.moveaxis(field.astype(np.float64), 2, 0)
    half = (a * a + b * b + c * c + d * d) / 2
    square = half - np.sqrt(np.maximum(half**2 - (a * d - b * c) ** 2, 0))
    return np.asarray(np.sqrt(np.maximum(square, 0)), np.float32)


def _grid(image: Image, geometry: Geometry, region: Mask) -> Image:
    import cv2

    canvas = np.ascontiguousarray(np.clip(image.color, 0, 1) * np.where(region, 0.8, 0.3)[..., None], np.float32)
    unit = max(1, round(min(canvas.shape[:2]) / 512))
    along = np.linspace(0, 1, 65)
    for patch in geometry.patches:
        rows, columns = _grid_lines(patch)
        lines = [((along, np.full(65, v)), (1.0, 0.1, 0.1)) for v in columns]
        lines += [((np.full(65, u), along), (0.1, 1.0, 0.1)) for u in rows]
        for at, color in lines:
            line = bezier.points(patch.controls, *at)[:, ::-1]
            fixed = np.rint(np.clip(line, -1e5, 1e5) * 16).astype(np.int32)
            cv2.polylines(canvas, [fixed[:, None]], False, color, unit, cv2.LINE_AA, 4)
    return Image(canvas, ("R", "G", "B"))


def _grid_lines(patch: Patch) -> tuple[np.ndarray, np.ndarray]:
    """Parameters u and v of lines that cut a patch into cells which are square in the texture, and its borders.

    The last cell of a row or column may be narrower.
    """
    shorter, longer = sorted(patch.size)
    side = max(longer / _MAX_CELLS_ALONG, min(longer / _CELLS_ALONG, shorter / _MIN_CELLS_ACROSS))
    rows, columns = (np.append(np.arange(0, 1 - 1e-6, side / size), 1) for size in patch.size)
    return bezier.even_parameters(patch.space, (rows, columns))


def _streamlines(image: Image, field: Jacobian) -> Image:
    down = streaks(np.arctan2(field[..., 0], field[..., 2]).astype(np.float32), 14)
    across = streaks(np.arctan2(field[..., 1], field[..., 3]).astype(np.float32), 14)
    light = np.dstack([down, across, np.zeros_like(down)]) ** 2.2
    return Image(np.asarray(0.35 * np.clip(image.color, 0, 1) + 0.5 * light, np.float32), ("R", "G", "B"))
