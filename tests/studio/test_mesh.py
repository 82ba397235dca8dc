"""Mesh, in a browser: draw and paint on a mesh, make its texture, and again in a terminal."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import PIL.Image
import yaml

from tests.studio.conftest import SMALL, Served, Watched, run_again


def test_a_mesh_comes_with_texture_coordinates(served: Served) -> None:
    status, content = served.request("/api/meshes?id=texloom:torus&side=64")
    assert status == 200
    corners = np.frombuffer(content, np.float32).reshape(-1, 3, 8)
    np.testing.assert_allclose(np.linalg.norm(corners[..., 3:6], axis=2), 1, atol=1e-3)
    assert corners[..., 6:].min() >= 0
    assert corners[..., 6:].max() <= 1
    assert served.request("/api/meshes?id=folder:blotches.png")[0] == 422
    assert served.request("/api/meshes?id=texloom:torus", token="")[0] == 401


def test_strokes_and_values_reach_the_texture(watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    page.get_by_role("tab", name="Mesh").click()
    view = page.locator("mesh-view")
    control = tmp_path / "halves.png"
    PIL.Image.fromarray(np.tile(np.linspace(0, 255, SMALL).astype(np.uint8), (SMALL, 1))).save(control)
    view.get_by_label("Choose pictures").set_input_files(control)
    view.get_by_role("button", name="halves", exact=True).wait_for()
    view.get_by_title("blotches").click()
    page.evaluate("() => Object.assign(document.querySelector('mesh-view'), {side: 96})")
    view.get_by_label("Mesh", exact=True).and_(page.locator("select")).select_option("texloom:torus")
    page.wait_for_function("() => document.querySelector('mesh-view').corners !== null")
    view.get_by_label("Control map of the exemplar").select_option(label="halves")
    box = view.locator("canvas.mesh").bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 + 80)
    for tool in ("Direction", "Control"):
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
    view.get_by_role("button", name="Make the texture").click()
    view.get_by_text("Done in").wait_for()
    page.locator("mesh-view[ready]").wait_for()
    with page.expect_download() as picture:
        view.get_by_role("link", name="texture.png").click()
    picture.value.save_as(tmp_path / "texture.png")
    view.get_by_role("button", name="Show as YAML or command").click()
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save blotches_on_mesh.yaml").click()
    flow = tmp_path / saved.value.suggested_filename
    saved.value.save_as(flow)
    assert {"strokes", "control", "target"} <= set(yaml.safe_load(flow.read_text())["sources"])
    out = run_again([str(flow)], tmp_path)
    assert (tmp_path / "texture.png").read_bytes() == (out / "texture.png").read_bytes()
    page.get_by_role("button", name="Close").click()
    page.get_by_role("tab", name="Inspect").click()
    page.get_by_label("Results").get_by_role("button", name="blotches_on_mesh").click()
    page.locator("inspect-view material-view[ready]").wait_for()
