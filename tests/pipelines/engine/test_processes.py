"""Processes that compute calls: what they answer, and what becomes of it when one dies."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import pytest

from texloom.pipelines.engine.executors.process_pool import ProcessPool, WorkerDiedError
from texloom.stages.vocabulary.declare import InputError


@pytest.fixture
def pool() -> Iterator[ProcessPool]:
    made = ProcessPool(2)
    yield made
    made.kill()
    made.close()


def process_once_there(path: Path, _: object = None) -> int:
    """The process that this runs in, when there is such a file."""
    deadline = time.monotonic() + 60
    while not path.exists():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    return os.getpid()


def kill_this_process(path: Path, _: object) -> None:
    path.touch()
    os.kill(os.getpid(), signal.SIGKILL)


def absolute(number: int, tell: Callable[[Any], None]) -> int:
    for part in range(number, 0):
        tell(part)
    return abs(number)


def tells_what_cannot_be_pickled(_: object, tell: Callable[[Any], None]) -> None:
    tell(lambda: None)


def refused(text: str, _: object) -> None:
    raise InputError(text)


def not_to_be_pickled(*_: object) -> Any:
    return lambda: None


class UnreadableError(Exception):
    """Comes back from its text as a call with too few arguments."""

    def __init__(self, first: str, second: str):
        super().__init__(first + second)


def unreadable(*_: object) -> None:
    raise UnreadableError("no", "where")


def test_answers_and_exceptions_come_back(pool: ProcessPool) -> None:
    assert [pool.submit(absolute, number).result() for number in (-1, -2, -3)] == [1, 2, 3]
    with pytest.raises(InputError, match="too small"):
        pool.submit(refused, "too small").result()
    with pytest.raises(RuntimeError, match="pickle"):
        pool.submit(not_to_be_pickled, None).result()
    with pytest.raises(TypeError, match="second"):
        pool.submit(unreadable, None).result()
    with pytest.raises(Exception, match="pickle"):
        pool.submit(tells_what_cannot_be_pickled, None).result()
    assert pool.submit(absolute, -4).result() == 4


def test_what_a_call_tells_comes_before_its_answer(pool: ProcessPool) -> None:
    told: list[int] = []
    answer = pool.submit(absolute, -3, told.append)
    answer.add_done_callback(lambda _: told.append(0))
    assert answer.result() == 3
    assert told[:3] == [-3, -2, -1]


def test_a_process_that_dies_takes_only_its_own_call_with_it(pool: ProcessPool, tmp_path: Path) -> None:
    beside = pool.submit(process_once_there, tmp_path / "end")
    dying = pool.submit(kill_this_process, tmp_path / "dying")
    with pytest.raises(WorkerDiedError):
        dying.result(timeout=60)
    assert pool.submit(absolute, -1).result(timeout=60) == 1, "another one has taken its place"
    (tmp_path / "end").touch()
    assert beside.result(timeout=60) != os.getpid()


def test_a_process_that_dies_while_it_has_nothing_to_do_takes_nothing(tmp_path: Path) -> None:
    pool, there = ProcessPool(1), tmp_path / "there"
    there.touch()
    first = pool.submit(process_once_there, there).result(timeout=60)
    os.kill(first, signal.SIGKILL)
    os.waitid(os.P_PID, first, os.WEXITED | os.WNOWAIT)  # it is dead by now
    assert pool.submit(process_once_there, there).result(timeout=60) not in (first, os.getpid())
    pool.close()


def begun(*calls: Future[Any]) -> None:
    deadline = time.monotonic() + 60
    while not all(call.running() for call in calls):
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_closing_waits_for_what_has_begun_and_cancels_the_rest(tmp_path: Path) -> None:
    pool = ProcessPool(1)
    first = pool.submit(process_once_there, tmp_path / "end")
    begun(first)
    waiting = [pool.submit(absolute, -1) for _ in range(3)]
    waiting[-1].add_done_callback(lambda _: (tmp_path / "end").touch())
    pool.close()
    assert first.result() != os.getpid()
    assert all(call.cancelled() for call in waiting)


def test_killing_ends_what_has_begun(tmp_path: Path) -> None:
    pool = ProcessPool(2)
    calls = [pool.submit(process_once_there, tmp_path / "never") for _ in range(2)]
    begun(*calls)
    waiting = pool.submit(absolute, -1)
    pool.kill()
    pool.close()
    assert [type(call.exception()) for call in calls] == [WorkerDiedError, WorkerDiedError]
    assert waiting.cancelled()
