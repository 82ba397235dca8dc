"""Paint, in a browser: a stroke changes the texture, undo takes it back, and a terminal makes the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.studio.conftest import Watched, draw_on, repeated

PAGES_ARE_KEPT = True


def shown(page: Any) -> str:
    """The picture on the canvas."""
    return str(page.locator("canvas.result").evaluate("canvas => canvas.toDataURL()"))


LOSE = "() => document.querySelector('texloom-studio').studio.socket.socket.close()"


def test_the_texture_follows_the_brush(watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    draw_on(page, "blotches", "Paint")
    page.get_by_label("Size of the canvas").get_by_role("button", name="256").click()
    page.get_by_role("button", name="Begin to paint").click()
    page.get_by_text("Paint: the texture follows").wait_for()
    canvas = page.locator("canvas.result")
    page.wait_for_function("() => document.querySelector('paint-view').pixels !== null")
    before = shown(page)
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + 40, box["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + 200, box["y"] + 90, steps=8)
    page.mouse.up()
    page.wait_for_function("before => document.querySelector('canvas.result').toDataURL() !== before", arg=before)
    page.get_by_role("button", name="Undo").click()
    page.wait_for_function("before => document.querySelector('canvas.result').toDataURL() === before", arg=before)
    page.get_by_role("button", name="Redo").click()
    page.wait_for_function("before => document.querySelector('canvas.result').toDataURL() !== before", arg=before)
    before = shown(page)
    page.evaluate(LOSE)  # in the middle of a stroke
    page.mouse.move(box["x"] + 40, box["y"] + 160)
    page.mouse.down()
    page.mouse.move(box["x"] + 100, box["y"] + 190, steps=4)
    page.get_by_text("Connecting to the studio").wait_for()
    page.mouse.move(box["x"] + 200, box["y"] + 160, steps=4)
    page.mouse.up()
    page.get_by_text("Connecting to the studio").wait_for(state="detached")
    page.wait_for_function("before => document.querySelector('canvas.result').toDataURL() !== before", arg=before)
    repeated(page.get_by_label("Brush", exact=True), tmp_path, "Finish with all maps")
