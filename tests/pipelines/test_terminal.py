"""What a run says: lines where there is no terminal, a bar where there is one."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import re
from collections.abc import Iterator

import pytest

from texloom.pipelines.engine.events import ItemReport, Note, StepProgress, StepReport, StepStarted
from texloom.pipelines.terminal import Terminal
from texloom.stages.progress import Progress


class Screen(io.StringIO):
    """A terminal."""

    def isatty(self) -> bool:
        return True


class Clock:
    """Time that passes when it is told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr("texloom.pipelines.terminal.time.monotonic", found)
    return found


@contextlib.contextmanager
def standard_error(stream: io.StringIO) -> Iterator[io.StringIO]:
    with contextlib.redirect_stderr(stream), pytest.MonkeyPatch.context() as patch:
        patch.setenv("TERM", "xterm")
        patch.setenv("COLUMNS", "100")
        for name in ("NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE", "JUPYTER_COLUMNS"):
            patch.delenv(name, raising=False)
        yield stream


def done(name: str, state: str, seconds: float) -> StepReport:
    return StepReport(name, "analysis.otsu", None, state, seconds)  # type: ignore[arg-type]


def test_a_line_a_step() -> None:
    with standard_error(io.StringIO()) as plain:
        lines = io.StringIO()
        terminal = Terminal(lines, ["edges", "structure"])
        terminal(done("edges", "cached", 0.01))
        terminal(StepStarted("structure"))
        terminal(done("structure", "ran", 12.345))
        terminal(done("edges", "failed", 0.5))
        assert lines.getvalue() == (
            "edges      cached\nstructure  ran      12.35 s\nedges      failed    0.50 s\n"
        )  # fmt: skip
        assert plain.getvalue() == ""


def test_plain_lines_come_now_and_then(clock: Clock) -> None:
    with standard_error(io.StringIO()) as plain:
        lines = io.StringIO()
        terminal = Terminal(lines, ["texture"])
        terminal(StepStarted("texture"))
        for second in range(100):
            clock.now += 1
            terminal(StepProgress("texture", Progress(second / 200, scale=1, scales=2, energy=99 - second)))
        written = plain.getvalue().splitlines()
        assert len(written) == 9, "one in ten seconds, and none for steps that are short"
        assert written[0] == "texture: 5 %, scale 1/2, energy 89, 3:10 left"
        assert written[-1] == "texture: 49 %, scale 1/2, energy 1, 1:42 left"
        assert lines.getvalue() == ""
        assert "\x1b" not in plain.getvalue()


def test_short_steps_say_nothing(clock: Clock) -> None:
    with standard_error(io.StringIO()) as plain:
        terminal = Terminal(io.StringIO(), ["a", "b"])
        for step in ("a", "b"):
            terminal(StepStarted(step))
            for share in (0.25, 0.5, 1.0):
                clock.now += 3
                terminal(StepProgress(step, Progress(share)))
        assert plain.getvalue() == ""


def test_time_left_counts_from_the_first_report(clock: Clock) -> None:
    """What an interrupted run has done already was not done in this time."""
    with standard_error(io.StringIO()) as plain:
        terminal = Terminal(io.StringIO(), ["a"])
        terminal(StepStarted("a"))
        clock.now += 20
        terminal(StepProgress("a", Progress(0.8)))
        clock.now += 30
        terminal(StepProgress("a", Progress(0.9)))
        assert plain.getvalue().splitlines() == ["a: 80 %, time left not known yet", "a: 90 %, 0:30 left"]


def test_notes_go_to_standard_error() -> None:
    with standard_error(io.StringIO()) as plain:
        lines = io.StringIO()
        Terminal(lines, ["a"])(Note("something"))
        assert (lines.getvalue(), plain.getvalue()) == ("", "something\n")


def test_names_are_printed_on_one_line_and_obeyed_by_no_terminal(clock: Clock) -> None:
    name = "a\nb\x1b]0;c\u202e"
    with standard_error(io.StringIO()) as plain:
        lines = io.StringIO()
        terminal = Terminal(lines, ["edges"], items=2)
        terminal(Note(f"{name}: left out"))
        terminal(StepStarted(name))
        clock.now += 11
        terminal(StepProgress(name, Progress(0.25)))
        terminal(dataclasses.replace(done("edges", "ran", 1.0), item=name))
        terminal(ItemReport(name, 1, 2, f"sources.{name}"))
    for text, count in ((plain.getvalue(), 2), (lines.getvalue(), 2)):
        assert text.count("\n") == count
        assert text.replace("\n", "").isprintable()
        assert text.count(r"a\nb\x1b]0;c\u202e") >= count


