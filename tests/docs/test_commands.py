"""Every command that a page prints is read by a shell as meant and accepted by texloom."""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.docs.pages import PAGES, commands, label
from texloom.pipelines.cli import main as cli
from texloom.pipelines.engine import scheduler

GEOMETRY = """
patches:
  - {name: wall, corners: [[4, 4], [4, 60], [60, 60], [60, 4]], edge: 6}
hole: [[[20, 20], [20, 40], [40, 40]]]
"""
FLAGS = ("--tileable", "--json")
"""options without a value"""
WRITTEN = ("--out", "--report", "--store", "--png")
"""options that name what is written"""
SHELLS = {"bash": ["bash", "-eu"], "zsh": ["zsh", "-feu"]}
UNSAFE = re.compile(r"[\[\]{}?*]|(?<![\w.\-/])[=~]")
"""what zsh expands, outside of quotes"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder of a user, without results."""
    for name in ("PREFECT_API_URL", "TEXLOOM_STORE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "artifacts" / "cache").mkdir(parents=True)
    return tmp_path


@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=label)
def test_printed_commands_are_accepted(
    page: Path, shell: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if shutil.which(shell) is None:
        unquoted = [command for command in commands(page) if UNSAFE.search(without_quoted(command))]
        assert not [command for command in unquoted if not command.startswith("texloom show")]
        return
    monkeypatch.setattr(scheduler, "execute", planned)
    for arguments in read_by(SHELLS[shell], commands(page), folder):
        local = [argument.replace("/data/", f"{folder}/data/") for argument in arguments]
        make_files(local)
        code, said = texloom(local)
        assert code == 0, f"texloom {' '.join(arguments)}\n{said}"


def test_the_page_of_a_run_that_is_refused_would_fail(folder: Path) -> None:
    for wrong in ("run self_tuning --sise 512", "run no_such_flow", "run self_tuning --set texture.ocurrence=3"):
        code, _ = texloom(wrong.split())
        assert code == 2


def planned(opened: Any, *_: object) -> Mapping[str, Path]:
    """Instead of running: the plan, which checks sources and params."""
    opened.plan()
    return {}


def texloom(arguments: Sequence[str]) -> tuple[int, str]:
    """Run the command in this process; exit code and output."""
    said = io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patched,
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(said),
    ):
        patched.setattr("sys.argv", ["texloom", *arguments])
        with pytest.raises(SystemExit) as stopped:
            cli.main()
    return int(stopped.value.code or 0), said.getvalue()


def read_by(shell: Sequence[str], lines: Sequence[str], folder: Path) -> list[list[str]]:
    """The arguments that a shell hands to texloom, for each line."""
    program, record = folder / "bin" / "texloom", folder / "arguments"
    program.parent.mkdir(exist_ok=True)
    program.write_text(f"#!/bin/sh\nprintf '%s\\0' \"$@\" >> '{record}'\nprintf '\\n\\0' >> '{record}'\n")
    program.chmod(0o755)
    script = "\n".join([f"PATH='{program.parent}':$PATH", *lines])
    subprocess.run([*shell, "-c", script], check=True, cwd=folder)
    calls = record.read_text().split("\n\0")[:-1]
    assert len(calls) == len(lines)
    return [call.split("\0")[:-1] for call in calls]


def without_quoted(command: str) -> str:
    return re.sub(r"'[^']*'|\"[^\"]*\"|\s#.*", "", command)


def make_files(arguments: Sequence[str]) -> None:
    """The files that a command takes: pictures, masks, maps of materials, geometry, results."""
    previous = ""
    for number, argument in enumerate(arguments):
        name = argument.partition("=")[2] if previous in ("--source", "--set", "--against") else argument
        is_picture = (
            number > 1 and not argument.startswith("-") and (not previous.startswith("--") or previous in FLAGS)
        )
        if name.startswith("skimage:") or previous in WRITTEN:
            pass
        elif name.endswith(".yaml"):
            Path(name).write_text(GEOMETRY)
        elif name.endswith(".exr"):
            make_result(Path(name))
        elif previous in ("--over", "--against"):
            make_pictures(name if "*" in name else f"{name}/*.png", 1024 if previous == "--against" else 256)
        elif previous == "--source" or (is_picture and arguments[0] in ("run", "plan")):
            make_pictures(name)
        previous = argument


def make_pictures(name: str, side: int = 256) -> None:
    """A picture, a folder of maps, or two that a pattern matches; square, of ``side`` px."""
    for path in [Path(name.replace("*", word)) for word in (("one", "two") if "*" in name else ("",))]:
        if path.exists():
            continue
        files = [path] if path.suffix else [path / f"{kind}.png" for kind in ("albedo", "height")]
        for file in files:
            file.parent.mkdir(parents=True, exist_ok=True)
            grey = np.random.default_rng(7).integers(0, 256, (side, side), np.uint8)
            Image.fromarray(grey).save(file)


def make_result(path: Path) -> None:
    """An EXR as texloom writes it."""
    from texloom.pipelines.store import codec
    from texloom.stages.arrays import Image as Pixels

    path = Path(str(path).replace("*", "any"))
    path.parent.mkdir(parents=True, exist_ok=True)
    codec.export(Pixels(np.zeros((8, 8, 1), np.float32), ("Y",)), Pixels, path, {})
