"""Every command that a page prints is read by a shell as meant and accepted by texloom."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import ROOT
from tests.docs.files import make_files
from tests.docs.pages import PAGES, blocks, commands, label, shell_lines
from tests.docs.run_commands import PROGRAMS, SHELLS, session
from texloom.pipelines.cli import main as cli
from texloom.pipelines.engine import preflight, scheduler
from texloom.pipelines.media import voted_results
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio import launch

QUICK = {
    "README.md": ["texloom run fill"],
    "docs/getting_started.md": ["texloom plan", "texloom doctor", "texloom completion"],
    "docs/tutorials/pipelines.md": ["texloom plan", "texloom store"],
    "docs/tutorials/researchers.md": ["texloom run score", "texloom show"],
    "docs/gallery.md": ["texloom run patch_based", "texloom run contour_report"],
}
"""the beginnings of commands that a second or two suffices for, by page"""
UNSAFE = re.compile(r"[\[\]{}?*]|(?<![\w.\-/])[=~]")
"""what zsh expands, outside of quotes"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder of a user, without results."""
    for name in ("PREFECT_API_URL", "TEXLOOM_STORE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    Store(tmp_path / "artifacts").create()
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
    monkeypatch.setattr(preflight, "free_space", lambda _: 10**12)
    monkeypatch.setattr(launch, "launch", lambda *_, **__: None)
    monkeypatch.setattr(voted_results, "find", lambda *_: ("", "0" * 64))
    for arguments in read_by(SHELLS[shell], commands(page), folder):
        local = [argument.replace("/data/", f"{folder}/data/") for argument in arguments]
        make_files(local, folder)
        code, said = texloom(local)
        assert code == 0, f"texloom {' '.join(arguments)}\n{said}"


@pytest.mark.parametrize(
    ("page", "start"), [(page, start) for page, starts in QUICK.items() for start in starts], ids=str
)
def test_quick_commands_run_to_their_end(page: str, start: str, tmp_path: Path) -> None:
    lines = [line for line in shell_lines(ROOT / page) if line.startswith(start)]
    assert lines
    with session(tmp_path, "bash") as opened:
        for line in lines:
            opened.run(line)


@pytest.mark.parametrize("page", PAGES, ids=label)
def test_a_block_names_its_language_and_commands_their_program(page: Path) -> None:
    assert all(block.language for block in blocks(page))
    programs = [shlex.split(line, comments=True)[0] for line in shell_lines(page)]
    assert {Path(program).name for program in programs} <= PROGRAMS


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
