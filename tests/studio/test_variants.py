"""Variants side by side, in a browser: seeds, methods and results, one of which is taken, or two blended."""

from __future__ import annotations

from typing import Any

from tests.studio.conftest import Watched, resize


def begin(page: Any, width: int = 64, height: int = 48) -> None:
    """Choose the picture, the quickest method, and a small size."""
    page.get_by_role("button", name="blotches").first.click()
    page.get_by_label("Method").select_option("quilting")
    resize(page, width, height)


def vary(page: Any, kind: str, count: int) -> None:
    """Show variants of a kind, and wait for all."""
    page.get_by_role("radio", name=kind, exact=True).click()
    page.wait_for_function(
        "([kind, count]) => { const { sheet } = document.querySelector('make-view').made.previews;"
        " return sheet?.kind === kind && sheet.waiting === count; }",
        arg=[kind.lower(), count],
    )


def zooms(page: Any) -> set[float]:
    """Of all pictures of the sheet."""
    return set(page.evaluate("[...document.querySelectorAll('variant-sheet picture-view')].map((one) => one.zoom)"))


def test_a_seed_and_a_method_are_taken_from_a_sheet(watched: Watched) -> None:
    page = watched.page
    begin(page)
    page.get_by_role("radio", name="Variants").click()
    vary(page, "Seeds", 9)
    assert zooms(page) == {0}
    page.get_by_role("figure", name="Seed 9").locator("canvas").hover()
    page.mouse.wheel(0, -300)
    page.wait_for_function("document.querySelector('variant-sheet picture-view').zoom > 0")
    assert len(zooms(page)) == 1
    page.get_by_role("figure", name="Seed 9").get_by_role("button").click()
    assert page.get_by_label("Seed", exact=True).input_value() == "9"
    assert page.get_by_role("radio", name="Single").get_attribute("aria-checked") == "true"

    page.get_by_role("radio", name="Variants").click()
    vary(page, "Methods", 7)
    refused = page.get_by_role("figure", name="Tiles and weaves")
    assert "neither a lattice nor courses" in refused.inner_text()
    assert refused.get_by_role("button").is_disabled()
    page.get_by_role("figure", name="Large pieces by the best seams").get_by_role("button").click()
    assert page.get_by_label("Method").input_value() == "graph_cut"
    assert page.get_by_label("Seed", exact=True).input_value() == "9"


def test_settings_are_varied_one_by_one(watched: Watched) -> None:
    page = watched.page
    begin(page)
    page.get_by_label("Method").select_option("self_tuning")
    page.get_by_role("radio", name="Variants").click()
    vary(page, "Settings", 7)
    page.get_by_role("figure", name="Uniformity 30").get_by_role("button").click()
    assert "30" in page.locator("label", has=page.get_by_label("Uniformity")).inner_text()


def test_two_results_are_blended_in_a_new_material(watched: Watched) -> None:
    page = watched.page
    begin(page, 96, 96)
    settings = page.get_by_label("Settings")
    for seed in (7, 8):
        page.get_by_label("Seed", exact=True).fill(str(seed))
        page.get_by_label("Seed", exact=True).press("Enter")
        settings.get_by_role("button", name="Finish at full size").click()
        settings.get_by_text("Done in").wait_for()
    page.get_by_role("radio", name="Variants").click()
    vary(page, "Results", 2)
    blend = page.get_by_role("button", name="Blend two")
    assert blend.is_disabled()
    for box in page.get_by_role("checkbox", name="blend").all():
        box.check()
    blend.click()
    assert page.get_by_label("Method").input_value() == "mix"
    pictures = page.get_by_label("Pictures of the texture")
    assert [one.strip().partition("\n")[0] for one in pictures.locator(".name").all_inner_texts()] == [
        "Seed 8, large pieces",
        "Seed 7, large pieces",
    ]
    page.get_by_role("status").filter(has_text="Preview at").wait_for()
    assert page.get_by_label("Name of the material").input_value().startswith("blotches")
