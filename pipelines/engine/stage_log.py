"""What stages log, and the warnings of libraries that they call, as notes of the step that is being computed."""

from __future__ import annotations

import contextlib
import contextvars
import logging
import threading
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

_tell: contextvars.ContextVar[Callable[[str], None] | None] = contextvars.ContextVar("tell", default=None)


_guard = threading.Lock()
_running: Counter[str] = Counter()
"""package to the number of tasks that are being computed"""
_propagated: dict[str, bool] = {}
"""package of tasks that are being computed to whether its logger passes records on else"""


@contextlib.contextmanager
def logging_to(module: str, tell: Callable[[str], None]) -> Iterator[None]:
    """Hand warnings that the package of ``module`` logs in this block, and Python's warnings, to ``tell``.

    Other threads, and code outside of such blocks, log as before.
    """
    package = module.partition(".")[0]
    token = _tell.set(tell)
    with _guard:
        _running[package] += 1
        if _running[package] == 1:
            _propagated[package] = _install(package)
    try:
        yield
    finally:
        _tell.reset(token)
        with _guard:
            _running[package] -= 1
            if not _running[package]:
                _remove(package, _propagated.pop(package))


class _TaskHandler(logging.Handler):
    """Takes what a running task logs; passes on the rest."""

    def emit(self, record: logging.LogRecord) -> None:
        """See `logging.Handler`."""
        tell = _tell.get()
        if tell is not None and record.levelno >= logging.WARNING:
            tell(record.getMessage())
        else:
            logging.getLogger().handle(record)


class _ShowWarning:
    """`warnings.showwarning` for tasks; the one that was there for everything else."""

    def __init__(self, show: Callable[..., None]):
        self.show = show

    def __call__(self, message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        tell = _tell.get()
        if tell is None:
            self.show(message, category, *place, **more)
        else:
            tell(f"{category.__name__}: {message}")


def _install(package: str) -> bool:
    if not isinstance(warnings.showwarning, _ShowWarning):
        warnings.showwarning = _ShowWarning(warnings.showwarning)
    logger = logging.getLogger(package)
    propagated = logger.propagate
    logger.addHandler(_TaskHandler())
    logger.propagate = False
    return propagated


def _remove(package: str, propagated: bool) -> None:
    logger = logging.getLogger(package)
    for handler in list(logger.handlers):
        if isinstance(handler, _TaskHandler):
            logger.removeHandler(handler)
    logger.propagate = propagated
    if isinstance(warnings.showwarning, _ShowWarning):
        warnings.showwarning = warnings.showwarning.show
