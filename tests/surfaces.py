"""Meshes whose geometry is known."""

from __future__ import annotations

import numpy as np


def grid(points: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A mesh of two triangles for each cell of (m, n) vertices, without normals."""
    nothing = np.full((*u.shape, 7), np.nan)
    whole = np.concatenate([points, nothing[..., :3], u[..., None], v[..., None], nothing[..., 3:]], axis=2)
    one, two, three, four = whole[:-1, :-1], whole[:-1, 1:], whole[1:, 1:], whole[1:, :-1]
    return np.stack([one, two, three, one, three, four], axis=2).reshape(-1, 12).astype(np.float32)


def square(side: float = 1.0, u: tuple[float, float] = (0, 1), x: tuple[float, float] = (0, 1)) -> np.ndarray:
    """The part of a square that faces +z between two shares of its width, at columns ``u`` of the texture."""
    v, along = np.meshgrid(np.linspace(0, 1, 3), np.linspace(0, 1, 3), indexing="ij")
    across = x[0] + (x[1] - x[0]) * along
    points = np.stack([side * across, side * v, np.zeros_like(v)], axis=2)
    return grid(points, u[0] + (u[1] - u[0]) * along, v)


def cylinder(u: tuple[float, float] = (0, 1), height: float = 2.0, cells: int = 64) -> np.ndarray:
    """A cylinder of radius 1 around y, unrolled into columns ``u`` of the texture, open at its ends."""
    v, share = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, cells + 1), indexing="ij")
    angle = 2 * np.pi * (share % 1)
    points = np.stack([np.sin(angle), height * (v - 0.5), np.cos(angle)], axis=2)
    return grid(points, u[0] + (u[1] - u[0]) * share, v)
