"""What of the extension for Blender needs no Blender: its archive, jobs, requests, nodes, pixels and meshes."""

from __future__ import annotations

import time
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bridge.conftest import COMMAND, builder
from tests.conftest import ROOT
from texloom.pipelines.media import meshes
from texloom.pipelines.media.conventions import LAYOUTS

PROGRAM = "blender"
FOLDER = ROOT / "hosts" / "blender"


# -- the archive


def test_the_archive(archive: Path, tmp_path: Path) -> None:
    assert archive.name == "texloom-0.1.0.zip"
    with zipfile.ZipFile(archive) as opened:
        names = opened.namelist()
        manifest = tomllib.loads(opened.read("blender_manifest.toml").decode())
        assert opened.read("texloom_client.py") == (ROOT / "pipelines" / "bridge" / "client.py").read_bytes()
    assert "build.py" not in names
    assert {Path(one).suffix for one in names} == {".py", ".toml", ""}  # no binaries
    assert {"__init__.py", "operators.py", "LICENSE"} <= set(names)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert manifest["version"] == project["version"]
    assert manifest["license"] == [f"SPDX:{project['license']}"]
    assert set(manifest["permissions"]) == {"files", "network"}
    assert builder().build(PROGRAM, tmp_path).read_bytes() == archive.read_bytes()


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("schema_version", "2.0.0"), ("id", "tex-loom"), ("version", "1"), ("name", ""), ("tagline", "It ends."),
        ("maintainer", None), ("type", "theme"), ("blender_version_min", "4.2"), ("license", ["MIT"]),
        ("permissions", {"files": "It reads."}), ("permissions", {"mail": "Writes letters"}),
    ],
)  # fmt: skip
def test_a_manifest_that_blender_would_refuse(field: str, value: Any) -> None:
    manifest = tomllib.loads((FOLDER / "blender_manifest.toml").read_text())
    build = builder()
    assert build.checked(manifest) is manifest
    with pytest.raises(ValueError, match=rf"^{field}"):
        build.checked({**manifest, field: value})


# -- jobs


def test_a_job_of_several_runs(plugin: Any, store: str, picture: np.ndarray) -> None:
    controller, requests = plugin("controller"), plugin("requests")
    with plugin("texloom_client").Client(COMMAND, store=store) as client:
        asked = requests.larger(picture, 48, 40, "off", "quilting", "default", 3, 2)
        job = controller.Job(client, "Variations", asked)
        applied: list[Any] = []
        texts = []

        def apply(results: list[Any]) -> str:
            applied.append(results)
            return "made"

        while (now := controller.step(job, apply)).state == "running":
            texts.append(now.text)
            time.sleep(0.002)  # a loop without pauses would take the time of what it waits for
        assert now == ("finished", "Variations: made")
        assert (len(applied), [one.maps["albedo"].shape for one in applied[0]]) == (1, [(40, 48, 3)] * 2)
        assert {text[:17] for text in texts} == {"Variations 1 of 2", "Variations 2 of 2"}
        assert job.progress.share == 1

        def refuse(_: list[Any]) -> str:
            raise plugin("texloom_client").TexloomError("the mesh is gone")

        again = controller.Job(client, "On Mesh", asked[:1])
        again.wait()
        assert controller.step(again, refuse) == ("failed", "On Mesh: the mesh is gone")
        wrong = controller.Job(client, "Larger", [controller.Request("quilting", {"exemplar": "none.png"})])
        with pytest.raises(controller.TexloomError, match=r"^Larger: .*none\.png"):
            wrong.wait()
        assert wrong.tick().state == "failed"


