"""The corners of an object's triangles in the scene, whatever file they come from."""

from __future__ import annotations

import numpy as np

_COLUMNS = {"normal": slice(3, 6), "texture": slice(6, 8), "direction": slice(8, 11), "control": slice(11, 12)}


def placed(points: np.ndarray, transform: np.ndarray, **attributes: np.ndarray | None) -> np.ndarray:
    """An object as part of a `texloom.stages.vocabulary.arrays.Mesh`.

    Parameters
    ----------
    points : (corners, 3), three rows for each triangle.
    transform : (4, 4), from the object's coordinates to the scene's; a mirrored object keeps its outside.
    attributes : ``normal``, ``texture``, ``direction`` and ``control`` at each corner, where the object has them.
    """
    linear = transform[:3, :3]
    whole = np.full((len(points), 12), np.nan, np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        whole[:, :3] = np.asarray(points, np.float64) @ linear.T + transform[:3, 3]
        for name, values in attributes.items():
            if values is None:
                continue
            made = np.asarray(values, np.float64).reshape(len(points), -1)
            if name == "normal":
                made = _unit(made @ np.linalg.pinv(linear))
            elif name == "direction":
                made = _unit(made @ linear.T)
            columns = _COLUMNS[name]
            whole[:, columns] = made[:, : columns.stop - columns.start]
        is_mirrored = np.linalg.det(linear) < 0
    if is_mirrored:
        whole = whole.reshape(-1, 3, 12)[:, ::-1].reshape(-1, 12)
    return whole


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors of length 1; not a number where they have no length."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.maximum(length, 1e-300), np.nan)
