"""Geometry files of the surfaces in a photograph: reading and checking them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import pydantic
from jaxtyping import Bool, Float64
from pydantic import Discriminator, Field, Tag

from texloom.stages.analysis.photographs import bezier
from texloom.stages.numerics.matrices import determinant, length_of, matrix_product
from texloom.stages.vocabulary.arrays import Mask, Quads
from texloom.stages.vocabulary.declare import Document, InputError, first_problem
from texloom.stages.vocabulary.sizes import LENGTHS, format_size

_MAX_ENTRIES = 256  # patches, and polygons of an area
_MAX_CLASSES = 8  # of features
_LONGEST = 1000  # times its other side: the longer one of a patch
_SAMPLES = 25  # a side: points of a patch that are checked for folds

_Number = Annotated[float, Field(strict=True, ge=-1e5, le=1e5, allow_inf_nan=False)]
_Positive = Annotated[_Number, Field(gt=0)]
_Point = tuple[_Number, _Number]
_Points = tuple[_Point, _Point, _Point, _Point]
_Weights = tuple[_Number, _Number, _Number, _Number]
_Polygon = Annotated[list[_Point], Field(min_length=3, max_length=4096)]
_AreaEntry = Annotated[
    Annotated[str, Tag("image")] | Annotated[list[_Polygon], Field(max_length=_MAX_ENTRIES), Tag("polygons")],
    Discriminator(lambda value: "image" if isinstance(value, str) else "polygons"),
]


class _PatchEntry(pydantic.BaseModel, extra="forbid"):
    name: str | None = None
    corners: _Points | None = None
    controls: tuple[_Points, _Points, _Points, _Points] | None = None
    weights: tuple[_Weights, _Weights, _Weights, _Weights] | None = None
    size: Annotated[tuple[_Positive, _Positive], LENGTHS] | None = None
    edge: _Positive | None = None
    beyond: Annotated[_Number, Field(ge=0)] = 0.0

    @pydantic.model_validator(mode="after")
    def _is_one_surface(self) -> "_PatchEntry":
        if (self.corners is None) == (self.controls is None):
            raise ValueError("want either corners or controls")
        if self.corners is not None and self.weights is not None:
            raise ValueError("weights belong to controls; corners have none")
        if self.controls is not None and self.beyond:
            raise ValueError("beyond belongs to corners; controls have none")
        return self


class _GeometryFile(pydantic.BaseModel, extra="forbid"):
    patches: Annotated[list[_PatchEntry], Field(min_length=1, max_length=_MAX_ENTRIES)]
    region: _AreaEntry = []
    without: _AreaEntry = []
    hole: _AreaEntry = []
    features: Annotated[dict[str, _AreaEntry], Field(max_length=_MAX_CLASSES)] = {}


@dataclass(frozen=True)
class Patch:
    """A patch of a surface."""

    name: str
    controls: bezier.Controls
    space: bezier.Controls
    """the control points in camera space, see `texloom.stages.analysis.photographs.bezier.in_space`"""
    size: tuple[float, float]
    """down and across, in units of texture"""

    @property
    def unit(self) -> Float64[np.ndarray, "2"]:
        """Units of ``space`` per unit of texture, down and across."""
        return np.array(bezier.lengths(self.space)) / self.size


Area: TypeAlias = Path | list[Float64[np.ndarray, "_ 2"]] | Mask
"""an image that is bright inside, polygons, row before column, or pixels"""


@dataclass(frozen=True)
class Geometry:
    """The content of a geometry file."""

    patches: list[Patch]
    region: Area | None
    """where texture is taken from; None: all that patches cover"""
    without: Area
    """excluded from the region"""
    hole: Area
    """to be filled"""
    features: dict[str, Area]
    """by class name"""


def read_geometry(document: Document, shape: tuple[int, int]) -> Geometry:
    """Read the geometry file of a photograph of ``shape``.

    It contains ``patches`` and areas: ``region``, ``without``, ``hole``, and ``features`` by name. An area is a
    list of polygons, each a list of [row, column] in px, or an image of the photograph's size. A patch has four
    ``corners``, clockwise from the texture's origin, or 4x4 ``controls`` with 4x4 ``weights`` (default: those of
    the plane through the corners). Its ``size``, width x height in any unit of length, is optional: by default it
    follows from perspective and the length of the nearest ``edge``, or from the patch that is closest in the
    photograph, which it is assumed to meet there (the first: an edge of 1); all patches together determine the
    focal length. A plane may extend ``beyond`` its corners, in multiples of its size. A patch may
    have a ``name``.

    Raises
    ------
    InputError
        names the file and the invalid patch or area.
    """
    try:
        return parsed_geometry(document.content, shape, document.pictures)
    except InputError as error:
        raise InputError(f"geometry: {document.file}: {error}") from None


def frontal(shape: tuple[int, int]) -> Geometry:
    """The whole photograph as a frontal plane with units of a px."""
    down, across = shape[0] - 1, shape[1] - 1
    corners = [[0, 0], [0, across], [down, across], [down, 0]]
    return parsed_geometry({"patches": [{"corners": corners, "size": (down, across)}]}, shape, {})


def geometry_of_planes(corners: Quads, shape: tuple[int, int]) -> Geometry:
    """Planes of a photograph of ``shape``; the nearest edge of the first is one unit."""
    return parsed_geometry({"patches": [{"corners": quad} for quad in corners.tolist()]}, shape, {})


def patch_of_plane(corners: Float64[np.ndarray, "4 2"], shape: tuple[int, int]) -> Patch | None:
    """The only plane of a photograph of ``shape``; none where its corners are not those of a rectangle seen."""
    try:
        return geometry_of_planes(corners[None].astype(np.float32), shape).patches[0]
    except InputError:
        return None


def parsed_geometry(content: Any, shape: tuple[int, int], pictures: Mapping[str, Path]) -> Geometry:
    """The content of a geometry file; see `read_geometry`.

    Parameters
    ----------
    pictures : the files of the images that the content names.
    """
    try:
        file = _GeometryFile.model_validate(content)
    except pydantic.ValidationError as error:
        raise InputError(first_problem(error)) from None
    names = [f"patch {entry.name or f'patches[{index}]'!r}" for index, entry in enumerate(file.patches)]
    region, without, hole = (
        _area(getattr(file, part), part, shape, pictures) for part in ("region", "without", "hole")
    )
    planes = [
        plane_controls(_corners(entry), entry.beyond, name) for entry, name in zip(file.patches, names, strict=True)
    ]
    views = [bezier.homography(_corners(entry)) for entry in file.patches]
    focal = bezier.focal_length(views, shape)
    patches = [_patch(*parts, focal, shape) for parts in zip(file.patches, names, planes, views, strict=True)]
    return Geometry(
        _in_one_unit(patches, [bool(entry.size or entry.edge) for entry in file.patches], shape),
        None if isinstance(region, list) and not region else region,
        without,
        hole,
        {name: _area(area, f"features: {name}", shape, pictures) for name, area in file.features.items()},
    )


def _area(entry: str | list[Any], name: str, shape: tuple[int, int], pictures: Mapping[str, Path]) -> Area:
    if not isinstance(entry, str):
        return [np.array(polygon, np.float64) for polygon in entry]
    if entry not in pictures:
        raise InputError(f"{name}: {entry[:80]!r} is not the name of an image, such as area.png")
    height, width = _picture_size(pictures[entry], f"{name}: {entry}")
    if (height, width) != shape:
        raise InputError(
            f"{name}: {entry}: {format_size((height, width))}; must have the size of the photograph, "
            f"{format_size(shape)}"
        )
    return pictures[entry]


def _picture_size(path: Path, name: str) -> tuple[int, int]:
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as picture:
            return picture.height, picture.width
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError):
        raise InputError(f"{name}: is not a readable image") from None


def pixels_inside(area: Area, shape: tuple[int, int]) -> Bool[np.ndarray, "h w"]:
    """The pixels of an area, inside its polygons, or in the brighter half of its image.

    Raises
    ------
    InputError
        the image is damaged.
    """
    import cv2

    if isinstance(area, np.ndarray):
        return area
    canvas = np.zeros(shape, np.uint8)
    if isinstance(area, Path):
        from PIL import Image

        try:
            with Image.open(area) as picture:
                return np.asarray(picture.convert("L")) >= 128
        except (OSError, SyntaxError):
            raise InputError(f"{area}: the image is damaged") from None
    for polygon in area:
        cv2.fillPoly(canvas, [np.rint(polygon[:, ::-1]).astype(np.int32)], 1)
    return canvas > 0


def plane_controls(corners: Float64[np.ndarray, "4 2"], beyond: float, name: str) -> bezier.Controls:
    """The plane through four corners as a patch, extended by ``beyond`` times its size on every side."""
    check_quad(corners, name)
    controls = bezier.of_plane(bezier.homography(corners), beyond)
    if not (controls[..., 2] > 0).all():
        raise InputError(f"{name}: crosses the horizon; lower beyond")
    return controls


def _corners(entry: _PatchEntry) -> Float64[np.ndarray, "4 2"]:
    points = np.array(entry.controls or [], np.float64)
    return np.array(entry.corners) if entry.corners else points[[0, 0, 3, 3], [0, 3, 3, 0]]


def _patch(
    entry: _PatchEntry,
    name: str,
    plane: bezier.Controls,
    view: Float64[np.ndarray, "3 3"],
    focal: float | None,
    shape: tuple[int, int],
) -> Patch:
    controls = plane
    if entry.controls:
        weights = np.array(entry.weights) if entry.weights else plane[..., 2]
        if not (weights > 0).all():
            raise InputError(f"{name}: a weight is not positive")
        controls = np.concatenate([np.array(entry.controls) * weights[..., None], weights[..., None]], axis=2)
    space = bezier.in_space(controls, shape, focal)
    _check_folds(controls, name)
    if entry.size:
        if max(entry.size) > _LONGEST * min(entry.size):
            raise InputError(f"{name}: size: one side is more than {_LONGEST} times as long as the other")
        size = np.array(entry.size) * (1 + 2 * entry.beyond)
    else:
        nearest = _nearest_edge_length(bezier.in_space(bezier.of_plane(view), shape, focal))
        size = np.array(bezier.lengths(space)) * (entry.edge or 1.0) / nearest
    return Patch(name, controls, space, (float(size[0]), float(size[1])))


def _in_one_unit(patches: list[Patch], measured: list[bool], shape: tuple[int, int]) -> list[Patch]:
    """Sizes of patches that were not measured, so that they meet others where they are closest in the photograph.

    There, their planes are at the same distance from the camera: as where walls and ground meet, and on one plane.
    Without any that was measured, the first has an edge of one unit.
    """
    patches = list(patches)
    known = [index for index, one in enumerate(measured) if one] or [0]
    rest = [index for index in range(len(patches)) if index not in known]
    outlines = [_outline(patch) for patch in patches]
    closest: dict[int, tuple[float, int, np.ndarray]] = {}
    """patch of the rest to its distance from the known patch that is closest, the place of that one among the
    known, and the point between them"""
    compared = 0
    while rest:
        for order in range(compared, len(known)):
            for j in rest:
                distance, between = _closest_points(outlines[known[order]], outlines[j])
                if j not in closest or distance < closest[j][0]:
                    closest[j] = distance, order, between
        compared = len(known)
        j = min(rest, key=lambda one: closest[one][:2])
        i, place = known[closest[j][1]], closest[j][2] - (np.array(shape) - 1) / 2
        here, there = (_distance(patches[index].space, patches[index].controls, place) for index in (i, j))
        if here > 0 and there > 0:
            lengths = np.array(bezier.lengths(patches[j].space))
            size = lengths * here / there / np.sqrt(np.prod(patches[i].unit))
            patches[j] = replace(patches[j], size=(float(size[0]), float(size[1])))
        known.append(j)
        rest.remove(j)
    return patches


def _closest_points(one: np.ndarray, other: np.ndarray) -> tuple[float, Float64[np.ndarray, "2"]]:
    """The distance of the points of two outlines that are closest, px, and the point between them."""
    apart = np.hypot(*np.moveaxis(one[:, None] - other, 2, 0))
    here, there = np.unravel_index(apart.argmin(), apart.shape)
    return float(apart[here, there]), (one[here] + other[there]) / 2


def _outline(patch: Patch) -> Float64[np.ndarray, "n 2"]:
    """Points along the straight lines between a patch's corners, px."""
    ring = (patch.controls[..., :2] / patch.controls[..., 2:])[[0, 0, 3, 3, 0], [0, 3, 3, 0, 0]]
    shares = np.linspace(0, 1, _SAMPLES)[:, None, None]
    return np.asarray((ring[:-1] * (1 - shares) + ring[1:] * shares).reshape(-1, 2))


