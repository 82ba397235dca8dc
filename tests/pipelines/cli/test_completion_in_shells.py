"""Completion as it is typed: a word, Tab, in an interactive shell."""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.pipelines.cli.test_main import texloom

pty = pytest.importorskip("pty", reason="there are no pseudo-terminals")

READY = "ready> "
SETTINGS = {
    "bash": (".bashrc", f"PS1='{READY}'; eval \"$(texloom completion bash)\""),
    "zsh": (".zshrc", f"PS1='{READY}'; eval \"$(texloom completion zsh)\""),
    "fish": (".config/fish/config.fish", f"function fish_prompt; printf '{READY}'; end; set -g fish_greeting"),
}
TYPED = {
    "run quil\tmi\t--tilea\t": "run quilting mine.png --tileable",
    "run self_tuning --set texture.tilea\tbo\t": "run self_tuning --set texture.tileable=both",
    "run fill --source pict\ttexl\tbri\t": "run fill --source picture=texloom:bricks",
    "run fill --source picture=mi\t": "run fill --source picture=mine.png",
}
ANSWERS = {b"\x1b[c": b"\x1b[?62c", b"\x1b[0c": b"\x1b[?62c", b"\x1b[6n": b"\x1b[1;1R"}
"""what a terminal says of itself when asked"""
WAIT = 60  # s


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A user's folder with a picture and a texloom that writes down its arguments, but for completion."""
    program = tmp_path / "bin" / "texloom"
    program.parent.mkdir()
    program.write_text(
        "#!/bin/sh\n"
        f'[ -n "$_TEXLOOM_COMPLETE" ] || [ "$1" = completion ] && exec {sys.executable} -m texloom "$@"\n'
        f"echo \"$*\" > '{tmp_path}/new'; mv '{tmp_path}/new' '{tmp_path}/typed'\n"
    )
    program.chmod(0o755)
    (tmp_path / "mine.png").touch()
    functions = tmp_path / ".config" / "fish" / "completions"
    functions.mkdir(parents=True)
    (functions / "texloom.fish").write_text(texloom("completion", "fish").out)
    return tmp_path


@contextlib.contextmanager
def terminal(shell: str, home: Path) -> Iterator[int]:
    """An interactive shell's terminal."""
    name, settings = SETTINGS[shell]
    (home / name).write_text(settings + "\n")
    environment = {
        "HOME": str(home), "PATH": f"{home / 'bin'}:{os.environ['PATH']}", "TERM": "xterm", "LANG": "C.UTF-8",
        "NUMBA_CACHE_DIR": str(home / "kernels"),
    }  # fmt: skip
    process, handle = pty.fork()
    if process == 0:
        os.chdir(home)
        os.execvpe(shell, [shell, "-i"], environment)
    try:
        yield handle
    finally:
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
        os.close(handle)


def shown(handle: int, seconds: float) -> bytes:
    """What the shell shows next."""
    if not select.select([handle], [], [], seconds)[0]:
        return b""
    found = os.read(handle, 65536)
    for question, answer in ANSWERS.items():
        if question in found:
            os.write(handle, answer)
    return found


@pytest.mark.parametrize("shell", SETTINGS)
def test_tab_completes_words_in_a_shell(shell: str, home: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"there is no {shell}")
    typed = home / "typed"
    with terminal(shell, home) as handle:
        seen, until = b"", time.monotonic() + WAIT
        while READY.encode() not in seen and time.monotonic() < until:
            seen += shown(handle, 0.1)
        for keys, expected in TYPED.items():
            typed.unlink(missing_ok=True)
            os.write(handle, f"texloom {keys}\r".encode())
            until = time.monotonic() + WAIT
            while not typed.exists() and time.monotonic() < until:
                seen += shown(handle, 0.05)
            assert typed.exists(), seen[-2000:]
            assert typed.read_text().strip() == expected
