"""What is drawn on a material, in a browser: guides, a collage and a lattice, and again in a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

from tests.studio.conftest import Watched, draw_on, repeated

SIDE = 96  # px of results
PERIOD = 24  # px of the tiles


def opened(watched: Watched, picture: Path, mode: str) -> Any:
    """A layer, with a dropped picture and a small result."""
    page = watched.page
    draw_on(page, picture, mode)
    shown = page.locator({"Guides": "direct-paint", "Collage": "direct-collage", "Lattice": "direct-lattice"}[mode])
    shown.locator("picture-view").first.wait_for()
    for side in ("Height", "Width"):
        shown.get_by_label(side).fill(str(SIDE))
        shown.get_by_label(side).press("Enter")
    return shown


def drag(shown: Any, view: int, points: Sequence[tuple[float, float]], button: str = "left") -> None:
    """Drag over a picture by shares of its own sides."""
    canvas = shown.locator("picture-view canvas").nth(view)
    box, mouse = canvas.bounding_box(), shown.page.mouse
    side = min(box["width"], box["height"]) - 32  # as pictures are fitted
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    places = [(middle[0] + (x - 0.5) * side, middle[1] + (y - 0.5) * side) for x, y in points]
    mouse.move(*places[0])
    mouse.down(button=button)
    for place in places[1:]:
        mouse.move(*place, steps=4)
    mouse.up(button=button)


def followed(shown: Any) -> None:
    """Wait for the preview."""
    shown.locator(".state", has_text="Preview;").wait_for()


def test_painted_layers(watched: Watched, tmp_path: Path) -> None:
    shown = opened(watched, watched.served.folder / "blotches.png", "Guides")
    shown.get_by_label("Preset").select_option("fast")
    drag(shown, 0, [(0.1, 0.1), (0.3, 0.1)])
    followed(shown)
    undo, redo = shown.get_by_role("button", name="Undo"), shown.get_by_role("button", name="Redo")
    undo.click()
    assert undo.is_disabled()
    redo.click()
    shown.get_by_role("radio", name="Structure").click()
    drag(shown, 0, [(0.5, 0.2), (0.5, 0.9)])
    shown.get_by_role("radio", name="Fill").click()
    drag(shown, 0, [(0.8, 0.2)])
    shown.get_by_role("radio", name="Brush").click()
    shown.get_by_role("radio", name="Areas").click()
    drag(shown, 0, [(0.7, 0.7), (0.9, 0.7)])
    shown.locator(".state", has_text="Now paint").wait_for()
    drag(shown, 1, [(0.2, 0.2), (0.8, 0.2)])
    shown.get_by_role("radio", name="Eraser").click()
    drag(shown, 1, [(0.8, 0.2), (0.7, 0.2)])
    followed(shown)
    flow = repeated(shown, tmp_path)
    assert all(f"{name}:" in flow for name in ("exemplar_guide", "target_guide", "exemplar_structure", "kind"))


def test_painted_direction(watched: Watched, tmp_path: Path) -> None:
    shown = opened(watched, watched.served.folder / "blotches.png", "Guides")
    shown.get_by_label("Preset").select_option("fast")
    shown.get_by_role("radio", name="Direction").click()
    drag(shown, 1, [(0.1, 0.1), (0.9, 0.8)])
    followed(shown)
    assert "strokes:" in repeated(shown, tmp_path)


def test_a_collage(watched: Watched, tmp_path: Path) -> None:
    shown = opened(watched, watched.served.folder / "blotches.png", "Collage")
    shown.get_by_label("Preset").select_option("fast")
    drag(shown, 0, [(0.1, 0.1), (0.7, 0.6)])
    drag(shown, 1, [(0.5, 0.5), (0.3, 0.3)])
    column = shown.get_by_label("Column", exact=True)
    assert abs(float(column.input_value()) - 0.3 * SIDE) <= 2
    shown.get_by_role("radio", name="Lasso").click()
    drag(shown, 0, [(0.2, 0.2), (0.8, 0.3), (0.7, 0.8), (0.3, 0.7)])
    angle = shown.get_by_label("Angle", exact=True)
    angle.fill("30")
    angle.press("Enter")
    shown.get_by_role("button", name="Back").click()
    followed(shown)
    assert "pieces:" in repeated(shown, tmp_path)
    shown.get_by_role("button", name="Delete").click()
    assert shown.get_by_label("Pieces, the last one on top").get_by_role("radio").count() == 1
    watched.page.keyboard.press("Control+z")
    assert shown.get_by_label("Pieces, the last one on top").get_by_role("radio").count() == 2


def test_a_lattice(watched: Watched, tmp_path: Path) -> None:
    rows, columns = np.mgrid[:SIDE, :SIDE]
    joints = (rows % PERIOD < 3) | (columns % PERIOD < 3)
    shade = 150 + np.random.default_rng(1).integers(-20, 20, (SIDE, SIDE))
    PIL.Image.fromarray(np.where(joints, 40, shade).astype(np.uint8)).save(tmp_path / "tiles.png")
    shown = opened(watched, tmp_path / "tiles.png", "Lattice")
    shown.get_by_role("button", name="Two vectors").click()
    for name in ("Row of vector 1", "Column of vector 2"):
        shown.get_by_label(name).fill(str(PERIOD))
        shown.get_by_label(name).press("Enter")
    drag(shown, 0, [(0.5 + 0.5 / SIDE, 0.75 + 0.5 / SIDE), (0.5 + 0.5 / SIDE, 0.77)])  # the first vector
    assert 25 <= float(shown.get_by_label("Row of vector 1").input_value()) <= 27
    shown.get_by_role("button", name="Undo").click()
    drag(shown, 0, [(0.75 + 0.5 / SIDE, 0.75 + 0.5 / SIDE), (0.77, 0.77)])  # a vertex
    watched.page.wait_for_function("() => !document.querySelector('direct-lattice').isWaiting")
    followed(shown)
    assert "vertices:" in repeated(shown, tmp_path)


@pytest.mark.long
def test_make_goes_on_with_what_is_drawn(watched: Watched, tmp_path: Path) -> None:
    """Its lines lead the results of Make too, also when the page was loaded again, until they are taken away."""
    page = watched.page
    shown = opened(watched, watched.served.folder / "blotches.png", "Guides")
    shown.get_by_label("Preset").select_option("fast")
    shown.get_by_role("radio", name="Direction").click()
    drag(shown, 1, [(0.1, 0.1), (0.9, 0.8)])
    followed(shown)
    shown.get_by_role("radio", name="Result", exact=True).click()
    settings = page.get_by_label("Settings")
    settings.get_by_role("button", name="Without direction").wait_for()
    page.get_by_role("button", name="Next").click()
    page.wait_for_timeout(1000)  # until the project has it
    page.reload()
    page.locator("summary", has_text="Draw direction").wait_for()
    layers = page.get_by_role("radiogroup", name="Layer").locator("visible=true")
    layers.get_by_role("radio", name="Guides").click()
    shown.locator("picture-view").first.wait_for()
    drag(shown, 0, [(0.1, 0.1), (0.3, 0.1)])  # what is left out
    followed(shown)
    layers.get_by_role("radio", name="Result", exact=True).click()
    flow = repeated(settings, tmp_path)
    assert "strokes:" in flow
    assert "seed: 8" in flow
    settings.get_by_role("button", name="Without parts left out, direction").click()
    page.locator("summary", has_text="guides, collage, paint, mesh").wait_for()
