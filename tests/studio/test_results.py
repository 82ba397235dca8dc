"""Inspect and Runs, in a browser: layers, the lit material, and what the store holds."""

from __future__ import annotations

from typing import Any

import pytest

from tests.studio.conftest import Watched


def finish(page: Any, method: str) -> None:
    """Make a texture at full size in Make."""
    page.get_by_role("button", name="blotches").first.click()
    page.get_by_label("Method").select_option(method)
    page.get_by_role("button", name="256", exact=True).click()
    page.get_by_role("button", name="Finish at full size").click()
    page.get_by_label("Settings").get_by_text("Done in").wait_for()


@pytest.fixture
def finished(watched: Watched) -> Watched:
    """A page with a texture at full size."""
    finish(watched.page, "quilting")
    return watched


def test_layers_and_the_lit_material(finished: Watched) -> None:
    page = finished.page
    page.get_by_role("radio", name="2D and 3D").click()
    page.locator("make-view material-view[ready]").wait_for()
    assert page.get_by_label("Texture at full size").is_visible()
    page.get_by_role("radio", name="3D", exact=True).click()
    assert page.get_by_label("Texture at full size").count() == 0
    page.reload()
    page.locator("make-view material-view[ready]").wait_for()
    page.get_by_role("radio", name="2D", exact=True).click()
    page.get_by_role("button", name="Inspect it").click()
    page.locator("material-view[ready]").wait_for()
    for shape in ("Sphere", "Cube", "Cloth", "Plane"):
        page.get_by_role("radio", name=shape).click()
    page.get_by_text("Light and relief").click()
    page.get_by_label("Light around").fill("200")
    page.get_by_label("Exposure").fill("1")
    assert page.get_by_label("Relief").count() == 0  # without a height map
    page.get_by_label("Layers").get_by_role("button", name="image").click()
    page.get_by_text("image, 256 × 256 px").wait_for()
    page.wait_for_function("() => document.querySelector('tiled-view').tileLayer.loaded.size === 1")
    page.get_by_role("radio", name="Repeat").last.click()
    page.get_by_text("Sizes, channels, provenance").click()
    page.get_by_text("synthesis.quilting").wait_for()


def test_runs_show_pictures_steps_and_flows(finished: Watched) -> None:
    page = finished.page
    page.get_by_role("tab", name="Runs").click()
    run = page.get_by_label("Runs in the store").get_by_role("button", name="quilting, seed 7").first
    run.click()
    assert run.locator("img").evaluate("image => image.decode().then(() => image.naturalWidth)") == 256
    page.get_by_label("Steps of the run").get_by_title("Inspect the layers of texture").click()
    page.get_by_label("Layers").get_by_role("button", name="image").wait_for()
    page.get_by_role("tab", name="Runs").click()
    page.get_by_label("Runs of this studio").get_by_text("vary", exact=True).wait_for()


def test_a_texture_without_end(watched: Watched) -> None:
    page = watched.page
    held: list[Any] = []
    page.route("**/api/pictures?*side=2048", lambda route: held.insert(0, route))
    finish(page, "per_pixel")
    page.get_by_role("button", name="Inspect it").click()
    page.get_by_role("radio", name="Compare").wait_for()  # also without the exemplar, so that no button moves later
    page.get_by_role("radio", name="Endless").click()
    page.wait_for_function("() => document.querySelector('tiled-view').tileLayer.loaded.size >= 4")
    while held:
        held.pop().continue_()
    page.locator("tiled-view canvas").press("ArrowLeft")
    page.get_by_role("button", name="Show as YAML", exact=True).click()
    page.get_by_role("dialog").get_by_text("origin").first.wait_for()
    page.get_by_role("button", name="Close").click()


def test_a_tile_that_cannot_be_made_is_not_asked_for_without_end(finished: Watched) -> None:
    page = finished.page
    asked: list[str] = []

    def fail(route: Any) -> None:
        asked.append(route.request.url)
        route.fulfill(status=500, body="no")

    page.route("**/api/tiles/**", fail)
    page.get_by_role("button", name="Inspect it").click()
    page.get_by_label("Layers").get_by_role("button", name="image").click()
    page.get_by_role("alert").first.wait_for()
    page.wait_for_timeout(500)
    assert 1 <= len(asked) < 10  # again whenever the view is drawn, as when the exemplar comes
    assert all("500" in problem for problem in finished.problems)
    finished.problems.clear()
