"""Layers of a material, in a browser: what is drawn on them comes back, and what they hold."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

from tests.pipelines.engine.prefect.server import wait_for
from tests.studio.conftest import Served, Watched, draw_on, exemplar, resize, watching

PREVIEWS = "document.querySelector('make-view').made.previews"
LAST = "() => document.querySelector('texloom-studio').studio.socket.newest.get('preview')[0].kind"
STATES = {
    "Collage": "document.querySelector('direct-collage')?.history.now",
    "Lattice": "document.querySelector('direct-lattice')?.history.now",
    "Mesh": "(({painted, side, map}) => [side, painted.now.strokes, painted.now.codes && [...map.codes].join('')])"
    "(document.querySelector('mesh-view'))",
    "Surfaces": "document.querySelector('photograph-view')?.photo?.recipe",
}


def layers(page: Any) -> Any:
    """The choice of a layer."""
    card = page.locator("details[aria-label=Draw]").locator("visible=true")
    if card.get_attribute("open") is None:
        card.locator("summary").click()
    return page.get_by_role("radiogroup", name="Layer").locator("visible=true")


def drag(canvas: Any, *points: tuple[float, float]) -> None:
    """Drag over a canvas, by shares of it."""
    box, mouse = canvas.bounding_box(), canvas.page.mouse
    places = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in points]
    mouse.move(*places[0])
    mouse.down()
    for place in places[1:]:
        mouse.move(*place, steps=4)
    mouse.up()


def state(page: Any, layer: str) -> Any:
    """What is drawn on a layer that is shown, when something is."""
    filled = f"() => {{ const now = {STATES[layer]}; return now && JSON.stringify(now).length > 20; }}"
    page.wait_for_function(filled)
    return page.evaluate(f"() => JSON.parse(JSON.stringify({STATES[layer]}, (_, one) => one ?? undefined))")


def unfolded(page: Any) -> None:
    """Wait for the mesh."""
    shown = "(document.querySelector('mesh-view') ?? {})"  # which is loaded when its layer is opened
    page.wait_for_function(f"() => (({{corners, waits}}) => corners && !waits){shown}")


def drawn(page: Any) -> dict[str, Any]:
    """Draw on the layers of a material; what is on each."""
    draw_on(page, "blotches", "Collage")
    picture = page.locator("direct-collage picture-view canvas").first
    picture.wait_for()
    page.wait_for_function("() => document.querySelector('direct-collage').exemplar")
    drag(picture, (0.4, 0.4), (0.6, 0.6))
    made = {"Collage": state(page, "Collage")}
    layers(page).get_by_role("radio", name="Lattice").click()
    page.locator("direct-lattice").get_by_role("button", name="Two vectors").click()
    made["Lattice"] = state(page, "Lattice")
    layers(page).get_by_role("radio", name="Mesh").click()
    view = page.locator("mesh-view")
    unfolded(page)
    view.get_by_role("button", name="512").click()
    unfolded(page)
    for tool in ("Direction", "Amount"):
        view.get_by_role("radio", name=tool).click()
        drag(view.locator("canvas.mesh"), (0.4, 0.62), (0.55, 0.68))
    return made | {"Mesh": state(page, "Mesh")}


def placed(page: Any) -> dict[str, Any]:
    """Place a plane on a photograph, and paint."""
    draw_on(page, "blotches", "Surfaces")
    view = page.locator("photograph-view")
    view.get_by_role("button", name="Add a plane").click()
    view.get_by_role("radio", name="Areas").click()
    drag(view.locator("photo-canvas canvas"), (0.45, 0.45), (0.5, 0.5))
    return {"Surfaces": state(page, "Surfaces")}


def found(page: Any, names: list[str]) -> dict[str, Any]:
    """What is on the layers of the material that is open."""
    page.locator("details[aria-label=Draw]").locator("visible=true").wait_for()
    if names == ["Surfaces"]:
        page.get_by_role("button", name="Place surfaces by hand").click()
    made = {}
    for name in names:
        if name != "Surfaces":
            layers(page).get_by_role("radio", name=name).click()
        made[name] = state(page, name)
    return made


@contextlib.contextmanager
def tab_of(folder: Path, chromium: Any, material: str = "") -> Iterator[tuple[Any, Served]]:
    """A page of a studio that begins now, with a material."""
    with Served(folder, folder.parent / "store") as served, watching(chromium, served, 1440, 900) as watched:
        if material:
            served.json("/api/project/view", {"view": "make", "material": material})
            watched.page.evaluate("() => sessionStorage.clear()")
            watched.page.reload()
        yield watched.page, served


@pytest.mark.long
@pytest.mark.parametrize("draw", [drawn, placed])
def test_what_is_drawn_comes_back_editable(
    page: None, tmp_path: Path, chromium: Any, draw: Callable[..., Any]
) -> None:
    """After a reload, in a new tab, and with another server."""
    folder = tmp_path / "project"
    folder.mkdir()
    PIL.Image.fromarray(exemplar()).save(folder / "blotches.png")
    with tab_of(folder, chromium) as (tab, served):
        expected = draw(tab)
        names = list(expected)
        material = tab.evaluate("() => document.querySelector('texloom-studio').studio.project.ready()")
        drawing = served.json(f"/api/materials/{material}")["material"]["drawing"]
        assert all(drawing[name.lower()] for name in names)
        tab.reload()
        assert found(tab, names) == expected
        other = tab.context.new_page()
        other.goto(served.base)
        assert found(other, names) == expected
    with tab_of(folder, chromium, material) as (tab, served):
        assert found(tab, names) == expected
        if draw is drawn:
            tab.locator("mesh-view").get_by_role("radio", name="Direction").click()
            drag(tab.locator("mesh-view canvas.mesh"), (0.4, 0.62), (0.5, 0.68))
            saved = f"/api/materials/{material}"
            wait_for(lambda: len(served.json(saved)["material"]["drawing"]["mesh"]["strokes"]) == 2)


def test_a_layer_without_previews_of_its_own_holds_those_of_make(watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    noise = np.random.default_rng(2).random((24, 24, 3))
    large = PIL.Image.fromarray((255 * noise).astype(np.uint8)).resize((384, 384), PIL.Image.Resampling.BICUBIC)
    large.save(tmp_path / "large.png")
    page.locator("make-view").get_by_label("Choose pictures").set_input_files(tmp_path / "large.png")
    page.get_by_label("Height").wait_for()
    resize(page, 2048, 2048)
    page.wait_for_function(f"() => {PREVIEWS}.isRefined")
    assert page.evaluate(LAST) == "preview"
    layers(page).get_by_role("radio", name="Paint").click()
    page.get_by_role("button", name="Begin to paint").wait_for()
    assert page.evaluate(LAST) == "preview_stop"
    layers(page).get_by_role("radio", name="Mesh").click()
    page.locator("mesh-view canvas.mesh").wait_for()
    assert page.evaluate(LAST) == "preview_stop"
    layers(page).get_by_role("radio", name="Result", exact=True).click()
    page.wait_for_function(f"() => {PREVIEWS}.isRefined")
    assert page.evaluate(LAST) == "preview"
