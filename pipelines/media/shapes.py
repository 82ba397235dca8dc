"""Meshes that ship with texloom, as ``texloom:NAME``: computed, with or without texture coordinates."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping

import numpy as np

from texloom.stages.kernels.core.loading import loaded

VERSION = 2
"""to be raised when a shape changes"""


def torus(along: int = 96, around: int = 48, radius: float = 1.0, tube: float = 0.4) -> np.ndarray:
    """A torus around the axis y; its texture coordinates cover the texture and wrap around in both directions."""
    u, v = np.meshgrid(np.linspace(0, 1, along + 1), np.linspace(0, 1, around + 1), indexing="ij")
    a, b = 2 * np.pi * (u % 1), 2 * np.pi * (v % 1)
    normal = np.stack([np.cos(b) * np.cos(a), np.sin(b), -np.cos(b) * np.sin(a)], axis=2)
    ring = np.stack([np.cos(a), np.zeros_like(a), -np.sin(a)], axis=2)
    return _grid(radius * ring + tube * normal, normal, u, v)


def terrain(cells: int = 128, side: float = 4.0, relief: float = 0.6) -> np.ndarray:
    """Hills over a square, seen from above in its texture coordinates."""
    u, v = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
    rng = np.random.default_rng(3)
    height = np.zeros_like(u)
    for octave in range(1, 5):
        for _ in range(4):
            turn, phase = rng.uniform(0, 2 * np.pi, 2)
            wave = 2**octave * (np.cos(turn) * u + np.sin(turn) * v)
            height += np.sin(2 * np.pi * wave / 2 + phase) / 2**octave / 4
    points = np.stack([(u - 0.5) * side, relief * height, (0.5 - v) * side], axis=2)
    return _grid(points, np.full_like(points, np.nan), u, v)


def tower() -> np.ndarray:
    """A building: three storeys, each smaller than the one below, and a pyramid. Without texture coordinates."""
    quads: list[list[tuple[float, float, float]]] = []
    outlines = [(1.0, 0.0), (1.0, 1.2), (0.75, 1.2), (0.75, 2.2), (0.5, 2.2), (0.5, 3.0), (0.6, 3.0), (0.0, 3.8)]
    corners = ((-1, 1), (1, 1), (1, -1), (-1, -1))
    for (r, y), (s, z) in itertools.pairwise(outlines):
        for (a, b), (c, d) in zip(corners, corners[1:] + corners[:1], strict=True):
            quads.append([(a * r, y, b * r), (c * r, y, d * r), (c * s, z, d * s), (a * s, z, b * s)])
    quads.append([(a, 0.0, -b) for a, b in corners])
    points = np.array(quads, np.float64)
    return _corners(_subdivided(points[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, 3), 3))


def blob(detail: int = 5) -> np.ndarray:
    """A sphere with bulges, of 20 * 4**detail faces. Without texture coordinates."""
    spatial = loaded("scipy.spatial")
    golden = (1 + 5**0.5) / 2
    rectangle = np.array([(0, a, b * golden) for a in (-1, 1) for b in (-1, 1)])
    points = np.concatenate([np.roll(rectangle, axis, axis=1) for axis in range(3)])
    hull = spatial.ConvexHull(points)
    faces = points[hull.simplices]
    outwards = (
        np.einsum("nk,nk->n", np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]), faces[:, 0]) > 0
    )
    faces[~outwards] = faces[~outwards, ::-1]
    faces = _subdivided(faces, detail)
    faces /= np.linalg.norm(faces, axis=2, keepdims=True)
    x, y, z = np.moveaxis(faces, 2, 0)
    bulge = (
        1 + 0.18 * np.sin(3 * x + 1) * np.sin(3 * y) + 0.12 * np.cos(5 * z + 2 * x) + 0.04 * np.sin(9 * y + 7 * z)
    )
    return _corners(faces * bulge[..., None])


SHAPES: Mapping[str, Callable[[], np.ndarray]] = {"torus": torus, "terrain": terrain, "tower": tower, "blob": blob}
"""name to a function that makes it"""


def _grid(points: np.ndarray, normals: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Two triangles for each cell of a grid of vertices."""
    nothing = np.full((*u.shape, 4), np.nan)
    whole = np.concatenate([points, normals, u[..., None], v[..., None], nothing], axis=2)
    one, two, three, four = whole[:-1, :-1], whole[1:, :-1], whole[1:, 1:], whole[:-1, 1:]
    return np.stack([one, two, three, one, three, four], axis=2).reshape(-1, 12).astype(np.float32)


def _subdivided(faces: np.ndarray, times: int) -> np.ndarray:
    """Each triangle, (n, 3, 3), as four, so many times."""
    for _ in range(times):
        a, b, c = np.moveaxis(faces, 1, 0)
        d, e, f = (a + b) / 2, (b + c) / 2, (c + a) / 2
        faces = np.stack([a, d, f, d, b, e, f, e, c, d, e, f], axis=1).reshape(-1, 3, 3)
    return faces


def _corners(faces: np.ndarray) -> np.ndarray:
    """Triangles, (n, 3, 3), without area left out, as a mesh of positions alone."""
    whole = np.full((len(faces), 3, 12), np.nan, np.float32)
    whole[..., :3] = faces
    sides = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    return np.asarray(whole[np.linalg.norm(sides, axis=1) > 0].reshape(-1, 12))
