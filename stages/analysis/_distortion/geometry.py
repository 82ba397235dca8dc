"""Geometry files of the surfaces in a photograph: reading and checking them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Float64

from texloom.stages.analysis._distortion import bezier
from texloom.stages.declare import Document, InputError

_MAX_ENTRIES = 256  # patches, and polygons of an area
_MAX_CLASSES = 8  # of features
_MAX_COORDINATE = 1e5  # px
_PATCH_ENTRIES = ("name", "corners", "controls", "weights", "size", "edge", "beyond")
_SAMPLES = 25  # a side: points of a patch that are checked for folds


@dataclass(frozen=True)
class Patch:
    """A patch of a surface."""

    name: str
    controls: bezier.Controls
    space: bezier.Controls
    """the control points in camera space, see `texloom.stages.analysis._distortion.bezier.in_space`"""
    size: tuple[float, float]
    """down and across, in units of texture"""

    @property
    def unit(self) -> Float64[np.ndarray, "2"]:
        """Units of ``space`` per unit of texture, down and across."""
        return np.array(bezier.lengths(self.space)) / self.size


Area: TypeAlias = Path | list[Float64[np.ndarray, "_ 2"]]
"""an image that is bright inside, or polygons, row before column"""


@dataclass(frozen=True)
class Geometry:
    """The content of a geometry file."""

    patches: list[Patch]
    region: Area
    """where texture is taken from; without polygons: all that patches cover"""
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
    the plane through the corners). Its ``size``, down and across in any unit of length, is optional: by default it
    follows from perspective and the length of the nearest ``edge`` (default 1). A plane may extend ``beyond`` its
    corners, in multiples of its size. A patch may have a ``name``.

    Raises
    ------
    InputError
        names the file and the invalid patch or area.
    """
    try:
        return _parsed(document.content, shape, document.pictures)
    except InputError as error:
        raise InputError(f"geometry: {document.file}: {error}") from None


def frontal(shape: tuple[int, int]) -> Geometry:
    """The whole photograph as a frontal plane with units of a px."""
    down, across = shape[0] - 1, shape[1] - 1
    corners = [[0, 0], [0, across], [down, across], [down, 0]]
    return _parsed({"patches": [{"corners": corners, "size": [down, across]}]}, shape, {})


def _parsed(content: Any, shape: tuple[int, int], pictures: Mapping[str, Path]) -> Geometry:
    parts = ("patches", "region", "without", "hole", "features")
    if not isinstance(content, dict) or not isinstance(content.get("patches"), list) or not content["patches"]:
        raise InputError('want {"patches": [{"corners": [[row, column], ...]}, ...]}')
    if unknown := sorted(map(str, set(content) - set(parts))):
        raise InputError(f"{unknown[0]}: no such entry; there is {', '.join(parts)}")
    if len(content["patches"]) > _MAX_ENTRIES:
        raise InputError(f"patches: {len(content['patches'])} are more than {_MAX_ENTRIES}")
    patches = []
    for index, entry in enumerate(content["patches"]):
        name = entry.get("name", f"patches[{index}]") if isinstance(entry, dict) else f"patches[{index}]"
        patches.append(_patch(entry, f"patch {str(name)[:40]!r}", shape))
    features = content.get("features", {})
    if not isinstance(features, dict) or len(features) > _MAX_CLASSES:
        raise InputError(f"features: want up to {_MAX_CLASSES} classes, {{name: image or polygons}}")
    region, without, hole = (
        _area(content.get(part, []), part, shape, pictures) for part in ("region", "without", "hole")
    )
    return Geometry(
        patches,
        region,
        without,
        hole,
        {str(name): _area(area, f"features: {name}", shape, pictures) for name, area in features.items()},
    )


def _area(value: Any, name: str, shape: tuple[int, int], pictures: Mapping[str, Path]) -> Area:
    if isinstance(value, str):
        if value not in pictures:
            raise InputError(f"{name}: {value[:80]!r} is not the name of an image, such as area.png")
        size = _picture_size(pictures[value], f"{name}: {value}")
        if size != shape:
            raise InputError(
                f"{name}: {value}: {size[0]}x{size[1]} px; must have the size of the photograph, "
                f"{shape[0]}x{shape[1]} px"
            )
        return pictures[value]
    if not isinstance(value, list) or len(value) > _MAX_ENTRIES:
        raise InputError(f"{name}: want an image's name or a list of up to {_MAX_ENTRIES} polygons")
    for index, polygon in enumerate(value):
        if not isinstance(polygon, list) or not 3 <= len(polygon) <= 4096:
            raise InputError(f"{name}[{index}]: want a list of three points [row, column] or more")
    return [_array(polygon, (len(polygon), 2), f"{name}[{index}]") for index, polygon in enumerate(value)]


