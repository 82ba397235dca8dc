"""Ctrl-C and termination, told apart from exceptions of the same kinds that the code of a stage raises."""

from __future__ import annotations

import signal
import threading


class Interruption(KeyboardInterrupt):
    """A run is ended from outside: what texloom raises itself."""


def raised_by_code(error: BaseException) -> bool:
    """Whether a SystemExit or KeyboardInterrupt comes from code, as by ``sys.exit``, and not from a signal.

    Only the main thread receives signals. Where the host program handles Ctrl-C, a KeyboardInterrupt is its own.
    """
    if isinstance(error, Interruption):
        return False
    if isinstance(error, SystemExit) or threading.current_thread() is not threading.main_thread():
        return True
    handler = signal.getsignal(signal.SIGINT)
    return handler is signal.SIG_IGN or str(getattr(handler, "__module__", "")).startswith("texloom.")
