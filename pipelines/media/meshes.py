"""Mesh files of sources: locating, digests, reading by trimesh or OpenUSD. Meshes that ship are computed."""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import io
import itertools
import json
import logging
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from texloom.pipelines.errors import hint
from texloom.pipelines.media import shapes, usd
from texloom.pipelines.media.corners import placed
from texloom.pipelines.media.headers import Refusal
from texloom.pipelines.media.locate import is_path, locate, opened
from texloom.pipelines.memory import check_memory
from texloom.pipelines.store.atomic import file_digest
from texloom.stages.common.surface.weld import weld

SUFFIXES = (".obj", ".ply", ".glb", ".gltf", ".stl", ".off", *usd.SUFFIXES)
_VERSION = 3  # to be raised when files are read to other values
_MAX_FACES = 20_000_000
_MAX_NODES = 100_000  # of a glTF, which take 15 s
_MEMORY = 12  # bytes that reading takes for a byte of a file, about
_MEMORY_OF_WORD = 100  # bytes, for a word of text, of which polygons may be triangles
_MEMORY_OF_FACE = 450  # bytes, of a triangle with all its corners
_WORDS = (".obj", ".off")  # text whose faces may have any number of corners
_SCHEME = "texloom:"


def inspect(reference: str) -> str:
    """The digest of a mesh, 64 hexadecimal digits; nothing is read but bytes.

    Raises
    ------
    Refusal : it cannot be a mesh, or trimesh or OpenUSD is missing.
    """
    if not is_path(reference):
        _shape(reference)
        return hashlib.sha256(f"{shapes.VERSION}:{reference}".encode()).hexdigest()
    path = locate(reference)
    if path.suffix.lower() not in SUFFIXES:
        kinds = f"{', '.join(SUFFIXES[:-1])} and {SUFFIXES[-1]}"
        raise Refusal(f"is no mesh; files that end in {kinds}, and texloom:NAME, are")
    module, name, extra = ("pxr", "OpenUSD", "usd") if _is_usd(path) else ("trimesh", "trimesh", "mesh")
    if importlib.util.find_spec(module) is None:
        raise Refusal(f"{name} is needed to read it; pip install 'texloom[{extra}]'")
    digest = hashlib.sha256(str(_VERSION).encode())
    needed = 0
    for one in _files(path):
        with opened(one) as file:
            needed += _MEMORY * one.stat().st_size
            digest.update(file_digest(file).encode())
            if one.suffix.lower() in _WORDS:
                file.seek(0)
                needed += _MEMORY_OF_WORD * _word_count(file)
    if problem := check_memory(needed):
        raise Refusal(problem)
    return digest.hexdigest()


def _word_count(file: BinaryIO) -> int:
    """Words between spaces and tabs, about."""
    return sum(part.count(b" ") + part.count(b"\t") for part in iter(lambda: file.read(1 << 20), b""))


