"""The command line as CONTRIBUTING.md states it."""

from __future__ import annotations

import re

import click
import pytest

from tests.conftest import ROOT
from texloom.pipelines.cli.exits import Exit
from texloom.pipelines.cli.main import texloom

_TEXT = (ROOT / "CONTRIBUTING.md").read_text()
_BLOCK = re.search(r"## The command line\n.*?```text\n(.*?)```", _TEXT, re.DOTALL)
assert _BLOCK is not None
STATED = {
    re.match(r"texloom ((?:store )?[a-z-]+)", line)[1]: line  # type: ignore[index]
    for line in re.sub(r"\n +", " ", _BLOCK[1]).splitlines()
}


def commands() -> dict[str, click.Command]:
    found = {}
    for name, command in texloom.commands.items():
        inner = command.commands if isinstance(command, click.Group) else {"": command}
        found |= {f"{name} {one}".strip(): leaf for one, leaf in inner.items()}
    return found


def options_of(line: str) -> set[str]:
    """The options that a line states, and its metavars with them where they have some."""
    found = set(re.findall(r"(?<![\w-])--[a-z-]+(?:\|-\w)?", re.sub(r"\[options of run[^\]]*\]", "", line)))
    more = re.search(r"\[options of run( but ([^\]]*))?\]", line)
    return found | (options_of(STATED["run"]) - set((more[2] or "").split()) if more else set())


def test_all_commands_are_stated() -> None:
    assert STATED.keys() == commands().keys()


@pytest.mark.parametrize("name", commands())
def test_options_are_those_of_the_command(name: str) -> None:
    params = commands()[name].params
    options = {"|".join(sorted(one.opts, key=len, reverse=True)) for one in params if isinstance(one, click.Option)}
    assert options_of(STATED[name]) == options


@pytest.mark.parametrize("name", commands())
def test_arguments_are_those_of_the_command(name: str) -> None:
    words = STATED[name].removeprefix(f"texloom {name}").split("--")[0].split("[options")[0]
    stated = re.findall(r"[A-Z]+(?:\.\.\.)?", words)
    arguments = [one for one in commands()[name].params if isinstance(one, click.Argument)]
    assert [word.endswith("...") for word in stated] == [one.nargs == -1 for one in arguments]
    for word, one in zip(stated, arguments, strict=True):
        assert word.rstrip(".").lower().rstrip("s") == str(one.name).rstrip("s")


@pytest.mark.parametrize("option", ["size", "tileable", "seeds", "out", "udim", "source", "set", "export"])
def test_values_are_as_stated(option: str) -> None:
    (found,) = (one for one in texloom.commands["run"].params if f"--{option}" in one.opts)
    assert re.search(rf"\[--{option}(\|-o)? ?{re.escape(str(found.metavar))}\]", STATED["run"])


def test_exit_codes_are_stated() -> None:
    stated = _TEXT[_TEXT.index("Exit codes:") :].split("\n\n")[0]
    assert set(map(int, re.findall(r"\b\d+\b", stated))) == {int(code) for code in Exit}
