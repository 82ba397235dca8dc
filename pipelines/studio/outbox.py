"""Messages to a page, kept until it has them."""

from __future__ import annotations

import asyncio
from collections import deque
from dataclasses import dataclass

from texloom.pipelines.studio.messages.message import unpacked

MOST_BYTES = 256 * 2**20
"""that wait for a page; one that falls behind by more has to ask for everything again"""
_PICTURES = (b'{"kind":"preview_picture"', b'{"kind":"job_picture"')
_FINAL = b'"is_final":true'


@dataclass
class _Waiting:
    frame: bytes
    picture: bytes
    """how its header begins, where a newer one of the same may take its place; else empty"""
    number: int = 0
    """once it has been sent"""


class Outbox:
    """Messages in the order in which they came, each with a number when it is sent.

    Of pictures of what goes on only the newest waits. All else is kept until the page says that it has arrived, and
    is sent again over the next socket.
    """

    def __init__(self) -> None:
        self.news = asyncio.Event()
        """something waits"""
        self._waiting: deque[_Waiting] = deque()
        self._sent: deque[_Waiting] = deque()
        self._number = 0

    def put(self, frame: bytes) -> None:
        """Send a message next."""
        picture = _picture_of(frame)
        if picture:
            self._waiting = deque(one for one in self._waiting if one.number or one.picture != picture)
        self._waiting.append(_Waiting(frame, picture))
        self.news.set()

    def take(self) -> tuple[int, bytes] | None:
        """The next message and its number; None where none waits."""
        if not self._waiting:
            return None
        one = self._waiting.popleft()
        if not one.number:
            self._number += 1
            one.number = self._number
        self._sent.append(one)
        return one.number, one.frame

    def arrived(self, number: int) -> None:
        """Forget what the page has: all up to a number."""
        while self._sent and self._sent[0].number <= number:
            self._sent.popleft()

    def again(self) -> None:
        """Send what was sent, but has not arrived, once more, without pictures of what goes on."""
        self._waiting.extendleft(one for one in reversed(self._sent) if not one.picture)
        self._sent.clear()
        self.news.set()

    @property
    def is_full(self) -> bool:
        """Whether more waits than is kept."""
        return sum(len(one.frame) for part in (self._waiting, self._sent) for one in part) > MOST_BYTES


def _picture_of(frame: bytes) -> bytes:
    header, _ = unpacked(frame)
    kind = next((one for one in _PICTURES if header.startswith(one)), b"")
    return b"" if _FINAL in header else kind