def _picture_size(path: Path, name: str) -> tuple[int, int]:
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as picture:
            return picture.height, picture.width
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError):
        raise InputError(f"{name}: is not a readable image") from None


def pixels_inside(area: Area, shape: tuple[int, int]) -> Bool[np.ndarray, "h w"]:
    """The pixels of an area: inside its polygons, or in the brighter half of its image.

    Raises
    ------
    InputError
        the image is damaged.
    """
    import cv2

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


def _array(value: Any, shape: tuple[int, ...], name: str) -> Float64[np.ndarray, "..."]:
    """Finite numbers as an array of ``shape``."""

    def fits(part: Any, sides: tuple[int, ...]) -> bool:
        if not sides:
            return type(part) in (int, float) and abs(part) <= _MAX_COORDINATE
        return (
            isinstance(part, list) and len(part) == sides[0] and all(fits(element, sides[1:]) for element in part)
        )

    if not fits(value, shape):
        dimensions = "x".join(map(str, shape)) + " " if shape else ""
        raise InputError(f"{name}: want {dimensions}finite numbers up to {_MAX_COORDINATE:g}")
    return np.array(value, np.float64)


def _patch(entry: Any, name: str, shape: tuple[int, int]) -> Patch:
    if not isinstance(entry, dict) or ("corners" in entry) == ("controls" in entry):
        raise InputError(f"{name}: want either corners or controls")
    if unknown := sorted(set(entry) - set(_PATCH_ENTRIES)):
        raise InputError(f"{name}: {unknown[0]}: no such entry; there is {', '.join(_PATCH_ENTRIES)}")
    curved = "controls" in entry
    if curved:
        points = _array(entry["controls"], (4, 4, 2), f"{name}: controls")
        corners = points[[0, 0, 3, 3], [0, 3, 3, 0]]
    else:
        corners = _array(entry["corners"], (4, 2), f"{name}: corners")
    check_quad(corners, name)
    matrix = bezier.homography(corners)
    beyond = float(_array(entry.get("beyond", 0), (), f"{name}: beyond"))
    if beyond < 0 or (curved and beyond):
        raise InputError(f"{name}: beyond: want 0 or more, and corners, not controls")
    plane = controls = bezier.of_plane(matrix, beyond)
    if curved:
        weights = _array(entry["weights"], (4, 4), f"{name}: weights") if "weights" in entry else plane[..., 2]
        controls = np.concatenate([points * weights[..., None], weights[..., None]], axis=2)
    elif "weights" in entry:
        raise InputError(f"{name}: weights belong to controls; corners have none")
    if not (controls[..., 2] > 0).all():
        raise InputError(
            f"{name}: " + ("a weight is not positive" if curved else "crosses the horizon; lower beyond")
        )
    focal = bezier.focal_length(matrix, shape)
    space = bezier.in_space(controls, shape, focal)
    _check_folds(controls, name)
    if "size" in entry:
        size = _array(entry["size"], (2,), f"{name}: size") * (1 + 2 * beyond)
    else:
        edge = float(_array(entry.get("edge", 1), (), f"{name}: edge"))
        nearest = _nearest_edge_length(bezier.in_space(bezier.of_plane(matrix), shape, focal))
        size = np.array(bezier.lengths(space)) * edge / nearest
    if not (size > 0).all():
        raise InputError(f"{name}: size and edge must be positive")
    return Patch(name, controls, space, (float(size[0]), float(size[1])))


def _nearest_edge_length(space: bezier.Controls) -> float:
    """Length of the edge of a plane with the least depth, in units of ``space``."""
    ring = space[[0, 0, 3, 3], [0, 3, 3, 0]]
    nearest = int(np.argmin([ring[k][2] + ring[(k + 1) % 4][2] for k in range(4)]))
    return max(float(np.linalg.norm(ring[nearest] - ring[(nearest + 1) % 4])), 1e-9)


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
    if not (np.linalg.det(np.stack([by_u, by_v, point], axis=-1)) > 0).all():
        raise InputError(f"{name}: the surface folds over in the image; move its control points apart")
