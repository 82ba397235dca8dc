"""Linear colour spaces by the names of the Color Interop Forum, and the conversion between their primaries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float32

REC709 = "lin_rec709_scene"
ACESCG = "lin_ap1_scene"
_D65, _ACES = (0.3127, 0.3290), (0.32168, 0.33767)
PRIMARIES: Mapping[str, tuple[float, ...]] = {
    REC709: (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, *_D65),
    ACESCG: (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, *_ACES),
    "lin_ap0_scene": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, *_ACES),
    "lin_rec2020_scene": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *_D65),
    "lin_p3d65_scene": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *_D65),
    "lin_adobergb_scene": (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, *_D65),
}
"""name to x and y of red, green, blue and white (CIE 1931), in the order of OpenEXR's ``chromaticities``"""
NO_COLOR = ("data", "unknown")
"""names of values that have no colour space"""
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
D50 = np.array([0.9642, 1.0, 0.8249])
"""XYZ of the connection space of ICC profiles"""
_TOLERANCE = 0.001  # of chromaticities; files round them differently


def same_primaries(one: Sequence[float], other: Sequence[float]) -> bool:
    """Whether two sets of chromaticities are equal within rounding."""
    return bool(np.abs(np.subtract(one, other)).max() <= _TOLERANCE)


def conversion(source: Sequence[float], target: Sequence[float]) -> np.ndarray:
    """The 3x3 matrix from linear colour of some primaries to that of others, white to white by Bradford.

    Raises
    ------
    ValueError
        The primaries lie on one line, or are not finite.
    """
    return np.asarray(np.linalg.inv(_to_d50(target)) @ _to_d50(source))


def from_d50(xyz: np.ndarray) -> np.ndarray:
    """The matrix to linear Rec.709 from a device whose red, green and blue have these XYZ (D50) as columns."""
    return np.asarray(np.linalg.inv(_to_d50(PRIMARIES[REC709])) @ xyz)


def converted(color: np.ndarray, matrix: np.ndarray) -> Float32[np.ndarray, "h w 3"]:
    """Linear colour (h, w, 3) by a matrix; computed in strips to save memory."""
    result = np.empty(color.shape, np.float32)
    rows = max(1, 2**20 // color.shape[1])
    for top in range(0, len(color), rows):
        result[top : top + rows] = color[top : top + rows].astype(np.float64) @ matrix.T
    return result


def _to_d50(chromaticities: Sequence[float]) -> np.ndarray:
    """XYZ, relative to D50, of linear colour."""
    xy = np.asarray(chromaticities, np.float64).reshape(4, 2)
    if not np.isfinite(xy).all() or abs(xy[3, 1]) < 1e-6:
        raise ValueError("chromaticities are not those of a colour space")
    x, y = xy.T
    xyz = np.stack([x, y, 1 - x - y])
    if abs(np.linalg.det(xyz[:, :3])) < 1e-6:
        raise ValueError("chromaticities are not those of a colour space")
    white = xyz[:, 3] / y[3]
    matrix = xyz[:, :3] * np.linalg.solve(xyz[:, :3], white)
    cones = _BRADFORD @ white
    adaptation = np.linalg.inv(_BRADFORD) @ np.diag((_BRADFORD @ D50) / cones) @ _BRADFORD
    return np.asarray(adaptation @ matrix)


def of_exr(header: Mapping[str, Any]) -> np.ndarray | None:
    """The matrix to Rec.709 of an EXR's colour; None where it is Rec.709, or the header does not tell.

    ``colorInteropID`` counts before ``chromaticities``.

    Raises
    ------
    ValueError
        It is in another colour space, which cannot be converted; in words.
    """
    name = header.get("colorInteropID")
    chromaticities = header.get("chromaticities")
    if isinstance(name, str) and name:
        if name in NO_COLOR:
            return None
        if name not in PRIMARIES:
            raise ValueError(f"is in the colour space {name[:60]!r}; {', '.join(PRIMARIES)} are read")
        chromaticities = PRIMARIES[name]
    if chromaticities is None or same_primaries(chromaticities, PRIMARIES[REC709]):
        return None
    return conversion(chromaticities, PRIMARIES[REC709])
