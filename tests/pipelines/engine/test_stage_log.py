"""What stages log while a step is computed."""

from __future__ import annotations

import contextvars
import logging
import threading
import warnings

import pytest

from texloom.pipelines.engine.stage_log import logging_to

LOGGER = logging.getLogger("texloom.stages.synthesis.something")


def test_warnings_of_stages_are_told_and_not_printed(
    capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    told: list[str] = []
    with logging_to("texloom.stages.synthesis.something", told.append):
        LOGGER.warning("too %s", "dark")
        LOGGER.info("nobody asked")
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.warn("overflow", RuntimeWarning, stacklevel=1)
    assert told == ["too dark", "RuntimeWarning: overflow"]
    assert caplog.messages == []
    assert capsys.readouterr() == ("", "")


def test_outside_of_steps_logging_is_as_it_was(caplog: pytest.LogCaptureFixture) -> None:
    told: list[str] = []
    with logging_to("texloom.stages.synthesis.something", told.append):
        pass
    LOGGER.warning("too dark")
    with pytest.warns(RuntimeWarning, match="overflow"):
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)
    assert (told, caplog.messages) == ([], ["too dark"])


def test_each_thread_tells_its_own_step() -> None:
    told: dict[str, list[str]] = {"a": [], "b": []}
    both = threading.Barrier(2)

    def step(name: str) -> None:
        with logging_to("texloom.stages", told[name].append):
            both.wait()
            LOGGER.warning(name)
            both.wait()

    threads = [threading.Thread(target=contextvars.copy_context().run, args=(step, name)) for name in told]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert told == {"a": ["a"], "b": ["b"]}


def test_packages_of_plug_ins_are_told_too() -> None:
    told: list[str] = []
    with logging_to("plugin.stage", told.append):
        logging.getLogger("plugin.stage").warning("from outside")
    assert told == ["from outside"]
