import os
import subprocess
import sys
import threading

import pytest

from tests.conftest import ROOT
from texloom.stages.kernels.core.threads import run_all, sharing, spans, thread_count


@pytest.mark.parametrize(("length", "pieces"), [(1, 16), (16, 16), (17, 16), (100, 3), (5, 1), (5, 0)])
def test_spans_cover_the_range_once_and_evenly(length: int, pieces: int) -> None:
    cut = spans(length, pieces)
    assert [i for first, last in cut for i in range(first, last)] == list(range(length))
    lengths = [last - first for first, last in cut]
    assert max(lengths) - min(lengths) <= 1
    assert min(lengths) >= 1
    assert len(cut) == max(1, min(length, pieces))


def test_thread_count_follows_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXLOOM_THREADS", "3")
    assert thread_count() == 3
    for nonsense in ("0", "-1", "many", "\u00b2", "1e9", "9" * 5000):
        monkeypatch.setenv("TEXLOOM_THREADS", nonsense)
        with pytest.raises(ValueError, match=r"^TEXLOOM_THREADS: got '.*', want a whole number from 1 to 999"):
            thread_count()
    monkeypatch.setenv("TEXLOOM_THREADS", "")
    assert thread_count() >= 1
    monkeypatch.delenv("TEXLOOM_THREADS")
    assert thread_count() >= 1


def test_calls_run_side_by_side_and_answer_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXLOOM_THREADS", "2")
    both = threading.Barrier(2, timeout=10)  # broken unless two threads meet

    def call(index: int) -> int:
        both.wait()
        return index

    assert run_all(call, [(index,) for index in range(4)]) == [0, 1, 2, 3]


def test_one_thread_is_the_caller(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXLOOM_THREADS", "1")
    assert run_all(lambda _: threading.get_ident(), [(1,), (2,)]) == [threading.get_ident()] * 2


def test_an_error_in_a_call_comes_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXLOOM_THREADS", "2")
    with pytest.raises(ZeroDivisionError):
        run_all(lambda value: 1 // value, [(1,), (0,), (1,)])


INTERRUPTED = """
import threading
from texloom.stages.kernels.core.threads import run_all

start = threading.Thread.start

def interrupted(thread):
    start(thread)
    if threading.current_thread() is threading.main_thread():
        raise KeyboardInterrupt

threading.Thread.start = interrupted
try:
    run_all(abs, [(-1,), (-2,)])
except KeyboardInterrupt:
    print("interrupted")
"""


def test_a_process_ends_that_is_interrupted_while_threads_start() -> None:
    environment = {**os.environ, "TEXLOOM_THREADS": "2", "PYTHONPATH": str(ROOT)}
    ran = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], env=environment, timeout=60, check=True, capture_output=True, text=True
    )
    assert (ran.stdout, ran.stderr) == ("interrupted\n", "")


def test_a_share_of_the_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXLOOM_THREADS", "5")
    with sharing(2):
        assert thread_count() == 2
        seen = set(run_all(lambda _: threading.get_ident(), [(index,) for index in range(20)]))
        assert len(seen) <= 2
        with sharing(1):
            assert run_all(lambda _: threading.get_ident(), [(1,), (2,)]) == [threading.get_ident()] * 2
    assert thread_count() == 5
