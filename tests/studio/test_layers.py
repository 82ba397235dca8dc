"""Layers of a material, in a browser: what they hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image

from tests.studio.conftest import Watched, resize

PREVIEWS = "document.querySelector('make-view').made.previews"
LAST = "() => document.querySelector('texloom-studio').studio.socket.newest.get('preview')[0].kind"


def layers(page: Any) -> Any:
    """The choice of a layer."""
    card = page.locator("details[aria-label=Draw]").locator("visible=true")
    if card.get_attribute("open") is None:
        card.locator("summary").click()
    return page.get_by_role("radiogroup", name="Layer").locator("visible=true")


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
