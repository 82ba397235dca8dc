"""The one client of this Krita, where its texloom is, and the jobs that go on."""

from __future__ import annotations

from krita import Krita

from .controller import Jobs
from .texloom_client import Client

JOBS = Jobs()
SETTINGS = ("command", "store")
_CLIENTS: list[Client] = []
_GROUP = "texloom"


def setting(name: str) -> str:
    return str(Krita.instance().readSetting(_GROUP, name, ""))


def change(values: dict[str, str]) -> None:
    """Keep where texloom and its results are; the next run starts it anew."""
    for name, value in values.items():
        Krita.instance().writeSetting(_GROUP, name, value)
    close()


def client() -> Client:
    """The connection, which starts texloom when a run needs it."""
    if not _CLIENTS:
        _CLIENTS.append(Client(setting("command") or None, store=setting("store") or None))
    return _CLIENTS[0]


def close() -> None:
    """End the server, with what it does."""
    JOBS.cancel_all()
    while _CLIENTS:
        _CLIENTS.pop().close()
