"""Large pictures and results in a browser: shown at once, and sharp where one looks closer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

from tests.studio.conftest import Watched, draw_on, resize

SIDES = (2304, 3072)
# Whether all tiles in view are there, and whether the canvas shows a picture pixel by pixel in its middle.
SHARP = """(view) => {
  const layer = view.tileLayer;
  const is = ({ level, row, column }) => layer.loaded.has(`${level}/${row}/${column}`);
  return layer !== null && [...layer.loaded.keys()].some((one) => one.startsWith("0/")) && layer.wanted.every(is);
}"""


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Noise, of more than a megabyte."""
    path = tmp_path_factory.mktemp("large") / "noise.png"
    noise = np.random.default_rng(1).integers(0, 256, (*SIDES, 3), np.uint8)
    PIL.Image.fromarray(noise).save(path, compress_level=1)
    return path


def zoom_to_pixels(page: Any, selector: str) -> None:
    """Show a pixel of a picture as one of the screen, and wait until it is sharp."""
    page.wait_for_function(f"() => document.querySelector('{selector}')?.tiles")
    view = page.locator(selector)
    assert view.evaluate("(view) => view.picture.width < view.tiles.width && view.scale < 1")
    view.evaluate("(view) => { view.zoom = 1; view.draw(); }")
    page.wait_for_function(f"() => ({SHARP})(document.querySelector('{selector}'))")


def is_sharp(page: Any, selector: str, file: Path) -> bool:
    """Whether the middle of a canvas shows the middle of a picture pixel by pixel."""
    codes = page.locator(selector).evaluate("""(view) => {
      const { width, height } = view.canvas;
      return [...view.canvas.getContext("2d").getImageData(width / 2 - 16, height / 2 - 16, 32, 32).data];
    }""")
    part, whole = np.array(codes, np.uint8).reshape(32, 32, 4)[..., :3], np.asarray(PIL.Image.open(file))
    places = [
        (whole.shape[0] // 2 + row, whole.shape[1] // 2 + column) for row in (-17, -16) for column in (-17, -16)
    ]
    return any((whole[row : row + 32, column : column + 32] == part).all() for row, column in places)


def test_a_large_picture_is_shown_while_it_is_sent_and_sharp_afterwards(watched: Watched, picture: Path) -> None:
    page = watched.page
    held: list[Any] = []
    page.route("**/api/receiving", lambda route: held.insert(0, route))
    page.locator("make-view").get_by_label("Choose pictures").set_input_files(picture)
    page.wait_for_function("() => document.querySelector('picture-view.incoming')?.picture.width === 1024")
    held[0].continue_()
    page.locator("picture-view.incoming").wait_for(state="detached")
    page.evaluate("() => { document.querySelector('make-view').made.previews.stop(); }")
    view = "make-stage picture-view"
    zoom_to_pixels(page, view)
    assert is_sharp(page, view, picture)


def test_a_photograph_is_sharp_below_its_surfaces(watched: Watched, picture: Path) -> None:
    draw_on(watched.page, picture, "Surfaces")
    zoom_to_pixels(watched.page, "photo-canvas")
    assert is_sharp(watched.page, "photo-canvas", picture)


def test_a_picture_that_cannot_be_read_is_not_shown(watched: Watched, tmp_path: Path, picture: Path) -> None:
    content = picture.read_bytes()
    (tmp_path / "broken.png").write_bytes(content[: len(content) // 2])
    page = watched.page
    page.locator("make-view").get_by_label("Choose pictures").set_input_files(tmp_path / "broken.png")
    page.get_by_role("alert").get_by_text("truncated or broken").wait_for()
    assert page.locator("picture-view.incoming").count() == 0
    watched.problems.clear()  # the refusal


def test_a_large_result_is_looked_at_in_tiles(watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    page.get_by_role("button", name="blotches").first.click()
    page.get_by_label("Method").select_option("quilting")
    resize(page, 4096, 64)
    with page.expect_response(lambda answer: "/api/jobs?" in answer.url):
        page.get_by_role("button", name="Finish at full size").click()
    page.get_by_role("status").filter(has_text="Full size, seed").wait_for()
    view = "make-stage picture-view"
    zoom_to_pixels(page, view)
    with page.expect_download() as texture:
        page.get_by_role("link", name="texture.png").click()
    texture.value.save_as(tmp_path / "texture.png")
    assert is_sharp(page, view, tmp_path / "texture.png")
