"""Make, in a browser: from a dropped picture to a saved flow file."""

from __future__ import annotations

import re
from pathlib import Path

from tests.studio.conftest import Watched, run_again


def test_from_a_dropped_picture_to_the_same_bits_in_a_terminal(watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    page.locator("make-view").get_by_label("Choose pictures").set_input_files(
        watched.served.folder / "blotches.png"
    )
    page.get_by_label("Method").select_option("quilting")
    page.get_by_label("Height").fill("96")
    page.get_by_label("Height").press("Enter")
    page.get_by_label("Width").fill("80")
    page.get_by_label("Width").press("Enter")
    page.get_by_label("Seed", exact=True).fill("5")
    page.get_by_label("Seed", exact=True).press("Enter")
    page.get_by_role("status").filter(has_text="Preview").wait_for()
    page.get_by_role("button", name="Finish at full size").click()
    page.get_by_label("Settings").get_by_text("Done in").wait_for()
    with page.expect_download() as picture:
        page.get_by_label("Settings").get_by_role("link", name="texture.png").click()
    page.get_by_role("button", name="Show as YAML or command").click()
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save blotches_quilting.yaml").click()
    flow = tmp_path / saved.value.suggested_filename
    saved.value.save_as(flow)
    picture.value.save_as(tmp_path / "texture.png")
    out = run_again([str(flow)], tmp_path)
    assert (tmp_path / "texture.png").read_bytes() == (out / "texture.png").read_bytes()


def test_views_undo_and_keys(watched: Watched) -> None:
    page = watched.page
    page.get_by_role("button", name="blotches").first.click()
    page.get_by_label("Method").select_option("quilting")
    for mode in ("Repeat", "Compare", "Seeds", "Single"):
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
