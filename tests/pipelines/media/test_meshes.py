"""Mesh files: what is read, and how what cannot be is refused."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from tests.surfaces import square
from texloom.pipelines import memory
from texloom.pipelines.media import meshes, shapes
from texloom.pipelines.media.sources import SourceError, open_mesh
from texloom.pipelines.media.writers.registry import WriteJob, write
from texloom.stages.common.surface.mesh import areas, with_normals
from texloom.stages.vocabulary.arrays import Image

SQUARE_OBJ = """
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
f 1/1 2/2 3/3
f 1/1 3/3 4/4
"""


def read(path: Path) -> np.ndarray:
    mesh = open_mesh("mesh", str(path)).value()
    assert isinstance(mesh, np.ndarray)
    return mesh


@pytest.mark.parametrize("name", shapes.SHAPES)
def test_meshes_that_ship_are_sound_and_face_outwards(name: str) -> None:
    mesh = read(Path(f"texloom:{name}"))
    assert mesh.dtype == np.float32
    assert mesh.shape[1] == 12
    assert (areas(mesh) > 0).all()
    points = mesh[:, :3].reshape(-1, 3, 3).astype(np.float64)
    if name == "terrain":
        assert np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])[:, 1].min() > 0
    else:
        assert np.einsum("ni,ni->n", points[:, 0], np.cross(points[:, 1], points[:, 2])).sum() > 0


def test_a_file_keeps_its_texture_coordinates(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    (tmp_path / "square.obj").write_text(SQUARE_OBJ)
    mesh = read(tmp_path / "square.obj")
    np.testing.assert_allclose(mesh[:, 6:8], mesh[:, :2])
    assert len(mesh) == 6


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".off", ".glb", ".gltf"])
def test_formats_and_several_objects(tmp_path: Path, suffix: str) -> None:
    trimesh = pytest.importorskip("trimesh")
    boxes = [trimesh.creation.box(), trimesh.creation.box(transform=np.diag([2.0, 2, 2, 1]))]
    whole = trimesh.Scene(boxes) if suffix.startswith(".gl") else trimesh.util.concatenate(boxes)
    made = whole.export(file_type=suffix[1:])
    for name, content in (made if isinstance(made, dict) else {f"boxes{suffix}": made}).items():
        (tmp_path / name).write_bytes(content.encode() if isinstance(content, str) else content)
    path = tmp_path / ("model.gltf" if suffix == ".gltf" else f"boxes{suffix}")
    mesh = read(path)
    assert len(mesh) == 72
    assert areas(mesh).sum() == pytest.approx(6 + 24)
    normals = with_normals(mesh)[:, 3:6]
    assert (np.einsum("ni,ni->n", normals, mesh[:, :3]) > 0).all()


PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
property float s
property float t
property float direction_x
property float direction_y
property float direction_z
property float control
element face 1
property list uchar int vertex_indices
end_header
0 0 0 0 0 2 0 0 0
1 0 0 1 0 0 2 0 0.25
1 1 0 1 1 0 0 2 0.5
0 1 0 0 1 0 0 0 1
4 0 1 2 3
"""


PLACES = [(0, 0), (1, 0), (1, 1), (0, 1)]


@pytest.mark.parametrize("suffix", [".ply", ".glb"])
def test_vectors_and_control_at_the_vertices(tmp_path: Path, suffix: str) -> None:
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / f"square{suffix}"
    if suffix == ".ply":
        path.write_text(PLY)
    else:
        one = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
        vectors = np.array([[2, 0, 0], [0, 2, 0], [0, 0, 2], [0, 0, 0]], np.float32)
        control = np.array([0, 0.25, 0.5, 1], np.float32)
        one.vertex_attributes |= {"_DIRECTION": vectors, "_CONTROL": control}
        turned = trimesh.Scene()
        turned.add_geometry(one, transform=np.diag([3, 3, 3, 1]))
        path.write_bytes(turned.export(file_type="glb"))
    mesh = read(path)
    side = mesh[:, :2].max()
    corner = [int(np.abs(mesh[:, :2] - np.array(place) * side).sum(axis=1).argmin()) for place in PLACES]
    vectors = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [np.nan] * 3]
    np.testing.assert_allclose(mesh[corner, 8:11], vectors)
    np.testing.assert_allclose(mesh[corner, 11], [0, 0.25, 0.5, 1])


