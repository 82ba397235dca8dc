"""How the progress of a step travels from the process that computes it to the run.

Reports are sent a few times a second at most, nobody waits for them, and they may be lost. Workers of this machine
send datagrams to a port of the run, so that one that is killed leaves nothing locked or half written. Those of a
Dask cluster log events, which the scheduler of the cluster passes on.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import json
import secrets
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

from texloom.stages.vocabulary.progress import Progress

_SECONDS = 0.25  # between two reports of a step
_LARGEST = 4096  # bytes of a report
_HOST = "127.0.0.1"

Tell = Callable[[int, Progress], None]
"""receives the number of a task and how far it is, from any thread"""


@dataclasses.dataclass(frozen=True)
class Channel:
    """Where the reports of a run go, as plain data."""

    name: str
    """of the run: the topic of its events, or what its datagrams begin with, which no other program knows"""
    port: int = 0
    """on the same machine; 0 for events of Dask"""


class DatagramReceiver:
    """Receives reports from processes of this machine until `close`."""

    def __init__(self, tell: Tell):
        self._tell = tell
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((_HOST, 0))
        self.channel = Channel(secrets.token_hex(16), self._socket.getsockname()[1])
        self._thread = threading.Thread(target=self._receive, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread that receives."""
        _send_datagram(self.channel, "")
        self._thread.join(timeout=1.0)
        self._socket.close()

    def _receive(self) -> None:
        name = self.channel.name.encode()
        while True:
            try:
                message = self._socket.recv(_LARGEST)
            except OSError:  # of an earlier datagram, on Windows; or closed
                if self._socket.fileno() < 0:
                    return
                continue
            if message == name:
                return
            if message.startswith(name):
                _pass_on(message[len(name) :], self._tell)


class DaskReceiver:
    """Receives reports from the workers of a Dask cluster until `close`."""

    def __init__(self, client: Any, tell: Tell):
        self._client = client
        self.channel = Channel(f"texloom-{secrets.token_hex(16)}")
        client.subscribe_topic(self.channel.name, lambda event: _pass_on(event[1], tell))

    def close(self) -> None:
        """Subscribe no longer."""
        with contextlib.suppress(Exception):  # the cluster may be gone
            self._client.unsubscribe_topic(self.channel.name)


class ProgressSender:
    """Sends what a task reports; to be used in the process that computes it."""

    def __init__(self, channel: Channel, number: int):
        self._send = functools.partial(_send_datagram if channel.port else _log_event, channel)
        self._number = number
        self._last = 0.0

    def __call__(self, progress: Progress) -> None:
        """Send a report, unless the last one was a moment ago."""
        now = time.monotonic()
        if progress.done >= 1 or now >= self._last + _SECONDS:
            self._last = now
            # pictures stay here: whoever shows them would have to ask this process for each
            values = {name: value for name, value in vars(progress).items() if name != "preview"}
            self._send(json.dumps([self._number, values]))


def _send_datagram(channel: Channel, text: str) -> None:
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setblocking(False)
        sender.sendto((channel.name + text).encode(), (_HOST, channel.port))


def _log_event(channel: Channel, text: str) -> None:
    from distributed import get_worker

    with contextlib.suppress(Exception):  # a worker that is leaving the cluster
        get_worker().log_event(channel.name, text)


def _pass_on(text: bytes | str, tell: Tell) -> None:
    with contextlib.suppress(ValueError, TypeError):  # not in our form
        number, values = json.loads(text)
        tell(int(number), Progress(**values))