def read(reference: str, digest: str) -> np.ndarray:
    """A mesh as `texloom.stages.vocabulary.arrays.Mesh`; all objects of a file in one, where the scene has them.

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
        raise Refusal(f"no such mesh ships with texloom{hint(name, shapes.SHAPES)}")
    return shapes.SHAPES[name]


def _is_usd(path: Path) -> bool:
    return path.suffix.lower() in usd.SUFFIXES


def _files(path: Path) -> list[Path]:
    """The file and those that it needs."""
    with opened(path):  # a regular file
        if _is_usd(path):
            try:
                return usd.layers(path)
            except ValueError as error:
                raise Refusal(f"cannot be read as USD: {error}") from None
        return [path, *_buffers(path)]


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
    suffix = path.suffix.lower().removeprefix(".")
    try:
        parts = usd.corners(path) if _is_usd(path) else _by_trimesh(path, suffix)
    except (MemoryError, Refusal):
        raise
    except Exception as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise Refusal(f"cannot be read as {suffix}: {reason}") from None
    _check_faces(sum(len(part) for part in parts) // 3)
    return np.concatenate(parts)


def _check_faces(count: int) -> None:
    """`Refusal` of none, or too many for the limit or the memory."""
    if not count:
        raise Refusal("has no faces")
    if count > _MAX_FACES:
        raise Refusal(f"has {count} faces, at most {_MAX_FACES}")
    if problem := check_memory(_MEMORY_OF_FACE * count):
        raise Refusal(f"has {count} faces; it {problem}")


@contextlib.contextmanager
def _unlogged(name: str) -> Iterator[None]:
    """Without handlers, Python prints what a library logs."""
    logger, handler = logging.getLogger(name), logging.NullHandler()
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


@_unlogged("trimesh")
def _by_trimesh(path: Path, suffix: str) -> list[np.ndarray]:
    """The corners of each object."""
    import trimesh

    content = path.read_bytes()
    options: dict[str, Any] = {"skip_materials": True}
    if suffix in ("glb", "gltf"):
        content = _with_plain_material(content)
        options = {"resolver": trimesh.resolvers.FilePathResolver(str(path))}
    scene = trimesh.load_scene(io.BytesIO(content), file_type=suffix, process=False, **options)
    nodes = scene.graph.transforms.node_data
    geometry = {node: scene.geometry[nodes[node]["geometry"]] for node in sorted(scene.graph.nodes_geometry)}
    objects = {node: one for node, one in geometry.items() if isinstance(one, trimesh.Trimesh)}
    _check_faces(sum(len(one.faces) for one in objects.values()))  # of a mesh for each node that shows it
    transforms = _transforms(scene)
    return [_of_object(one, transforms[node]) for node, one in objects.items()]


def _transforms(scene: Any) -> dict[Any, np.ndarray]:
    """From each node's coordinates to the scene's, (4, 4).

    `trimesh.scene.transforms.SceneGraph.get` takes time by the square of the depth.
    """
    forest = scene.graph.transforms
    known = {scene.graph.base_frame: np.eye(4)}
    for shown in scene.graph.nodes_geometry:
        path = [shown]
        while path[-1] not in known:
            if path[-1] not in forest.parents or len(path) > len(forest.parents) + 1:
                raise ValueError("its nodes are no tree")
            path.append(forest.parents[path[-1]])
        for above, below in itertools.pairwise(reversed(path)):
            known[below] = known[above] @ forest.edge_data[above, below]["matrix"]
    return known


def _with_plain_material(content: bytes) -> bytes:
    """A glTF with one material without pictures: trimesh drops texture coordinates where there is none."""
    is_binary = content[:4] == b"glTF"
    length = struct.unpack_from("<I", content, 12)[0] if is_binary else len(content)
    start = 20 if is_binary else 0
    document = json.loads(content[start : start + length])
    if (count := len(document.get("nodes", []))) > _MAX_NODES:
        raise Refusal(f"has {count} nodes, at most {_MAX_NODES}")
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
    vertex, count = np.asarray(geometry.faces, np.int64).ravel(), len(geometry.vertices)
    if vertex.size and not 0 <= vertex.min() <= vertex.max() < count:
        raise ValueError("a face names a vertex that is not there")
    texture = getattr(geometry.visual, "uv", None)
    has_normals = "vertex_normals" in geometry._cache.cache
    given = {
        "normal": geometry.vertex_normals if has_normals else None,
        "texture": texture if texture is not None and len(texture) == count else None,
        **_attributes(geometry),
    }
    at_corners = {name: None if values is None else np.asarray(values)[vertex] for name, values in given.items()}
    return placed(np.asarray(geometry.vertices)[vertex], transform, **at_corners)


def _attributes(geometry: Any) -> dict[str, np.ndarray]:
    """Direction and control at the vertices: _DIRECTION and _CONTROL of glTF, direction_x and so on of PLY."""
    named = {name.lower().removeprefix("_"): values for name, values in geometry.vertex_attributes.items()}
    raw = geometry.metadata.get("_ply_raw", {}).get("vertex", {})
    if names := {"direction_x", "direction_y", "direction_z", "control"} & set(raw.get("properties", ())):
        # trimesh splits vertices where texture coordinates differ, and keeps no attributes then
        table = {name: np.asarray(raw["data"][name], np.float64).ravel() for name in {*"xyz", *names}}
        points = np.column_stack([table[axis] for axis in "xyz"])
        number = weld(np.concatenate([points, geometry.vertices]))
        first = np.zeros(number.max() + 1, np.int64)
        first[number[: len(points)]] = np.arange(len(points))
        at = first[number[len(points) :]]
        if len(names - {"control"}) == 3:
            named["direction"] = np.column_stack([table[f"direction_{axis}"] for axis in "xyz"])[at]
        if "control" in names:
            named["control"] = table["control"][at]
    return {name: named[name] for name in ("direction", "control") if name in named}
