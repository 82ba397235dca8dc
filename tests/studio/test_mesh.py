"""The layer Mesh, in a browser: draw and paint on a mesh, make its texture, and again in a terminal."""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
import yaml

from tests.studio.conftest import SMALL, Served, Watched, draw_on, repeated


def test_a_mesh_comes_with_texture_coordinates(served: Served) -> None:
    status, content = served.request("/api/meshes?id=texloom:torus&side=64")
    assert status == 200
    corners = np.frombuffer(content, np.float32).reshape(-1, 3, 8)
    np.testing.assert_allclose(np.linalg.norm(corners[..., 3:6], axis=2), 1, atol=1e-3)
    assert corners[..., 6:].min() >= 0
    assert corners[..., 6:].max() <= 1
    assert served.request("/api/meshes?id=folder:blotches.png")[0] == 422
    assert served.request("/api/meshes?id=texloom:torus", cookie="")[0] == 401


def test_strokes_and_values_reach_the_texture(watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    control = tmp_path / "halves.png"
    PIL.Image.fromarray(np.tile(np.linspace(0, 255, SMALL).astype(np.uint8), (SMALL, 1))).save(control)
    page.locator("make-view").get_by_label("Choose pictures").set_input_files(control)
    page.get_by_role("button", name="halves", exact=True).wait_for()
    draw_on(page, "blotches", "Mesh")
    view = page.locator("mesh-view")
    page.evaluate("() => Object.assign(document.querySelector('mesh-view'), {side: 96})")
    view.get_by_label("Mesh", exact=True).and_(page.locator("select")).select_option("texloom:torus")
    opened = "({corners, shape, waits}) => corners !== null && shape === 'texloom:torus' && waits === ''"
    page.wait_for_function(f"() => ({opened})(document.querySelector('mesh-view'))")
    view.get_by_label("Control map of the exemplar").select_option(label="halves")
    box = view.locator("canvas.mesh").bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 + 80)
    for tool in ("Direction", "Amount"):
        view.get_by_role("radio", name=tool).click()
        page.mouse.move(middle[0] - 100, middle[1])
        page.mouse.down()
        page.mouse.move(middle[0] + 60, middle[1] + 30, steps=4)
        page.mouse.up()
    painted = "() => document.querySelector('mesh-view').painted.now"
    assert page.evaluate(f"() => ({painted})().strokes.length") == 1
    page.keyboard.press("Tab")
    view.get_by_role("button", name="Undo").click()
    assert page.evaluate(f"() => ({painted})().codes") is None
    view.get_by_role("button", name="Redo").click()
    page.wait_for_function("() => document.querySelector('mesh-view').preview.isWhole")
    seen = page.evaluate("() => document.querySelector('mesh-view').preview.picture.toDataURL()")
    flow = yaml.safe_load(repeated(view, tmp_path, "Make the texture"))
    preview = PIL.Image.open(io.BytesIO(base64.b64decode(seen.partition(",")[2])))
    with PIL.Image.open(tmp_path / "texture.png") as texture:
        np.testing.assert_array_equal(np.asarray(preview), np.asarray(texture.convert("RGBA")))
    assert {"strokes", "control", "target"} <= set(flow["sources"])
    page.locator("mesh-view[ready]").wait_for()
    view.get_by_role("button", name="Inspect it").click()
    page.locator("inspect-view material-view[ready]").wait_for()


@pytest.mark.parametrize("suffix", ["obj", "ply", "glb"])
def test_a_dropped_mesh_is_kept(served: Served, suffix: str) -> None:
    trimesh = pytest.importorskip("trimesh")
    content = trimesh.creation.box().export(file_type=suffix)
    status, mesh = drop(served, f"box.{suffix}", content.encode() if isinstance(content, str) else content)
    assert status == 200, mesh
    status, corners = served.request(f"/api/meshes?id={mesh}&side=64")
    assert (status, len(corners)) == (200, 36 * 8 * 4)
    assert mesh in served.json("/api/start")["meshes"]


def test_a_mesh_of_usd_is_kept(served: Served) -> None:
    pytest.importorskip("pxr")
    points = "[(0,0,0),(1,0,0),(1,1,0),(0,1,0)]"
    faces = "int[] faceVertexCounts=[4]\nint[] faceVertexIndices=[0,1,2,3]"
    text = f'#usda 1.0\ndef Mesh "square" {{\n{faces}\npoint3f[] points={points}\n}}\n'
    assert drop(served, "square.usda", text.encode())[0] == 200


def test_a_broken_mesh_is_refused(served: Served) -> None:
    pytest.importorskip("trimesh")
    status, problem = drop(served, "words.glb", b"no mesh")
    assert status == 422
    assert problem["problem"].startswith("words.glb: cannot be read as glb")


def drop(served: Served, name: str, content: bytes) -> tuple[int, Any]:
    """Send a mesh."""
    key = served.json("/api/receiving", b"", "POST")
    assert served.request(f"/api/received/{key}/{name}", content, "PUT")[0] == 200
    status, answer = served.request(f"/api/received/{key}/mesh", b"", "POST")
    return status, json.loads(answer)
