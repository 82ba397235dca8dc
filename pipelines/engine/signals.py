"""Signals that end a run, kept from libraries that would take them for an error of their own.

An exception that a handler raises inside Prefect or Dask may come out as another one, or leave a cluster half
started.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import Any

ENDING = (signal.SIGINT, signal.SIGTERM)


class _Deferral:
    """The signals that wait, and the handlers that will receive them."""

    def begin(self) -> None:
        """Signals wait from now on; those that the system handles still end this process at once."""
        from multiprocessing import resource_tracker  # which adds a module that a run in this process does without

        self.received: list[int] = []
        self.handlers: dict[int, Any] = {
            number: signal.signal(number, self.receive)
            for number in ENDING
            if signal.getsignal(number) not in (signal.SIG_DFL, None)
        }
        resource_tracker.ensure_running()  # at its start it would unblock them
        self.mask = signal.pthread_sigmask(signal.SIG_BLOCK, self.handlers)

    def receive(self, number: int, _: object) -> None:
        """Handle a signal that another thread has let through."""
        self.received.append(number)

    def end(self) -> None:
        """Handle those that have waited."""
        signal.pthread_sigmask(signal.SIG_SETMASK, self.mask)
        for number in ENDING:
            if signal.getsignal(number) == self.receive:
                signal.signal(number, self.handlers.get(number, signal.SIG_DFL))
        for late in dict.fromkeys(self.received):
            signal.raise_signal(late)


_deferrals: list[_Deferral] = []
"""of the main thread, one in the other"""


@contextlib.contextmanager
def deferred() -> Iterator[None]:
    """Handle signals after the ``with`` block, in which Prefect or Dask work or start processes.

    New processes inherit what is blocked, or they would end in their imports, with a traceback each. Dask's workers
    keep it blocked and end with this process.
    """
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "pthread_sigmask"):
        yield
        return
    deferral = _Deferral()
    _deferrals.append(deferral)
    deferral.begin()
    try:
        yield
    finally:
        _deferrals.remove(deferral)
        deferral.end()


@contextlib.contextmanager
def accepted() -> Iterator[None]:
    """Handle signals at once, inside a `deferred` block that has called back."""
    deferral = _deferrals[-1] if _deferrals else None
    if deferral is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    try:
        for number, handler in deferral.handlers.items():
            signal.signal(number, handler)  # Prefect may have replaced it
        deferral.end()
        yield
    finally:
        deferral.begin()