def test_a_job_is_cancelled(plugin: Any, store: str, picture: np.ndarray) -> None:
    controller, requests = plugin("controller"), plugin("requests")
    clients: list[Any] = []

    def connected() -> Any:
        clients.append(plugin("texloom_client").Client(COMMAND, store=store))
        return clients[-1]

    jobs = controller.Jobs(connected)
    jobs.close()  # nothing has begun
    job = jobs.begin("Variations", requests.larger(picture, 800, 800, "both", "self_tuning", "default", 3, 3))
    while job.tick().share == 0:
        time.sleep(0.002)
    jobs.cancel_all()
    assert job.tick().text.endswith("is being cancelled") or job.has_ended
    with pytest.raises(controller.CancelledError, match=r"^Variations: cancelled$"):
        job.wait()
    assert controller.step(job, lambda _: "made").state == "cancelled"
    assert job.results == []
    jobs.end(job)
    assert jobs.running == []
    quick = requests.larger(picture, 48, 40, "off", "quilting", "default", 3)
    jobs.begin("Larger", quick).wait()
    assert len(clients) == 1
    jobs.close()
    jobs.begin("Larger", quick).wait()
    assert len(clients) == 2
    jobs.close()


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda r, m: r.larger(None, 8, 8, "off", "quilting", "default", 3, 0), "count: 0 variations; 1 to 64"),
        (lambda r, m: m.material("", 64, "both", 1.0, "default", 3), "path: nothing: no such folder or picture"),
        (lambda r, m: m.material(".", 64, "both", 0.0, "default", 3), "texel_size: 0 mm is not above 0"),
        (lambda r, m: m.material(__file__, 64, "both", 1.0, "default", 3), "path: test_blender.py is neither"),
        (lambda r, m: m.on_mesh(0, "", 64, 0, 0, 3, has_control=True), "control: vertex paint controls it"),
        (lambda r, m: m.on_mesh(0, "", 64, 0, 0, 3, control=0), "control: a picture is given without vertex paint"),
    ],
)
def test_requests_that_are_refused(plugin: Any, make: Any, problem: str) -> None:
    with pytest.raises(plugin("texloom_client").TexloomError, match=problem):
        make(plugin("requests"), plugin("material_requests"))


def test_folders_and_photographs(plugin: Any, tmp_path: Path) -> None:
    requests = plugin("material_requests")
    photo = tmp_path / "wall.JPG"
    photo.touch()
    made = [requests.material(str(one), 256, "both", 0.5, "fast", 3)[0] for one in (tmp_path, photo)]
    assert [one.flow for one in made] == ["materials", "photo_material"]
    assert made[0].options == {
        "seed": 3, "layout": "blender", "size": "256", "tileable": "both", "texel_size": "0.5mm", "preset": "fast",
    }  # fmt: skip


# -- nodes


def test_the_roles_are_those_of_the_layout(plugin: Any) -> None:
    node_plan = plugin("node_plan")
    suffixes = [part.suffix for part in LAYOUTS["blender"].written]
    assert sorted(suffixes) == sorted(node_plan.ROLES)
    assert [node_plan.role_of(f"maps/wall_height_{one}.png") for one in suffixes] == suffixes
    assert node_plan.role_of("maps/wall.usda") == ""


def test_a_plan_of_all_maps(plugin: Any) -> None:
    node_plan = plugin("node_plan")
    made = node_plan.plan(set(node_plan.ROLES), node_plan.Relief(0.02, -0.005), "charts")
    into = {(target, socket): source for source, _, target, socket in made.links}
    assert {socket: source for (target, socket), source in into.items() if target == "surface"} == {
        "Base Color": "base_color", "Roughness": "roughness", "Metallic": "metallic", "Alpha": "opacity",
        "Specular IOR Level": "specular", "Emission Color": "emissive", "Normal": "bump",
    }  # fmt: skip
    assert into["bump", "Color"] == "normal"
    assert into["displacement", "Height"] == "height"
    assert made.nodes["displacement"].values == {"Scale": 0.02, "Midlevel": 0.25}
    assert made.nodes["coordinates"].properties == made.nodes["bump"].properties == {"uv_map": "charts"}
    assert made.nodes["surface"].values == {"Emission Strength": 1.0}
    assert made.notes == ["occlusion is in the node 'ao', linked to nothing, as renderers compute it"]
    assert {name for link in made.links for name in (link[0], link[2])} == set(made.nodes)
    assert made.displacement == "DISPLACEMENT"
    assert node_plan.plan({"base_color", "height"}, node_plan.Relief(1)).displacement == "BOTH"
    assert "displacement" not in node_plan.plan({"base_color", "height"}, None).nodes
    with pytest.raises(plugin("texloom_client").TexloomError, match="fuzz: no map of a Principled material"):
        node_plan.plan({"base_color", "fuzz"}, None)


