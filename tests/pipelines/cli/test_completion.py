"""What shells complete."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.shell_completion import CompletionItem, get_completion_class

from tests.pipelines.cli.test_main import texloom
from texloom.pipelines.cli import completion
from texloom.pipelines.cli import main as cli

COMPLETED = {
    "": {"run", "plan", "doctor", "completion"},
    "run self": {"self_tuning", "self_tuning_report"},
    "plan quil": {"quilting"},
    "run self_tuning texloom:bri": {"texloom:bricks"},
    "run self_tuning --set ": {"size=", "tileable=", "texture.occurrence=", "edges.detector="},
    "run self_tuning --set start.s": {"start.size="},
    "run self_tuning --set texture.preset=": {f"texture.preset={one}" for one in ("kaspar2015", "default", "fast")},
    "run self_tuning --set texture.tileable=": {f"texture.tileable={name}" for name in ("off", "x", "y", "both")},
    "run self_tuning --preset f": {"fast"},
    "run fill --source ": {"picture=", "holes="},
    "run fill --source picture=texloom:bri": {"picture=texloom:bricks"},
    "run self_tuning --export a.exr=edges.": {"a.exr=edges.strength"},
    "run self_tuning --runner d": {"dask"},
    "stages opt": {"optimise"},
    "stages analysis.ot": {"analysis.otsu"},
    "flows grap": {"graph_cut"},
    "compare quilting hyb": {"hybrid"},
    "compare self_tuning quilting --set si": {"size="},
    "run nowhere --set ": set(),
}


def items(line: str, shell: str) -> list[CompletionItem[str]]:
    completion.register()
    found = get_completion_class(shell)
    assert found is not None
    *words, typed = line.split(" ")
    return found(cli.texloom, {}, "texloom", "_TEXLOOM_COMPLETE").get_completions(words, typed)


def completed(line: str, shell: str) -> set[str]:
    return {item.value for item in items(line, shell) if item.type == "plain"}


@pytest.mark.parametrize(("line", "expected"), COMPLETED.items(), ids=map(repr, COMPLETED))
def test_completed_words(line: str, expected: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for shell in ("bash", "zsh", "fish"):
        found = completed(line, shell)
        assert expected <= found
        assert found or not expected
    if line.endswith("="):
        assert found == expected


@pytest.mark.parametrize(
    "line",
    [
        "run self_tuning mi",
        "run fill --source picture=mi",
        "run photo_to_texture --set surface.geometry=mi",
        "run self_tuning --set edges.model=mi",
        "compare quilting --over mi",
        "compare quilting --against other=mi",
    ],
)
def test_files_are_left_to_the_shell(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert [(item.type, item.value) for item in items(line, "bash")] == [("file", "mi")]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_scripts(shell: str) -> None:
    result = texloom("completion", shell)
    assert result.code == 0
    assert "_TEXLOOM_COMPLETE" in result.out


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
def test_bash_adds_to_what_follows_a_sign(tmp_path: Path) -> None:
    """Bash parts words at ``=``, so that what is added must not repeat what is before it."""
    (tmp_path / "texloom").write_text(f'#!/bin/sh\nexec {sys.executable} -m texloom "$@"\n')
    (tmp_path / "texloom").chmod(0o755)
    line = "texloom run self_tuning --set texture.preset=f"
    program = (
        f"{texloom('completion', 'bash').out}\n"
        f'COMP_LINE="{line}"; COMP_POINT={len(line)}; _texloom_completion texloom; echo "${{COMPREPLY[@]}}"'
    )
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    done = subprocess.run(["bash", "-c", program], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout == "fast\n"


def test_flows_are_completed_without_heavy_imports() -> None:
    code = (
        "import sys; from texloom.pipelines.cli import completion\n"
        "assert completion.flow_names(None, None, 'self')\n"
        "heavy = {'numpy', 'pydantic', 'numba', 'prefect', 'texloom.pipelines.flow.loader'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
