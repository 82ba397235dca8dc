"""How a long stage says where it is: silent unless a runner listens."""

from __future__ import annotations

import contextlib
import contextvars
import dataclasses
from collections.abc import Callable, Iterator

from texloom.stages.arrays import Image


@dataclasses.dataclass(frozen=True)
class Progress:
    """One report from inside a stage."""

    done: float
    """share of the stage's work that is finished, 0..1, by the stage's own estimate of cost"""
    scale: int = 0
    """the scale at work, 1 is the coarsest; 0 where there are none"""
    scales: int = 0
    iteration: int = 0
    """the iteration within the scale, from 1; 0 where there are none"""
    iterations: int = 0
    energy: float | None = None
    """what is being minimised, where something is"""
    preview: Callable[[], Image] | None = None
    """makes a picture of the state so far; called only if somebody looks"""


Listener = Callable[[Progress], None]

_listener: contextvars.ContextVar[Listener | None] = contextvars.ContextVar("progress_listener", default=None)


def report(progress: Progress) -> None:
    """Tell the listener, if there is one."""
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
    """Pass on the reports made inside the ``with`` block as the work between two shares of the whole, each 0..1."""
    listener = _listener.get()
    if listener is None:
        yield
        return
    with listening(
        lambda progress: listener(dataclasses.replace(progress, done=first + (last - first) * progress.done))
    ):
        yield
