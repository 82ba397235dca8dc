"""The flow `on_mesh` as a user runs it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skimage.data

from tests.pipelines.cli.test_main import assert_refused, texloom
from tests.pipelines.media.test_material_set import save
from texloom.pipelines.api import run as run_flow
from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.flow.model import Overrides

SMALL = ("--set", "views.side=32", "--set", "size=64")
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
CORNERS = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"


@pytest.fixture
def exemplar(tmp_path: Path) -> Path:
    """A folder of maps."""
    (tmp_path / "brick").mkdir()
    grey = skimage.data.brick()[:48, :48]
    save(tmp_path / "brick" / "brick_albedo.png", np.stack([grey] * 3, axis=2))
    save(tmp_path / "brick" / "brick_roughness.png", 255 - grey)
    return tmp_path / "brick"


def run(folder: Path, *options: str | Path) -> Any:
    return texloom("run", "on_mesh", *options, *SMALL, "--store", folder / "store", "--out", folder / "out")


def test_all_exports_are_written_and_nothing_is_computed_twice(exemplar: Path, tmp_path: Path) -> None:
    first = run(tmp_path, exemplar, "--source", "mesh=texloom:torus", "--json")
    assert first.code == 0, first
    exports = json.loads(first.out)["exports"]
    assert {Path(name).name for name in exports} == {
        "charts.png", "views.png", "report.html", "scores.json", "mesh.glb", "texture.exr", "texture.png", "maps",
    }  # fmt: skip
    assert {path.name for path in (tmp_path / "out" / "maps").glob("*.png")} == {
        "brick_albedo.png", "brick_roughness.png",
    }  # fmt: skip
    assert json.loads((tmp_path / "out" / "scores.json").read_text())["seams"]["ratio"] < 1.5
    before = (tmp_path / "out" / "mesh.glb").read_bytes()
    (tmp_path / "out" / "mesh.glb").unlink()
    second = run(tmp_path, exemplar, "--source", "mesh=texloom:torus", "--json")
    assert {step["state"] for step in json.loads(second.out)["steps"]} == {"cached"}
    assert (tmp_path / "out" / "mesh.glb").read_bytes() == before


def test_a_model_in_another_format_is_the_mesh_too(exemplar: Path, tmp_path: Path) -> None:
    usda = ("--export", "torus.usda=texture.image", "--export", "plane.usda=charts.layout")
    done = run(tmp_path, exemplar, "--source", "mesh=texloom:torus", *usda)
    assert done.code == 0, done
    assert 'def Mesh "mesh"' in (tmp_path / "out" / "torus.usda").read_text()
    assert 'def Mesh "plane"' in (tmp_path / "out" / "plane.usda").read_text()


def test_strokes_of_a_file_lead_the_texture(exemplar: Path, tmp_path: Path) -> None:
    """Around a torus, where texture otherwise points down in the texture coordinates."""
    made = []
    for name, line in (("down", [[4, 32], [60, 32]]), ("around", [[32, 1], [32, 63]])):
        strokes = tmp_path / f"{name}.json"
        strokes.write_text(json.dumps({"size": "64x64", "strokes": [line]}))
        sources = {"exemplar": exemplar, "mesh": "texloom:torus", "strokes": strokes}
        params = {"direction.field": "texture", "direction.stroke_radius": 4, "views.side": 32}
        made.append(run_flow("on_mesh", sources, params, size=64, store=tmp_path / "store", out=tmp_path / name))
    away = abs(made[0]["charts"].mesh[:, 7] - 0.5)
    alike = abs(np.einsum("ni,ni->n", made[0]["direction"].direction, made[1]["direction"].direction))
    assert alike[away < 0.02].mean() < 0.2
    assert alike[away > 0.2].mean() > 0.98
    assert (made[0]["texture"].match != made[1]["texture"].match).any()


def test_another_mesh_of_the_same_name_is_another_result(exemplar: Path, tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    mesh = tmp_path / "square.obj"
    states = []
    for text in (SQUARE, SQUARE.replace("1 1 0", "1 1 0.5")):
        mesh.write_text(text + CORNERS + "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
        done = run(tmp_path, exemplar, "--source", f"mesh={mesh}", "--json")
        assert done.code == 0, done
        states.append({step["name"]: step["state"] for step in json.loads(done.out)["steps"]})
    assert states[1]["appearance"] == "cached"
    assert states[1]["charts"] == states[1]["texture"] == "ran"


def test_the_texel_size_is_that_of_the_exemplar_on_the_surface() -> None:
    flow = load_flow(find_flow("on_mesh"), Overrides(delivery={"texel_size": "2mm"}))
    assert getattr(flow.steps["texture"].params, "texel_size", None) == 0.002
    assert flow.delivery.texel_size == 0.002


@pytest.mark.parametrize(
    ("content", "options", "problem"),
    [
        (SQUARE, (), "mesh.obj: has no faces"),
        (SQUARE.replace("0", "nan").replace("1", "nan") + "f 1 2 3\n", (), "mesh: no face has an area"),
        (SQUARE + "f 1 2 2\n", (), "no face has an area"),
        (SQUARE + "f 1 2 3\n", ("--set", "charts=own"), "has no texture coordinates; --set charts=new"),
        (SQUARE + "f 1 2 7\n", (), "cannot be read as obj"),
        (
            SQUARE + CORNERS + "f 1/1 2/2 3/3\n",
            ("--set", "geometry=up"),
            "goes with the exemplar's control map, which is missing",
        ),
    ],
)
def test_what_cannot_be_textured_is_refused(
    exemplar: Path, tmp_path: Path, content: str, options: tuple[str, ...], problem: str
) -> None:
    pytest.importorskip("trimesh")
    (tmp_path / "mesh.obj").write_text(content)
    done = run(tmp_path, exemplar, "--source", f"mesh={tmp_path / 'mesh.obj'}", *options)
    assert_refused(done, problem)
    assert not (tmp_path / "out").exists()


def test_a_picture_is_no_mesh(exemplar: Path, tmp_path: Path) -> None:
    done = run(tmp_path, exemplar, "--source", f"mesh={exemplar / 'brick_albedo.png'}")
    assert_refused(done, "brick_albedo.png: is no mesh; files that end in .obj")