def test_a_digest_is_of_the_content(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    for name in ("one.obj", "two.obj"):
        (tmp_path / name).write_text(SQUARE_OBJ)
    one, two = (open_mesh("mesh", str(tmp_path / name)) for name in ("one.obj", "two.obj"))
    assert one.digest == two.digest
    (tmp_path / "two.obj").write_text(SQUARE_OBJ.replace("v 1 1 0", "v 1 2 0"))
    assert open_mesh("mesh", str(tmp_path / "two.obj")).digest != one.digest
    with pytest.raises(SourceError, match="has changed"):
        two.value()


def test_the_buffers_of_gltf_count(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    for name, content in trimesh.Scene([trimesh.creation.box()]).export(file_type="gltf").items():
        (tmp_path / name).write_bytes(content)
    before = meshes.inspect(str(tmp_path / "model.gltf"))
    buffer = next(tmp_path.glob("*.bin"))
    buffer.write_bytes(buffer.read_bytes()[::-1])
    assert meshes.inspect(str(tmp_path / "model.gltf")) != before


@pytest.mark.parametrize(
    ("file", "content", "problem"),
    [
        ("none.obj", "", "is empty"),
        ("points.obj", "v 0 0 0\nv 1 0 0\n", "has no faces|cannot be read"),
        ("beyond.obj", "v 0 0 0\nv 1 0 0\nf 1 2 9\n", "cannot be read as obj"),
        ("words.ply", "not a mesh", "cannot be read as ply"),
        ("words.glb", "not a mesh", "cannot be read as glb"),
        ("words.gltf", "[", "is not glTF"),
        ("words.stl", "solid\n", "has no faces|cannot be read"),
        ("words.off", "OFF\n1", "has no faces|cannot be read"),
        ("picture.png", "x", "is no mesh; files that end in"),
    ],
)
def test_what_is_no_mesh_is_refused_by_one_line(tmp_path: Path, file: str, content: str, problem: str) -> None:
    pytest.importorskip("trimesh")
    (tmp_path / file).write_text(content)
    with pytest.raises(SourceError, match=problem) as error:
        open_mesh("mesh", str(tmp_path / file)).value()
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(f"sources.mesh: {tmp_path / file}: ")


def nodes_of(path: Path, nodes: list[dict[str, object]]) -> None:
    """A glTF of a square for each node that has a mesh; the first node is the scene's."""
    trimesh = pytest.importorskip("trimesh")
    one = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    content = trimesh.Scene([one]).export(file_type="glb")
    length = struct.unpack("<I", content[12:16])[0]
    document = json.loads(content[20 : 20 + length]) | {"nodes": nodes, "scenes": [{"nodes": [0]}], "scene": 0}
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = content[20 + length :]
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    path.write_bytes(head + text + rest)


def test_nodes_below_each_other_are_placed(tmp_path: Path) -> None:
    """2,000 levels; with a path from the root for each node it would take a minute."""
    levels = 2000
    nodes: list[dict[str, object]] = [{"translation": [1, 0, 0], "children": [i + 1]} for i in range(levels)]
    nodes[0]["scale"] = [2, 2, 2]
    nodes[3]["mesh"] = 0
    nodes_of(tmp_path / "deep.glb", [*nodes, {"mesh": 0}])
    mesh = read(tmp_path / "deep.glb").reshape(2, 6, 12)
    lowest = sorted(part[:, 0].min() for part in mesh)
    assert lowest == [1 + 2 * 3, 1 + 2 * (levels - 1)]
    np.testing.assert_allclose(np.ptp(mesh[:, :, :2], axis=1), 2)


def test_nodes_that_hold_each_other_are_refused(tmp_path: Path) -> None:
    nodes_of(tmp_path / "round.glb", [{"mesh": 0, "children": [1]}, {"mesh": 0, "children": [0]}])
    with pytest.raises(SourceError, match="cannot be read as glb"):
        read(tmp_path / "round.glb")


def test_too_many_nodes_or_faces_are_refused_before_they_take_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nodes: list[dict[str, object]] = [{"children": [*range(1, 41)]}, *({"mesh": 0} for _ in range(40))]
    nodes_of(tmp_path / "many.glb", nodes)
    monkeypatch.setattr(meshes, "placed", lambda *_, **__: pytest.fail("placed"))
    monkeypatch.setattr(meshes, "_MAX_FACES", 79)
    with pytest.raises(SourceError, match="has 80 faces, at most 79"):
        read(tmp_path / "many.glb")
    monkeypatch.setattr(meshes, "_MAX_FACES", 80)
    monkeypatch.setenv(memory.VARIABLE, "35kB")
    with pytest.raises(SourceError, match=r"has 80 faces; it takes up to 36\.0 kB of memory"):
        read(tmp_path / "many.glb")
    monkeypatch.setattr(meshes, "_MAX_NODES", 40)
    with pytest.raises(SourceError, match="has 41 nodes, at most 40"):
        read(tmp_path / "many.glb")


@pytest.mark.parametrize("suffix", [".obj", ".off"])
def test_a_polygon_of_many_corners_is_estimated_by_these(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("trimesh")
    corners = " ".join(["1", "2", "3"] * 1000)
    points = "0 0 0\n1 0 0\n0 1 0\n"
    obj = "".join(f"v {line}\n" for line in points.splitlines()) + f"f {corners}\n"
    off = f"OFF\n3 1 0\n{points}3000 {corners}\n"
    (tmp_path / f"polygon{suffix}").write_text(obj if suffix == ".obj" else off)
    monkeypatch.setenv(memory.VARIABLE, "300kB")
    with pytest.raises(SourceError, match=r"takes up to 37\d\.\d kB of memory"):
        open_mesh("mesh", str(tmp_path / f"polygon{suffix}"))


def test_a_shape_that_does_not_ship_is_refused() -> None:
    with pytest.raises(SourceError, match="no such mesh ships with texloom; did you mean 'torus'"):
        open_mesh("mesh", "texloom:thorus")


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    with pytest.raises(SourceError, match="no such file"):
        open_mesh("mesh", str(tmp_path / "rock.obj"))


def test_glb_of_a_mesh(tmp_path: Path) -> None:
    mesh = with_normals(square(2.0))
    image = Image(np.full((8, 8, 3), 0.5, np.float32), ("R", "G", "B"))
    path = tmp_path / "square.glb"
    write(WriteJob(path, image, Image, {}, mesh=mesh))
    content = path.read_bytes()
    length = struct.unpack("<I", content[12:16])[0]
    document = json.loads(content[20 : 20 + length])
    indices, points, normals, tangents, texture = document["accessors"]
    assert (indices["count"], indices["componentType"], points["count"]) == (24, 5123, 9)
    assert (points["min"], points["max"]) == ([0, 0, 0], [2, 2, 0])
    body = content[28 + length :]

    def values(accessor: dict[str, int], width: int) -> np.ndarray:
        view = document["bufferViews"][accessor["bufferView"]]
        part = body[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        return np.frombuffer(part, np.float32).reshape(-1, width)

    np.testing.assert_allclose(values(normals, 3), np.tile([0, 0, 1], (9, 1)))
    np.testing.assert_allclose(values(tangents, 4), np.tile([1, 0, 0, 1], (9, 1)))
    places = values(points, 3)[:, :2] / 2
    np.testing.assert_allclose(values(texture, 2), np.stack([places[:, 0], 1 - places[:, 1]], axis=1))


@pytest.mark.parametrize(("suffix", "module"), [(".glb", "trimesh"), (".usda", "pxr")])
def test_a_mesh_that_was_exported_can_be_read_again(tmp_path: Path, suffix: str, module: str) -> None:
    pytest.importorskip(module)
    mesh = with_normals(square(2.0, (0.25, 0.75)))
    image = Image(np.full((8, 8, 3), 0.5, np.float32), ("R", "G", "B"))
    write(WriteJob(tmp_path / f"square{suffix}", image, Image, {}, mesh=mesh))
    np.testing.assert_allclose(read(tmp_path / f"square{suffix}"), mesh, atol=1e-6)


def test_the_material_of_a_mesh_in_other_programs(tmp_path: Path) -> None:
    """The displacement is 5 % of the texture's width on the mesh, 4 units for one of the texture."""
    mesh = with_normals(square(2.0, (0.25, 0.75)))
    mesh[:, 7] /= 2
    image = Image(np.full((8, 8, 4), 0.5, np.float32), ("R", "G", "B", "height"))
    for suffix in (".glb", ".usda", ".mtlx"):
        write(WriteJob(tmp_path / f"square{suffix}", image, Image, {}, mesh=mesh))
    assert 'name="scale" type="float" value="0.2"' in (tmp_path / "square.mtlx").read_text()
    pygltflib = pytest.importorskip("pygltflib")
    (primitive,) = pygltflib.GLTF2().load(str(tmp_path / "square.glb")).meshes[0].primitives
    assert primitive.attributes.TEXCOORD_0 is not None
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom, UsdShade

    stage = Usd.Stage.Open(str(tmp_path / "square.usda"))
    prim = UsdGeom.Mesh(stage.GetPrimAtPath("/square/mesh"))
    assert len(prim.GetPointsAttr().Get()) == 9
    material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
    assert material.ComputeSurfaceSource()[0]
    scale = UsdShade.Shader(stage.GetPrimAtPath("/square/square/height")).GetInput("scale").Get()
    assert scale[0] == pytest.approx(0.2)
