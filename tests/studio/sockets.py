"""A page that talks to the studio, without a browser."""

from __future__ import annotations

import json
import uuid
from collections.abc import Iterator
from typing import Any

from websockets.sync.client import ClientConnection, connect

from texloom.pipelines.studio.messages.message import Message, numbered, packed, unpacked, without_numbers


class Page:
    """A page, over one socket after the other."""

    def __init__(self, base: str, cookie: str, **headers: str):
        self.name = str(uuid.uuid4())
        self.number = self.received = self.acknowledged = 0
        self._address = f"{base.replace('http', 'ws')}/api/socket?page={self.name}"
        self._headers = {"Cookie": cookie} | headers
        self.socket = self.connected()

    def connected(self) -> ClientConnection:
        """A new socket."""
        return connect(self._address, additional_headers=self._headers, max_size=None, proxy=None)

    def again(self) -> dict[str, Any]:
        """Lose the socket, and connect with another one; what the server says first."""
        self.socket.close()
        self.socket = self.connected()
        return next(self.messages())[0]

    def send(self, message: Message, payload: bytes = b"") -> bytes:
        """Send a message; what has been sent."""
        self.number += 1
        sent = numbered(self.number, self.received, packed(message, payload))
        self.socket.send(sent)
        return sent

    def messages(self) -> Iterator[tuple[dict[str, Any], bytes]]:
        """What comes: JSON and payload. What has arrived is told with the next message that is sent."""
        while True:
            sent = self.socket.recv(120, decode=False)
            assert isinstance(sent, bytes)
            number, self.acknowledged, frame = without_numbers(sent)
            if number and number <= self.received:  # sent again
                continue
            self.received = max(self.received, number)
            if frame:
                header, payload = unpacked(frame)
                yield json.loads(header), bytes(payload)

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()