# -- pixels


def test_pixels_there_and_back(plugin: Any) -> None:
    pixels, client = plugin("pixels"), plugin("texloom_client")
    random = np.random.default_rng(1)
    for values in (
        random.integers(0, 256, (5, 7, 4), np.uint8),
        random.integers(0, 256, (5, 7, 3), np.uint8),
        random.random((5, 7, 3), np.float32) * 3,
    ):
        flat, is_float, has_alpha = pixels.to_flat(client.Pixels.of(values))
        assert (is_float, has_alpha) == (values.dtype == np.float32, values.shape[2] == 4)
        back = pixels.to_array(flat.astype(np.float32), 7, 5, 4, is_float, is_data=False)
        np.testing.assert_array_equal(pixels.without_alpha(back), values)
    flat, _, _ = pixels.to_flat(client.Pixels.of(np.array([[[1, 2, 3]], [[4, 5, 6]]], np.uint8)))
    np.testing.assert_allclose(flat * 255, [4, 5, 6, 255, 1, 2, 3, 255], rtol=1e-6)  # from the bottom row on


def test_floats_are_multiplied_by_alpha_but_data_are_not(plugin: Any) -> None:
    pixels = plugin("pixels")
    flat = np.array([0.2, 0.1, 0.0, 0.5, 0.3, 0.3, 0.3, 0.0], np.float32)
    plain = pixels.to_array(flat, 2, 1, 4, True, is_data=False)
    np.testing.assert_allclose(plain[0], [[0.4, 0.2, 0, 0.5], [0.3, 0.3, 0.3, 0]])
    np.testing.assert_array_equal(pixels.to_array(flat, 2, 1, 4, True, is_data=True).ravel(), flat)
    with pytest.raises(plugin("texloom_client").TexloomError, match="not finite"):
        pixels.to_array(flat * np.float32("nan"), 2, 1, 4, True, is_data=True)


def test_masks(plugin: Any) -> None:
    pixels, error = plugin("pixels"), plugin("texloom_client").TexloomError
    values = np.zeros((2, 2, 4), np.uint8)
    values[0] = [[255, 255, 255, 255], [255, 255, 255, 100]]
    values[1, 1] = [0, 0, 0, 255]
    np.testing.assert_array_equal(pixels.transparent(values), [[0, 255], [255, 0]])
    np.testing.assert_array_equal(pixels.painted(values, (2, 2)), [[255, 0], [0, 0]])
    with pytest.raises(error, match="the mask has 2x2 px, the picture 3x2 px"):
        pixels.painted(values, (2, 3))
    with pytest.raises(error, match="the picture has no alpha"):
        pixels.transparent(values[..., :3])
    for mask, problem in ((np.zeros((2, 2)), "nothing is white"), (np.ones((2, 2)), "all is white")):
        with pytest.raises(error, match=problem):
            pixels.some(mask, "white")


# -- meshes


def test_texloom_reads_the_mesh(plugin: Any, tmp_path: Path) -> None:
    """A triangle on the floor: z is up in Blender, y in glTF, texture coordinates from the bottom in both."""
    pytest.importorskip("trimesh")
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0.5]], np.float32)
    texture = np.array([[0, 0], [1, 0], [0, 0.75]], np.float32)
    normals = np.array([[0, 0, 1]] * 3, np.float32)
    direction = np.array([[0, 1, 0], [0, 0, 0], [0, 1, 0]], np.float32)
    path = tmp_path / "mesh.glb"
    path.write_bytes(plugin("glb").glb(points, texture, normals, direction, np.array([0, 0.5, 1], np.float32)))
    corners = meshes.read(str(path), meshes.inspect(str(path)))
    np.testing.assert_allclose(corners[:, :3], points[:, [0, 2, 1]] * (1, 1, -1))
    np.testing.assert_allclose(corners[:, 3:6], [[0, 1, 0]] * 3)
    np.testing.assert_allclose(corners[:, 6:8], texture)
    np.testing.assert_allclose(corners[[0, 2], 8:11], [[0, 0, -1]] * 2)
    assert np.isnan(corners[1, 8:11]).all()
    np.testing.assert_allclose(corners[:, 11], [0, 0.5, 1])
