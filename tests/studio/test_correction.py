"""Correction, in a browser: draw around a spot, choose a version, accept it, undo it; and again in a terminal."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image

from tests.studio.conftest import Watched, resize, run_again


def shown(page: Any) -> np.ndarray:
    """The picture of the result that can be downloaded now."""
    with page.expect_download() as download:
        page.get_by_label("Settings").get_by_role("link", name="texture.png").click()
    return np.asarray(PIL.Image.open(io.BytesIO(Path(download.value.path()).read_bytes())))


def finish(page: Any, side: int) -> None:
    """Make a square texture of the picture."""
    resize(page, side, side)
    page.get_by_role("button", name="Finish at full size").click()
    page.get_by_label("Settings").get_by_text("Done in").wait_for()


def draw_around(page: Any, length: int) -> None:
    """Draw around a square, px of the screen, right of the middle of the result and below."""
    box = page.get_by_label("Texture at full size").bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.move(*middle)
    page.mouse.down()
    for right, down in ((length, 0), (length, length), (0, length), (0, 0)):
        page.mouse.move(middle[0] + right, middle[1] + down, steps=3)
        page.evaluate("document.querySelector('make-view').requestUpdate()")  # as news from the server do
    page.mouse.up()


def test_only_the_inside_of_an_outline_changes(watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    page.get_by_role("button", name="blotches").first.click()
    page.get_by_label("Preset").select_option("fast")
    finish(page, 128)
    before = shown(page)
    page.get_by_role("button", name="Correct a spot").click()
    draw_around(page, 80)
    page.get_by_role("radio", name="Version 2").click()
    page.get_by_role("button", name="Accept").click()
    page.get_by_text("Full size, corrected").wait_for()
    after = shown(page)
    changed = np.argwhere((before != after).any(axis=2))
    assert len(changed) > 10
    assert (changed.min(axis=0) >= 62).all()
    assert (changed.max(axis=0) <= 88).all()

    page.get_by_role("button", name="Show as YAML or command").click()
    with page.expect_download() as saved:
        page.get_by_role("button", name="_revise.yaml").click()
    flow = tmp_path / saved.value.suggested_filename
    saved.value.save_as(flow)
    page.get_by_role("button", name="Close").click()
    again = run_again([str(flow)], tmp_path)
    assert (np.asarray(PIL.Image.open(again / "texture.png")) == after).all()

    page.get_by_role("button", name="Undo").click()
    assert (shown(page) == before).all()
    page.get_by_role("button", name="Redo").click()
    assert (shown(page) == after).all()


def test_all_but_the_inside_of_an_outline_is_made_again(watched: Watched) -> None:
    page = watched.page
    page.get_by_role("button", name="blotches").first.click()
    page.get_by_label("Method").select_option("quilting")
    finish(page, 96)
    before = shown(page)
    page.get_by_role("button", name="Correct a spot").click()
    page.get_by_role("radio", name="All else").click()
    draw_around(page, 120)
    page.get_by_role("radio", name="Version 1").wait_for()
    page.get_by_role("button", name="Accept").click()
    page.get_by_text("Full size, corrected").wait_for()
    after = shown(page)
    assert (before[52:58, 52:58] == after[52:58, 52:58]).all()
    assert (before != after).any(axis=2).mean() > 0.3
