"""What libraries print is kept back, and nothing else."""

from __future__ import annotations

import contextlib
import os
import sys
import threading

import pytest

from texloom.pipelines.store.capture import capture_output


def test_captures_that_overlap_leave_the_streams_as_they_were(capfd: pytest.CaptureFixture[str]) -> None:
    stdout = sys.stdout
    begun, ended = threading.Event(), threading.Event()

    def other() -> None:
        with capture_output():
            print("other")
            begun.set()
            ended.wait(60)

    thread = threading.Thread(target=other)
    with capture_output():
        thread.start()
        assert begun.wait(60)
        print("own")
        assert capfd.readouterr() == ("", "")
    ended.set()
    thread.join()
    assert sys.stdout is stdout
    print("after")
    assert capfd.readouterr() == ("own\nother\nafter\n", "")


def test_what_another_thread_prints_meanwhile_passes_at_once(capfd: pytest.CaptureFixture[str]) -> None:
    """The server of the studio tells an address while pictures are read in a thread."""
    with capture_output():
        thread = threading.Thread(target=lambda: print("an address", flush=True))
        thread.start()
        thread.join()
        assert capfd.readouterr() == ("an address\n", "")


def test_what_a_library_prints_of_a_broken_file_is_discarded(capfd: pytest.CaptureFixture[str]) -> None:
    with contextlib.suppress(ValueError), capture_output():
        print("a library complains")
        os.write(2, b"and once more")
        raise ValueError("broken")
    assert capfd.readouterr() == ("", "")
