"""Paint, in a browser: a stroke changes the texture, undo takes it back, and a terminal makes the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image

from tests.studio.conftest import Watched, draw_on, exemplar, repeated
from texloom.pipelines.studio.messages.answers import PaintOpened, PaintPicture, PaintProgress, PaintSummarised
from texloom.pipelines.studio.messages.message import Message
from texloom.pipelines.studio.messages.requests import PaintDabRequest, PaintOpenRequest, PaintSummaryRequest
from texloom.pipelines.studio.painting import Painter
from texloom.pipelines.studio.work import Places

PAGES_ARE_KEPT = True


def shown(page: Any) -> str:
    """The picture on the canvas."""
    return str(page.locator("canvas.result").evaluate("canvas => canvas.toDataURL()"))


# Keep back that the picture is summarised.
HOLD = """() => {
  const { followed } = document.querySelector("paint-view");
  const receive = followed.receive.bind(followed);
  const held = [];
  followed.receive = (message, payload) => {
    if (message.kind !== "paint_summarised") return receive(message, payload);
    held.push([message, payload]);
    return false;
  };
  window.release = () => {
    delete followed.receive;
    held.forEach(([message, payload]) => followed.receive(message, payload));
  };
}"""
# Lose the socket until `reconnect`, and send something while it closes, as a stroke may where that takes long.
LOSE = """() => {
  const { studio } = document.querySelector("texloom-studio");
  const { socket } = studio;
  socket.connect = () => {
    window.reconnect = () => {
      delete socket.connect;
      socket.connect();
    };
  };
  socket.socket.close();
  studio.send({ kind: "preview_stop" });
}"""


def test_the_texture_follows_the_brush(watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    draw_on(page, "blotches", "Paint")
    page.get_by_label("Size of the canvas").get_by_role("button", name="256").click()
    page.get_by_role("button", name="Begin to paint").click()
    page.get_by_text("Paint: the texture follows").wait_for()
    canvas = page.locator("canvas.result")
    page.wait_for_function("() => document.querySelector('paint-view').followed.pixels !== null")
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
    page.wait_for_function("() => window.reconnect")
    page.evaluate("() => window.reconnect()")
    page.get_by_text("Connecting to the studio").wait_for(state="detached")
    page.wait_for_function("before => document.querySelector('canvas.result').toDataURL() !== before", arg=before)
    repeated(page.get_by_label("Brush", exact=True), tmp_path, "Finish with all maps")


def stroke(page: Any, top: float) -> None:
    """Paint a line across the canvas."""
    box = page.locator("canvas.result").bounding_box()
    page.mouse.move(box["x"] + 40, box["y"] + top)
    page.mouse.down()
    page.mouse.move(box["x"] + 200, box["y"] + top + 30, steps=8)
    page.mouse.up()


def test_a_draft_is_painted_while_the_picture_is_summarised(watched: Watched, tmp_path: Path) -> None:
    """And what is painted is there again when the page is loaded again."""
    page = watched.page
    noise = np.random.default_rng(8).random((32, 32, 3))
    image = PIL.Image.fromarray((255 * noise).astype(np.uint8))
    image.resize((256, 256), PIL.Image.Resampling.BICUBIC).save(tmp_path / "moss.png")
    draw_on(page, tmp_path / "moss.png", "Paint")
    page.get_by_label("Size of the canvas").get_by_role("button", name="256").click()
    page.evaluate(HOLD)
    page.get_by_role("button", name="Begin to paint").click()
    page.get_by_text("Paint this draft while").wait_for()
    page.wait_for_function("() => document.querySelector('paint-view').followed.pixels?.width === 128")
    before = shown(page)
    stroke(page, 60)
    page.wait_for_function("before => document.querySelector('canvas.result').toDataURL() !== before", arg=before)
    assert page.get_by_role("button", name="Finish with all maps").count() == 0
    page.evaluate("() => window.release()")
    page.get_by_text("Paint: the texture follows").wait_for()
    page.wait_for_function("() => document.querySelector('paint-view').followed.pixels.width === 256")
    painted = page.evaluate("() => [...document.querySelector('paint-view').map.codes]")
    page.wait_for_timeout(600)  # what is drawn is sent after a pause
    texture = shown(page)
    page.reload()
    page.locator("details[aria-label=Draw] > summary").locator("visible=true").click()
    page.get_by_role("radiogroup", name="Layer").locator("visible=true").get_by_role("radio", name="Paint").click()
    page.get_by_text("Paint: the texture follows").wait_for()
    assert page.evaluate("() => [...document.querySelector('paint-view').map.codes]") == painted
    page.wait_for_function(
        "texture => document.querySelector('canvas.result').toDataURL() === texture", arg=texture
    )


def test_a_summary_is_made_once(tmp_path: Path) -> None:
    PIL.Image.fromarray(exemplar()).save(tmp_path / "blotches.png")
    painter = Painter(
        Places(folder=str(tmp_path), store=str(tmp_path / "store"), scratch=str(tmp_path / "scratch"))
    )
    told: list[Message] = []

    def send(message: Message, _: bytes = b"") -> None:
        told.append(message)

    asked: dict[str, Any] = {"texture": "folder:blotches.png", "control": ""}
    painter.summarise(PaintSummaryRequest(number=1, **asked), lambda: None, send)
    assert told[-1] == PaintSummarised(number=1)
    assert {one.step for one in told if isinstance(one, PaintProgress)} >= {"compact", "appearance"}
    told.clear()
    painter.open(PaintOpenRequest(number=2, size=(48, 48), **asked), bytes(48 * 48), lambda: None, send)
    assert {one.step for one in told if isinstance(one, PaintProgress)} == {"canvas"}
    told.clear()
    painter.open(PaintOpenRequest(number=3, size=(24, 24), scale=0.9, **asked), bytes(24 * 24), lambda: None, send)
    assert told[-2:] == [
        PaintOpened(number=3, control=""),
        PaintPicture(number=3, top=0, left=0, height=24, width=24),
    ]
    told.clear()
    painter.paint(PaintDabRequest(number=3, top=0, left=0, height=24, width=24), bytes([255]) * 24 * 24, send)
    assert isinstance(told[-1], PaintPicture)
