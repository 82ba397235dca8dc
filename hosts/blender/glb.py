"""A mesh as a GLB file, of its triangles' corners: glTF has y up and texture coordinates from the top."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

_FLOAT, _TRIANGLES, _ARRAY_BUFFER = 5126, 4, 34962
_KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}


def y_up(vectors: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) of Blender, where z is up, as glTF has them."""
    return np.stack([vectors[:, 0], vectors[:, 2], -vectors[:, 1]], axis=1)


def glb(
    points: np.ndarray, texture: np.ndarray, normals: np.ndarray, direction: np.ndarray | None = None,
    control: np.ndarray | None = None,
) -> bytes:  # fmt: skip
    """The file.

    points, normals, direction : (n, 3) of each corner, three a triangle, z up; direction is 0 where nothing leads.
    texture : (n, 2), as Blender has them.
    control : (n,) in 0..1.
    """
    arrays = {"POSITION": y_up(points), "NORMAL": y_up(normals)}
    arrays["TEXCOORD_0"] = np.stack([texture[:, 0], 1 - texture[:, 1]], axis=1)
    if direction is not None:
        arrays["_DIRECTION"] = y_up(direction)
    if control is not None:
        arrays["_CONTROL"] = control[:, None]
    content, views, accessors = b"", [], []
    for name, values in arrays.items():
        packed = np.ascontiguousarray(values, "<f4")
        views.append(
            {"buffer": 0, "byteOffset": len(content), "byteLength": packed.nbytes, "target": _ARRAY_BUFFER}
        )
        accessor: dict[str, Any] = {
            "bufferView": len(views) - 1, "componentType": _FLOAT, "count": len(packed),
            "type": _KINDS[packed.shape[1]],
        }  # fmt: skip
        if name == "POSITION":
            accessor |= {"min": packed.min(axis=0).tolist(), "max": packed.max(axis=0).tolist()}
        accessors.append(accessor)
        content += packed.tobytes()
    attributes = {name: number for number, name in enumerate(arrays)}
    document = {
        "asset": {"version": "2.0", "generator": "texloom for Blender"},
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "mode": _TRIANGLES}]}],
        "buffers": [{"byteLength": len(content)}], "bufferViews": views, "accessors": accessors,
    }  # fmt: skip
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(content), b"BIN\0") + content
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
