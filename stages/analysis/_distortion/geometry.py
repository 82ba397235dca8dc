"""Files that say where surfaces lie in a photograph: reading and checking them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Float64

from texloom.stages.analysis._distortion import bezier
from texloom.stages.declare import Document, InputError

_MOST = 256  # patches, and polygons
_CLASSES = 8  # of features
_FARTHEST = 1e5  # px
_PATCH = ("name", "corners", "controls", "weights", "size", "edge", "beyond")
_FINE = 25  # points a side at which a patch is looked at


@dataclass(frozen=True)
class Patch:
    """A part of a surface."""

    name: str
    controls: bezier.Controls
    space: bezier.Controls
    """the same in space, see `texloom.stages.analysis._distortion.bezier.in_space`"""
    size: tuple[float, float]
    """of the part, down and across, in units of texture"""

    @property
    def unit(self) -> Float64[np.ndarray, "2"]:
        """Units of ``space`` in a unit of texture, down and across."""
        return np.array(bezier.lengths(self.space)) / self.size


Area: TypeAlias = Path | list[Float64[np.ndarray, "_ 2"]]
"""a picture that is bright there, or polygons, row before column"""


@dataclass(frozen=True)
class Geometry:
    """What a file says."""

    patches: list[Patch]
    region: Area
    """to take texture from; no polygon: all that patches cover"""
    without: Area
    """to leave out"""
    hole: Area
    """to fill"""
    features: dict[str, Area]
    """by the names of their classes"""


def read_geometry(document: Document, shape: tuple[int, int]) -> Geometry:
    """Understand a file of patches for a photograph of ``shape``.

    It holds ``patches``, and areas: ``region``, ``without``, ``hole``, and ``features`` by name. An area is a list
    of polygons, each a list of [row, column] in px, or a picture as large as the photograph. A patch has four
    ``corners``, clockwise from where the texture begins, or 4x4 ``controls`` with 4x4 ``weights``, which default
    to those of the plane through their corners; its ``size`` down and across in any unit of length, else the
    length of its nearest ``edge``, 1 if not given, and the rest from perspective; a plane may go on ``beyond`` its
    corners, in multiples of its size; and a ``name``.

    Raises
    ------
    InputError
        naming the file and the patch or area that is wrong.
    """
    try:
        return _parsed(document.content, shape, document.pictures)
    except InputError as error:
        raise InputError(f"geometry: {document.file}: {error}") from None


def frontal(shape: tuple[int, int]) -> Geometry:
    """The whole photograph as a plane seen from the front, a px a unit."""
    down, across = shape[0] - 1, shape[1] - 1
    corners = [[0, 0], [0, across], [down, across], [down, 0]]
    return _parsed({"patches": [{"corners": corners, "size": [down, across]}]}, shape, {})


def _parsed(content: Any, shape: tuple[int, int], pictures: Mapping[str, Path]) -> Geometry:
    parts = ("patches", "region", "without", "hole", "features")
    if not isinstance(content, dict) or not isinstance(content.get("patches"), list) or not content["patches"]:
        raise InputError('want {"patches": [{"corners": [[row, column], ...]}, ...]}')
    if unknown := sorted(map(str, set(content) - set(parts))):
        raise InputError(f"{unknown[0]}: no such entry; there is {', '.join(parts)}")
    if len(content["patches"]) > _MOST:
        raise InputError(f"patches: {len(content['patches'])} are more than {_MOST}")
    patches = []
    for index, entry in enumerate(content["patches"]):
        name = entry.get("name", f"patches[{index}]") if isinstance(entry, dict) else f"patches[{index}]"
        patches.append(_patch(entry, f"patch {str(name)[:40]!r}", shape))
    features = content.get("features", {})
    if not isinstance(features, dict) or len(features) > _CLASSES:
        raise InputError(f"features: want up to {_CLASSES} classes, {{name: picture or polygons}}")
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
            raise InputError(f"{name}: {value[:80]!r} is not a picture's name, such as area.png")
        found = _picture_size(pictures[value], f"{name}: {value}")
        if found != shape:
            raise InputError(
                f"{name}: {value}: {found[0]}x{found[1]} px; must be as large as the photograph, "
                f"{shape[0]}x{shape[1]} px"
            )
        return pictures[value]
    if not isinstance(value, list) or len(value) > _MOST:
        raise InputError(f"{name}: want a picture's name or a list of up to {_MOST} polygons")
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
        raise InputError(f"{name}: is not a picture that can be read") from None


def mask_of(area: Area, shape: tuple[int, int]) -> Bool[np.ndarray, "h w"]:
    """The pixels of an area: inside its polygons, or in the brighter half of its picture.

    Raises
    ------
    InputError : the picture is broken.
    """
    import cv2

    canvas = np.zeros(shape, np.uint8)
    if isinstance(area, Path):
        from PIL import Image

        try:
            with Image.open(area) as picture:
                return np.asarray(picture.convert("L")) >= 128
        except (OSError, SyntaxError):
            raise InputError(f"{area}: is broken") from None
    for polygon in area:
        cv2.fillPoly(canvas, [np.rint(polygon[:, ::-1]).astype(np.int32)], 1)
    return canvas > 0


def _array(value: Any, shape: tuple[int, ...], name: str) -> Float64[np.ndarray, "..."]:
    """Finite numbers as an array of ``shape``."""

    def fits(part: Any, sides: tuple[int, ...]) -> bool:
        if not sides:
            return type(part) in (int, float) and abs(part) <= _FARTHEST
        return isinstance(part, list) and len(part) == sides[0] and all(fits(one, sides[1:]) for one in part)

    if not fits(value, shape):
        wanted = "x".join(map(str, shape)) + " " if shape else ""
        raise InputError(f"{name}: want {wanted}finite numbers up to {_FARTHEST:g}")
    return np.array(value, np.float64)


def _patch(entry: Any, name: str, shape: tuple[int, int]) -> Patch:
    if not isinstance(entry, dict) or ("corners" in entry) == ("controls" in entry):
        raise InputError(f"{name}: want either corners or controls")
    if unknown := sorted(set(entry) - set(_PATCH)):
        raise InputError(f"{name}: {unknown[0]}: no such entry; there is {', '.join(_PATCH)}")
    curved = "controls" in entry
    if curved:
        given = _array(entry["controls"], (4, 4, 2), f"{name}: controls")
        corners = given[[0, 0, 3, 3], [0, 3, 3, 0]]
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
        controls = np.concatenate([given * weights[..., None], weights[..., None]], axis=2)
    elif "weights" in entry:
        raise InputError(f"{name}: weights belong to controls; corners have none")
    if not (controls[..., 2] > 0).all():
        reason = "a weight is not positive" if curved else "passes through the horizon"
        raise InputError(f"{name}: {reason}" + ("" if curved else "; give less beyond"))
    space = bezier.in_space(controls, shape, bezier.focal_length(matrix, shape))
    _check_folds(controls, name)
    long = np.array(bezier.lengths(space))
    if "size" in entry:
        size = _array(entry["size"], (2,), f"{name}: size") * (1 + 2 * beyond)
    else:
        # the nearest edge is the one with the least depth
        edge = float(_array(entry.get("edge", 1), (), f"{name}: edge"))
        cut = bezier.in_space(bezier.of_plane(matrix), shape, bezier.focal_length(matrix, shape))
        ring = cut[[0, 0, 3, 3], [0, 3, 3, 0]]
        nearest = int(np.argmin([ring[k][2] + ring[(k + 1) % 4][2] for k in range(4)]))
        size = long * edge / max(float(np.linalg.norm(ring[nearest] - ring[(nearest + 1) % 4])), 1e-9)
    if not (size > 0).all():
        raise InputError(f"{name}: size and edge must be positive")
    return Patch(name, controls, space, (float(size[0]), float(size[1])))


def check_quad(corners: Float64[np.ndarray, "4 2"], name: str) -> None:
    """`InputError` unless the corners are a convex quadrangle, clockwise as one sees it."""
    sides = np.roll(corners, -1, axis=0) - corners
    after = np.roll(sides, -1, axis=0)
    # positive where the path turns clockwise, rows growing downwards
    turns = sides[:, 1] * after[:, 0] - sides[:, 0] * after[:, 1]
    if np.abs(turns).min() < 1:
        raise InputError(f"{name}: the corners have no area, or three are on a line")
    clockwise = int((turns > 0).sum())
    if clockwise == 2:
        raise InputError(f"{name}: the corners are crossed; give them clockwise around the patch")
    if clockwise == 0:
        raise InputError(f"{name}: the corners run anticlockwise, which mirrors the texture")
    if clockwise != 4:
        raise InputError(f"{name}: passes through the horizon: no plane seen in perspective has such corners")


def _check_folds(controls: bezier.Controls, name: str) -> None:
    at = np.linspace(0, 1, _FINE)
    u, v = np.meshgrid(at, at, indexing="ij")
    (bu, du), (bv, dv) = bezier.bernstein(u), bezier.bernstein(v)
    point = np.einsum("...i,...j,ijk->...k", bu, bv, controls)
    by_u = np.einsum("...i,...j,ijk->...k", du, bv, controls)
    by_v = np.einsum("...i,...j,ijk->...k", bu, dv, controls)
    # the triple product has the sign of the Jacobian's determinant, w being positive
    if not (np.linalg.det(np.stack([by_u, by_v, point], axis=-1)) > 0).all():
        raise InputError(f"{name}: the surface folds over in the picture; move its control points apart")
