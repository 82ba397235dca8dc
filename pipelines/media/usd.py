"""Meshes of USD files: all meshes that a renderer would show, triangulated, in metres with y up.

Specification: UsdGeomMesh and UsdGeomPrimvarsAPI of OpenUSD. Subdivision surfaces are read as their cages, animated
ones at their first frame; point instancers are left out.

``python -m texloom.pipelines.media.usd TASK FILE`` is the process in which OpenUSD runs.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.media.corners import placed

_MEMORY, _GROWTH = 2**32, 64  # bytes of address space for reading, and more for each byte of the file

SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
"""of the files that are USD"""


def layers(path: Path) -> list[Path]:
    """The file and those that it is composed from, without textures; `ValueError` if one is broken or missing."""
    names = _in_process("layers", path)
    return [path, *(Path(name) for name in names if not path.samefile(name))]


def corners(path: Path) -> list[np.ndarray]:
    """The corners of each mesh, see `placed`; `ValueError` if it is broken."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "corners.npy"
        _in_process("corners", path, str(made))
        return [np.load(made)]


def _in_process(task: str, path: Path, *arguments: str) -> list[str]:
    """What a task tells; in a process with limited memory, as damaged files make OpenUSD take any amount."""
    command = [sys.executable, "-P", "-m", __name__, task, str(path), *arguments]
    done = subprocess.run(command, capture_output=True, check=False)  # noqa: S603
    try:
        told: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    except (ValueError, IndexError):
        raise ValueError(f"OpenUSD ended with code {done.returncode}") from None
    if "problem" in told:
        raise ValueError(told["problem"])
    return list(told["names"])


def main(task: str, path: str, *arguments: str) -> None:
    """Do a task and print a line of JSON, ``names`` or a ``problem``."""
    from pxr import Tf

    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY + _GROWTH * Path(path).stat().st_size,) * 2)
    told: dict[str, Any]
    try:
        told = {"names": _layers(path) if task == "layers" else _save_corners(path, *arguments)}
    except Tf.ErrorException as error:
        # OpenUSD says where in its source it is
        said = re.search(r" : '\s*(.+)", str(error))
        told = {"problem": said[1].strip().removesuffix("'") if said else "it is broken"}
    except MemoryError:
        told = {"problem": "it needs too much memory"}
    except ValueError as error:
        told = {"problem": str(error)}
    sys.stdout.write(f"\n{json.dumps(told)}\n")


def _layers(path: str) -> list[str]:
    from pxr import UsdUtils

    used, _, missing = UsdUtils.ComputeAllDependencies(path)
    for name in missing:
        if name.lower().endswith(SUFFIXES):
            raise ValueError(f"it needs {name}, which is missing or broken")
    return sorted({layer.realPath for layer in used if layer.realPath})


def _save_corners(path: str, made: str) -> list[str]:
    from pxr import Gf, Usd, UsdGeom

    stage = Usd.Stage.Open(path)
    time = Usd.TimeCode.EarliestTime()
    scene = Gf.Matrix4d().SetScale(UsdGeom.GetStageMetersPerUnit(stage))
    if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z:
        scene *= Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d.XAxis(), -90))
    transforms = UsdGeom.XformCache(time)
    parts = [
        _corners(UsdGeom.Mesh(prim), transforms.GetLocalToWorldTransform(prim) * scene, time)
        for prim in _shown(stage, time)
    ]
    np.save(made, np.concatenate([np.zeros((0, 12), np.float32), *parts]))
    return []


