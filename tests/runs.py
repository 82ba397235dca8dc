"""Runs of commands in this process; of stages with other numbers of threads, with progress, from checkpoints."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import pytest

from texloom.pipelines.cli import main as cli
from texloom.stages.vocabulary.checkpoints import Checkpoints
from texloom.stages.vocabulary.progress import Progress, listening

Result = TypeVar("Result")


def run_command(*arguments: str) -> None:
    """Do what `texloom` does in a terminal, without the start of a process; it has to succeed."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sys, "argv", ["texloom", *arguments])
        patched.setenv("PYTHONSAFEPATH", "1")  # the command sets it for the rest of its process
        with pytest.raises(SystemExit, match=r"^0$"):
            cli.main()


def run_with_threads(
    run: Callable[[], Result], monkeypatch: pytest.MonkeyPatch, counts: Sequence[int] = (1, 3)
) -> list[Result]:
    """The result with each number of threads."""
    results = []
    for count in counts:
        monkeypatch.setenv("TEXLOOM_THREADS", str(count))
        results.append(run())
    return results


def run_with_progress(run: Callable[[], Result]) -> tuple[Result, list[Progress]]:
    """The result, and what was reported."""
    seen: list[Progress] = []
    with listening(seen.append):
        result = run()
    return result, seen


class MemoryCheckpoints(Checkpoints):
    """States of one type, those up to a level."""

    def __init__(self, state: type[Any], until: int = 100):
        self.state, self.until = state, until
        self.saved: dict[int, Any] = {}

    def latest(self, state: type[Any]) -> tuple[int, Any] | None:
        assert state is self.state
        return max(self.saved.items(), default=None)

    def save(self, level: int, state: Any) -> None:
        assert isinstance(state, self.state)
        if level <= self.until:
            self.saved[level] = state
