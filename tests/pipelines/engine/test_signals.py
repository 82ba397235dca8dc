"""Signals that wait until a library has done its work."""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Iterator

import pytest

from texloom.pipelines.engine import signals

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no signal masks")


class EndedError(Exception):
    """What the handler of these tests raises."""


@contextlib.contextmanager
def ended() -> Iterator[None]:
    """What the handler raises ends the block."""
    try:
        yield
    except EndedError:
        return
    pytest.fail("no signal was handled")


@pytest.fixture(autouse=True)
def _handlers() -> Iterator[None]:
    def end(number: int, _: object) -> None:
        raise EndedError(number)

    before = {number: signal.signal(number, end) for number in signals.ENDING}
    yield
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, ()) & {*signals.ENDING}
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", signals.ENDING)
def test_a_signal_waits_for_the_end_of_the_block(number: signal.Signals) -> None:
    done = []
    with ended(), signals.deferred():
        signal.raise_signal(number)
        done.append(number)
    assert done == [number]


@pytest.mark.parametrize("number", signals.ENDING)
def test_a_signal_ends_what_is_called_back(number: signal.Signals) -> None:
    """Also one that came before, and where a library has a handler of its own by then."""
    done = []
    with ended(), signals.deferred():
        signal.signal(signal.SIGTERM, lambda *_: done.append("the library's"))
        with signals.accepted():
            signal.raise_signal(number)
            done.append("not ended")
    with ended(), signals.deferred():
        signal.raise_signal(number)
        with signals.accepted():
            done.append("not ended")
    assert done == []


def test_after_what_is_called_back_signals_wait_again() -> None:
    done = []
    with ended(), signals.deferred():
        with signals.accepted():
            pass
        signal.raise_signal(signal.SIGINT)
        done.append("all")
    assert done == ["all"]


def test_the_handler_of_the_system_is_left_alone() -> None:
    """As after the first signal, so that the second ends the process at once."""
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    with contextlib.suppress(EndedError), signals.deferred():
        assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
        assert signal.SIGTERM not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    signal.signal(signal.SIGTERM, before)