def _shown(stage: Any, time: Any) -> list[Any]:
    """The meshes that are visible, those of instances too."""
    from pxr import Usd, UsdGeom

    shown = []
    walk = iter(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)))
    for prim in walk:
        if prim.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()
        elif prim.IsA(UsdGeom.Mesh):
            mesh = UsdGeom.Mesh(prim)
            is_rendered = mesh.ComputePurpose() in (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
            if is_rendered and mesh.ComputeVisibility(time) != UsdGeom.Tokens.invisible:
                shown.append(prim)
    return shown


def _corners(mesh: Any, transform: Any, time: Any) -> np.ndarray:
    """The corners of a mesh in the scene."""
    from pxr import UsdGeom

    points = np.asarray(mesh.GetPointsAttr().Get(time) or (), np.float64).reshape(-1, 3)
    vertex = np.asarray(mesh.GetFaceVertexIndicesAttr().Get(time) or (), np.int64)
    counts = np.asarray(mesh.GetFaceVertexCountsAttr().Get(time) or (), np.int64)
    if counts.size and (counts.min() < 0 or counts.sum() != vertex.size):
        raise ValueError(f"{mesh.GetPath()}: its faces do not fit its list of vertices")
    if vertex.size and not 0 <= vertex.min() <= vertex.max() < len(points):
        raise ValueError(f"{mesh.GetPath()}: a face names a vertex that is not there")
    corner, face = _triangles(counts, np.asarray(mesh.GetHoleIndicesAttr().Get(time) or (), np.int64))
    if mesh.GetOrientationAttr().Get(time) == UsdGeom.Tokens.leftHanded:
        corner = corner.reshape(-1, 3)[:, ::-1].ravel()
    index = {
        UsdGeom.Tokens.constant: np.zeros(len(corner), np.int64),
        UsdGeom.Tokens.uniform: face,
        UsdGeom.Tokens.vertex: vertex[corner],
        UsdGeom.Tokens.varying: vertex[corner],
        UsdGeom.Tokens.faceVarying: corner,
    }

    def spread(values: Any, interpolation: str, what: str) -> np.ndarray | None:
        if values is None or interpolation not in index:
            return None
        try:
            array, at = np.asarray(values, np.float64), index[interpolation]
        except ValueError:
            raise ValueError(f"{mesh.GetPath()}: {what} has other values than numbers") from None
        if at.size and at.max() >= len(array):
            raise ValueError(f"{mesh.GetPath()}: {what} has {len(array)} values, too few for its faces")
        return np.asarray(array.reshape(len(array), -1)[at])

    def primvar(name: str) -> np.ndarray | None:
        found = UsdGeom.PrimvarsAPI(mesh).FindPrimvarWithInheritance(name)
        if not found.HasValue():
            return None
        return spread(found.ComputeFlattened(time), found.GetInterpolation(), f"primvars:{name}")

    normal = primvar("normals")
    if normal is None and mesh.GetNormalsAttr().HasValue():
        normal = spread(mesh.GetNormalsAttr().Get(time), mesh.GetNormalsInterpolation(), "normals")
    if mesh.GetSubdivisionSchemeAttr().Get() != UsdGeom.Tokens.none:
        normal = None  # a subdivision surface has none of its own
    return placed(
        points[vertex[corner]],
        np.array(transform).T,
        normal=normal,
        texture=primvar(_texture_name(mesh)),
        direction=primvar("direction"),
        control=primvar("control"),
    )


def _triangles(counts: np.ndarray, holes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners, numbered through all faces, of the fans of triangles of the faces; and the face of each."""
    kept = counts >= 3
    kept[holes[(holes >= 0) & (holes < counts.size)]] = False
    first = np.cumsum(counts) - counts
    parts = np.where(kept, counts - 2, 0)
    face = np.repeat(np.arange(counts.size), parts)
    number = np.arange(face.size) - np.repeat(np.cumsum(parts) - parts, parts)
    corner = first[face, None] + np.stack([np.zeros_like(number), number + 1, number + 2], axis=1)
    return corner.ravel(), np.repeat(face, 3)


def _texture_name(mesh: Any) -> str:
    """The primvar of texture coordinates: st, else the first of their type, else the first of two floats."""
    from pxr import Sdf, UsdGeom

    found = UsdGeom.PrimvarsAPI(mesh).FindPrimvarsWithInheritance()
    kinds: dict[str, Any] = {one.GetPrimvarName(): one.GetTypeName() for one in found if one.HasValue()}
    if "st" in kinds:
        return "st"
    for wanted in (Sdf.ValueTypeNames.TexCoord2fArray, Sdf.ValueTypeNames.Float2Array):
        named = [name for name, kind in kinds.items() if kind == wanted]
        if named:
            return min(named)
    return "st"


if __name__ == "__main__":
    main(*sys.argv[1:])
