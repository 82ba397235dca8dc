"""Buffering of library output."""

from __future__ import annotations

import contextlib
import io
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from typing import Any


class _ThreadOutput:
    """Standard output: what a thread that captures prints is buffered; what others print passes at once."""

    def __init__(self, stream: Any):
        self.stream = stream
        self.buffers: dict[int, io.StringIO] = {}  # of threads, by identifier

    def write(self, text: str) -> int:
        written: int = self.buffers.get(threading.get_ident(), self.stream).write(text)
        return written

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


class _Captures:
    """Those that overlap in time, for which the streams of the process are replaced once."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._count = 0

    def begin(self) -> None:
        """Begin one in this thread."""
        with self._lock:
            if not self._count:
                self._failed, self._output = False, _ThreadOutput(sys.stdout)
                self._replaced = _replaced(self._output)
            self._count += 1
            self._output.buffers[threading.get_ident()] = io.StringIO()

    def end(self, failed: bool) -> None:
        """End this thread's."""
        with self._lock:
            self._count -= 1
            self._failed |= failed
            printed = self._output.buffers.pop(threading.get_ident()).getvalue()
            if not self._count:
                self._replaced(self._failed)
            if printed and not failed and self._output.stream is not None:
                with contextlib.suppress(OSError):
                    self._output.stream.write(printed)
                    self._output.stream.flush()


def _replaced(output: _ThreadOutput) -> Callable[[bool], None]:
    """Replace the streams; the function puts them back, and discards the errors if it is told to.

    Libraries write errors to the descriptor, which does not tell threads apart.
    """
    with contextlib.ExitStack() as stack:
        if output.stream is not None:
            stack.enter_context(contextlib.redirect_stdout(output))
        errors = None
        if sys.__stderr__ is not None:  # else the process was started with it closed
            errors = stack.enter_context(tempfile.TemporaryFile())
            stderr = os.dup(2)
            stack.callback(os.close, stderr)
            os.dup2(errors.fileno(), 2)
            stack.callback(os.dup2, stderr, 2)
        streams = stack.pop_all()

    def put_back(discard: bool) -> None:
        with streams, contextlib.suppress(OSError):
            if errors is not None and not discard:
                errors.seek(0)
                os.write(stderr, errors.read())

    return put_back


_captures = _Captures()


@contextlib.contextmanager
def capture_output() -> Iterator[None]:
    """Buffer what this thread prints, and all errors; discard them if an exception is raised: libraries print too.

    Where a stream cannot be written, what was printed is lost: the caller would take the error for its file's.
    Captures of several threads may overlap; errors are passed on when the last ends, if all went well.
    """
    _captures.begin()
    failed = True
    try:
        yield
        failed = False
    finally:
        _captures.end(failed)
