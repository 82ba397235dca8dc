"""Jacobian field: the distortion of a texture on the surfaces of a photograph, at every pixel."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64
from numpy.typing import ArrayLike
from pydantic import Field

from texloom.stages.analysis.photographs.field import PhotoDistortion, check_count, coverage, distortion
from texloom.stages.analysis.photographs.geometry import (
    Geometry,
    frontal,
    geometry_of_planes,
    pixels_inside,
    plane_controls,
    read_geometry,
)
from texloom.stages.analysis.photographs.grid import grid_lines, outlined
from texloom.stages.common.geometry.orientation import streaks
from texloom.stages.common.grids.pyramid import reduced
from texloom.stages.common.grids.size_checks import check_same_size
from texloom.stages.kernels.core.elementary_functions import arctan2, power
from texloom.stages.vocabulary.arrays import Image, Jacobian, Mask, Quads
from texloom.stages.vocabulary.declare import Document, InputError, Outline, Params, stage
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.sizes import format_size

_MIN_WINDOW = 7  # px; side of a square that must fit into the region
_SHOWN_SIDE = 2048  # px of the longer side of the pictures


class JacobianFieldParams(Params):
    """Geometry of the surfaces, and resolution of the texture."""

    geometry: Document | None = None
    """a YAML or JSON file of patches, `patches: [{corners: [[row, column], ...], size: WIDTHxHEIGHT}]`; see
    docs/photographs.md. null: ``planes``, or without any the whole photograph as a frontal plane"""
    detail: float = Field(0.3, gt=0, le=1)
    """share of the region that is sharp enough for the finest level: smaller values give a larger, finer texture
    from fewer pixels"""
    magnify: float = Field(1.0, gt=0, le=16)
    """factor on the texture's size when it is placed in the photograph"""


@dataclasses.dataclass(frozen=True)
class JacobianField(PhotoDistortion):
    """Distortion and regions of the texture in the photograph, and pictures of them."""

    grid: Image
    """the photograph, of at most 2048 px a side, with a grid over every patch, darkened outside the region"""
    streamlines: Image
    """line integral convolution along both directions of the texture over the photograph: red down, green across"""
    controls: Float32[np.ndarray, "patches 4 4 3"]
    """control points of each patch: row, column and 1, times the weight"""
    spaces: Float32[np.ndarray, "patches 4 4 3"]
    """the same in camera space, up to scale"""
    sizes: Float32[np.ndarray, "patches 2"]
    """of each patch, down and across, units of texture"""


def check_geometry(params: JacobianFieldParams, known: Mapping[str, Any]) -> None:
    """The file must be valid for the photograph; a region image must have the photograph's size."""
    image, region = known.get("image"), known.get("region")
    if image is not None:
        geometry = _geometry(params, (image.height, image.width))
        if region is None and params.geometry is not None:
            _check_region(geometry, (image.height, image.width), params.geometry.file)
    check_same_size(region, "region", image, "photograph")


def outlines(params: JacobianFieldParams, known: Mapping[str, Any]) -> dict[str, Outline]:  # noqa: ARG001
    """The Jacobians are those of the photograph's pixels."""
    image = known.get("image")
    return {} if image is None else {"jacobian": Outline(image.height, image.width)}


@stage(version=2, check=check_geometry, outlines=outlines)
def jacobian_field(
    image: Image,
    params: JacobianFieldParams,
    region: Image | None = None,
    scale: float | None = None,
    planes: Quads | None = None,
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
    planes : corners of planes, which are used if there is no file, as from `plane_proposal`.

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
    if params.geometry is None and planes is not None and len(planes):
        geometry = geometry_of_planes(planes, shape)
    if region is not None:
        geometry = dataclasses.replace(geometry, region=region.color.max(axis=2) >= 0.5)
    parts = (coverage(patch, shape) for patch in geometry.patches)
    report(Progress(0.1))
    result = distortion(geometry, parts, shape, params.detail, params.magnify, scale)
    report(Progress(0.8))
    shown = reduced(image.color, _SHOWN_SIDE)
    pictures = _grid(shown, geometry, result.region), _streamlines(shown, result.jacobian)
    controls, spaces, sizes = (
        np.array([getattr(patch, name) for patch in geometry.patches], np.float32)
        for name in ("controls", "space", "size")
    )
    return JacobianField(
        **vars(result),
        grid=pictures[0],
        streamlines=pictures[1],
        controls=controls,
        spaces=spaces,
        sizes=sizes,
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
    Eisenacher et al. 2008, section 3.1.

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

    inside = outlined(geometry.patches, shape) if geometry.region is None else pixels_inside(geometry.region, shape)
    inside = inside & ~pixels_inside(geometry.without, shape) & ~pixels_inside(geometry.hole, shape)
    names = ", ".join(patch.name for patch in geometry.patches[:3])
    where = f"geometry: {file}: region ({names})"
    check_count(inside, where)
    if not cv2.erode(
        np.pad(inside, 1).astype(np.uint8), np.ones((_MIN_WINDOW, _MIN_WINDOW), np.uint8), borderValue=0
    ).any():
        raise InputError(f"{where}: does not contain a square of {format_size((_MIN_WINDOW, _MIN_WINDOW))}")


def _grid(shown: Float32[np.ndarray, "h w 3"], geometry: Geometry, region: Mask) -> Image:
    import cv2

    height, width = shown.shape[:2]
    inside = region[_nearest(height, region.shape[0])[:, None], _nearest(width, region.shape[1])]
    canvas = np.ascontiguousarray(np.clip(shown, 0, 1) * np.where(inside, 0.8, 0.3)[..., None], np.float32)
    factors = np.array(canvas.shape[:2]) / region.shape
    unit = _unit(canvas.shape)
    for patch in geometry.patches:
        down, across = grid_lines(patch)
        for lines, color in ((down, (1.0, 0.1, 0.1)), (across, (0.1, 1.0, 0.1))):
            places = (lines + 0.5) * factors - 0.5
            fixed = np.rint(np.clip(places[..., ::-1], -1e5, 1e5) * 16).astype(np.int32)
            cv2.polylines(canvas, list(fixed), False, color, unit, cv2.LINE_AA, 4)
    return Image(canvas, ("R", "G", "B"))


def _streamlines(shown: Float32[np.ndarray, "h w 3"], field: Jacobian) -> Image:
    import cv2

    unit = _unit(field.shape)
    coarse = field[::unit, ::unit]
    down = streaks(arctan2(coarse[..., 0], coarse[..., 2]).astype(np.float32), 14)
    across = streaks(arctan2(coarse[..., 1], coarse[..., 3]).astype(np.float32), 14)
    lines = 0.5 * power(np.dstack([down, across, np.zeros_like(down)]), 2.2)
    picture = 0.35 * np.clip(shown, 0, 1)
    picture += cv2.resize(lines, (shown.shape[1], shown.shape[0]), interpolation=cv2.INTER_LINEAR)
    return Image(np.asarray(picture, np.float32), ("R", "G", "B"))


def _nearest(count: int, of: int) -> np.ndarray:
    """Of so many rows or columns of a picture, the nearest that a reduced one shows."""
    return ((np.arange(count) + 0.5) * of / count).astype(int)


def _unit(shape: tuple[int, ...]) -> int:
    """Width of lines in a picture, px."""
    return max(1, round(min(shape[:2]) / 512))