def test_names_are_no_markup_of_a_bar(clock: Clock) -> None:
    with standard_error(Screen()) as screen:
        terminal = Terminal(io.StringIO(), ["edges"])
        terminal(StepStarted("[/b]a/edges"))
        terminal(StepProgress("[/b]a/edges", Progress(0.25)))
        terminal.bar.refresh()
        assert "[/b]a/edges" in re.sub(r"\x1b\[[0-9;]*m", "", screen.getvalue())
        terminal.close()


def test_a_bar_on_a_terminal(clock: Clock) -> None:
    with standard_error(Screen()) as screen:
        lines = io.StringIO()
        terminal = Terminal(lines, ["texture", "scores"])
        terminal(StepStarted("texture"))
        terminal(StepProgress("texture", Progress(0.25)))
        clock.now += 30
        terminal(StepProgress("texture", Progress(0.5, scale=3, scales=8, iteration=2, iterations=9, energy=1.5)))
        terminal.bar.refresh()
        terminal(done("texture", "ran", 60.0))
        written = screen.getvalue()
        assert "texture" in written
        assert "━" in written
        assert "50 %, scale 3/8, iteration 2/9, energy 1.5, 1:00 left" in re.sub(r"\x1b\[[0-9;]*m", "", written)
        assert "\x1b[2K" in written, "taken away at the end"
        assert terminal.bar is None
        assert lines.getvalue() == "texture  ran      60.00 s\n"


def test_a_note_takes_the_bar_away_first(clock: Clock) -> None:
    with standard_error(Screen()) as screen:
        terminal = Terminal(io.StringIO(), ["a"])
        terminal(StepStarted("a"))
        terminal(StepProgress("a", Progress(0.25)))
        terminal(Note("something"))
        assert "\x1b[?25h" in screen.getvalue(), "the cursor is shown again"
        assert screen.getvalue().endswith("something\n")
        terminal(StepProgress("a", Progress(0.5)))
        terminal.bar.refresh()
        assert "25 %" not in screen.getvalue().partition("something")[2]
        assert "50 %" in screen.getvalue().partition("something")[2], "and it comes back"
        terminal.close()
        terminal.close()
        assert screen.getvalue().count("\x1b[?25h") == 2


def test_each_step_has_its_own_bar(clock: Clock) -> None:
    with standard_error(Screen()) as screen:
        terminal = Terminal(io.StringIO(), ["first", "second"])
        for step in ("first", "second"):
            terminal(StepStarted(step))
            terminal(StepProgress(step, Progress(0.25)))
            terminal.bar.refresh()
            terminal(done(step, "ran", 1))
        assert screen.getvalue().index("first") < screen.getvalue().index("second")


def test_a_set_says_what_is_done_has_failed_and_is_left(clock: Clock) -> None:
    with standard_error(io.StringIO()):
        lines = io.StringIO()
        terminal = Terminal(lines, ["edges"], items=4)
        terminal(dataclasses.replace(done("edges", "cached", 0.0), item="a"))
        terminal(ItemReport("a", 1, 4, None))
        for item in ("c", "b"):  # at the same time
            terminal(StepStarted(f"{item}/edges"))
        clock.now += 30
        for item, number in (("c", 2), ("b", 3)):
            terminal(dataclasses.replace(done("edges", "ran", 30.0), item=item))
            terminal(ItemReport(item, number, 4, "too dark" if item == "c" else None))
        terminal(ItemReport("d", 4, 4, None))
        assert [line for line in lines.getvalue().splitlines() if line.startswith("[")] == [
            "[1/4] a: 1 cached",
            "[2/4] c: failed: too dark (1 failed, 1:00 left)",
            "[3/4] b: 1 ran (1 failed, 0:15 left)",
            "[4/4] d: ",
        ]


def test_a_bar_for_the_set_and_one_for_each_step(clock: Clock) -> None:
    with standard_error(Screen()) as screen:
        terminal = Terminal(io.StringIO(), ["edges"], items=200)
        for step in ("a/edges", "b/edges"):
            terminal(StepStarted(step))
            terminal(StepProgress(step, Progress(0.25)))
        terminal.bar.refresh()
        written = re.sub(r"\x1b\[[0-9;]*m", "", screen.getvalue())
        assert "0 of 200" in written
        assert "a/edges" in written
        assert "b/edges" in written
        terminal.close()
