"""What a process prints, waited for with a bound."""

from __future__ import annotations

import subprocess
import threading
from typing import AnyStr

import pytest

_SECONDS = 180.0  # in which a busy machine starts anything


def next_line(process: subprocess.Popen[AnyStr], seconds: float = _SECONDS) -> AnyStr:
    """The next line of a process's output; where none comes in time, the process is killed and the test fails."""
    assert process.stdout is not None
    lines: list[AnyStr] = []
    reader = threading.Thread(target=lambda stream: lines.append(stream.readline()), args=[process.stdout])
    reader.start()
    reader.join(seconds)
    if reader.is_alive():
        process.kill()
        reader.join()
        pytest.fail(f"{process.args!r} has printed no line within {seconds:g} s, but {lines[0]!r}")
    return lines[0]
