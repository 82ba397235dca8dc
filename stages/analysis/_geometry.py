"""Files that say where surfaces lie in a photograph: reading and checking them."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from stages.analysis import _bezier
from stages.declare import InputError

_LARGEST = 1 << 20  # bytes of a file
_MOST = 256  # patches, and polygons
_FARTHEST = 1e5  # px
_PATCH = ("name", "corners", "controls", "weights", "size", "edge", "beyond")
_FINE = 25  # points a side at which a patch is looked at


@dataclass(frozen=True)
class Patch:
    """A part of a surface."""

    name: str
    controls: _bezier.Controls
    space: _bezier.Controls
    """the same in space, see `stages.analysis._bezier.in_space`"""
    size: tuple[float, float]
    """of the part, down and across, in units of texture"""

    @property
    def unit(self) -> Float64[np.ndarray, "2"]:
        """Units of ``space`` in a unit of texture, down and across."""
        return np.array(_bezier.lengths(self.space)) / self.size


@dataclass(frozen=True)
class Geometry:
    """What a file says."""

    patches: list[Patch]
    region: list[Float64[np.ndarray, "n 2"]]
    """polygons to take texture from, row before column; none: all that patches cover"""
    without: list[Float64[np.ndarray, "n 2"]]
    """polygons to leave out"""
    hole: list[Float64[np.ndarray, "n 2"]]
    """polygons to fill"""


def read_geometry(path: Path, shape: tuple[int, int]) -> Geometry:
    """Read a file of patches for a photograph of ``shape``.

    It is JSON: ``{"patches": [...], "region": [polygon, ...], "without": [...], "hole": [...]}``, a polygon a list
    of [row, column] in px. A patch has four ``corners``, clockwise from where the texture begins, or 4x4
    ``controls`` with 4x4 ``weights``, which default to those of the plane through their corners; its ``size`` down
    and across in any unit of length, else the length of its nearest ``edge``, 1 if not given, and the rest from
    perspective; a plane may go on ``beyond`` its corners, in multiples of its size; and a ``name``.

    Raises
    ------
    InputError
        naming the file and the patch that is wrong.
    """
    try:
        data = path.read_bytes() if path.stat().st_size <= _LARGEST else None
        content = None if data is None else json.loads(data)
    except OSError as error:
        raise InputError(f"geometry: {path}: {error.strerror or 'cannot be read'}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"geometry: {path}: is not JSON: {str(error).splitlines()[0]}") from None
    if data is None:
        raise InputError(f"geometry: {path}: larger than {_LARGEST} bytes")
    try:
        return _parsed(content, shape)
    except InputError as error:
        raise InputError(f"geometry: {path}: {error}") from None


def frontal(shape: tuple[int, int]) -> Geometry:
    """The whole photograph as a plane seen from the front, a px a unit."""
    down, across = shape[0] - 1, shape[1] - 1
    corners = [[0, 0], [0, across], [down, across], [down, 0]]
    return _parsed({"patches": [{"corners": corners, "size": [down, across]}]}, shape)


def _parsed(content: Any, shape: tuple[int, int]) -> Geometry:
    parts = ("patches", "region", "without", "hole")
    if not isinstance(content, dict) or not isinstance(content.get("patches"), list) or not content["patches"]:
        raise InputError('want {"patches": [{"corners": [[row, column], ...]}, ...]}')
    if unknown := sorted(set(content) - set(parts)):
        raise InputError(f"{unknown[0]}: no such entry; there is {', '.join(parts)}")
    if len(content["patches"]) > _MOST:
        raise InputError(f"patches: {len(content['patches'])} are more than {_MOST}")
    patches = []
    for index, entry in enumerate(content["patches"]):
        name = entry.get("name", f"patches[{index}]") if isinstance(entry, dict) else f"patches[{index}]"
        patches.append(_patch(entry, f"patch {str(name)[:40]!r}", shape))
    return Geometry(patches, *(_polygons(content.get(part, []), part) for part in parts[1:]))


def _polygons(value: Any, name: str) -> list[np.ndarray]:
    if not isinstance(value, list) or len(value) > _MOST:
        raise InputError(f"{name}: want a list of up to {_MOST} polygons")
    for index, polygon in enumerate(value):
        if not isinstance(polygon, list) or not 3 <= len(polygon) <= 4096:
            raise InputError(f"{name}[{index}]: want a list of three points [row, column] or more")
    return [_array(polygon, (len(polygon), 2), f"{name}[{index}]") for index, polygon in enumerate(value)]


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
    matrix = _bezier.homography(corners)
    beyond = float(_array(entry.get("beyond", 0), (), f"{name}: beyond"))
    if beyond < 0 or (curved and beyond):
        raise InputError(f"{name}: beyond: want 0 or more, and corners, not controls")
    plane = controls = _bezier.of_plane(matrix, beyond)
    if curved:
        weights = _array(entry["weights"], (4, 4), f"{name}: weights") if "weights" in entry else plane[..., 2]
        controls = np.concatenate([given * weights[..., None], weights[..., None]], axis=2)
    elif "weights" in entry:
        raise InputError(f"{name}: weights belong to controls; corners have none")
    if not (controls[..., 2] > 0).all():
        reason = "a weight is not positive" if curved else "passes through the horizon"
        raise InputError(f"{name}: {reason}" + ("" if curved else "; give less beyond"))
    space = _bezier.in_space(controls, shape, _bezier.focal_length(matrix, shape))
    _check_folds(controls, name)
    long = np.array(_bezier.lengths(space))
    if "size" in entry:
        size = _array(entry["size"], (2,), f"{name}: size") * (1 + 2 * beyond)
    else:
        # the nearest edge is the one with the least depth
        edge = float(_array(entry.get("edge", 1), (), f"{name}: edge"))
        cut = _bezier.in_space(_bezier.of_plane(matrix), shape, _bezier.focal_length(matrix, shape))
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


def _check_folds(controls: _bezier.Controls, name: str) -> None:
    at = np.linspace(0, 1, _FINE)
    u, v = np.meshgrid(at, at, indexing="ij")
    (bu, du), (bv, dv) = _bezier.bernstein(u), _bezier.bernstein(v)
    point = np.einsum("...i,...j,ijk->...k", bu, bv, controls)
    by_u = np.einsum("...i,...j,ijk->...k", du, bv, controls)
    by_v = np.einsum("...i,...j,ijk->...k", bu, dv, controls)
    # the triple product has the sign of the Jacobian's determinant, w being positive
    if not (np.linalg.det(np.stack([by_u, by_v, point], axis=-1)) > 0).all():
        raise InputError(f"{name}: the surface folds over in the picture; move its control points apart")
