"""Completion in shells: flows, steps, params, sources and their values."""

from __future__ import annotations

import os
import typing
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import BashComplete, CompletionItem, add_completion_class, get_completion_class
from click.shell_completion import split_arg_string as words_of

if TYPE_CHECKING:
    from texloom.pipelines.flow.model import Flow

_VARIABLE = "_TEXLOOM_COMPLETE"

Items = list[CompletionItem[str]]


def script(shell: str) -> str:
    """What a shell reads to complete texloom's words."""
    register()
    found = get_completion_class(shell)
    if found is None:
        raise click.UsageError(f"no completion for {shell}")
    from texloom.pipelines.cli.main import texloom

    return found(texloom, {}, "texloom", _VARIABLE).source()


class _Bash(BashComplete):
    """Completes words with ``=`` and ``:``, at which bash parts words, and adds no space after ``=``."""

    source_template = """\
%(complete_func)s() {
    local IFS=$'\\n' response item type value
    response=$(env COMP_WORDS="${COMP_LINE:0:COMP_POINT}" %(complete_var)s=bash_complete $1)
    for item in $response; do
        IFS=',' read type value <<< "$item"
        if [[ $type == 'dir' ]]; then
            compopt -o dirnames
        elif [[ $type == 'file' ]]; then
            compopt -o default
        else
            COMPREPLY+=("$value")
            [[ $value == *= ]] && compopt -o nospace
        fi
    done
    return 0
}
complete -o nosort -F %(complete_func)s %(prog_name)s
"""

    def get_completion_args(self) -> tuple[list[str], str]:
        line = os.environ["COMP_WORDS"]
        words = words_of(line)[1:]
        return (words, "") if line[-1:].isspace() or not words else (words[:-1], words[-1])

    def format_completion(self, item: CompletionItem[Any]) -> str:
        _, typed = self.get_completion_args()
        kept = max(typed.rfind(mark) for mark in "=:") + 1  # bash adds to what follows the mark
        return f"{item.type},{item.value[kept:] if item.type == 'plain' else item.value}"


def register() -> None:
    """Let bash complete in this way."""
    add_completion_class(_Bash)


def flow_names(_context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """Flows that ship, and files."""
    from texloom.pipelines.flow.shipped import flow_catalogue

    found = [CompletionItem(name, help=text) for name, text in flow_catalogue().items() if name.startswith(typed)]
    return found or [CompletionItem(typed, type="file")]


def stage_names(_context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """Stages by their short names, or with their groups."""
    from texloom.stages.declare import stage_names

    return _plain([name if "." in typed else name.rpartition(".")[2] for name in stage_names()], typed)


def pictures(_context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """Files, or what ships as texloom:NAME."""
    return _pictures("", typed)


def params(context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """``PARAM=`` of a flow and its steps; after the sign, the values of a choice."""
    flow = _flow(context)
    if flow is None:
        return []
    name, equals, _ = typed.partition("=")
    if equals:
        return _plain([f"{name}={value}" for value in _choices(flow, name)], typed)
    of_steps = [f"{step.name}.{param}" for step in flow.steps.values() for param in type(step.params).model_fields]
    return _plain([f"{param}=" for param in [*flow.params, *of_steps]], typed)


def presets(context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """Values of a flow's preset."""
    flow = _flow(context)
    return [] if flow is None else _plain(_choices(flow, "preset"), typed)


def sources(context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """``NAME=`` of a flow's sources; after the sign, pictures."""
    flow = _flow(context)
    name, equals, path = typed.partition("=")
    if equals:
        return _pictures(f"{name}=", path)
    return [] if flow is None else _plain([f"{name}=" for name in flow.sources], typed)


def exports(context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """After ``NAME.EXT=``, the outputs of a flow's steps."""
    flow = _flow(context)
    name, equals, _ = typed.partition("=")
    if flow is None or not equals:
        return []
    outputs = [f"{name}={step.name}.{output}" for step in flow.steps.values() for output in step.stage.outputs]
    return _plain(outputs, typed)


def runners(_context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """The runners."""
    from texloom.pipelines.flow.model import RUNNERS

    return [CompletionItem(name, help=text) for name, text in RUNNERS.items() if name.startswith(typed)]


def _plain(values: Iterable[str], typed: str) -> Items:
    return [CompletionItem(value) for value in values if value.startswith(typed)]


def _pictures(before: str, typed: str) -> Items:
    from texloom.pipelines.media.locate import shipped_pictures

    if ":" in typed or (typed and any(name.startswith(typed) for name in shipped_pictures())):
        return _plain([f"{before}{name}" for name in shipped_pictures()], before + typed)
    return [CompletionItem(typed, type="file")]


def _flow(context: click.Context) -> Flow | None:
    """The flow that has been typed, unless it is wrong."""
    from texloom.pipelines.flow.loader import find_flow, load_flow
    from texloom.stages.declare import InputError

    # click leaves the arguments unread where an option before them still lacks its value
    name = context.params.get("flow") or next((word for word in context.args if not word.startswith("-")), None)
    try:
        return load_flow(find_flow(name)) if name else None
    except InputError:
        return None


def _choices(flow: Flow, name: str) -> list[str]:
    """The values of a param of few."""
    step, _, param = flow.params.get(name, (name,))[0].partition(".")
    if step not in flow.steps or param not in type(flow.steps[step].params).model_fields:
        return []
    kind = type(flow.steps[step].params).model_fields[param].annotation
    kinds = [kind, *typing.get_args(kind)]
    if bool in kinds:
        return ["true", "false"]
    return [
        str(value) for one in kinds if typing.get_origin(one) is typing.Literal for value in typing.get_args(one)
    ]