def _distance(space: bezier.Controls, controls: bezier.Controls, place: np.ndarray) -> float:
    """From the camera to the plane of a patch's corners along a ray; ``place``: px from the photograph's centre."""
    first, second, third = space[0, 0], space[0, 3], space[3, 3]
    normal = np.cross(second - first, third - first)
    ray = np.append(place, first[2] / controls[0, 0, 2])  # its third component is the focal length
    return float(matrix_product(normal, first) / matrix_product(normal, ray))


def _nearest_edge_length(space: bezier.Controls) -> float:
    """Length of the edge of a plane with the least depth, in units of ``space``."""
    ring = space[[0, 0, 3, 3], [0, 3, 3, 0]]
    nearest = int(np.argmin([ring[k][2] + ring[(k + 1) % 4][2] for k in range(4)]))
    return max(float(length_of(ring[nearest] - ring[(nearest + 1) % 4])), 1e-9)


def check_quad(corners: Float64[np.ndarray, "4 2"], name: str) -> None:
    """`InputError` unless the corners form a convex quadrilateral, clockwise in the image."""
    sides = np.roll(corners, -1, axis=0) - corners
    after = np.roll(sides, -1, axis=0)
    # Positive where the path turns clockwise, as rows grow downwards.
    turns = sides[:, 1] * after[:, 0] - sides[:, 0] * after[:, 1]
    if np.abs(turns).min() < 1:
        raise InputError(f"{name}: the corners have no area, or three are collinear")
    clockwise = int((turns > 0).sum())
    if clockwise == 2:
        raise InputError(f"{name}: the corners are crossed; give them clockwise around the patch")
    if clockwise == 0:
        raise InputError(f"{name}: the corners run anticlockwise, which mirrors the texture")
    if clockwise != 4:
        raise InputError(f"{name}: crosses the horizon: no plane in perspective has such corners")


def _check_folds(controls: bezier.Controls, name: str) -> None:
    """`InputError` where the surface's orientation in the image is reversed."""
    at = np.linspace(0, 1, _SAMPLES)
    u, v = np.meshgrid(at, at, indexing="ij")
    (bu, du), (bv, dv) = bezier.bernstein(u), bezier.bernstein(v)
    point = np.einsum("...i,...j,ijk->...k", bu, bv, controls)
    by_u = np.einsum("...i,...j,ijk->...k", du, bv, controls)
    by_v = np.einsum("...i,...j,ijk->...k", bu, dv, controls)
    # The triple product has the sign of the Jacobian's determinant, since w is positive.
    if not (determinant(np.stack([by_u, by_v, point], axis=-1)) > 0).all():
        raise InputError(f"{name}: the surface folds over in the image; move its control points apart")
