"""What a run shows: lines where there is no terminal, live lines where there is one."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from texloom.pipelines.engine.events import ItemReport, Note, RunStarted, StepProgress, StepReport, StepStarted
from texloom.pipelines.terminal import Terminal
from texloom.stages.vocabulary.progress import Progress


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


def plain_text(written: str) -> str:
    """What was written, without what a terminal obeys."""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", written)


def started(*steps: str, items: int = 0) -> RunStarted:
    return RunStarted("flow", {"exemplar": "/x/wall.png"}, (96, 128), (7,), Path.cwd() / "store", steps, items)


def shown(lines: io.StringIO) -> list[str]:
    """The lines after the header."""
    return lines.getvalue().splitlines()[1:]


def begun(*steps: str, items: int = 0) -> tuple[Terminal, io.StringIO]:
    """A terminal that has shown its header, and its lines."""
    lines = io.StringIO()
    terminal = Terminal(lines)
    terminal(started(*steps, items=items))
    return terminal, lines


def done(name: str, state: str, seconds: float) -> StepReport:
    return StepReport(name, "analysis.otsu", None, state, seconds)  # type: ignore[arg-type]


def redraw(terminal: Terminal) -> None:
    terminal.live.refresh()


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, "flow: wall.png; 128 x 96 px; seed 7; store store"),
        ({"size": None, "seeds": (3, 4, 5), "items": 3}, "flow: wall.png; 3 items; 3 seeds, 3 to 5; store store"),
        ({"size": None, "items": 1}, "flow: wall.png; 1 item; seed 7; store store"),
        (
            {"sources": {"picture": "skimage:brick", "holes": "h/holes.png"}, "store": Path("/far/store")},
            "flow: picture skimage:brick, holes holes.png; 128 x 96 px; seed 7; store /far/store",
        ),
        ({"sources": {"a": f"{'0' * 64}.png"}}, f"flow: {'0' * 37}...; 128 x 96 px; seed 7; store store"),
        (
            {"sources": {"a": "/x/wall.png and 2 more"}},
            "flow: wall.png and 2 more; 128 x 96 px; seed 7; store store",
        ),
        ({"sources": {}}, "flow: 128 x 96 px; seed 7; store store"),
    ],
)
def test_the_header_says_what_is_run(changes: dict[str, object], expected: str) -> None:
    lines = io.StringIO()
    Terminal(lines)(dataclasses.replace(started("edges"), **changes))
    assert lines.getvalue() == f"{expected}\n"


def test_a_line_a_step() -> None:
    with standard_error(io.StringIO()) as plain:
        terminal, lines = begun("edges", "structure")
        terminal(done("edges", "cached", 0.01))
        terminal(StepStarted("structure"))
        terminal(done("structure", "ran", 12.345))
        terminal(done("edges", "failed", 0.5))
        assert shown(lines) == [
            "[1/2] edges      cached",
            "[2/2] structure  ran      12.35 s",
            "[1/2] edges      failed    0.50 s",
        ]
        assert plain.getvalue() == ""


def test_the_summary_counts_steps_and_names_scores_and_folder(clock: Clock) -> None:
    terminal, lines = begun("a", "b", "c")
    for name, state in (("a", "cached"), ("b", "ran"), ("c", "ran")):
        terminal(done(name, state, 1.0))
    clock.now += 12.34
    terminal.summarise({"fidelity": 0.987, "variety": 1.0}, Path("out"))
    clock.now += 3600
    terminal.summarise({}, None)
    assert shown(lines)[-2:] == [
        "2 ran, 1 cached in 12.3 s; fidelity 0.99, variety 1.00; out",
        "2 ran, 1 cached in 1:00:12",
    ]


def test_plain_lines_come_now_and_then(clock: Clock) -> None:
    with standard_error(io.StringIO()) as plain:
        terminal, lines = begun("start", "texture")
        terminal(StepStarted("texture"))
        for second in range(100):
            clock.now += 1
            terminal(StepProgress("texture", Progress(second / 200, scale=1, scales=2, energy=99 - second)))
        written = plain.getvalue().splitlines()
        assert len(written) == 9, "one in ten seconds, and none for steps that are short"
        assert written[0] == "[2/2] texture: 5 %, 3:10 left, scale 1/2, energy 89"
        assert written[-1] == "[2/2] texture: 49 %, 1:42 left, scale 1/2, energy 1"
        assert shown(lines) == []
        assert "\x1b" not in plain.getvalue()


def test_short_steps_say_nothing(clock: Clock) -> None:
    with standard_error(io.StringIO()) as plain:
        terminal, _ = begun("a", "b")
        for step in ("a", "b"):
            terminal(StepStarted(step))
            for share in (0.25, 0.5, 1.0):
                clock.now += 3
                terminal(StepProgress(step, Progress(share)))
        assert plain.getvalue() == ""


def test_time_left_counts_from_the_first_report(clock: Clock) -> None:
    """What an interrupted run has done already was not done in this time."""
    with standard_error(io.StringIO()) as plain:
        terminal, _ = begun("a")
        terminal(StepStarted("a"))
        clock.now += 20
        terminal(StepProgress("a", Progress(0.8)))
        clock.now += 30
        terminal(StepProgress("a", Progress(0.9)))
        assert plain.getvalue().splitlines() == ["[1/1] a: 80 %", "[1/1] a: 90 %, 0:30 left"]


def test_no_time_left_before_a_hundredth_is_done(clock: Clock) -> None:
    """The first iteration of a step may wait for its kernels to be compiled, and would promise hours."""
    with standard_error(io.StringIO()) as plain:
        terminal, _ = begun("a")
        terminal(StepStarted("a"))
        terminal(StepProgress("a", Progress(0.0)))
        for share in (0.001, 0.02):
            clock.now += 20
            terminal(StepProgress("a", Progress(share)))
        assert plain.getvalue().splitlines() == ["[1/1] a: 0 %", "[1/1] a: 2 %, 32:40 left"]


def test_notes_go_to_standard_error() -> None:
    with standard_error(io.StringIO()) as plain:
        terminal, lines = begun("a")
        terminal(Note("something"))
        terminal(Note("b/a: too dark", is_warning=True))
        assert (shown(lines), plain.getvalue()) == ([], "something\nwarning: b/a: too dark\n")


def test_names_are_printed_on_one_line_and_obeyed_by_no_terminal(clock: Clock) -> None:
    name = "a\nb\x1b]0;c\u202e"
    with standard_error(io.StringIO()) as plain:
        terminal, lines = begun("edges", items=2)
        terminal(dataclasses.replace(started("edges"), sources={"exemplar": name}))
        terminal(Note(f"{name}: left out"))
        terminal(StepStarted(name))
        clock.now += 11
        terminal(StepProgress(name, Progress(0.25)))
        terminal(dataclasses.replace(done("edges", "ran", 1.0), item=name))
        terminal(ItemReport(name, 1, 2, f"sources.{name}"))
    for text, count in ((plain.getvalue(), 2), ("\n".join(shown(lines)) + "\n", 3)):
        assert text.count("\n") == count
        assert text.replace("\n", "").isprintable()
        assert text.count(r"a\nb\x1b]0;c\u202e") >= count


def test_names_are_no_markup_of_a_live_line(clock: Clock) -> None:
    with standard_error(Screen()) as screen:
        terminal, _ = begun("edges")
        terminal(StepStarted("[/b]a/edges"))
        redraw(terminal)
        assert "[/b]a/edges" in plain_text(screen.getvalue())
        terminal.close()


def test_a_step_that_reports_nothing_has_a_live_line(clock: Clock) -> None:
    with standard_error(Screen()) as screen:
        terminal, lines = begun("edges", "scores")
        terminal(StepStarted("scores"))
        for _ in range(2):
            clock.now += 65
            redraw(terminal)
        written = plain_text(screen.getvalue())
        assert re.search(r"\[2/2\] scores ━+ 1:05", written)
        assert re.search(r"\[2/2\] scores ━+ 2:10", written)
        terminal(done("scores", "ran", 130.0))
        assert terminal.live is None
        assert "\x1b[2K" in screen.getvalue(), "taken away at the end"
        assert shown(lines) == ["[2/2] scores  ran     130.00 s"]


def test_a_live_line_says_how_far_a_step_is(clock: Clock) -> None:
    with standard_error(Screen()) as screen:
        terminal, _ = begun("texture", "scores")
        terminal(StepStarted("texture"))
        terminal(StepProgress("texture", Progress(0.25)))
        clock.now += 30
        terminal(StepProgress("texture", Progress(0.5, scale=3, scales=8, iteration=2, iterations=9, energy=1.5)))
        redraw(terminal)
        written = plain_text(screen.getvalue())
        assert "0:30 50 %, 1:00 left, scale 3/8, iteration 2/9, energy 1.5" in written.replace("  ", " ")
        terminal.close()


def test_a_note_comes_above_the_live_lines(clock: Clock) -> None:
    with standard_error(Screen()) as screen:
        terminal, _ = begun("a")
        terminal(StepStarted("a"))
        terminal(StepProgress("a", Progress(0.25)))
        terminal(Note("something"))
        before, _, after = screen.getvalue().partition("something\n")
        assert before.count("\x1b[?25h") == 1, "the cursor is shown again"
        terminal(StepProgress("a", Progress(0.5)))
        redraw(terminal)
        after = screen.getvalue().partition("something\n")[2]
        assert "50 %" in plain_text(after), "and they come back"
        terminal.close()
        terminal.close()
        assert screen.getvalue().count("\x1b[?25h") == 2


def test_a_set_says_what_is_done_has_failed_and_is_left(clock: Clock) -> None:
    with standard_error(io.StringIO()):
        terminal, lines = begun("edges", items=4)
        terminal(dataclasses.replace(done("edges", "cached", 0.0), item="a"))
        terminal(ItemReport("a", 1, 4, None))
        for item in ("c", "b"):  # at the same time
            terminal(StepStarted(f"{item}/edges"))
        clock.now += 30
        for item, number in (("c", 2), ("b", 3)):
            terminal(dataclasses.replace(done("edges", "ran", 30.0), item=item))
            terminal(ItemReport(item, number, 4, "too dark" if item == "c" else None))
        terminal(ItemReport("d", 4, 4, None))  # of which all steps gather
        assert [line for line in shown(lines) if line.startswith("item")] == [
            "item 1/4 a: 1 cached",
            "item 2/4 c: failed: too dark (1 failed, 1:00 left)",
            "item 3/4 b: 1 ran (1 failed, 0:15 left)",
            "item 4/4 d: no steps of its own",
        ]


def test_a_live_line_for_the_set_and_one_for_what_each_worker_does(clock: Clock) -> None:
    with standard_error(Screen()) as screen:
        terminal, _ = begun("edges", "scores", items=200)
        terminal(StepStarted("a/edges"))
        terminal(StepStarted("b/scores"))
        terminal(StepProgress("b/scores", Progress(0.25)))
        redraw(terminal)
        written = plain_text(screen.getvalue())
        assert "0 of 200" in written
        assert re.search(r"\[1/2\] a/edges +━+ 0:00", written)
        assert re.search(r"\[2/2\] b/scores +[━╸╺]+ 0:00 25 %", written)
        terminal.close()


def test_many_workers_do_not_fill_the_screen(clock: Clock) -> None:
    with standard_error(Screen()) as screen:
        terminal, _ = begun("edges", items=200)
        for item in range(40):
            terminal(StepStarted(f"{item}/edges"))
        redraw(terminal)
        written = plain_text(screen.getvalue())
        assert "and 28 more steps" in written
        assert "39/edges" not in written
        terminal.close()


def test_colours_are_for_terminals_that_want_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    for lines, has_color in ((Screen(), True), (io.StringIO(), False)):
        Terminal(lines)(done("edges", "failed", 0.5))
        assert ("\x1b[31m" in lines.getvalue()) == has_color
    monkeypatch.setenv("NO_COLOR", "1")
    Terminal(lines := Screen())(done("edges", "failed", 0.5))
    assert "\x1b" not in lines.getvalue()
