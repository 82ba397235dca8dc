"""The jobs of this Krita, and where its texloom is."""

from __future__ import annotations

from krita import Krita

from .controller import Jobs
from .texloom_client import Client

SETTINGS = ("command", "store")
_GROUP = "texloom"


def setting(name: str) -> str:
    return str(Krita.instance().readSetting(_GROUP, name, ""))


def change(values: dict[str, str]) -> None:
    """Keep where texloom and its results are; the next run starts it anew."""
    for name, value in values.items():
        Krita.instance().writeSetting(_GROUP, name, value)
    JOBS.close()


def _connected() -> Client:
    return Client(setting("command") or None, store=setting("store") or None)


JOBS = Jobs(_connected)
