"""Progress reports of long stages; they are ignored unless a runner listens."""

from __future__ import annotations

import contextlib
import contextvars
import dataclasses
from collections.abc import Callable, Iterator

from texloom.stages.vocabulary.arrays import Image


@dataclasses.dataclass(frozen=True)
class Progress:
    """One report from inside a stage."""

    done: float
    """finished share of the stage's estimated work, 0..1"""
    scale: int = 0
    """the current scale, 1 is the coarsest; 0 without scales"""
    scales: int = 0
    iteration: int = 0
    """the iteration within the scale, from 1; 0 without iterations"""
    iterations: int = 0
    energy: float | None = None
    """the value of the objective function, if there is one"""
    preview: Callable[[], Image] | None = None
    """renders the current state; called only if a listener shows it"""


Listener = Callable[[Progress], None]

_listener: contextvars.ContextVar[Listener | None] = contextvars.ContextVar("progress_listener", default=None)


def report(progress: Progress) -> None:
    """Send a report to the listener, if there is one."""
    listener = _listener.get()
    if listener is not None:
        listener(progress)


@contextlib.contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Send the reports made inside the ``with`` block to ``listener``."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextlib.contextmanager
def part(first: float, last: float) -> Iterator[None]:
    """Map the reports of the ``with`` block to the range ``first`` to ``last`` of the whole work, each 0..1."""
    listener = _listener.get()
    if listener is None:
        yield
        return
    with listening(
        lambda progress: listener(dataclasses.replace(progress, done=first + (last - first) * progress.done))
    ):
        yield
