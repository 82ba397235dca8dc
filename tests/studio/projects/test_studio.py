"""A project in a browser: coming back, the wall, thousands of pictures, names of files."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import PIL.Image
import pytest

from tests.pipelines.engine.prefect.server import wait_for
from tests.studio.conftest import Served, Watched, exemplar, watching
from texloom.pipelines.studio.projects.files import FOLDER

RECIPE = {"flow": "quilting", "sources": {"exemplar": "folder:blotches.png"}, "size": "64x64", "seed": 3}


def opened(folder: Path) -> Served:
    """A studio of a folder, with a store beside it."""
    return Served(folder, folder.parent / "store")


def job_of(served: Served, material: str, variant: int) -> Any:
    return served.json(f"/api/materials/{material}")["material"]["variants"][variant]["job"]


@pytest.fixture
def folder(page: None, tmp_path: Path) -> Path:
    folder = tmp_path / "Castle"
    folder.mkdir()
    PIL.Image.fromarray(exemplar()).save(folder / "blotches.png")
    return folder


@pytest.fixture
def tab(chromium: Any, served: Served) -> Iterator[Watched]:
    """A page of the studio of the module."""
    with watching(chromium, served, 1440, 900, accept_downloads=True) as watched:
        yield watched


def finished(page: Any, seed: str) -> None:
    """Make a texture of 64 px in Make."""
    page.locator("make-view").get_by_title("blotches").first.click()
    page.get_by_label("Method").select_option("quilting")
    for side in ("Width", "Height"):
        page.get_by_label(side).fill("64")
        page.get_by_label(side).press("Enter")
    page.get_by_label("Seed", exact=True).fill(seed)
    page.get_by_label("Seed", exact=True).press("Enter")
    page.get_by_role("button", name="Finish at full size").click()
    page.get_by_label("Settings").get_by_text("Done in").wait_for()


@contextlib.contextmanager
def slow_news(page: Any) -> Iterator[None]:
    """Let a page wait for what it reads of its material."""

    def wait(route: Any) -> None:
        if route.request.method == "GET":
            time.sleep(0.5)
        route.continue_()

    page.route("**/api/materials/*", wait)
    yield
    page.unroute("**/api/materials/*", wait)


def settled(page: Any, name: str, seed: str) -> None:
    """Wait until a material is shown with a result at full size."""
    page.get_by_role("status").filter(has_text=f"Full size, seed {seed}").wait_for()
    assert page.get_by_label("Name of the material").input_value() == name
    assert page.get_by_label("Seed", exact=True).input_value() == seed
    assert page.get_by_label("Width").input_value() == "64"
    page.wait_for_function("() => document.querySelector('make-view').made.results.picture?.width === 64")


def test_reload_and_a_new_tab_come_back_to_results_that_can_be_gone_back_to(tab: Watched) -> None:
    page = tab.page
    finished(page, "5")
    page.get_by_label("Name of the material").fill("Old wall")
    page.get_by_label("Name of the material").press("Enter")
    page.get_by_role("radio", name="Repeat").click()
    page.get_by_label("Seed", exact=True).fill("6")
    page.get_by_label("Seed", exact=True).press("Enter")
    page.get_by_role("button", name="Finish at full size").click()
    page.get_by_role("status").filter(has_text="Full size, seed 6").wait_for()
    page.reload()
    settled(page, "Old wall", "6")
    assert page.get_by_role("radio", name="Repeat").get_attribute("aria-checked") == "true"
    page.get_by_role("button", name="Seed 5, large pieces: go back to it").click()
    settled(page, "Old wall", "5")
    page.get_by_role("button", name="Compare with: Seed 6, large pieces").click()
    page.get_by_role("status").filter(has_text="Left of the line").wait_for()
    page.keyboard.press("Control+z")
    settled(page, "Old wall", "6")
    page.wait_for_timeout(600)  # until the last change is sent, which a reload would send too
    other = page.context.new_page()
    other.goto(tab.served.base)
    settled(other, "Old wall", "6")
    other.close()


def test_files_are_called_after_their_material_and_never_overwrite_others(tab: Watched) -> None:
    page = tab.page
    for name in ("Mur", "Mur 2"):
        if name == "Mur 2":
            page.get_by_role("button", name="New material").locator("visible=true").click()
        finished(page, "3")
        field = page.get_by_label("Name of the material")
        own = field.input_value()
        with slow_news(page):
            field.fill("Mur")
            field.press("Enter")
            if name == "Mur 2":
                page.get_by_role("alert").filter(has_text="files are called so already").wait_for()
                assert field.input_value() == own  # now, as what is typed next would be mixed with it later
                tab.problems = [one for one in tab.problems if "422" not in one]
                field.fill(name)
                field.press("Enter")
        stem = name.replace(" ", "_")
        page.get_by_role("status").filter(has_text="Full size").wait_for()
        page.wait_for_function(
            f"() => document.querySelector('make-view').made.results.job.name === '{stem}_quilting'"
        )
        settings = page.get_by_label("Settings")
        with page.expect_download() as texture:
            settings.get_by_role("link", name="texture.png").click()
        assert texture.value.suggested_filename == f"{stem}_quilting_texture.png"
        with page.expect_download() as maps:
            settings.get_by_label("Download maps for a program").select_option("unreal")
        assert maps.value.suggested_filename == f"{stem}_quilting_unreal.zip"
        with zipfile.ZipFile(maps.value.path()) as archive:
            assert [Path(one).name for one in archive.namelist()] == [f"T_{stem}_BC.png"]
        settings.get_by_role("button", name="Save in the folder").click()
        settings.get_by_text(f"Saved in {tab.served.folder / f'{stem}_quilting'}").wait_for()
    assert (tab.served.folder / "Mur_quilting" / "texture.png").is_file()


def test_a_name_that_is_typed_outlives_news(tab: Watched) -> None:
    """Another page renames the material and makes it a favourite meanwhile."""
    page, served = tab.page, tab.served
    made = served.json("/api/materials", RECIPE)
    page.get_by_role("tab", name="Materials").click()
    page.locator("materials-view").get_by_role("button", name=f"Open {made['name']}", exact=True).click()
    name = page.get_by_label("Name of the material")
    name.wait_for()
    name.fill("Half a na")
    served.json(f"/api/materials/{made['id']}", {"name": "Renamed elsewhere", "is_favourite": True})
    page.get_by_role("button", name="Favourite", exact=True, pressed=True).wait_for()
    assert name.input_value() == "Half a na"
    name.press_sequentially("me")
    name.press("Enter")
    wait_for(lambda: served.json(f"/api/materials/{made['id']}")["material"]["name"] == "Half a name")


def test_rename_tag_duplicate_delete_and_undo_on_the_wall(tab: Watched) -> None:
    page, served = tab.page, tab.served
    served.json("/api/materials", RECIPE | {"seed": 4})  # which the search does not find
    made = served.json("/api/materials", RECIPE)
    wall = page.locator("materials-view")
    page.get_by_role("tab", name="Materials").click()
    wall.get_by_role("button", name=f"Details of {made['name']}", exact=True).click()
    wall.get_by_label("Name", exact=True).fill("Plaster")
    wall.get_by_label("Name", exact=True).press("Enter")
    wall.get_by_role("button", name="Open Plaster", exact=True).wait_for()
    wall.get_by_label("Tags, with commas").fill("wet, old")
    wall.get_by_label("Tags, with commas").press("Enter")
    wall.get_by_role("button", name="wet (1)").wait_for()
    wall.get_by_role("button", name="Favourite: Plaster", exact=True).click()
    wall.get_by_role("button", name="Duplicate").click()
    wall.get_by_role("button", name="Open Plaster 2", exact=True).wait_for()
    wall.get_by_label("Search materials").fill("plaster wet")
    wall.get_by_role("status").filter(has_text="2 of ").wait_for()
    wall.get_by_role("button", name="★ Favourites").click()
    wall.get_by_role("status").filter(has_text="1 of ").wait_for()
    wall.get_by_role("button", name="Details of Plaster", exact=True).click()
    wall.get_by_role("button", name="Delete").click()
    wall.get_by_text("Plaster is in the bin").wait_for()
    wall.get_by_text("No material is found").wait_for()
    page.locator("body").press("Control+z")
    wall.get_by_role("button", name="Open Plaster", exact=True).wait_for()
    wall.get_by_role("button", name="Details of Plaster", exact=True).click()
    wall.get_by_role("button", name="Delete").click()
    wall.get_by_role("button", name="Bin (1)").click()
    wall.get_by_role("button", name="Open Plaster", exact=True).click()  # chooses it
    wall.get_by_role("button", name="Restore").click()
    wall.get_by_text("The bin is empty").wait_for()
    kept = served.json(f"/api/materials/{made['id']}")["material"]
    assert (kept["name"], kept["tags"], kept["is_favourite"], kept["is_deleted"]) == (
        "Plaster", ["wet", "old"], True, False,
    )  # fmt: skip


@pytest.mark.skipif(os.name != "posix", reason="needs a signal that nothing catches")
def test_another_server_comes_back_and_finishes_what_was_running(folder: Path, chromium: Any) -> None:
    first = opened(folder)
    with first.process:
        try:
            made = first.json("/api/jobs", RECIPE)
            owner = first.json("/api/materials")["shown"][0]["id"]
            wait_for(lambda: job_of(first, owner, 0)["state"] == "done")
            first.json("/api/project/view", {"view": "make", "material": owner})
            waiting = [
                first.json(f"/api/jobs?material={owner}", RECIPE | {"seed": seed, "size": "256x256"})
                for seed in (4, 5)
            ]
            path = folder / FOLDER / "materials" / f"{owner}.json"
            while (
                len(json.loads(path.read_text())["variants"]) < 3 or not (folder / FOLDER / "project.json").exists()
            ):
                time.sleep(0.01)
        finally:
            first.process.kill()
    with opened(folder) as second:
        context = chromium.new_context(viewport={"width": 1440, "height": 900})
        page = context.new_page()
        page.set_default_timeout(300_000)
        second.let_in(context)
        page.goto(second.base)
        page.get_by_role("status").filter(has_text="Full size, seed 5").wait_for()  # the last one that was wanted
        page.get_by_role("button", name="Seed 3, large pieces: go back to it").click()
        page.get_by_role("status").filter(has_text="Full size, seed 3").wait_for()
        context.close()
        found = second.json(f"/api/materials/{owner}")["material"]
        assert [one["job"]["id"] for one in found["variants"]] == [made["id"], *(one["id"] for one in waiting)]
        assert {one["job"]["state"] for one in found["variants"]} == {"done"}
        status, content = second.request(f"/api/jobs/{made['id']}/files/texture.png")
        assert status == 200
        status, thumbnail = second.request(f"/api/thumbnails/{made['id']}")
        assert PIL.Image.open(io.BytesIO(thumbnail)).size == (64, 64)
        data = json.loads(path.read_text())
        data["variants"][0]["job"]["files"] += ["../../store.key", "/etc/passwd", ".."]
        lost = found["variants"][1]
        before = second.request(f"/api/jobs/{lost['job']['id']}/files/texture.png")
    shutil.rmtree(second.store / "runs" / lost["folder"])
    path.write_text(json.dumps(data))
    with opened(folder) as third:
        for name in ("../../store.key", "..%2f..%2fidentity", "/etc/passwd", ".."):
            assert third.request(f"/api/jobs/{made['id']}/files/{name}")[0] in (404, 422)
        assert third.request(f"/api/jobs/{made['id']}/files/texture.png") == (200, content)
        job = job_of(third, owner, 1)
        assert job["state"] == "cancelled"
        assert "no longer in the store" in job["text"]
        third.json(f"/api/jobs/{job['id']}/again", b"", "POST")
        wait_for(lambda: job_of(third, owner, 1)["state"] == "done")
        assert third.request(f"/api/jobs/{job['id']}/files/texture.png") == before


def test_two_thousand_pictures_are_counted_and_searched(folder: Path, chromium: Any) -> None:
    content = (folder / "blotches.png").read_bytes()
    for number in range(2000):
        place = folder / f"set {number % 4}" / f"stone {number:04}.png"
        place.parent.mkdir(exist_ok=True)
        place.write_bytes(content)
    with opened(folder) as served:
        context = chromium.new_context(viewport={"width": 1440, "height": 900})
        page = Watched(context.new_page(), served).page
        shown = page.locator("make-view picture-list")
        shown.get_by_text("60 of 2001 shown").wait_for()
        assert shown.locator("ul.pictures").first.locator("li").count() == 60
        shown.get_by_role("button", name="Show more (1941 are left)").click()
        shown.get_by_text("120 of 2001 shown").wait_for()
        shown.get_by_label("Folder", exact=True).select_option("set 1")
        shown.get_by_text("60 of 500 found in 2001 shown").wait_for()
        shown.get_by_label("Search pictures").fill("1997")
        shown.get_by_text("1 of 1 found in 2001 shown").wait_for()
        shown.get_by_title("stone 1997").click()
        page.get_by_role("status").filter(has_text="Preview").wait_for()
        assert page.get_by_label("Name of the material").input_value() == "stone 1997"
        context.close()
