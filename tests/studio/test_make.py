"""Make, in a browser: from a dropped picture to a saved flow file."""

from __future__ import annotations

import re
import shutil
import zipfile
from pathlib import Path

import pytest
import yaml

from tests.studio.conftest import Watched, repeated, resize


def test_from_a_dropped_picture_to_the_same_bits_in_a_terminal(watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    page.locator("make-view").get_by_label("Choose pictures").set_input_files(
        watched.served.folder / "blotches.png"
    )
    page.get_by_label("Method").select_option("quilting")
    resize(page, 80, 96)
    page.get_by_label("Seed", exact=True).fill("5")
    page.get_by_label("Seed", exact=True).press("Enter")
    page.get_by_role("status").filter(has_text="Preview").wait_for()
    settings = page.get_by_label("Settings")
    assert "quilting" in repeated(settings, tmp_path)
    settings.get_by_role("button", name="Save in the folder").click()
    saved = watched.served.folder / "blotches_quilting"
    settings.get_by_text(f"Saved in {saved}").wait_for()
    assert (saved / "texture.png").read_bytes() == (tmp_path / "texture.png").read_bytes()
    shutil.rmtree(saved)
    with page.expect_download() as maps:
        settings.get_by_label("Download maps for a program").select_option("unity")
    assert maps.value.suggested_filename == "blotches_quilting_unity.zip"
    page.get_by_role("button", name="256", exact=True).click()
    page.get_by_role("button", name="Undo").click()
    page.get_by_role("status").filter(has_text="Full size, seed 5").wait_for()


def test_files_may_be_dropped_anywhere(watched: Watched) -> None:
    page = watched.page
    begin = """([name, codes]) => {
      const data = new DataTransfer();
      data.items.add(new File([Uint8Array.from(codes)], name));
      return data;
    }"""
    picture = (watched.served.folder / "blotches.png").read_bytes()
    for name, content in (("dropped.png", picture), ("flat.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")):
        data = page.evaluate_handle(begin, [name, list(content)])
        page.locator("section.stage").locator("visible=true").first.dispatch_event("drop", {"dataTransfer": data})
        if name == "dropped.png":
            page.get_by_role("button", name="dropped", pressed=True).wait_for()
    page.wait_for_function("""() => {
      const view = document.querySelector("mesh-view");
      return view?.corners && view.querySelector("select[aria-label=Mesh]").value.endsWith("/flat.obj");
    }""")


def test_all_files_of_a_large_folder_are_taken(watched: Watched) -> None:
    """A browser tells the entries of a folder in parts."""
    count = watched.page.evaluate("""async () => {
      const left = [...Array(250)].map((_, number) => ({
        isFile: true, name: `${number}.png`, file: (done) => done(new File([], `${number}.png`)),
      }));
      const reader = { readEntries: (done) => done(left.splice(0, 100)) };
      const folder = { isDirectory: true, name: "many", createReader: () => reader };
      const data = { files: [], items: [{ webkitGetAsEntry: () => folder }] };
      return (await customElements.get("picture-list").filesIn(data))[0].length;
    }""")
    assert count == 250


def test_views_undo_and_keys(watched: Watched) -> None:
    page = watched.page
    page.get_by_role("button", name="blotches").first.click()
    page.get_by_label("Method").select_option("quilting")
    for mode in ("Repeat", "Compare", "Variants", "Single"):
        page.get_by_role("radio", name=mode).click()
        assert page.get_by_role("radio", name=mode).get_attribute("aria-checked") == "true"
    seed = page.get_by_label("Seed", exact=True)
    page.get_by_role("button", name="Next").click()
    assert seed.input_value() == "8"
    page.keyboard.press("Control+z")
    assert seed.input_value() == "7"
    page.keyboard.press("Control+Shift+z")
    assert seed.input_value() == "8"
    page.get_by_role("button", name="Switch between dark and light").click()
    assert page.evaluate("document.documentElement.dataset.theme") in ("light", "dark")


def test_maps_of_a_material_are_made_to_tile(watched: Watched) -> None:
    page = watched.page
    page.get_by_role("button", name="Try it with bricks").click()
    assert page.get_by_label("Method").input_value() == "self_tuning"
    page.get_by_title("brick_maps").first.click()
    assert page.get_by_label("Method").input_value() == "materials"
    assert page.get_by_label("Tileable").input_value() == "both"


@pytest.mark.long
def test_one_picture_becomes_a_material_with_all_maps(watched: Watched, tmp_path: Path) -> None:
    """Photograph to the maps of a program: picture, maps, size, finish, program."""
    page = watched.page
    page.get_by_role("button", name="blotches").first.click()
    settings = page.get_by_label("Settings")
    settings.get_by_role("radio", name="A photograph").click()
    settings.locator("summary", has_text="foreign parts left out").wait_for()
    settings.get_by_role("radio", name="A flat picture").click()
    settings.get_by_role("radio", name="All maps").click()
    assert settings.get_by_label("Tileable").input_value() == "both"
    settings.locator("summary", has_text="shadows removed where sure").click()
    settings.get_by_label("Shadows").select_option(label="kept")
    settings.locator("summary", has_text="shadows kept").wait_for()
    settings.get_by_label("Preset").select_option("fast")
    resize(page, 64, 64)
    flow = repeated(settings, tmp_path)
    assert yaml.safe_load(flow)["steps"]["light"] == {"params": {"strength": 0}}
    page.locator("make-view material-view[ready]").wait_for()
    page.get_by_text("Light and relief").click()
    page.locator("material-view").get_by_label("Relief").fill("10")
    with page.expect_download() as maps:
        settings.get_by_label("Download maps for a program").select_option("unreal")
    with zipfile.ZipFile(maps.value.path()) as archive:
        assert {one.rpartition("_")[2] for one in archive.namelist()} >= {"BC.png", "N.png", "ORM.png"}
    page.get_by_role("button", name="Correct a spot").click()
    page.get_by_label("Worst places").get_by_role("button").first.click()
    page.get_by_role("radio", name="Version 1").click()
    page.get_by_role("button", name="Accept").click()
    page.get_by_text("Full size, corrected").wait_for()
    settings.get_by_role("radio", name="Colour only").click()
    assert settings.get_by_label("Method").input_value() == "self_tuning"


@pytest.mark.long
def test_a_material_is_looked_at_on_a_mesh_of_ones_own_under_a_sky(watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    (tmp_path / "roof.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 1\nf 1 2 3\n")
    page.get_by_role("button", name="blotches").first.click()
    page.get_by_label("Method").select_option("quilting")
    page.get_by_role("radio", name="3D", exact=True).click()
    page.locator("make-view material-view[ready]").wait_for()
    view = page.locator("make-view material-view")
    scene = "document.querySelector('make-view material-view').scene"
    corners = f"{scene}.mesh.geometry.attributes.position.count"
    view.get_by_role("radio", name="Mesh").click()
    view.get_by_label("Choose a mesh file").set_input_files(tmp_path / "roof.obj")
    page.wait_for_function(f"() => {corners} === 3")
    page.get_by_text("Light and relief").click()
    assert page.evaluate(f"() => {scene}.surrounded") == "studio"
    view.get_by_label("Surroundings").select_option(label="a clear sky")
    page.wait_for_function(f"() => {scene}.surrounded === 'sky'")
    view.get_by_role("radio", name="Sphere").click()
    page.wait_for_function(f"() => {corners} > 3")


def test_refusals_are_shown_and_the_page_goes_on(watched: Watched, tmp_path: Path) -> None:
    broken = tmp_path / "broken.png"
    broken.write_bytes(b"\x89PNG\r\n\x1a\nnothing")
    watched.page.locator("make-view").get_by_label("Choose pictures").set_input_files(broken)
    watched.page.get_by_role("alert").filter(has_text="broken.png").wait_for()
    watched.problems = [
        one for one in watched.problems if "422" not in one
    ]  # the browser reports the answer itself
    watched.page.get_by_role("button", name="blotches").first.click()
    watched.page.get_by_role("button", name="Finish at full size").wait_for()


def test_two_tabs_do_not_interfere(watched: Watched) -> None:
    other = Watched(watched.page.context.new_page(), watched.served)
    for tab, method in ((watched, "quilting"), (other, "graph_cut")):
        tab.page.get_by_role("button", name="blotches").first.click()
        tab.page.get_by_label("Method").select_option(method)
    for tab in (watched, other):
        tab.page.get_by_role("status").filter(has_text=re.compile("^Preview")).wait_for()
    other.check()
    other.page.close()


def test_another_picture_is_chosen_for_a_method_that_takes_one(watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    page.get_by_role("button", name="blotches").first.click()
    page.get_by_label("Method").select_option("restyle")
    settings = page.get_by_label("Settings")
    page.get_by_role("status").filter(has_text="Choose: picture that it is laid over").wait_for()
    assert settings.get_by_role("button", name="Finish at full size").is_disabled()
    settings.get_by_label("Picture that it is laid over").select_option("texloom:bricks")
    resize(page, 96, 64)
    page.get_by_role("status").filter(has_text="Preview").wait_for()
    assert "texloom:bricks" in repeated(settings, tmp_path)
    page.get_by_label("Method").select_option("quilting")
    assert settings.get_by_label("Picture that it is laid over").count() == 0
