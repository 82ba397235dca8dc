"""How the command line ends: exit codes, and signals that end a run in order."""

from __future__ import annotations

import signal
from enum import IntEnum

from texloom.pipelines.interruption_cause import interruption_of
from texloom.stages.vocabulary.interruption import Interruption

ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Exit(IntEnum):
    """The exit codes."""

    DONE = 0
    FAILED = 1
    """a stage failed"""
    WRONG = 2
    """the request is wrong"""
    INTERRUPTED = 130
    TERMINATED = 143


class Termination(Interruption):
    """SIGTERM: whatever ends by Ctrl-C ends by it in the same way."""


def end_in_order(number: int, _: object) -> None:
    """End the run in order, with what is finished kept; the next signal ends this process at once."""
    for one in ENDING_SIGNALS:
        if signal.getsignal(one) == end_in_order:
            signal.signal(one, signal.SIG_DFL)
    raise Termination if number == signal.SIGTERM else Interruption


def ended_by(error: BaseException) -> tuple[str, Exit]:
    """How a run was ended from outside, in a word and as an exit code."""
    if isinstance(interruption_of(error), Termination):
        return "terminated", Exit.TERMINATED
    return "interrupted", Exit.INTERRUPTED
