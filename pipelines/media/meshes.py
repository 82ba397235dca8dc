"""Mesh files of sources: locating, digests, reading by trimesh. Meshes that ship are computed."""

from __future__ import annotations

import hashlib
import importlib.util
import io
import json
import logging
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.errors import closest
from texloom.pipelines.media import shapes
from texloom.pipelines.media.decode import Refusal
from texloom.pipelines.media.locate import is_path, locate, opened
from texloom.pipelines.memory import check_memory
from texloom.pipelines.store.atomic import file_digest

SUFFIXES = (".obj", ".ply", ".glb", ".gltf", ".stl", ".off")
_VERSION = 1  # to be raised when files are read to other values
_MAX_FACES = 20_000_000
_MEMORY = 12  # bytes that reading takes for a byte of a file, about
_SCHEME = "texloom:"


def inspect(reference: str) -> str:
    """The digest of a mesh, 64 hexadecimal digits; nothing is read but bytes.

    Raises
    ------
    Refusal : it cannot be a mesh, or trimesh is missing.
    """
    if not is_path(reference):
        _shape(reference)
        return hashlib.sha256(f"{shapes.VERSION}:{reference}".encode()).hexdigest()
    path = locate(reference)
    if path.suffix.lower() not in SUFFIXES:
        kinds = f"{', '.join(SUFFIXES[:-1])} and {SUFFIXES[-1]}"
        raise Refusal(f"is no mesh; files that end in {kinds}, and texloom:NAME, are")
    if importlib.util.find_spec("trimesh") is None:
        raise Refusal("trimesh is needed to read it; pip install 'texloom[mesh]'")
    digest = hashlib.sha256(str(_VERSION).encode())
    size = 0
    for one in (path, *_buffers(path)):
        with opened(one) as file:
            size += one.stat().st_size
            digest.update(file_digest(file).encode())
    if problem := check_memory(_MEMORY * size):
        raise Refusal(problem)
    return digest.hexdigest()


def read(reference: str, digest: str) -> np.ndarray:
    """A mesh as `texloom.stages.arrays.Mesh`; all objects of a file in one, where the scene has them.

    Raises
    ------
    Refusal : it is broken, has no faces or too many, or is not the one of that digest.
    """
    if not is_path(reference):
        return _shape(reference)()
    if inspect(reference) != digest:
        raise Refusal("has changed since the run began")
    corners = _corners(locate(reference))
    if inspect(reference) != digest:
        raise Refusal("has changed while it was read")
    return corners


def _shape(reference: str) -> Callable[[], np.ndarray]:
    name = reference.removeprefix(_SCHEME)
    if not reference.startswith(_SCHEME) or name not in shapes.SHAPES:
        near = closest(name, shapes.SHAPES) or f"; there is {', '.join(shapes.SHAPES)}"
        raise Refusal(f"no such mesh ships with texloom{near}")
    return shapes.SHAPES[name]


def _buffers(path: Path) -> list[Path]:
    """The other files of a glTF in text, which lie beside it."""
    if path.suffix.lower() != ".gltf":
        return []
    try:
        names = [one.get("uri", "") for one in json.loads(path.read_bytes()).get("buffers", [])]
        return [path.parent / name for name in names if name and not name.startswith("data:")]
    except (ValueError, TypeError, AttributeError, RecursionError):
        raise Refusal("is not glTF: its text is not that of a JSON document") from None


def _corners(path: Path) -> np.ndarray:
    import trimesh

    logging.getLogger("trimesh").addHandler(logging.NullHandler())
    suffix = path.suffix.lower().removeprefix(".")
    try:
        content = path.read_bytes()
        options: dict[str, Any] = {"skip_materials": True}
        if suffix in ("glb", "gltf"):
            content = _with_plain_material(content)
            options = {"resolver": trimesh.resolvers.FilePathResolver(str(path))}
        scene = trimesh.load_scene(io.BytesIO(content), file_type=suffix, process=False, **options)
        parts = [
            _of_object(scene.geometry[name], np.asarray(scene.graph[node][0]))
            for node in sorted(scene.graph.nodes_geometry)
            for name in [scene.graph[node][1]]
            if isinstance(scene.geometry[name], trimesh.Trimesh)
        ]
    except MemoryError:
        raise
    except Exception as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise Refusal(f"cannot be read as {suffix}: {reason}") from None
    count = sum(len(part) for part in parts) // 3
    if not count:
        raise Refusal("has no faces")
    if count > _MAX_FACES:
        raise Refusal(f"has {count} faces, at most {_MAX_FACES}")
    return np.concatenate(parts)


def _with_plain_material(content: bytes) -> bytes:
    """A glTF with one material without pictures: trimesh drops texture coordinates where there is none."""
    is_binary = content[:4] == b"glTF"
    length = struct.unpack_from("<I", content, 12)[0] if is_binary else len(content)
    start = 20 if is_binary else 0
    document = json.loads(content[start : start + length])
    for name in ("textures", "images", "samplers"):
        document.pop(name, None)
    document["materials"] = [{}]
    for mesh in document.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            primitive["material"] = 0
    made = json.dumps(document).encode()
    if not is_binary:
        return made
    made += b" " * (-len(made) % 4)
    rest = content[start + length :]
    head = struct.pack("<4sIII4s", b"glTF", 2, start + len(made) + len(rest), len(made), b"JSON")
    return head + made + rest


def _of_object(geometry: Any, transform: np.ndarray) -> np.ndarray:
    """The corners of an object's faces, in the scene."""
    faces = np.asarray(geometry.faces, np.int64)
    if faces.size and not 0 <= faces.min() <= faces.max() < len(geometry.vertices):
        raise ValueError("a face names a vertex that is not there")
    if np.linalg.det(transform[:3, :3]) < 0:
        faces = faces[:, ::-1]
    whole = np.full((faces.size, 8), np.nan, np.float32)
    points = np.asarray(geometry.vertices, np.float64) @ transform[:3, :3].T + transform[:3, 3]
    with np.errstate(over="ignore"):
        whole[:, :3] = points[faces.ravel()]
    if "vertex_normals" in geometry._cache.cache:
        normals = np.asarray(geometry.vertex_normals, np.float64) @ np.linalg.pinv(transform[:3, :3])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        whole[:, 3:6] = np.where(length > 0, normals / np.maximum(length, 1e-300), np.nan)[faces.ravel()]
    texture = getattr(geometry.visual, "uv", None)
    if texture is not None and len(texture) == len(geometry.vertices):
        whole[:, 6:] = np.asarray(texture)[faces.ravel(), :2]
    return whole
