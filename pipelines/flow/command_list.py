"""Command lines for a farm: one for each item of a set, and one that gathers."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Sequence
from pathlib import Path

from texloom.pipelines.errors import refused
from texloom.pipelines.flow.command import option_words, param_words
from texloom.pipelines.flow.items import Item
from texloom.pipelines.flow.model import Flow
from texloom.pipelines.flow.shipped import flow_word
from texloom.pipelines.flow.source_choice import absolute
from texloom.pipelines.flow.step_params import file_params


@dataclasses.dataclass(frozen=True)
class CommandList:
    """What a farm has to run. Each command may be repeated: what is finished is not computed again."""

    items: dict[str, list[str]]
    """item to command, in any order and at the same time; one called as the flow where there is no set"""
    gather: list[str] | None
    """the command that comes after all of them, where steps gather"""

    def lines(self, only: str | None = None) -> list[str]:
        """The commands quoted for POSIX shells; ``only`` is ``items``, ``gather`` or nothing.

        Raises
        ------
        InputError : a file's name has a line break.
        """
        words = [] if only == "gather" else list(self.items.values())
        if self.gather is not None and only != "items":
            words.append(self.gather)
        lines = [shlex.join(one) for one in words]
        if broken := next((line for line in lines if len(line.splitlines()) > 1), None):
            raise refused(f"a command cannot be one line, as a name in it has a line break: {broken}")
        return lines


def command_list(
    flow: Flow, items: Sequence[Item], store: Path, out: Path, force: bool, remote: str = ""
) -> CommandList:
    """The commands that make what ``texloom run`` would; all paths in them are absolute."""
    whole = [*_run(flow), "--store", str(store.absolute()), "--out", str(out.absolute()), *["--force"] * force]
    whole += ["--remote", remote] if remote else []
    if not items:
        return CommandList({flow.name: whole}, None)
    gathers = any(step.scope == "final" for step in flow.steps.values())
    return CommandList({item.name: [*whole, "--item", item.name] for item in items}, whole if gathers else None)


def _run(flow: Flow) -> list[str]:
    overrides = flow.overrides
    here = Path.cwd()
    words = ["texloom", "run", flow_word(flow.path.absolute())]
    words += [absolute(picture, here) for picture in overrides.pictures]
    for name, given in overrides.sources.items():
        words += ["--source", f"{name}={absolute(given if isinstance(given, str) else given[0], here)}"]
    for name, text in overrides.texts.items():
        words += param_words(name, _located(flow, name, text))
    words += [word for file, taken in overrides.exports.items() for word in ("--export", f"{file}={taken}")]
    words += option_words({**overrides.part, **overrides.delivery})
    words += [] if overrides.keep is None else ["--keep", overrides.keep]
    if overrides.seed is not None or overrides.seeds is not None:
        first, last = flow.seeds[0], flow.seeds[-1]
        words += ["--seed", str(first)] if first == last else ["--seeds", f"{first}-{last}"]
    return words


def _located(flow: Flow, name: str, text: str) -> str:
    """The value of a param; a file's path is absolute."""
    step, _, param = flow.params.get(name, (name,))[0].partition(".")
    if step in flow.steps and param in file_params(type(flow.steps[step].params)):
        return str(getattr(flow.steps[step].params, param))
    return text


def only_item(flow: Flow, name: str) -> Flow:
    """The flow for one item of its set, without the steps that gather."""
    steps = {step.name: step for step in flow.steps.values() if step.scope != "final"}
    exports = {file: taken for file, taken in flow.exports.items() if taken.output is None or taken.name in steps}
    own = frozenset(one for one in flow.intermediate if flow.steps[one].scope == "item")  # others take the rest
    return dataclasses.replace(flow, steps=steps, exports=exports, item=name, intermediate=own)
