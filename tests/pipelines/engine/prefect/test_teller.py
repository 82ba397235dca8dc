"""What a server is told while it does not always answer."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import prefect
import pytest

from texloom.pipelines.engine.prefect import teller
from texloom.pipelines.engine.prefect.teller import Teller


class Server:
    """Takes what it is told, unless it is silent or has a problem with it."""

    def __init__(self) -> None:
        self.told: list[str] = []
        self.asked = threading.Event()
        self.is_silent = False
        self.refused: str | None = None
        self.busy = 0
        """how often it will say that its database is locked"""

    def take(self, what: str) -> None:
        self.asked.set()
        if self.is_silent:
            raise httpx.ConnectError("refused")
        if what == self.refused or self.busy:
            code = 503 if self.busy else 500
            self.busy -= code == 503
            request = httpx.Request("POST", "http://localhost")
            raise httpx.HTTPStatusError(str(code), request=request, response=httpx.Response(code))
        self.told.append(what)


def saying(what: str) -> Callable[[Any], None]:
    return lambda server: server.take(what)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Server:
    made = Server()

    @contextlib.contextmanager
    def client(**_: Any) -> Iterator[Server]:
        yield made

    monkeypatch.setattr(prefect, "get_client", client)
    monkeypatch.setattr(teller, "_PAUSE", 0.01)
    monkeypatch.setattr(teller, "_LAST_PAUSE", 0.01)
    return made


def test_a_server_that_answers_again_is_told_what_it_missed(server: Server) -> None:
    server.is_silent = True
    ours = Teller()
    ours.tell(saying("begun"))
    assert server.asked.wait(60)
    while not ours._is_silent:
        pass
    ours.tell(saying("half"), is_needed=False)
    ours.tell(saying("done"))
    server.is_silent = False
    assert ours.close(60) == 0
    assert server.told == ["begun", "done"]


def test_a_server_that_stays_silent_is_not_waited_for(server: Server) -> None:
    server.is_silent = True
    ours = Teller()
    ours.tell(saying("begun"))
    ours.tell(saying("done"))
    assert ours.close(0.1) == 2
    assert server.told == []


def test_what_a_server_never_takes_is_left_out(server: Server) -> None:
    server.refused = "begun"
    ours = Teller()
    for what in ("begun", "done"):
        ours.tell(saying(what))
    assert ours.close(60) == 0
    assert server.told == ["done"]


def test_a_busy_server_is_told_all(server: Server) -> None:
    server.busy = 10
    ours = Teller()
    for what in ("begun", "done"):
        ours.tell(saying(what))
    assert ours.close(60) == 0
    assert server.told == ["begun", "done"]


def test_a_call_with_a_fault_of_its_own_stops_no_other(server: Server) -> None:
    ours = Teller()
    ours.tell(lambda _: [].index(1))
    ours.tell(saying("done"))
    assert ours.close(60) == 0
    assert server.told == ["done"]
