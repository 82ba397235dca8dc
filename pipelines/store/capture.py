"""Buffering of library output."""

from __future__ import annotations

import contextlib
import io
import os
import sys
import tempfile
from collections.abc import Iterator


@contextlib.contextmanager
def capture_output() -> Iterator[None]:
    """Buffer standard output and error; discard them if an exception is raised, as libraries print errors too.

    Where a stream cannot be written, what was printed is lost: the caller would take the error for its file's.
    """
    printed = io.StringIO()
    with contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.redirect_stdout(printed))
        if sys.__stderr__ is None:  # the process was started with it closed
            yield
        else:
            written = stack.enter_context(tempfile.TemporaryFile())
            stderr = os.dup(2)
            stack.callback(os.close, stderr)
            os.dup2(written.fileno(), 2)
            stack.callback(os.dup2, stderr, 2)
            yield
            written.seek(0)
            with contextlib.suppress(OSError):
                os.write(stderr, written.read())
    if sys.stdout is not None and (text := printed.getvalue()):
        with contextlib.suppress(OSError):
            sys.stdout.write(text)
