"""The benchmark of other programs."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from benchmarks.other_tools import Made, filled, lines, measured, read_tools
from texloom.stages.vocabulary.declare import InputError

SIZE = (48, 40)
COPY = "import shutil, sys; sys.exit(shutil.copy(sys.argv[1], sys.argv[2]) == 0)"


@pytest.fixture
def exemplar(tmp_path: Path) -> Path:
    path = tmp_path / "a b.png"
    PIL.Image.fromarray(np.random.default_rng(1).integers(0, 256, (*SIZE, 3), np.uint8)).save(path)
    return path


def tools(folder: Path, text: str) -> dict[str, list[str]]:
    (folder / "tools.yaml").write_text(text)
    return read_tools(folder / "tools.yaml")


def test_commands_are_filled_in(tmp_path: Path) -> None:
    words = tools(tmp_path, "one: make '{exemplar}' -o {out} --size={width}x{height} -s {seed} {other}")["one"]
    assert filled(words, Path("a b.png"), Path("c.png"), SIZE, 3) == [
        *("make", "a b.png", "-o", "c.png", "--size=40x48", "-s", "3", "{other}")
    ]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("- one", "must map names of tools to their commands"),
        ("one: make {exemplar}", r"one: the command must have \{exemplar\} and \{out\}"),
    ],
)
def test_wrong_files(tmp_path: Path, text: str, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        tools(tmp_path, text)


def test_a_picture_is_scored_and_timed(exemplar: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-c", COPY, "{exemplar}", "{out}"]
    made = measured(
        lambda one, out: filled(command, one, out, SIZE, 0), exemplar, tmp_path / "o" / "a.png", SIZE, 60
    )
    assert made.problem == ""
    assert made.wall > 0 < made.cpu
    assert made.scores["fidelity"] == 1.0
    small = measured(
        lambda one, out: filled(command, one, out, SIZE, 0), exemplar, tmp_path / "o" / "a.png", (99, 99), 60
    )
    assert "the result must have at least 99 x 99 px" in small.problem


@pytest.mark.parametrize(
    ("command", "problem"),
    [
        (["no-such-program"], "no-such-program: No such file or directory"),
        ([sys.executable, "-c", "raise SystemExit('out of paint')"], "exit code 1: out of paint"),
        ([sys.executable, "-c", "pass"], "result"),
        ([sys.executable, "-c", "import time; time.sleep(9)"], "took more than 0.5 s"),
    ],
)
def test_tools_that_fail(exemplar: Path, tmp_path: Path, command: list[str], problem: str) -> None:
    made = measured(
        lambda *_: command, exemplar, tmp_path / "none.png", SIZE, 0.5 if "sleep" in command[-1] else 60
    )
    assert problem in made.problem
    assert made.scores == {}


def test_means_are_over_the_exemplars_that_all_working_tools_made() -> None:
    good, poor = (
        Made(1.0, 2.0, {"fidelity": 0.75, "variety": None}),
        Made(3.0, 6.0, {"fidelity": 0.25, "variety": 1}),
    )
    failed = Made(9.0, 9.0, {}, "it crashed")
    head, first, second, never = lines({"one": [good, poor], "two": [poor, failed], "broken": [failed, failed]})
    assert head.split() == ["pictures", "s", "CPU", "s", "fidelity", "variety"]
    assert first.split() == ["one", "2", "of", "2", "1.00", "2.00", "0.750", "-"]
    assert second.split() == ["two", "1", "of", "2", "3.00", "6.00", "0.250", "1.000"]
    assert never.split() == ["broken", "0", "of", "2"]
