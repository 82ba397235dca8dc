"""What stages log while a step is computed."""

from __future__ import annotations

import contextvars
import logging
import threading
import warnings
from pathlib import Path

import numpy as np
import pytest

import texloom
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
    both = threading.Barrier(2, timeout=60)

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


def test_a_message_names_the_step_of_the_flow(tmp_path: Path) -> None:
    light = np.linspace(0.3, 1, 160, dtype=np.float32)[:, None]
    noise = 0.2 + 0.5 * np.random.default_rng(0).random((160, 160), np.float32)
    store, told = tmp_path / "store", dict[str, list[str]]()
    for step in ("even", "flat"):  # the second one is the first one's result
        flow = tmp_path / f"{step}.yaml"
        flow.write_text(
            f"flow: {step}\nsources: {{picture: required}}\n"
            f"steps:\n  {step}: {{stage: analysis.tone, inputs: {{image: picture}}}}\n"
            f"exports: {{texture.exr: {step}.image}}\n"
        )
        told[step] = []
        texloom.run(
            flow, {"picture": light * noise}, store=store, out=tmp_path / step,
            progress=lambda event, own=told[step]: own.append(event.text) if "--set" in event.text else None,
        )  # fmt: skip
    for step, (text,) in told.items():
        assert f" {step}: the exemplar" in text
        assert f"--set {step}.even=never" in text
