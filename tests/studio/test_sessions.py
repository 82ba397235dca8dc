"""Pages that lose their socket: nothing is lost, nothing is done twice, and who is forgotten is told so."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import websockets

from tests.studio.conftest import Served
from tests.studio.sockets import Page
from texloom.pipelines.studio import sessions
from texloom.pipelines.studio.messages.answers import JobPicture, PaintPicture, PreviewPicture
from texloom.pipelines.studio.messages.message import packed
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.messages.requests import PaintDabRequest, PaintOpenRequest, PreviewRequest
from texloom.pipelines.studio.outbox import MOST_BYTES, Outbox

PAGES_ARE_KEPT = True
SIDE = 64
EXEMPLAR = "folder:blotches.png"


def until(page: Page, is_it: Callable[[dict[str, Any]], bool]) -> tuple[dict[str, Any], bytes]:
    return next(told for told in page.messages() if is_it(told[0]))


def painted(page: Page) -> tuple[dict[str, Any], bytes]:
    return until(page, lambda message: message["kind"] == "paint_picture")


def paint(page: Page, number: int, row: int, code: int) -> bytes:
    dab = PaintDabRequest(number=number, top=row, left=0, height=8, width=SIDE)
    return page.send(dab, bytes([code]) * 8 * SIDE)


def test_a_canvas_outlives_its_socket(served: Served) -> None:
    """Strokes that are sent twice are painted once; pictures that were on their way come again."""
    opening = PaintOpenRequest(number=1, texture=EXEMPLAR, control="", size=(SIDE, SIDE))
    ramp = np.linspace(0, 255, SIDE * SIDE).astype(np.uint8).tobytes()
    shown: list[np.ndarray] = []
    for is_lost in (False, True):
        with Page(served.base, served.cookie) as page:
            page.send(opening, ramp)
            picture = np.frombuffer(painted(page)[1], np.uint8).reshape(SIDE, SIDE, 4).copy()
            sent = [paint(page, 1, 8 * step, 30 * step) for step in range(6)]
            if is_lost:
                told = page.again()
                assert told == {"kind": "connected", "is_new": False}
                for one in sent:  # as a page does that has not heard whether they arrived
                    page.socket.send(one)
            ended = PaintDabRequest(number=2, top=0, left=0, height=1, width=1)
            page.send(ended, b"\0")
            for message, payload in page.messages():
                if message["kind"] == "paint_picture":
                    top, left, height, width = (message[name] for name in ("top", "left", "height", "width"))
                    part = np.frombuffer(payload, np.uint8).reshape(height, width, 4)
                    picture[top : top + height, left : left + width] = part
                    if message["number"] == 2:
                        break
            shown.append(picture)
    assert (shown[0] == shown[1]).all()


def test_the_server_says_what_has_arrived(served: Served) -> None:
    with Page(served.base, served.cookie) as page:
        recipe = Recipe(flow="quilting", sources={"exemplar": EXEMPLAR}, size=(48, 64))
        page.send(PreviewRequest(number=1, recipe=recipe))
        until(page, lambda message: message.get("is_final", False))
        assert page.acknowledged == page.number == 1


def test_a_page_may_connect_again_before_its_socket_is_lost(served: Served) -> None:
    recipe = Recipe(flow="quilting", sources={"exemplar": EXEMPLAR}, size=(48, 64))
    with Page(served.base, served.cookie) as page:
        for number in (1, 2, 3):
            before, page.socket = page.socket, page.connected()
            page.send(PreviewRequest(number=number, recipe=recipe.model_copy(update={"seed": number})))
            told, _ = until(page, lambda message: message.get("is_final", False))
            assert told["number"] == number
            with pytest.raises(websockets.ConnectionClosed):
                list(before)


def test_a_page_without_a_name_is_refused(served: Served) -> None:
    page = Page(served.base, served.cookie)
    page._address = page._address.partition("?")[0]
    with pytest.raises(websockets.ConnectionClosed):
        page.again()


def test_pages_are_bounded_and_the_oldest_lost_one_goes(served: Served) -> None:
    first = Page(served.base, served.cookie)
    assert next(first.messages())[0] == {"kind": "connected", "is_new": True}
    first.socket.close()
    others = [Page(served.base, served.cookie) for _ in range(sessions.MOST_PAGES)]
    try:
        for page in others:
            assert next(page.messages())[0]["is_new"]
        with pytest.raises(websockets.ConnectionClosed) as refused:
            first.again()
        assert "pages are open; close one" in refused.value.rcvd.reason
        others[0].socket.close()
        assert first.again() == {"kind": "connected", "is_new": True}
    finally:
        for page in (first, *others):
            page.socket.close()


def picture(number: int, is_final: bool = False) -> bytes:
    return packed(PreviewPicture(number=number, height=1, width=1, scale=1, done=1, is_final=is_final), b"\0" * 4)


def test_only_pictures_of_what_goes_on_are_left_out() -> None:
    part = packed(PaintPicture(number=1, top=0, left=0, height=1, width=1), b"\0" * 4)
    running = packed(JobPicture(job="a", height=1, width=1), b"\0" * 4)
    outbox = Outbox()
    for frame in (picture(1), part, running, picture(2), part, picture(3, is_final=True), running):
        outbox.put(frame)
    taken = [outbox.take() for _ in range(6)]
    assert taken == [(1, part), (2, picture(2)), (3, part), (4, picture(3, is_final=True)), (5, running), None]


def test_what_has_not_arrived_is_sent_again_in_order() -> None:
    parts = [packed(PaintPicture(number=n, top=0, left=0, height=1, width=1), b"\0" * 4) for n in range(4)]
    outbox = Outbox()
    for frame in (parts[0], parts[1], picture(1), parts[2]):
        outbox.put(frame)
    for _ in range(4):
        outbox.take()
    outbox.arrived(1)
    outbox.again()
    outbox.put(parts[3])
    assert [outbox.take() for _ in range(4)] == [(2, parts[1]), (4, parts[2]), (5, parts[3]), None]
    outbox.arrived(5)
    outbox.again()
    assert outbox.take() is None


def test_what_waits_is_bounded() -> None:
    outbox = Outbox()
    large = packed(PaintPicture(number=1, top=0, left=0, height=1, width=1), bytes(MOST_BYTES // 2))
    outbox.put(large)
    assert not outbox.is_full
    outbox.take()
    outbox.put(large)
    assert outbox.is_full
