"""glTF 2.0 binary: a plane or mesh with the material, its maps as PNGs in the same file."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

from texloom.pipelines.media.conventions import GLTF
from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.material_export import with_unit_normals
from texloom.pipelines.media.relief import relief_of
from texloom.pipelines.media.writers.layouts import levels_of, material_name, parts_of, with_bits
from texloom.pipelines.media.writers.registry import WriteJob
from texloom.pipelines.store.atomic import write_atomically
from texloom.pipelines.store.codec import ArtifactError
from texloom.pipelines.store.png_file import png
from texloom.stages.common.surface.mesh import along_texture, unit_tangents
from texloom.stages.common.surface.weld import weld
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import TORUS, Wraps

_LARGEST = 2**32 - 1  # bytes; lengths are of 32 bits
_FLOAT, _SHORT, _INT = 5126, 5123, 5125
_VERTICES, _INDICES = 34962, 34963
_REPEAT, _CLAMP, _LINEAR, _MIPMAPS = 10497, 33071, 9729, 9987
_OPAQUE = 0.999
_CUTOFF = 0.5


def write(job: WriteJob) -> dict[str, str]:
    """See `texloom.pipelines.media.writers.registry.write`."""
    image = with_unit_normals(job.value, 8)
    try:
        content = binary(material_name(job.path.stem), image, job.delivery, job.mesh, job.bits)
    except ValueError as error:
        raise ArtifactError(f"{job.path}: {error}") from None
    write_atomically(job.path, content)
    return {"": hashlib.sha256(content).hexdigest()}


def binary(
    name: str,
    image: Image,
    delivery: Delivery,
    mesh: np.ndarray | None = None,
    fed: Mapping[str, int] | None = None,
) -> bytes:
    """The bytes of a file; `ValueError` where they would be too many.

    Parameters
    ----------
    image : normals of unit length, green up.
    delivery : its texel size gives the plane's, m; without one the longer side is 1.
    mesh : what the image lies on, see `texloom.stages.vocabulary.arrays.Mesh`; None: the plane.
    fed : role to the bits of what the map is made from; PNGs have 16 for more than 8.
    """
    arrays = _plane(image, delivery) if mesh is None else _indexed(mesh)
    blobs = [array.astype(array.dtype.newbyteorder("<")).tobytes() for array in arrays]
    parts = [with_bits(part, fed or {}) for part in parts_of(image, GLTF)]
    blobs += [png(levels_of(image, part, directx=False)) for part in parts]
    views, content = [], b""
    for blob in blobs:
        views.append({"buffer": 0, "byteOffset": len(content), "byteLength": len(blob)})
        content += blob + bytes(-len(blob) % 4)
    kinds = [
        (_SHORT if arrays[0].dtype == np.uint16 else _INT, "SCALAR"),
        (_FLOAT, "VEC3"),
        (_FLOAT, "VEC3"),
        (_FLOAT, "VEC4"),
        (_FLOAT, "VEC2"),
    ]
    accessors: list[dict[str, Any]] = [
        {"bufferView": index, "componentType": kind, "count": len(array), "type": shape}
        for index, (array, (kind, shape)) in enumerate(zip(arrays, kinds, strict=True))
    ]
    for index, view in enumerate(views[: len(arrays)]):
        view["target"] = _INDICES if index == 0 else _VERTICES
    accessors[1] |= {"min": arrays[1].min(axis=0).tolist(), "max": arrays[1].max(axis=0).tolist()}
    document = {
        "asset": {"version": "2.0", "generator": "texloom"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name}],
        "meshes": [{"name": name, "primitives": [_primitive()]}],
        "materials": [_material(name, image, [part.suffix for part in parts]) | _extras(image)],
        "textures": [{"sampler": 0, "source": index} for index in range(len(parts))],
        "images": [
            {"bufferView": len(arrays) + index, "mimeType": "image/png", "name": f"{name}_{part.suffix}"}
            for index, part in enumerate(parts)
        ],
        "samplers": [
            _sampler(image.wraps if mesh is None else TORUS)
        ],  # texture coordinates of meshes lie anywhere
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(content)}],
    }
    return _chunks(json.dumps(document, separators=(",", ":")).encode(), content)


def _sampler(wraps: Wraps) -> dict[str, int]:
    across, down = (_REPEAT if goes_on else _CLAMP for goes_on in (wraps.across, wraps.down))
    return {"magFilter": _LINEAR, "minFilter": _MIPMAPS, "wrapS": across, "wrapT": down}


def _plane(image: Image, delivery: Delivery) -> list[np.ndarray]:
    """Indices, points, normals, tangents and texture coordinates."""
    longer = max(image.height, image.width)
    height, width = delivery.size(image.height, image.width) or (image.height / longer, image.width / longer)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32) / 2
    points = np.concatenate([corners * np.array([width, height], np.float32), np.zeros((4, 1), np.float32)], axis=1)
    return [
        np.array([0, 1, 2, 0, 2, 3], np.uint16),
        points,
        np.tile(np.array([0, 0, 1], np.float32), (4, 1)),
        np.tile(np.array([1, 0, 0, 1], np.float32), (4, 1)),
        np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32),
    ]


def _indexed(mesh: np.ndarray) -> list[np.ndarray]:
    """As `_plane`, of a mesh whose equal corners are one vertex."""
    whole = np.concatenate([mesh[:, :8], _tangents(mesh)], axis=1)
    vertex = weld(whole)
    _, first = np.unique(vertex, return_index=True)
    points = whole[first]
    texture = np.stack([points[:, 6], 1 - points[:, 7]], axis=1)
    kind = np.uint16 if len(points) < 2**16 else np.uint32
    return [vertex.astype(kind), points[:, :3], points[:, 3:6], points[:, 8:], texture]


def _tangents(mesh: np.ndarray) -> np.ndarray:
    """Along u at each corner, orthogonal to the normal, with the side to which v points; (corners, 4) float32."""
    along, side = along_texture(mesh)
    side = np.repeat(side, 3)[:, None]
    corner = weld(np.concatenate([mesh[:, :8], side], axis=1))
    along = np.repeat(along[..., 0], 3, axis=0)
    along = np.stack([np.bincount(corner, along[:, axis]) for axis in range(3)], axis=1)[corner]
    return np.concatenate([unit_tangents(along, mesh[:, 3:6]), side], axis=1).astype(np.float32)


def _primitive() -> dict[str, Any]:
    attributes = {"POSITION": 1, "NORMAL": 2, "TANGENT": 3, "TEXCOORD_0": 4}
    return {"attributes": attributes, "indices": 0, "material": 0}


def _material(name: str, image: Image, parts: list[str]) -> dict[str, Any]:
    texture = {part: {"index": index} for index, part in enumerate(parts)}
    surface: dict[str, Any] = {"baseColorTexture": texture["baseColor"]}
    material: dict[str, Any] = {"name": name, "pbrMetallicRoughness": surface}
    packed = texture.get("occlusionRoughnessMetallic")
    if packed is None:
        surface |= {"metallicFactor": 0.0}
    else:
        surface["metallicRoughnessTexture"] = packed
        material["occlusionTexture"] = packed
    if "normal" in texture:
        material["normalTexture"] = texture["normal"]
    if "emissive" in texture:
        material |= {"emissiveTexture": texture["emissive"], "emissiveFactor": [1.0, 1.0, 1.0]}
    if "A" in image.channels and image.pixels[..., image.channels.index("A")].min() < _OPAQUE:
        material |= {"alphaMode": "MASK", "alphaCutoff": _CUTOFF}
    return material


def _extras(image: Image) -> dict[str, Any]:
    """What glTF has no place for: what the heights mean, which other files hold."""
    relief = relief_of(image)
    return {"extras": {"height": relief.record()}} if relief.is_normalised else {}


def _chunks(document: bytes, content: bytes) -> bytes:
    document += b" " * (-len(document) % 4)
    total = 12 + 8 + len(document) + 8 + len(content)
    if total > _LARGEST:
        raise ValueError(f"{total} bytes are more than a .glb holds, {_LARGEST}")
    head = struct.pack("<4sII", b"glTF", 2, total)
    chunk = struct.pack("<I4s", len(document), b"JSON") + document
    return head + chunk + struct.pack("<I4s", len(content), b"BIN\0") + content
