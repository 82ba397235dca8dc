"""What a Prefect server is told, by a thread of its own, so that no step waits for the server."""

from __future__ import annotations

import collections
import contextlib
import contextvars
import functools
import threading
import time
from collections.abc import Callable

import httpx
import prefect
from prefect.client.orchestration import SyncPrefectClient
from prefect.settings import PREFECT_CLIENT_MAX_RETRIES, temporary_settings

_ANSWER = 10.0  # seconds for an answer
_PAUSE = 5.0  # seconds before a server that did not answer is asked again
_LAST_PAUSE = 1.0  # the same at the end
_BUSY = {408, 429, 503}  # answers of a server that will take it later, as while its database is locked
_OVERLOADED = {*_BUSY, *range(500, 600)}  # of one that does not take what it is told
_TRIES = 3  # of a call that is answered so, but for a busy server: it may be at fault itself

Call = Callable[[SyncPrefectClient], object]


class Teller:
    """Calls a server one call after the other. While it does not answer they wait, in their order."""

    def __init__(self) -> None:
        self._waiting: collections.deque[Call] = collections.deque()
        self._changed = threading.Condition()
        self._is_silent = False
        self._end = threading.Event()
        self._patience = float("inf")
        self._answered = 0.0
        """when the server has answered last"""
        work = functools.partial(contextvars.copy_context().run, self._work)
        self._thread = threading.Thread(target=work, name="texloom-prefect", daemon=True)
        self._thread.start()

    def tell(self, call: Call, is_needed: bool = True) -> None:
        """Have a call made soon; one that is not needed is left out while the server does not answer."""
        with self._changed:
            if is_needed or not self._is_silent:
                self._waiting.append(call)
                self._changed.notify()

    def close(self, patience: float) -> int:
        """Wait until all calls are made, or no answer came for so many seconds; how many could not be made."""
        self._answered, self._patience = time.monotonic(), patience
        self._end.set()
        with self._changed:
            self._changed.notify()
        while self._thread.is_alive() and self._has_patience():
            self._thread.join(1)
        return len(self._waiting)

    def _has_patience(self) -> bool:
        return time.monotonic() < self._answered + self._patience

    def _work(self) -> None:
        with (
            contextlib.suppress(Exception),  # of the client's own making and end
            temporary_settings({PREFECT_CLIENT_MAX_RETRIES: 0}),
            prefect.get_client(sync_client=True, httpx_settings={"timeout": _ANSWER}) as client,
        ):
            tries = 0
            while (call := self._next()) is not None:
                tries += 1
                problem = _problem_of(call, client)
                self._is_silent = problem is not None
                if problem is None:
                    self._answered = time.monotonic()
                if problem is None or (tries >= _TRIES and _may_be_at_fault(problem)):
                    self._waiting.popleft()
                    tries = 0
                elif self._end.is_set():
                    time.sleep(_LAST_PAUSE)
                else:
                    self._end.wait(_PAUSE)

    def _next(self) -> Call | None:
        """The first call that has not been answered; none at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._end.is_set())
            return self._waiting[0] if self._waiting and self._has_patience() else None


def _may_be_at_fault(problem: httpx.HTTPError) -> bool:
    """Whether a server answered, and is not just busy."""
    return isinstance(problem, httpx.HTTPStatusError) and problem.response.status_code not in _BUSY


def _problem_of(call: Call, client: SyncPrefectClient) -> httpx.HTTPError | None:
    """Why a server did not take a call, if it may take it later."""
    try:
        call(client)
    except httpx.TransportError as error:
        return error
    except httpx.HTTPStatusError as error:
        return error if error.response.status_code in _OVERLOADED else None
    except Exception:  # the call itself is at fault
        return None
    return None
